"""Comparison of two controllers in the same episodes."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis.groups import flatten_experiment
from swarmwright.analysis.significance import LEVEL, SignedRank, compute_signed_rank
from swarmwright.analysis.table import columns, number, write_csv
from swarmwright.common.arguments import check_arguments, path_of
from swarmwright.common.errors import InputError
from swarmwright.common.formatting import format_count, format_p_value
from swarmwright.common.html import render_preformatted
from swarmwright.common.problems import format_value
from swarmwright.common.statistics import Estimate, estimate
from swarmwright.common.untrusted import escape_line
from swarmwright.common.values import ComparedByValue
from swarmwright.controllers.controller import Controller
from swarmwright.experiment.experiment import Experiment, as_experiment
from swarmwright.runs.choice import choose
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.post_evaluation import (
    EPISODES,
    ControllerEvaluation,
    EvaluationOptions,
    evaluate_controllers,
)
from swarmwright.runs.run import Run
from swarmwright.runs.store.database import FILE
from swarmwright.runs.validation import estimate_gain
from swarmwright.servers.evaluation.base import Progress, Servers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Values = NDArray[np.float64]

_CANDIDATE = re.compile(r"(.+):(\d{1,18}):(\d{1,18})")
"""Format of a candidate of a run: RUN:GENERATION:CANDIDATE."""
_CONDITIONS = ("simulation", "parameters", "fitness", "code.simulation")
"""Keys of an experiment that define an episode and its fitness."""
_NAMED = 6
"""Number of seeds, or keys of experiments, that a note names."""


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class ControllerComparison(ComparedByValue):
    """Two controllers evaluated in the same episodes; returned by `swarmwright.compare_controllers`.

    `print(result)` shows it as text, `figure()` as a picture, `to_mapping()` as plain values, and
    `export(path)` writes every episode. Fitness is in the units of the simulation, more is better.
    """

    names: tuple[str, str]
    """Names of the controllers: as they were given, or A and B."""
    first: ControllerEvaluation
    second: ControllerEvaluation
    """Evaluation of the second controller with the same seeds."""
    experiment: Experiment = field(compare=False)
    """Experiment in which both were evaluated."""
    held_out: bool
    """Whether the seeds are held-out seeds, which the evolution of neither run had used."""
    notes: tuple[str, ...] = ()
    """Caveats of the compared runs, a sentence each; `caveats` also has those of the results."""

    @property
    def seeds(self) -> list[int]:
        """Simulation seed of each episode."""
        return self.first.seeds

    @cached_property
    def differences(self) -> Values:
        """(episodes,) fitness of the first minus the second; NaN if a failed episode does not count."""
        values = [
            contender.ranking.replace_failures(contender.episodes) for contender in (self.first, self.second)
        ]
        with np.errstate(invalid="ignore"):  # NaN and infinities of failed episodes
            differences = values[0] - values[1]
        return np.where(np.isfinite(values[0]) & np.isfinite(values[1]), differences, np.nan)

    @cached_property
    def paired(self) -> Values:
        """The counted differences."""
        return self.differences[~np.isnan(self.differences)]

    @property
    def left_out(self) -> list[int]:
        """Seeds of excluded episodes, in which one of the controllers failed."""
        return [
            seed
            for seed, difference in zip(self.seeds, self.differences, strict=True)
            if math.isnan(difference)
        ]

    @property
    def is_reportable(self) -> bool:
        """Whether every pair counts: no episode failed, or `ranking.failed` gives failures a fitness."""
        return len(self.paired) == len(self.seeds)

    @cached_property
    def depends_on_seed(self) -> bool | None:
        """Whether the fitness of either controller differs between episodes; None for a single episode."""
        if len(self.seeds) < 2:
            return None
        depends = (
            np.unique(contender.episodes) for contender in (self.first, self.second)
        )  # equal NaNs count as the same fitness
        return any(len(values) > 1 for values in depends)

    @cached_property
    def difference(self) -> Estimate:
        """Mean difference, first minus second, with Student's 95 % confidence interval.

        There is no interval if all differences are equal, since their variance is then unknown.
        """
        result = estimate(self.paired.tolist())
        if len(self.paired) and np.ptp(self.paired) == 0:
            return Estimate(result.mean, None, None, None, None)
        return result

    @cached_property
    def test(self) -> SignedRank | None:
        """Wilcoxon's signed-rank test of the differences; None if there is nothing to test.

        None if no pair counts, with one episode, and if fitness does not depend on the seed.
        """
        if len(self.paired) < 2 or not self.depends_on_seed:
            return None
        return compute_signed_rank(self.paired)

    @cached_property
    def fitness_difference(self) -> Estimate | None:
        """Difference in fitness, aggregated over episodes by the ranking, for example as the median.

        None if both fitness values are means, or if either is not reportable.
        """
        if all(contender.fitness == contender.mean for contender in (self.first, self.second)):
            return None
        return estimate_gain(self.first, self.second)

    @cached_property
    def caveats(self) -> tuple[str, ...]:
        """All caveats, which restrict the conclusions, a sentence each."""
        return (*self.notes, *_caveats(self))

    def __repr__(self) -> str:
        """Return which controller is better, and by how much."""
        names = " against ".join(self.names)
        return f"<ControllerComparison of {names}: difference {_format_estimate(self.difference)}>"

    def _repr_html_(self) -> str:
        """Return the printed text, for notebooks."""
        return render_preformatted(str(self))

    def __str__(self) -> str:
        return "\n".join([*_lines(self), *(f"Note: {escape_line(note)}." for note in self.caveats)])

    def to_mapping(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON; NaN is not converted."""
        test = self.test
        return {
            "first": {"controller": self.names[0], **self.first.to_mapping()},
            "second": {"controller": self.names[1], **self.second.to_mapping()},
            "seeds": self.seeds,
            "differences": self.differences.tolist(),
            "difference": {**vars(self.difference), "confidence": 0.95, "interval": "t"},
            "fitness_difference": None if self.fitness_difference is None else vars(self.fitness_difference),
            "test": None if test is None else {"name": "Wilcoxon signed-rank", **vars(test)},
            "held_out": self.held_out,
            "depends_on_seed": self.depends_on_seed,
            "failed": [self.first.failed, self.second.failed],
            "left_out": self.left_out,
            "reportable": self.is_reportable,
            "notes": list(self.caveats),
        }

    def figure(self) -> "Figure":
        """Return a matplotlib figure: fitness of the first over the second, and every difference."""
        from swarmwright.display.figures.paired import draw

        return draw(self)

    @check_arguments
    def plot(self, path: str | PathLike[str]) -> Path:
        """Draw `figure` into a file (.png, .svg or .pdf); return its path.

        Raises InputError for another suffix or a file that cannot be written.
        """
        from swarmwright.display.figures.style import save

        return save(self.figure(), Path(path))

    def export(self, path: str | PathLike[str]) -> None:
        """Write every episode as a table, .csv: seed, first, second, difference.

        nan: the controller failed in the episode, or the pair does not count. Raises InputError for another
        suffix, and if the file cannot be written.
        """
        rows = (self.first.episodes.tolist(), self.second.episodes.tolist(), self.differences.tolist())
        heading = ["seed", "first", "second", "difference"]
        write_csv(path, heading, zip(self.seeds, *rows, strict=True))


