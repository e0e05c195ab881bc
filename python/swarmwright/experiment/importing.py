"""The base class and registry of importers, which convert files of other tools into experiments.

Swarmwright announces its own importers as entry points, like other packages.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from swarmwright.common.errors import InputError
from swarmwright.common.registry import Registry

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment
    from swarmwright.export.subject import Subject


@dataclass(frozen=True)
class Imported:
    """An experiment converted from files of another tool."""

    yaml: str
    """The commented experiment file."""
    experiment: "Experiment"
    """The loaded experiment."""
    notes: tuple[str, ...]
    """Differences from the original files, a sentence each."""
    files: dict[str, str] = field(default_factory=dict)
    """Texts of further files beside the experiment, by name."""


@dataclass(frozen=True)
class ImportOptions:
    """Options of `swarmwright import`."""

    target: Path | None = None
    """The experiment file to write; None to print it."""
    simulation: str | None = None
    """Simulation to use instead of that of the files."""
    method: str | None = None
    """Kind of method to use, with its defaults."""
    controller: str | None = None
    """Kind of controller to use, with its defaults."""
    ranking: str | None = None
    """Kind of ranking to use, with its defaults."""
    field: Path | None = None
    """File with the field of the simulation."""


class Importer(ABC):
    """Importer of a tool's files, announced in the entry-point group `swarmwright.importers`."""

    words: ClassVar[str]
    """Description of its files, such as "a FREVO session"."""
    unused: ClassVar[frozenset[str]] = frozenset()
    """Names of `ImportOptions` that do not apply and are refused."""
    last: ClassVar[bool] = False
    """Whether the importer is tried last, to explain problems of unrecognized files."""

    @abstractmethod
    def recognises(self, files: Sequence[Path]) -> bool:
        """Whether files or folders belong to this tool, by their contents.

        Raises InputError if a file cannot be read.
        """

    @abstractmethod
    def load(self, files: Sequence[Path], options: ImportOptions) -> Imported:
        """Convert the files into an experiment.

        Raises InputError with file and line of every problem.
        """

    def is_experiment(self, file: Path) -> bool:
        """Whether commands accept this XML file wherever they accept an experiment file."""
        return False

    def write_back(
        self,
        run: Path,
        files: Sequence[Path],
        output: Path,
        *,
        generation: int | None = None,
        candidate: int | None = None,
        force: bool = False,
    ) -> "tuple[Subject, list[Path]]":
        """Write copies of the files with a candidate's values; return the candidate and the written files.

        Raises InputError if files of this tool cannot hold values.
        """
        raise InputError(f"{', '.join(map(str, files))}: {self.words} cannot hold the values of a candidate")


IMPORTERS: Registry[Importer] = Registry(
    "importer", "swarmwright.importers", {}, "swarmwright.experiment.importing:Importer"
)
"""All importers by name."""
