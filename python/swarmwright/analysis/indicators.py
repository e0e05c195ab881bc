"""Quality indicators of fronts and archives, to compare runs of `nsga2`, `map_elites` and `novelty`."""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from swarmwright.common.arguments import mapping, number
from swarmwright.common.errors import InputError
from swarmwright.common.problems import format_value
from swarmwright.methods._pareto import ParetoOptions
from swarmwright.methods.archive import Grid, Values, ranks
from swarmwright.methods.map_elites import MapElitesOptions
from swarmwright.runs.elites import (
    Elites,
    compute_elites,
    compute_elites_over_generations,
    options_of_elites,
)
from swarmwright.runs.run import Run


def hypervolume(values: Values, reference: Values) -> float:
    """Return the exact volume that is dominated by at least one row and dominates the reference point.

    Rows that are not better than the reference point in every column add nothing (as in pymoo). The time
    grows quickly with the number of columns.

    Args:
        values: (n, columns), with at least two columns; more is better in each.
        reference: (columns,), a value of each column that is worse than all values of interest.

    Source: While, Bradstreet and Barone, "A fast way of calculating exact hypervolumes", IEEE Transactions on
    Evolutionary Computation 16(1), 2012.
    """
    gains = values - reference
    return _volume(gains[np.logical_and.reduce(gains > 0, axis=1)])


def _volume(gains: Values) -> float:
    """Return the volume of the union of boxes from the origin to each row."""
    if gains.shape[1] == 2:
        return _area(gains)
    unique = np.unique(gains, axis=0)
    gains = unique[ranks(unique, last=0) == 0]
    gains = gains[np.argsort(gains[:, -1], kind="stable")]
    total = 0.0
    for index, row in enumerate(gains[:, :-1]):
        # The intersection with later boxes, which reach farther in the last column, has the row's extent
        # there, so one column fewer remains.
        shared = _volume(np.minimum(gains[index + 1 :, :-1], row))
        total += float(gains[index, -1]) * max(0.0, float(np.prod(row)) - shared)
    return total


def _area(gains: Values) -> float:
    """Return the area of the union of rectangles, (n, 2)."""
    ordered = gains[np.argsort(-gains[:, 0], kind="stable")]
    heights = np.maximum.accumulate(ordered[:, 1])
    widths = ordered[:, 0] - np.append(ordered[1:, 0], 0.0)
    return float(heights @ widths)


By = Literal["fitness", "hypervolume", "qd_score", "coverage"]
"""The compared quantity of runs."""
WORDS: Mapping[By, str] = {
    "fitness": "fitness",
    "hypervolume": "hypervolume",
    "qd_score": "QD score",
    "coverage": "coverage",
}
_REFERENCE_MARGIN = 0.1
"""Share of an objective's range by which the reference point is worse than all compared values."""
_POINTS = 40
"""Largest number of generations in a curve."""
_QUICK_FRONT_SIZES = {2: math.inf, 3: 1000, 4: 300}
"""Largest front size for which the hypervolume takes about 0.1 s, by the number of objectives, including
fitness; not computed for more objectives."""