class Contender(NamedTuple):
    """A controller to compare."""

    name: str
    controller: Controller
    run: Run | None = None
    """Run of the candidate."""
    generation: int | None = None
    """Generation of the candidate."""

    @classmethod
    def of(cls, letter: str, value: Run | Controller | str | PathLike[str]) -> Self:
        """Return the contender that an argument names. letter: A or B, the label of an unnamed controller.

        Raises InputError if the run, candidate or controller does not exist.
        """
        if isinstance(value, Controller):
            return cls(letter, value)
        if isinstance(value, Run):
            return cls._candidate(str(value.path), value)
        path = path_of(letter, value, "a run folder or a controller")
        candidate = None if path.exists() else _CANDIDATE.fullmatch(str(path))
        if candidate is not None:
            return cls._candidate(str(path), Run.open(candidate[1]), int(candidate[2]), int(candidate[3]))
        if (path / FILE).is_file():
            return cls._candidate(str(path), Run.open(path))
        return cls(str(path), Controller.load(path))

    @classmethod
    def _candidate(
        cls, name: str, run: Run, generation: int | None = None, candidate: int | None = None
    ) -> Self:
        choice = choose(run, generation, candidate)
        return cls(name, Controller(choice.specification), run, choice.generation)


class Match(NamedTuple):
    """Two controllers and the experiment in which they are compared."""

    first: Contender
    second: Contender
    experiment: Experiment
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        first: Run | Controller | str | PathLike[str],
        second: Run | Controller | str | PathLike[str],
        experiment: Experiment | Mapping[str, Any] | str | PathLike[str] | None,
    ) -> Self:
        """Create a match from the arguments of `compare_controllers`; raises the same errors."""
        both = Contender.of("A", first), Contender.of("B", second)
        if experiment is not None:
            return cls(*both, as_experiment(experiment))
        runs = [(contender.run, contender.generation) for contender in both if contender.run is not None]
        if not runs:
            raise InputError(
                "neither A nor B is a run whose experiment they can be compared in; name one: --experiment "
                "FILE (in Python, experiment=..)"
            )
        notes = () if len(runs) < 2 else tuple(_describe_conditions(both, runs[0][0], runs[1][0]))
        return cls(*both, resolve_experiment(*runs[0]), notes)

    def evaluate(self, where: EvaluationOptions) -> ControllerComparison:
        """Evaluate both controllers; raises the same errors as `compare_controllers`."""
        used = [
            set() if contender.run is None else contender.run._store.collect_seeds()
            for contender in (self.first, self.second)
        ]
        names = self.first.name, self.second.name
        shown_names = [
            letter if letter == name else f"{letter} ({escape_line(name)})"
            for letter, name in zip("AB", names, strict=True)
        ]
        first, second = evaluate_controllers(
            dict(zip(shown_names, (self.first.controller, self.second.controller), strict=True)),
            self.experiment,
            where,
            used[0] | used[1],
            may_fail=self.experiment.ranking.failure_fitness is not None,
        )
        notes = [*self.notes, *_describe_used_seeds(first.seeds, used)]
        if self.first.controller.specification == self.second.controller.specification:
            notes.append("A and B are the same controller")
        return ControllerComparison(
            names=names,
            first=first,
            second=second,
            experiment=self.experiment,
            held_out=where.seed is None,
            notes=tuple(notes),
        )


