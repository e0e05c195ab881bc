"""Input files of commands: experiment files, and files of other tools that an importer reads."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.cli._output import complain

if TYPE_CHECKING:
    from swarmwright import Experiment
    from swarmwright.experiment.importing import Importer

_IMPORT = "'swarmwright import' has options for the field and for unsupported components"


def experiment_of(file: Path, settings: Sequence[str]) -> "Experiment":
    """Read an experiment file, or an XML file such as a FREVO session that an importer accepts as one.

    settings: in the form of `--set`. Notes of the importer go to standard error. Raises InputError.
    """
    from swarmwright import Experiment, InputError
    from swarmwright.common.files import first_character

    if first_character(file) != "<":  # avoids loading importers
        return Experiment.load(file, settings)
    from swarmwright.experiment.importing import ImportOptions

    importer = next((reader for reader in importers() if reader.is_experiment(file)), None)
    if importer is None:
        return Experiment.load(file, settings)
    try:
        imported = importer.load([file], ImportOptions())
    except InputError as error:
        raise InputError(f"{error}\n{_IMPORT}") from error
    for note in imported.notes:
        complain(note)
    return imported.experiment.with_settings(settings)


def importer_of(files: Sequence[Path]) -> "Importer":
    """Return the importer that reads these files. Raises InputError if there is none."""
    from swarmwright import InputError, PlugInError
    from swarmwright.common.plug_in_code import report_failures

    descriptions = []
    for importer in importers():
        descriptions.append(importer.words)
        try:
            with report_failures():
                is_recognised = importer.recognises(files)
        except PlugInError as error:
            complain(str(error))
            continue
        if is_recognised:
            return importer
    named = ", ".join(map(str, files))
    raise InputError(
        f"{named}: no importer recognises this; available importers: {', '.join(descriptions) or 'none'}"
    )


def importers() -> "Iterator[Importer]":
    """Yield all importers in the order in which they are tried; report those that cannot be loaded."""
    from swarmwright import InputError
    from swarmwright.experiment.importing import IMPORTERS

    readers = []
    for name in IMPORTERS.names():
        try:
            readers.append(IMPORTERS.get(name)())
        except InputError as error:
            complain(str(error))
    yield from sorted(readers, key=lambda run: run.last)
