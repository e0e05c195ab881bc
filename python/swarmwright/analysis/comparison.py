"""Comparison of runs: groups, their final fitness, and whether the groups differ."""

import os
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis.after_evaluations import by_generation, fitness_at
from swarmwright.analysis.groups import RunGroup, group
from swarmwright.analysis.significance import Difference, Kruskal, difference, holm, kruskal_wallis
from swarmwright.core.arguments import checked, listed
from swarmwright.core.errors import InputError
from swarmwright.runs.elites import has_elites
from swarmwright.runs.instances import by_instance
from swarmwright.runs.post_evaluation import EPISODES
from swarmwright.runs.run import Run, run_of
from swarmwright.runs.validation import command_to_validate
from swarmwright.user_code.copying import shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEW = 5
"""Runs of a group below which a test has little power."""


@dataclass(frozen=True)
class Group:
    """Runs whose experiments differ in nothing but the seed."""

    label: str
    """What distinguishes the group, in words."""
    differs: dict[str, Any]
    """Keys of the experiment that differ between the groups, with this group's values."""
    runs: tuple[Run, ...]
    final: NDArray[np.float64]
    """Best fitness of each run, or that of its best candidate on held-out seeds, (runs,), more is better; NaN
    where no candidate could be evaluated."""
    counts: tuple[int, ...]
    """Evaluations of each run that count."""

    def quantile(self, share: float) -> float:
        """Return a quantile of the final fitness; a run without any counts as minus infinity."""
        values = np.sort(np.where(np.isnan(self.final), -np.inf, self.final))
        position = share * (len(values) - 1)
        low = int(position)
        part = position - low
        high = min(low + 1, len(values) - 1)
        if part == 0 or values[low] == values[high]:
            return float(values[low])
        return float(values[low] * (1 - part) + values[high] * part)

    @property
    def median(self) -> float:
        """Median of the final fitness."""
        return self.quantile(0.5)

    @property
    def quartiles(self) -> tuple[float, float]:
        """Lower and upper quartile of the final fitness."""
        return self.quantile(0.25), self.quantile(0.75)

    @property
    def evaluations(self) -> tuple[int, int]:
        """Evaluations that count, of the run with the fewest and of that with the most."""
        return min(self.counts), max(self.counts)


@dataclass(frozen=True)
class Pair:
    """Two groups, and how they differ."""

    first: Group
    second: Group
    difference: Difference
    """Figures of the first against the second."""
    p_holm: float
    """p, corrected for the number of pairs after Holm."""