@check_arguments
def compare_controllers(
    first: Run | Controller | str | PathLike[str],
    second: Run | Controller | str | PathLike[str],
    *,
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str] | None = None,
    episodes: int = EPISODES,
    seed: SupportsIndex | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> ControllerComparison:
    """Compare two controllers in the same episodes.

    Both get the same seeds, which reduces the variance of the difference: smaller differences can be found
    than with two separate means. Nothing is added to runs.

    Args:
        first: a run or its folder, which stands for its best candidate; `RUN:GENERATION:CANDIDATE` for
            another candidate; a file as `Controller.load` reads it; or a `Controller`.
        second: likewise.
        experiment: in which both are evaluated: an experiment, its file, or a mapping with its keys. Default:
            the experiment of the first, or of the second if the first is not a run.
        episodes: number of episodes, at least 1; if fitness aggregates several, for example as a median, at
            least that number.
        seed: simulation seed of the first episode; the others follow. Default: held-out seeds, which the
            evolution of neither run used.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`; it counts the episodes of both.

    Raises:
        InputError: a candidate or controller does not exist, neither is a run and no experiment is given, the
            runs have different simulations and no experiment is given, a controller does not fit the
            simulation, or a number is out of range.
        SimulationError: every episode of a controller failed, the last in the code of the simulation.
        RunError: no broker, no suitable server, or every episode failed for another reason.

    See also `compare` for groups of runs, and `post_evaluate` for a single controller.

    Examples:
        >>> first_generation = "result:0:0"
        >>> comparison = swarmwright.compare_controllers(
        ...     "result", first_generation, episodes=20, servers="in-process"
        ... )
        >>> len(comparison.seeds)
        20
        >>> round(comparison.difference.mean, 2)
        8.81
    """
    where = EvaluationOptions.of(episodes, seed, broker, servers, on_progress)
    return Match.of(first, second, experiment).evaluate(where)


