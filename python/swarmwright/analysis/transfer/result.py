"""The result of a transfer."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis.groups import RunGroup
from swarmwright.analysis.significance import Difference, difference, holm
from swarmwright.analysis.table import write_csv
from swarmwright.analysis.tasks import group_by_task
from swarmwright.common.arguments import check_arguments
from swarmwright.common.html import render_preformatted
from swarmwright.common.values import ComparedByValue
from swarmwright.runs.transfer.transferred import Transferred

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GroupLoss(ComparedByValue):
    """The best candidates of runs that differ only in the seed, in one target."""

    label: str
    """Description of what distinguishes these runs from the others."""
    target: str
    source_fitness: Values
    """(runs,) mean fitness of each run's best candidate in its own simulation."""
    target_fitness: Values
    """(runs,) mean fitness of the same candidates in the target."""
    losses: Values
    """(runs,) fitness lost: the first minus the second."""


@dataclass(frozen=True)
class GroupPair:
    """Two groups of runs, compared by their losses."""

    first: GroupLoss
    second: GroupLoss
    difference: Difference
    """Difference of the losses, first against second; more is worse."""
    p_holm: float
    """p, corrected for the number of pairs of the task in this target after Holm."""

    @property
    def magnitude(self) -> str:
        """Effect size in words: negligible, small, medium or large; empty if `p_holm` is above 0.05."""
        return self.difference.magnitude_at(self.p_holm)


@dataclass(frozen=True)
class GroupTask:
    """Groups of runs that solve the same task, in one target."""

    label: str
    """Description of what distinguishes the task; empty if all groups are tested against each other."""
    differs: dict[str, Any]
    """Keys of the experiment that differ between the tasks, with this task's values."""
    target: str
    groups: tuple[GroupLoss, ...]
    pairs: tuple[GroupPair, ...]
    """Every group of the task against every later one."""


@dataclass(frozen=True, repr=False)
class Transfer:
    """Candidates of runs in other simulations; returned by `swarmwright.transfer`.

    `print(result)` shows it as tables, `figure()` as a picture, `to_mapping()` as plain values, and
    `export(path)` writes every episode.
    """

    seeds: tuple[int, ...]
    """Simulation seed of each episode."""
    targets: tuple[str, ...]
    runs: tuple[Transferred, ...]
    """One for each run and target, run by run."""
    groups: tuple[RunGroup, ...]
    """Groups of runs that differ only in the seed."""
    notes: tuple[str, ...]
    """Caveats, a sentence each."""

    @cached_property
    def group_losses(self) -> tuple[GroupLoss, ...]:
        """The losses of each group of runs, from the best candidate of each run, target by target."""
        losses = []
        for target in self.targets:
            runs_of_group = {
                str(transfer.run.path): transfer for transfer in self.runs if transfer.target == target
            }
            for group in self.groups:
                members = [runs_of_group[str(run.path)] for run in group.runs]
                columns = np.array(
                    [
                        (member.source_fitness[0].mean, member.target_fitness[0].mean, member.losses[0].mean)
                        for member in members
                    ]
                ).T
                losses.append(GroupLoss(group.label, target, *columns))
        return tuple(losses)

    @cached_property
    def tasks(self) -> tuple[GroupTask, ...]:
        """The groups by the task that they solve, target by target; tests are within a task.

        Losses are differences of fitness, so those of different tasks have different units.
        """
        tasks_in_order = []
        tasks = group_by_task(self.groups, by="fitness", held_out=False)
        for target in self.targets:
            losses = [group_loss for group_loss in self.group_losses if group_loss.target == target]
            for task in tasks:
                members = tuple(losses[index] for index in task.indices)
                tasks_in_order.append(GroupTask(task.label, task.differs, target, members, _test(members)))
        return tuple(tasks_in_order)

    @property
    def pairs(self) -> tuple[GroupPair, ...]:
        """Pairs of all tasks: every group against every later one of its task, target by target."""
        return tuple(pair for task in self.tasks for pair in task.pairs)

    def __repr__(self) -> str:
        """Return what was evaluated in which simulations."""
        runs = len(self.runs) // max(len(self.targets), 1)
        subject = f"{runs} run{'' if runs == 1 else 's'}"
        return f"<Transfer of {subject} to {', '.join(self.targets)}: {len(self.seeds)} held-out seeds>"

    def _repr_html_(self) -> str:
        """Return the printed text, for notebooks."""
        return render_preformatted(str(self))

    def __str__(self) -> str:
        from swarmwright.analysis.transfer.table import table

        return table(self)

    def to_mapping(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON."""
        from swarmwright.analysis.transfer.table import to_mapping

        return to_mapping(self)

    def figure(self) -> "Figure":
        """Return a matplotlib figure: for each target, fitness in it over fitness in the run's simulation."""
        from swarmwright.display.figures.transfer import draw

        return draw(self)

    @check_arguments
    def plot(self, path: str | PathLike[str]) -> Path:
        """Draw `figure` into a file (.png, .svg or .pdf); return its path.

        Raises InputError for another suffix or a file that cannot be written.
        """
        from swarmwright.display.figures.style import save

        return save(self.figure(), Path(path))

    def export(self, path: str | PathLike[str]) -> None:
        """Write every episode as a table, .csv.

        Columns: run, target, generation, candidate (generation is empty for a random candidate), seed,
        fitness in the run's own simulation and in the target (nan if the episode failed).

        Raises InputError for another suffix, and if the file cannot be written.
        """
        rows = (
            (str(run.run.path), run.target, candidate.generation, candidate.candidate, *episode)
            for run in self.runs
            for candidate, source, target in zip(
                run.candidates, run.source_episodes.tolist(), run.target_episodes.tolist(), strict=True
            )
            for episode in zip(self.seeds, source, target, strict=True)
        )
        heading = ["run", "target", "generation", "candidate", "seed", "fitness", "fitness_in_target"]
        write_csv(path, heading, rows)


def _test(groups: Sequence[GroupLoss]) -> tuple[GroupPair, ...]:
    pairs = list(combinations(groups, 2))
    differences = [difference(first.losses, second.losses) for first, second in pairs]
    corrected = holm([pair_difference.p for pair_difference in differences])
    return tuple(
        GroupPair(first, second, samples, p)
        for (first, second), samples, p in zip(pairs, differences, corrected, strict=True)
    )