@dataclass(frozen=True)
class Comparison:
    """Runs in groups, with tests of their final fitness; made by `swarmwright.compare`.

    `print(comparison)` shows it as a table, `figure()` as a picture, `to_mapping()` as plain values.
    """

    groups: tuple[Group, ...]
    pairs: tuple[Pair, ...]
    """Every group against every later one."""
    kruskal: Kruskal | None
    """Test of all groups at once; None for fewer than three."""
    at: int | None
    """Evaluations after which fitness is compared; None: at each run's end."""
    notes: tuple[str, ...]
    """Caveats, a sentence each."""
    held_out: bool = False
    """Whether the fitness on held-out seeds is compared."""

    def __str__(self) -> str:
        from swarmwright.analysis.table import table

        return table(self)

    def to_mapping(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON."""
        from swarmwright.analysis.table import to_mapping

        return to_mapping(self)

    @checked
    def figure(self, *, x: str = "evaluations") -> "Figure":
        """Return a matplotlib figure: best fitness over `x`, and the final fitness of every run.

        x: "evaluations" or "generations".
        """
        from swarmwright.figures.comparison import draw

        return draw(self, x=x)

    @checked
    def plot(self, path: str | Path, *, x: str = "evaluations") -> Path:
        """Draw `figure` into a file (.png, .svg or .pdf); return its path.

        Raises InputError for another ending or a file that cannot be written.
        """
        from swarmwright.figures.style import save

        return save(self.figure(x=x), Path(path))


@checked
def compare(
    runs: Iterable[Run | str | os.PathLike[str]], *, at: int | None = None, held_out: bool = False
) -> Comparison:
    """Compare runs: group them by what differs between their experiments, and test whether groups differ.

    Runs that differ in their seed alone are one group; of runs with the same experiment and seed one counts.
    The best fitness of each run is compared by Mann and Whitney's test, with Vargha and Delaney's A12 as the
    size of the effect and Hodges and Lehmann's estimate of the difference with its 95 % confidence interval;
    three groups and more by Kruskal and Wallis' test as well, and p of pairs is corrected after Holm.

    Args:
        runs: run folders, or runs. One group alone is described and not tested.
        at: compare the best of the first so many evaluations instead of that at each run's end. Runs that
            ended earlier count with what they had, and those whose candidates are evaluated again (racing,
            `reevaluate`) with their last generation that was finished by then.
        held_out: compare the fitness of each run's best candidate on held-out seeds, by its validation,
            instead of the best recorded fitness, which is too high where fitness depends on the seed.

    Raises:
        InputError: no run is given, a folder is not a run, a run holds no finished generation, one had none
            yet after `at` evaluations, or, with `held_out`, a run has no validation.
    """
    listed("runs", runs, "run folders")
    opened = [run_of(run) for run in runs]
    if not opened:
        raise InputError("there are no runs to compare; name run folders such as runs/minisim-1")
    for run in opened:
        if not run.history:
            raise InputError(f"{run.path}: holds no finished generation to compare")
    if held_out:
        _check_validated(opened, at)
    if at is not None:
        _check_finished(opened, at)
    grouped, notes = group(opened)
    groups = tuple(_group(one, at, held_out=held_out) for one in grouped)
    pairs = tuple(combinations(groups, 2))
    differences = [difference(one.final, other.final) for one, other in pairs]
    corrected = holm([found.p for found in differences])
    return Comparison(
        groups,
        tuple(
            Pair(one, other, found, p)
            for (one, other), found, p in zip(pairs, differences, corrected, strict=True)
        ),
        kruskal_wallis([one.final for one in groups]) if len(groups) > 2 else None,
        at,
        (*notes, *_cautions(groups, at, held_out=held_out)),
        held_out,
    )


def _check_finished(runs: Sequence[Run], at: int) -> None:
    slowest = max(filter(by_generation, runs), key=lambda run: run.history[0].evaluations, default=None)
    if slowest is not None and at < (needed := slowest.history[0].evaluations):
        raise InputError(
            f"at {at} evaluations {slowest.path} had no finished generation yet; compare at {needed} or later"
        )


def _check_validated(runs: Sequence[Run], at: int | None) -> None:
    if at is not None:
        raise InputError("at: the best candidates at the end of runs are validated; leave it or held_out")
    missing = [run for run in runs if run.validation is None]
    if missing:
        names = ", ".join(str(run.path) for run in missing[:3])
        others = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        command = command_to_validate(missing[0], _episodes(runs))
        raise InputError(f"{names}{others}: not validated on held-out seeds; `{command}` does it")


def _episodes(runs: Iterable[Run]) -> int:
    """Return in how many held-out episodes a run is to be validated, to be compared with others."""
    return max((len(run.unseen.seeds) for run in runs if run.unseen is not None), default=EPISODES)


def _group(one: RunGroup, at: int | None, *, held_out: bool) -> Group:
    found = [(_validated(run), run.evaluations) if held_out else fitness_at(run, at) for run in one.runs]
    final = np.array([fitness for fitness, _ in found], dtype=np.float64)
    return Group(one.label, one.differs, one.runs, final, tuple(count for _, count in found))


def _validated(run: Run) -> float:
    assert run.validation is not None
    return run.validation.best.fitness.mean


_DEFINITIONS = {
    "fitness": "its expression",
    "ranking.aggregate": "the aggregate of episodes",
    "ranking.level": "the level of the aggregate",
}
"""Keys by which fitness is another quantity."""


_JUDGING = {"code", "code.simulation", "code.ranking"}
"""Code by which fitness may be another quantity; that of methods and controllers is what is compared."""


def _command(groups: Sequence[Group], option: str) -> str:
    """Return the command that compares the runs otherwise; what lies beside them is not named."""
    paths = [run.path for one in groups for run in one.runs]
    folder = paths[0].parent
    everything = {path.name for path in folder.iterdir() if path.is_dir()} if folder.is_dir() else set()
    all_of_it = {path.parent for path in paths} == {folder} and everything <= {path.name for path in paths}
    which = f"{shlex.quote(str(folder))}/*" if all_of_it and len(paths) > 1 else "RUN .."
    return f"`swarmwright runs compare {which} {option}`"


def _definitions(groups: Sequence[Group], *, held_out: bool) -> Iterator[str]:
    """Yield why fitness of the groups may not be comparable."""
    keys = {key for one in groups for key in one.differs}
    others = [words for key, words in _DEFINITIONS.items() if key in keys]
    if others:
        yield f"fitness of different definitions is compared: groups differ in {' and '.join(others)}"
    parameters = {key.split(".")[1] for key in keys if key.startswith("parameters.")} - {"seed"}
    if parameters:
        names = ", ".join(sorted(parameters))
        yield f"groups differ in the simulation's parameters, so they solve different tasks: {names}"
    if held_out:
        yield from _held_out(groups)
        return
    made = {_recorded(one.runs[0]) for one in groups}
    command = f"{_command(groups, '--held-out')} compares fitness on held-out seeds"
    missing = [run for one in groups for run in one.runs if run.validation is None]
    if missing:
        count = sum(len(one.runs) for one in groups)
        command = f"fitness on held-out seeds is known of {count - len(missing)} of {count} runs"
    if len(made) > 1:
        yield (
            f"the best recorded fitness is made of different episodes ({'; '.join(sorted(made))}), and the "
            f"fewer they are, the more it is too high; {command}"
        )
    elif any(_lucky(run) for one in groups for run in one.runs):
        yield (
            "the best recorded fitness is too high where fitness depends on the seed, most of all with "
            f"new seeds in each generation; {command}"
        )


def _elites(groups: Sequence[Group]) -> Iterator[str]:
    """Yield that runs of methods that are made for many candidates are compared by one of them."""
    kinds = [one.label for one in groups if has_elites(one.runs[0])]
    if kinds:
        yield (
            f"only the best fitness is compared, not the archive or the front of {' and '.join(kinds)}: "
            "`swarmwright runs elites RUN --json` has the coverage and QD score of an archive, and the "
            "candidates of a front"
        )


def _held_out(groups: Sequence[Group]) -> Iterator[str]:
    """Yield why fitness on held-out seeds of runs may not be comparable."""
    of_runs = [run.unseen.seeds for one in groups for run in one.runs if run.unseen is not None]
    least, most = (limit(map(len, of_runs), default=0) for limit in (min, max))
    if least != most:
        yield (
            f"the runs were validated in {least:,} to {most:,} episodes, and the fewer they are, the less "
            f"certain fitness is; `swarmwright resume RUN --set validate.episodes={most}` validates a run "
            "in as many"
        )
    elif len(set(map(tuple, of_runs))) > 1:
        yield "the runs were validated on different held-out seeds"


def _lucky(run: Run) -> bool:
    """Return whether the best of a run may owe its recorded fitness to its seeds."""
    return run.experiment.ranking.seeds == "new" or run.unseen is not None


def _recorded(run: Run) -> str:
    """Return of what recorded fitness is made."""
    experiment = run.experiment
    if by_instance(experiment):
        return "the mean of all instances of racing"
    episodes = experiment.ranking.episodes
    past = " and those before, evaluated again" if experiment.ranking.reevaluate else ""
    return f"{episodes} episode{'s' if episodes > 1 else ''}{past}"


def _waits(one: Group, at: int) -> bool:
    """Return whether evaluations of a generation that was not finished do not count."""
    return any(count < min(at, run.evaluations) for run, count in zip(one.runs, one.counts, strict=True))


def _cautions(groups: Sequence[Group], at: int | None, *, held_out: bool) -> list[str]:
    found = []
    few = [one for one in groups if len(one.runs) < FEW]
    if few and len(groups) > 1:
        least = min(len(one.runs) for one in few)
        counts = "; ".join(f"{one.label}: {len(one.runs)}" for one in few)
        if len(few) > 3:
            counts = f"{len(few)} groups have {least} or more"
        found.append(f"with fewer than {FEW} runs in a group ({counts}) a test has little power")
    shortest = min(one.evaluations[0] for one in groups)
    longest = max(one.evaluations[1] for one in groups)
    ended = [str(run.path) for one in groups for run in one.runs if run.evaluations < (at or 0)]
    if ended:
        more = f" and {len(ended) - 5} more" if len(ended) > 5 else ""
        found.append(
            f"ended before {at:,} evaluations, and count with what they had: {', '.join(ended[:5])}{more}"
        )
    waiting = [one.label for one in groups if at is not None and _waits(one, at)]
    if waiting:
        found.append(
            f"candidates of {' and '.join(waiting)} are evaluated again, so the last generation that was "
            f"finished within the first {at:,} evaluations counts"
        )
    if at is None and not held_out and len(groups) > 1 and longest > 1.1 * shortest:
        found.append(
            f"the runs have {shortest:,} to {longest:,} evaluations, and each is compared at its end; "
            f"{_command(groups, f'--at {shortest}')} compares all after as many"
        )
    found += _definitions(groups, held_out=held_out)
    found += _elites(groups)
    simulations = {shown(one.runs[0].experiment.simulation) for one in groups}
    if len(simulations) > 1:
        found.append(f"fitness of different simulations is compared: {', '.join(sorted(simulations))}")
    if any(_JUDGING & one.differs.keys() for one in groups):
        found.append(
            "fitness that different code computed is compared: `swarmwright runs show` names the files"
        )
    interrupted = [run for one in groups for run in one.runs if run.interrupted]
    running = [run for run in interrupted if run.state == "running"]
    for words, some in (
        ("still running", running),
        ("ended early", [run for run in interrupted if run not in running]),
    ):
        if some:
            found.append(f"{words}: {', '.join(str(run.path) for run in some)}")
    return found