def _describe_conditions(both: tuple[Contender, Contender], first_run: Run, second_run: Run) -> Iterator[str]:
    """Yield notes on different conditions in the runs of two candidates.

    Raises InputError if they have different simulations.
    """
    first_values, second_values = flatten_experiment(first_run), flatten_experiment(second_run)
    if first_values["simulation"] != second_values["simulation"]:
        raise InputError(
            f"A ({both[0].name}) was evolved in {first_run.experiment.label}, B ({both[1].name}) in "
            f"{second_run.experiment.label}; name the experiment in which both are evaluated: --experiment "
            "FILE (in Python, experiment=..)"
        )
    keys = [
        key
        for key in dict.fromkeys([*first_values, *second_values])
        if key.startswith(_CONDITIONS)
        and key != "parameters.seed"
        and first_values.get(key) != second_values.get(key)
    ]
    if keys:
        named = "; ".join(
            f"{key}: A {format_value(first_values.get(key))}, B {format_value(second_values.get(key))}"
            for key in keys[:_NAMED]
        )
        more = f"; and {len(keys) - _NAMED} more" if len(keys) > _NAMED else ""
        yield (
            "A and B were evolved under different conditions, and both are evaluated in the experiment of A "
            f"({named}{more})"
        )


def _describe_used_seeds(seeds: Sequence[int], used: Sequence[set[int]]) -> Iterator[str]:
    """Yield a note if evolution had used some of the seeds."""
    for letter, used_seeds in zip("AB", used, strict=True):
        if count := len(used_seeds.intersection(seeds)):
            yield (
                f"the evolution of {letter} used {count:,} of these {len(seeds):,} seeds, so its fitness in "
                "them is biased upwards where fitness depends on the seed"
            )


def _lines(comparison: ControllerComparison) -> Iterator[str]:
    """Yield lines with the two controllers as a table, their difference and the test."""
    count = len(comparison.seeds)
    seeds = (
        f"seeds {comparison.seeds[0]} to {comparison.seeds[-1]}"
        if count > 1
        else f"seed {comparison.seeds[0]}"
    )
    seeds = f"held-out {seeds}" if comparison.held_out else seeds
    yield (
        f"{format_count(count, 'episode')} of {escape_line(comparison.experiment.subject)}, the same for "
        f"both ({seeds}):"
    )
    failed = bool(comparison.first.failed or comparison.second.failed)
    rows = [["", "controller", "mean fitness", "95 % interval", *["failed episodes"] * failed]]
    for letter, name, evaluation in zip(
        "AB", comparison.names, (comparison.first, comparison.second), strict=True
    ):
        mean = evaluation.mean
        interval = "" if not mean.standard_error else f"{number(mean.low or 0)} to {number(mean.high or 0)}"
        rows.append([letter, name, number(mean.mean), interval, *[str(evaluation.failed)] * failed])
    yield from columns(rows)
    yield ""
    yield f"Difference A - B: {_format_estimate(comparison.difference)}"
    fitness_difference = comparison.fitness_difference
    if fitness_difference is not None:
        options = comparison.first.ranking.options
        aggregation = f"{getattr(options, 'aggregate', options.kind)} of {options.episodes} episodes"
        yield f"Difference of fitness ({aggregation}): {_format_estimate(fitness_difference)}"
    test = comparison.test
    if test is None:
        return
    yield (
        f"A is better in {format_count(test.better, 'episode')}, B in {test.worse:,}; equal in {test.equal:,}"
    )
    if test.better or test.worse:
        yield (
            f"Wilcoxon signed-rank test: W {test.w:g}, p {format_p_value(test.p)} ({test.method}); effect "
            "size "
            f"(matched-pairs rank-biserial correlation) {test.effect:.2f}"
        )
    if comparison.is_reportable:
        better = f"{'A' if test.effect > 0 else 'B'} is significantly better (p at most 0.05)."
        yield better if test.p <= LEVEL else "No significant difference (p above 0.05)."


