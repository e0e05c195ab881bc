"""Files of other tools as experiments: the base class of importers, and which ones there are.

There is no importer built in: ours are announced in Swarmwright's own package, as those of other packages.
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
    """An experiment made of files of another tool.

    yaml: the commented experiment file. experiment: the same, loaded. notes: what could not be taken over as
    it was, a sentence each. files: what is written beside the experiment, text by name.
    """

    yaml: str
    experiment: "Experiment"
    notes: tuple[str, ...]
    files: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ImportOptions:
    """Options of `swarmwright import`.

    target: the experiment file that will be written, None where it is printed. simulation: used in the place
    of the files' own, as an experiment names it. method, controller, ranking: kinds that are used, with their
    defaults. field: a file with the field of the simulation.
    """

    target: Path | None = None
    simulation: str | None = None
    method: str | None = None
    controller: str | None = None
    ranking: str | None = None
    field: Path | None = None


class Importer(ABC):
    """Reads files of one tool; announced in the entry-point group `swarmwright.importers`."""

    words: ClassVar[str]
    """What it reads, such as "a FREVO session"."""
    unused: ClassVar[frozenset[str]] = frozenset()
    """Names of `ImportOptions` that do not apply; a user who gives one is told so."""
    last: ClassVar[bool] = False
    """Whether it is asked after all others, because it explains what is wrong with files of no known kind."""

    @abstractmethod
    def recognises(self, files: Sequence[Path]) -> bool:
        """Whether these files or folders are of this tool, by what they hold.

        Raises InputError when a file cannot be read.
        """

    @abstractmethod
    def load(self, files: Sequence[Path], options: ImportOptions) -> Imported:
        """Make an experiment of the files.

        Raises InputError that names file and line of everything that is wrong.
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
        """Write copies of the files with a candidate's values; the candidate, and what was written.

        Raises InputError where values cannot be written into files of this tool.
        """
        raise InputError(f"{', '.join(map(str, files))}: {self.words} cannot hold the values of a candidate")


IMPORTERS: Registry[Importer] = Registry(
    "importer", "swarmwright.importers", {}, "swarmwright.experiment.importing:Importer"
)
"""All importers, by their names."""