@dataclass(frozen=True)
class Indicator:
    """A compared quantity of runs, and its constants."""

    by: By = "fitness"
    offset: float | None = None
    """Value that the QD score subtracts from the fitness of each elite; None for other indicators."""
    reference: dict[str, float] | None = None
    """Reference point of the hypervolume, in the units of the objectives; None for other indicators."""
    ranges: dict[str, tuple[float, float]] | None = None
    """Worst and best value of each objective in the compared fronts, which are scaled to 0 and 1; None if
    objectives are not scaled."""
    largest: int = 0
    """Number of candidates of the largest compared front; 0 for other indicators."""
    is_explicit: bool = False
    """Whether the offset or the reference point was given."""
    notes: tuple[str, ...] = ()
    """Caveats, a sentence each."""

    @property
    def words(self) -> str:
        """Name of the indicator in texts."""
        return WORDS[self.by]

    @property
    def has_curve(self) -> bool:
        """Whether it is an indicator of fronts or archives that is quickly computed for many generations."""
        if self.reference is None:
            return self.by != "fitness"
        return self.largest <= _QUICK_FRONT_SIZES.get(len(self.reference), 0)

    @property
    def options(self) -> str:
        """Command-line options that select it; empty for fitness."""
        if self.by == "fitness":
            return ""
        options = [f"--by {self.by}"]
        if self.is_explicit and self.offset is not None:
            options.append(f"--offset {self.offset:.15g}")
        if self.is_explicit and self.reference is not None:
            options += [
                f"--reference {shlex.quote(f'{name}={value:.15g}')}" for name, value in self.reference.items()
            ]
        return " ".join(options)

    def value(self, elites: Elites) -> float:
        """Return its value for a front or an archive."""
        if self.by == "hypervolume":
            return _hypervolume(self, elites)
        value = elites.coverage if self.by == "coverage" else elites.qd_score(self.offset or 0.0)
        return value or 0.0

    def curve(self, run: Run) -> dict[int, float]:
        """Return its values at the end of some generations, by generation.

        run: one of the runs that were given to `measure`.
        """
        chosen = np.linspace(0, run.generations - 1, _POINTS).round().astype(int)
        return {
            generation: self.value(elites)
            for generation, elites in compute_elites_over_generations(run, frozenset(chosen.tolist()))
        }

    @property
    def heading(self) -> str:
        """Description of what is compared; empty for fitness."""
        if self.by == "coverage":
            return "Coverage of each run's archive: the share of its cells that have an elite."
        if self.by == "qd_score":
            assert self.offset is not None
            why = (
                ""
                if self.is_explicit or not self.offset
                else ", the lowest fitness of an elite of these runs"
            )
            return (
                "QD score of each run's archive: the sum over its elites of fitness minus an offset of "
                f"{self.offset:.6g}{why}."
            )
        if self.by == "hypervolume":
            assert self.reference is not None
            point = ", ".join(f"{name} {value:.6g}" for name, value in self.reference.items())
            if self.ranges is None:
                return (
                    "Hypervolume of each run's front, in the units of its objectives; reference point: "
                    f"{point}."
                )
            scales = ", ".join(
                f"{name} {worst:.6g} to {best:.6g}" for name, (worst, best) in self.ranges.items()
            )
            return (
                "Hypervolume of each run's front; each objective is scaled from 0 to 1 between its worst and "
                f"its best value in the fronts of these runs: {scales}; reference point: {point} "
                f"(-{_REFERENCE_MARGIN:g} in each, scaled)."
            )
        return ""

    def to_mapping(self) -> dict[str, Any]:
        """Return the indicator as plain values, for JSON."""
        return {
            "by": self.by,
            "offset": self.offset,
            "reference": self.reference,
            "ranges": None
            if self.ranges is None
            else {name: list(limits) for name, limits in self.ranges.items()},
        }


FITNESS = Indicator()


def find_shared_indicators(runs: Sequence[Run]) -> tuple[By, ...]:
    """Return the indicators by which all of these runs can be compared."""
    if not runs:
        return ()
    methods = [options_of_elites(run) for run in runs]
    fronts = [method for method in methods if isinstance(method, ParetoOptions)]
    archives = [method for method in methods if isinstance(method, MapElitesOptions)]
    if len(fronts) == len(methods) and all(front.objectives == fronts[0].objectives for front in fronts):
        return ("hypervolume",)
    if len(archives) == len(methods) and all(
        _division(archive) == _division(archives[0]) for archive in archives
    ):
        return ("qd_score",) if archives[0].cells is None else ("qd_score", "coverage")
    return ()


def find_quick_indicators(runs: Sequence[Run]) -> tuple[By, ...]:
    """Return those of `find_shared_indicators` that are computed quickly, and therefore by default."""
    shared = find_shared_indicators(runs)
    if "hypervolume" not in shared:
        return shared
    most = _QUICK_FRONT_SIZES.get(1 + len(runs[0].experiment.method.needed_metrics), 0)
    return shared if most and all(len(run.elites.candidates) <= most for run in runs) else ()