def _format_estimate(measured: Estimate) -> str:
    """Format a mean difference with its interval."""
    if measured.low is None or measured.high is None:
        return number(measured.mean) if math.isfinite(measured.mean) else "not known"
    interval = f"{number(measured.low)} to {number(measured.high)}"
    return f"{number(measured.mean)}, 95 % confidence interval {interval} (Student's t of the differences)"


def _caveats(comparison: ControllerComparison) -> Iterator[str]:
    """Yield the caveats of a comparison."""
    yield from _describe_failures(comparison)
    count, test = len(comparison.paired), comparison.test
    if len(comparison.seeds) < 2:
        yield "one episode says nothing about others, so there is no interval and no test; take more"
    elif comparison.depends_on_seed is False:
        yield (
            f"all {count:,} episodes of each controller have the same fitness, which does not seem to depend "
            "on the seed: the difference is exact, and there is no interval and no test"
        )
    elif count > 1 and np.ptp(comparison.paired) == 0:
        yield f"the difference is the same in all {count:,} episodes, so there is no interval"
    elif test is not None and test.least > LEVEL:
        yield (
            f"{format_count(test.better + test.worse, 'difference')} cannot be significant, since the "
            "test's p is "
            f"at least {format_p_value(test.least)}; take more episodes"
        )
    elif test is not None and _contradicts(comparison.difference, test):
        yield (
            "test and interval disagree: the test is of the ranks of the differences, the interval is of "
            "their mean, which a few large differences can dominate; look at the figure"
        )
    if hasattr(comparison.first.ranking.options, "slow"):
        yield "both were evaluated in the experiment's own simulation, not in the ranking's slow one"


def _contradicts(difference: Estimate, test: SignedRank) -> bool:
    """Return whether test and interval disagree about a difference, or about its sign."""
    if difference.low is None or difference.high is None:
        return False
    apart = difference.low > 0 or difference.high < 0
    return (test.p <= LEVEL) != apart or (apart and difference.mean * test.effect < 0)


def _describe_failures(comparison: ControllerComparison) -> Iterator[str]:
    """Yield notes on episodes in which a controller failed, and on how these count."""
    value = comparison.first.ranking.options.failure_fitness
    for letter, evaluation in zip("AB", (comparison.first, comparison.second), strict=True):
        if not evaluation.failed:
            continue
        seeds = [
            seed
            for seed, fitness in zip(evaluation.seeds, evaluation.episodes, strict=True)
            if not math.isfinite(fitness)
        ]
        more = f" and {len(seeds) - _NAMED:,} more" if len(seeds) > _NAMED else ""
        seed_words = f"{', '.join(map(str, seeds[:_NAMED]))}{more}"
        counts = "" if value is None else f", and counts as {value:g} there"
        share = f"{evaluation.failed:,} of {len(evaluation.seeds):,} episodes"
        yield f"{letter} failed in {share} (seeds {seed_words}){counts}"
    if not comparison.is_reportable:
        yield (
            f"pairs with a failed episode are left out ({len(comparison.left_out):,} of "
            f"{len(comparison.seeds):,}), so do not report these figures: a controller that fails in hard "
            "episodes is compared only in the easy ones; "
            "--set ranking.failed=NUMBER gives failed episodes a fitness"
        )
