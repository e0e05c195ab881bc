"""The provenance of a run as the store records it: experiment, time and versions."""

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
"""Key of the commit among versions; no package name can have a space."""

HASH_SEED = "hash seed"
"""Key of Python's hash seed among versions; its value is `random` if each process has its own."""


def record_experiment(experiment: "Experiment", copy: Copy | None) -> dict[str, Any]:
    """Return the experiment as the store records it, with classes in the run's copy of the code."""
    values = experiment.to_mapping()
    if copy is not None:

        def find_file(part: str, _: str) -> str | None:
            copied = copy.parts.get(part)
            return None if copied is None else copy.main_path_in_run(copied)

        values |= with_files(values, find_file)
    simulation = None if copy is None else copy.parts.get("simulation")
    if simulation is not None and is_environment(simulation.component):
        values["simulation"] = simulation.component
    elif copy is not None and simulation is not None:
        path = copy.main_path_in_run(simulation)
        name = SimulationName.parse(SimulationName.parse(simulation.component).with_file(path))
        if name.is_command:
            values["simulation"]["folder"] = name.definition["folder"]
        else:
            values["simulation"] = name.text
    return values


def timestamp(seconds: float | None = None) -> str:
    """Format a time as ISO 8601, UTC.

    seconds: since 1970; None for now.
    """
    moment = datetime.now(UTC) if seconds is None else datetime.fromtimestamp(seconds, UTC)
    return moment.isoformat(timespec="milliseconds")


def versions(libraries: Sequence[str]) -> dict[str, str]:
    """Return the versions of Python, this package, NumPy, SQLite and the installed ones of `libraries`.

    The commit is included if the package is used from a checkout.
    """
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - only where a run starts

    commit = revision()
    installed = {
        "swarmwright": _engine.__version__,
        **({} if commit is None else {COMMIT: commit}),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "sqlite": sqlite3.sqlite_version,
    }
    for library in libraries:
        with suppress(PackageNotFoundError):  # the method reports what is missing
            installed[library] = version(library)
    return installed