def measure(
    by: By,
    runs: Sequence[Run],
    at: int | None = None,
    *,
    reference: Mapping[str, float] | None = None,
    offset: float | None = None,
) -> tuple[Indicator, list[float]]:
    """Return an indicator and its value for each run.

    Args:
        by: an indicator of fronts or archives.
        runs: at least one run.
        at: use the elites of the first `at` evaluations; None: of all.
        reference: reference point of the hypervolume. Default: derived from all fronts.
        offset: offset of the QD score. Default: 0, or the lowest fitness of all elites if that is lower.

    Raises:
        InputError: a run has no such indicator, the runs have different objectives or cells, or the reference
            point is wrong.
    """
    (_check_objectives if by == "hypervolume" else _check_cells)(by, runs)
    point = None if reference is None else _reference(reference, runs[0])
    requested_offset = None if offset is None else number("offset", offset)
    elites = [run.elites if at is None or at >= run.evaluations else compute_elites(run, at) for run in runs]
    indicator = Indicator(by)
    if by == "hypervolume":
        indicator = _build_front_indicator(elites, point)
    if by == "qd_score":
        indicator = _build_archive_indicator(elites, requested_offset)
    return indicator, [indicator.value(elite) for elite in elites]


def build_indicator(elites: Elites) -> Indicator:
    """Return the indicator to compare a front or an archive with its earlier states.

    It is the hypervolume or the QD score, the same that `measure` uses for a single run with these elites.
    """
    return (
        _build_front_indicator([elites], None)
        if elites.kind == "front"
        else _build_archive_indicator([elites], None)
    )


def _check_objectives(by: By, runs: Sequence[Run]) -> None:
    first = _options(by, runs[0], ParetoOptions, "nsga2 or nsga3, which have a front")
    for run in runs[1:]:
        options = _options(by, run, ParetoOptions, "nsga2 or nsga3, which have a front")
        if options.objectives != first.objectives:
            raise InputError(
                f"{runs[0].path} and {run.path} have different objectives, and so no {WORDS[by]} that can be "
                f"compared: {_objectives(first)}; {_objectives(options)}. Name runs with the same objectives"
            )


def _check_cells(by: By, runs: Sequence[Run]) -> None:
    words = "map_elites and novelty, which have an archive"
    first = _options(by, runs[0], MapElitesOptions, words)
    for run in runs:
        options = _options(by, run, MapElitesOptions, words)
        if by == "coverage" and options.cells is None:
            raise InputError(
                f"{run.path}: an unstructured archive has no cells, and so no coverage; compare by qd_score"
            )
        if _division(options) != _division(first):
            raise InputError(
                f"{runs[0].path} and {run.path} have archives of different cells, and so no {WORDS[by]} that "
                f"can be compared: {_cells(first)}; {_cells(options)}. Name runs with the same measures, "
                "ranges and bins, and the same archive"
            )


def _options(by: By, run: Run, kind: type[Any], methods: str) -> Any:  # noqa: ANN401 - of the kind
    options = options_of_elites(run)
    if not isinstance(options, kind):
        raise InputError(
            f"{run.path}: was made by {options.kind}, and has no {WORDS[by]}; only runs of {methods}, can be "
            "compared by it. Leave the others out, or compare by fitness"
        )
    return options


def _objectives(options: ParetoOptions) -> str:
    goals = [f"{name} ({goal})" for name, goal in sorted(options.objectives.items())]
    return ", ".join(["fitness (maximize)", *goals])


def _division(options: MapElitesOptions) -> object:
    """Return what decides which elites an archive can have."""
    return dict(zip(options.needed_metrics, options.axes, strict=False)), options.archive


def _cells(options: MapElitesOptions) -> str:
    measures = zip(options.needed_metrics, options.axes, strict=False)
    if isinstance(options.cells, Grid):
        return ", ".join(
            f"{name} {axis.low:g} to {axis.high:g} in {axis.bins} bins" for name, axis in sorted(measures)
        )
    ranges = ", ".join(f"{name} {axis.low:g} to {axis.high:g}" for name, axis in sorted(measures))
    archive = ", ".join(f"{key}: {value}" for key, value in options.archive.model_dump().items())
    return f"{ranges}, archive {{{archive}}}"


