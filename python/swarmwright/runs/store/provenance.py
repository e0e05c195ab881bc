"""What a store notes of where a run comes from: the experiment, when, and with which versions."""

import platform
import sqlite3
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright import _engine
from swarmwright.common.revision import revision
from swarmwright.common.simulation_names import SimulationName, is_environment
from swarmwright.simulations.user_code.copying import Copy, with_files

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment


COMMIT = "swarmwright commit"
"""Key of the commit among versions, which no package can have, because of the space."""

HASH_SEED = "hash seed"
"""Key of Python's hash seed among versions, `random` where each process has its own."""


def recorded(experiment: "Experiment", copy: Copy | None) -> dict[str, Any]:
    """Return the experiment as it is written: its class in the run's copy, relative to the run folder."""
    values = experiment.to_mapping()
    if copy is not None:

        def file_of(part: str, _: str) -> str | None:
            kept = copy.parts.get(part)
            return None if kept is None else copy.main_path_in_run(kept)

        values |= with_files(values, file_of)
    kept = None if copy is None else copy.parts.get("simulation")
    if kept is not None and is_environment(kept.component):
        values["simulation"] = kept.component
    elif copy is not None and kept is not None:
        place = copy.main_path_in_run(kept)
        name = SimulationName.parse(SimulationName.parse(kept.component).in_file(place))
        if name.is_command:
            values["simulation"]["folder"] = name.definition["folder"]
        else:
            values["simulation"] = name.text
    return values


def timestamp(seconds: float | None = None) -> str:
    """Return a time as ISO 8601, UTC.

    seconds: since 1970; None for now.
    """
    moment = datetime.now(UTC) if seconds is None else datetime.fromtimestamp(seconds, UTC)
    return moment.isoformat(timespec="milliseconds")


def versions(libraries: Sequence[str]) -> dict[str, str]:
    """Return the versions of what computes a run; `libraries` that are not installed are left out.

    With the commit where the package is used from a checkout.
    """
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - only where a run starts

    commit = revision()
    found = {
        "swarmwright": _engine.__version__,
        **({} if commit is None else {COMMIT: commit}),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "sqlite": sqlite3.sqlite_version,
    }
    for library in libraries:
        with suppress(PackageNotFoundError):  # the method reports what is missing
            found[library] = version(library)
    return found
