"""Importer of drawn models, for `swarmwright import` and `swarmwright export --model`."""

from collections.abc import Sequence
from pathlib import Path

from swarmwright.experiment.importing import Imported, Importer, ImportOptions
from swarmwright.export.subject import Subject
from swarmwright.interop.models._experiment import load
from swarmwright.interop.models._write_back import write_back


class ModelImporter(Importer):
    """Reads the files of a model, recognised by their content."""

    words = "a drawn model"
    unused = frozenset({"field", "ranking"})
    last = True

    def recognises(self, files: Sequence[Path]) -> bool:  # noqa: ARG002 - as in the base class
        """Accept all files; `load` reports unknown kinds."""
        return True

    def load(self, files: Sequence[Path], options: ImportOptions) -> Imported:
        """Convert the model to an experiment."""
        return load(
            files,
            target=options.target,
            simulation=options.simulation,
            method=options.method,
            controller=options.controller,
        )

    def write_back(
        self,
        run: Path,
        files: Sequence[Path],
        output: Path,
        *,
        generation: int | None = None,
        candidate: int | None = None,
        force: bool = False,
    ) -> tuple[Subject, list[Path]]:
        """Write copies of the files with a candidate's values; return the candidate and the paths."""
        return write_back(run, files, output=output, generation=generation, candidate=candidate, force=force)
