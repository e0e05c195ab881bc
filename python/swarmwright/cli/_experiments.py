"""Experiments that commands are given: experiment files, and files of other tools that an importer reads."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.cli._output import complain

if TYPE_CHECKING:
    from swarmwright import Experiment
    from swarmwright.experiment.importing import Importer

_IMPORT = "'swarmwright import' has options for the field and for components without a counterpart"


def experiment_of(file: Path, settings: Sequence[str]) -> "Experiment":
    """Read an experiment file, or an XML file such as a FREVO session that an importer accepts in its place.

    settings: as `--set` takes them. Notes of the importer go to standard error. Raises InputError as the
    readers do.
    """
    from swarmwright import Experiment, InputError
    from swarmwright.common.files import first_character

    if first_character(file) != "<":  # nor are importers loaded
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
    """Return the importer that reads these files. Raises InputError where there is none."""
    from swarmwright import InputError, PlugInError
    from swarmwright.common.plug_in_code import reported

    asked = []
    for importer in importers():
        asked.append(importer.words)
        try:
            with reported():
                found = importer.recognises(files)
        except PlugInError as error:
            complain(str(error))
            continue
        if found:
            return importer
    named = ", ".join(map(str, files))
    raise InputError(f"{named}: no importer reads this; there are those of {', '.join(asked) or 'nothing'}")


def importers() -> "Iterator[Importer]":
    """Yield all importers in the order in which they are asked; name one that cannot be loaded."""
    from swarmwright import InputError
    from swarmwright.experiment.importing import IMPORTERS

    found = []
    for name in IMPORTERS.names():
        try:
            found.append(IMPORTERS.get(name)())
        except InputError as error:
            complain(str(error))
    yield from sorted(found, key=lambda run: run.last)
