"""Experiments that commands are given: files, or sessions of FREVO as `swarmwright import` reads them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.cli._output import complain

if TYPE_CHECKING:
    from swarmwright import Experiment

_IMPORT = "'swarmwright import' has options for the field and for components without a counterpart"


def experiment_of(file: Path, settings: Sequence[str]) -> "Experiment":
    """Read an experiment file or a FREVO session, whatever its name, with settings as `--set` takes them.

    What of a session differs from FREVO is said on standard error. Raises InputError as their readers do.
    """
    from swarmwright import Experiment, InputError
    from swarmwright.common.files import first_character

    if first_character(file) != "<":  # nor is what reads sessions imported
        return Experiment.load(file, settings)
    from swarmwright.interop import frevo

    if not frevo.is_session(file):
        return Experiment.load(file, settings)
    try:
        imported = frevo.load(file)
    except InputError as error:
        raise InputError(f"{error}\n{_IMPORT}") from error
    not_as_in_frevo(imported.notes)
    return imported.experiment.with_settings(settings)


def not_as_in_frevo(notes: Sequence[str]) -> None:
    """Say on standard error what of a session could not be taken over as it was."""
    for note in notes:
        complain(f"not as in FREVO: {note}")