def _reference(values: Mapping[str, float], run: Run) -> dict[str, float]:
    names = ["fitness", *run.experiment.method.needed_metrics]
    example = f"a value of each objective: {', '.join(names)}"
    reference = mapping("reference", values, example)
    wrong = [name for name in reference if name not in names]
    if wrong:
        raise InputError(
            f"reference: {format_value(wrong[0])} is not an objective of {run.path}; the reference point has "
            f"{example}"
        )
    missing = [name for name in names if name not in reference]
    if missing:
        raise InputError(
            f"reference: has no value of {' and '.join(missing)}; the reference point has {example}"
        )
    return {name: float(number(f"reference.{name}", reference[name])) for name in names}


def _build_front_indicator(elites: Sequence[Elites], reference: dict[str, float] | None) -> Indicator:
    names = ["fitness", *elites[0].goals]
    every = np.concatenate([_orient_values(elite, names) for elite in elites])
    signs = _signs(elites[0], names)
    largest = max(len(elite.candidates) for elite in elites)
    if reference is not None:
        point = np.array(list(reference.values())) * signs
        behind = int((~np.logical_and.reduce(every > point, axis=1)).sum())
        note = (
            f"{behind:,} of {len(every):,} candidates of the fronts are not better than the reference point "
            "in every objective, and add nothing"
        )
        notes = (note,) if behind else ()
        return Indicator("hypervolume", reference=reference, largest=largest, is_explicit=True, notes=notes)
    # Fronts without candidates have no range, and any range gives them a hypervolume of 0.
    finite_values = every if len(every) else np.array([[0.0], [1.0]]) * np.ones(len(names))
    worst, best = finite_values.min(axis=0), finite_values.max(axis=0)
    point = (worst - 2 * _REFERENCE_MARGIN * _half_width(worst, best)) * signs + 0.0
    ranges = zip((worst * signs + 0.0).tolist(), (best * signs + 0.0).tolist(), strict=True)
    return Indicator(
        "hypervolume",
        reference=dict(zip(names, point.tolist(), strict=True)),
        ranges=dict(zip(names, ranges, strict=True)),
        largest=largest,
    )


def _hypervolume(indicator: Indicator, elites: Elites) -> float:
    assert indicator.reference is not None
    names = list(indicator.reference)
    front, signs = _orient_values(elites, names), _signs(elites, names)
    if indicator.ranges is None:
        return hypervolume(front, np.array(list(indicator.reference.values())) * signs)
    worst, best = np.array(list(indicator.ranges.values())).T * signs
    scaled = (front / 2 - worst / 2) / _half_width(worst, best)
    return hypervolume(scaled, np.full(len(names), -_REFERENCE_MARGIN))


def _half_width(worst: Values, best: Values) -> Values:
    """Return half of each range, without overflow for huge values; a single value has a range of 1."""
    return np.where(best > worst, best / 2 - worst / 2, 0.5)


def _signs(elites: Elites, names: Sequence[str]) -> Values:
    return np.array([-1.0 if elites.goals.get(name) == "minimize" else 1.0 for name in names])


def _orient_values(elites: Elites, names: Sequence[str]) -> Values:
    """Return fitness and metrics of a front, (candidates, names), with signs such that more is better."""
    rows = [
        [candidate.fitness, *(candidate.metrics[name] for name in names[1:])]
        for candidate in elites.candidates
    ]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(names)) * _signs(elites, names)


def _build_archive_indicator(elites: Sequence[Elites], requested_offset: float | None) -> Indicator:
    lowest = min((candidate.fitness for archive in elites for candidate in archive.candidates), default=0.0)
    offset = min(0.0, lowest) if requested_offset is None else float(requested_offset)
    note = (
        f"the offset is above the lowest fitness of an elite, {lowest:.6g}, so that more elites can have a "
        "lower QD score; give the worst possible fitness"
    )
    notes = (note,) if lowest < offset else ()
    return Indicator("qd_score", offset=offset, is_explicit=requested_offset is not None, notes=notes)
