"""The importer of FREVO sessions, for `swarmwright import` and other commands that read an experiment."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from swarmwright.experiment.importing import Imported, Importer, ImportOptions
from swarmwright.interop.frevo._document import is_session
from swarmwright.interop.frevo._mapping import load


class FrevoImporter(Importer):
    """Importer of sessions (.zse), or of the session in a result (.zre)."""

    words = "a FREVO session"

    def recognises(self, files: Sequence[Path]) -> bool:
        """Return whether this is a single session."""
        return len(files) == 1 and files[0].is_file() and is_session(files[0])

    def is_experiment(self, file: Path) -> bool:
        """Return whether this is a session."""
        return is_session(file)

    def load(self, files: Sequence[Path], options: ImportOptions) -> Imported:
        """Convert the session to an experiment, see `swarmwright.frevo.load`."""
        imported = load(
            files[0],
            field=options.field,
            folder=Path() if options.target is None else options.target.parent,
            simulation=options.simulation,
            method=options.method,
            controller=options.controller,
            ranking=options.ranking,
        )
        return replace(imported, notes=tuple(f"not as in FREVO: {note}" for note in imported.notes))
