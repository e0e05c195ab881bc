"""What came out of a transfer."""

import csv
import io
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis.groups import RunGroup
from swarmwright.analysis.significance import Difference, difference, holm
from swarmwright.core.arguments import checked
from swarmwright.core.errors import InputError
from swarmwright.core.files import write_text
from swarmwright.runs.transfer.transferred import Transferred

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Values = NDArray[np.float64]


@dataclass(frozen=True)
class DesignLoss:
    """The best candidates of runs that differ in the seed alone, in one target."""

    label: str
    """What distinguishes these runs from the others."""
    target: str
    source_fitness: Values
    """(runs,) mean fitness of the best candidate of each run in its own simulation."""
    target_fitness: Values
    """(runs,) the same in the target."""
    losses: Values
    """(runs,) what is lost: the first minus the second."""


@dataclass(frozen=True)
class DesignPair:
    """Two designs, and whether one loses more."""

    first: DesignLoss
    second: DesignLoss
    difference: Difference
    """Of the losses, the first's against the second's; more is worse."""
    p_holm: float
    """p, corrected for the number of pairs of this target after Holm."""


@dataclass(frozen=True)
class Transfer:
    """Candidates of runs in other simulations; made by `swarmwright.transfer`.

    `print(result)` shows it as tables, `figure()` as a picture, `to_mapping()` as plain values, and
    `export(path)` writes every episode.
    """

    seeds: tuple[int, ...]
    """Simulation seed of each episode."""
    targets: tuple[str, ...]
    runs: tuple[Transferred, ...]
    """One for each run and target, run by run."""
    groups: tuple[RunGroup, ...]
    """Runs that differ in the seed alone."""
    notes: tuple[str, ...]
    """Caveats, a sentence each."""

    @cached_property
    def designs(self) -> tuple[DesignLoss, ...]:
        """The losses of each group of runs, by the best of each run, target by target."""
        found = []
        for target in self.targets:
            of = {str(one.run.path): one for one in self.runs if one.target == target}
            for group in self.groups:
                members = [of[str(run.path)] for run in group.runs]
                columns = np.array(
                    [
                        (one.source_fitness[0].mean, one.target_fitness[0].mean, one.losses[0].mean)
                        for one in members
                    ]
                ).T
                found.append(DesignLoss(group.label, target, *columns))
        return tuple(found)

    @cached_property
    def pairs(self) -> tuple[DesignPair, ...]:
        """Every design against every later one, target by target."""
        found: list[DesignPair] = []
        for target in self.targets:
            designs = [one for one in self.designs if one.target == target]
            pairs = list(combinations(designs, 2))
            differences = [difference(one.losses, other.losses) for one, other in pairs]
            corrected = holm([one.p for one in differences])
            found += [
                DesignPair(one, other, of, p)
                for (one, other), of, p in zip(pairs, differences, corrected, strict=True)
            ]
        return tuple(found)

    def __str__(self) -> str:
        from swarmwright.analysis.transfer.table import table

        return table(self)

    def to_mapping(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON."""
        from swarmwright.analysis.transfer.table import to_mapping

        return to_mapping(self)

    def figure(self) -> "Figure":
        """Return a matplotlib figure: for each target, its fitness over that in the run's simulation."""
        from swarmwright.figures.transfer import draw

        return draw(self)

    @checked
    def plot(self, path: str | Path) -> Path:
        """Draw `figure` into a file (.png, .svg or .pdf); return its path.

        Raises InputError for another ending or a file that cannot be written.
        """
        from swarmwright.figures.style import save

        return save(self.figure(), Path(path))

    def export(self, path: str | Path) -> None:
        """Write every episode as a table, .csv.

        Columns: run, target, generation, candidate (generation empty: a random one), seed, fitness in the
        run's own simulation and in the target (nan where the episode failed).

        Raises InputError for another ending, and when the file cannot be written.
        """
        check_table(Path(path))
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(["run", "target", "generation", "candidate", "seed", "fitness", "fitness_in_target"])
        for one in self.runs:
            rows = zip(
                one.candidates, one.source_episodes.tolist(), one.target_episodes.tolist(), strict=True
            )
            for candidate, source, target in rows:
                whose = (one.run.path, one.target, candidate.generation, candidate.candidate)
                table.writerows((*whose, *row) for row in zip(self.seeds, source, target, strict=True))
        write_text(path, text.getvalue())


def check_table(path: Path) -> None:
    """Raise InputError unless the table of a transfer can have this name."""
    if path.suffix.lower() != ".csv":
        raise InputError(f"{path}: the table of a transfer ends with .csv")
