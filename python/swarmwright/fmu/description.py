"""What an FMU announces, as far as a simulation needs it."""

import importlib.util
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from swarmwright.core.errors import InputError, explained
from swarmwright.fmu.units import Unit

_REALS = ("Real", "Float32", "Float64")
_INTEGERS = (
    "Integer", "Enumeration", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64",
)  # fmt: skip
VERSIONS = ("2.0", "3.0")
_MOST_FAULTS = 300
"""Characters of what is wrong with a file that are repeated."""


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU."""

    name: str
    reference: int
    type: str
    """As in modelDescription.xml: Real, Integer, Boolean, .. of FMI 2.0, Float64, Int32, .. of FMI 3.0."""
    causality: str
    """parameter, input, output, local, .."""
    start: Any
    """A number, a boolean or text; None where there is none."""
    unit: str
    minimum: float | None
    maximum: float | None
    is_array: bool

    @property
    def is_number(self) -> bool:
        """Whether it is one number or boolean."""
        return not self.is_array and self.type in (*_REALS, *_INTEGERS, "Boolean")

    @property
    def is_real(self) -> bool:
        """Whether it may have a fraction."""
        return self.type in _REALS


@dataclass(frozen=True)
class Description:
    """An FMU for co-simulation."""

    version: str
    """2.0 or 3.0."""
    identifier: str
    """Of the library."""
    token: str
    """The GUID, or instantiation token."""
    variables: Mapping[str, Variable]
    start_time: float
    stop_time: float | None
    step_size: float | None
    only_once: bool
    """Whether a process can have one instance only."""
    platforms: tuple[str, ...]
    """Those that it has libraries for, as its folders are called: linux64, x86_64-linux, .."""
    units: Mapping[str, Unit | None] = field(default_factory=dict)
    """By name; None for those that are not defined by SI base units."""

    def of_causality(self, causality: str) -> list[Variable]:
        """Return the variables with one number, of a causality."""
        return [one for one in self.variables.values() if one.causality == causality and one.is_number]


def is_installed() -> bool:
    """Return whether FMPy is here."""
    return importlib.util.find_spec("fmpy") is not None


NEEDS = "FMUs are read by FMPy: pip install 'swarmwright[fmi]'"


def described(file: Path) -> Description:
    """Return what an FMU announces. Raises InputError where the file is not one for co-simulation."""
    try:
        changed = file.stat().st_mtime_ns
    except OSError:
        raise InputError(f"{file}: there is no such file") from None
    return _described(file, changed)


@lru_cache(maxsize=16)
def _described(file: Path, _changed: int) -> Description:
    if not is_installed():
        raise InputError(NEEDS)
    from fmpy import read_model_description  # noqa: PLC0415 - optional

    try:
        with zipfile.ZipFile(file) as archive:
            places = [Path(name).parts for name in archive.namelist()]
        found = read_model_description(str(file), validate=False)
    except Exception as error:  # noqa: BLE001 - whatever a broken file leads to
        raise InputError(f"{file}: is not an FMU: {explained(error)[:_MOST_FAULTS]}") from None
    version = next((one for one in VERSIONS if str(found.fmiVersion).startswith(one)), None)
    if version is None:
        raise InputError(
            f"{file}: is an FMU of FMI {found.fmiVersion}; those of {' and '.join(VERSIONS)} work"
        )
    if found.coSimulation is None:
        raise InputError(
            f"{file}: is not for co-simulation, only for model exchange or scheduled execution; export one "
            "for co-simulation"
        )
    experiment = found.defaultExperiment
    try:
        variables = {one.name: _variable(one) for one in found.modelVariables}
        times = {
            key: None if experiment is None else _number(getattr(experiment, key))
            for key in ("startTime", "stopTime", "stepSize")
        }
    except ValueError as error:
        raise InputError(f"{file}: modelDescription.xml: {error}") from None
    return Description(
        version,
        found.coSimulation.modelIdentifier,
        found.guid,
        variables,
        times["startTime"] or 0.0,
        times["stopTime"],
        times["stepSize"] or None,
        bool(found.coSimulation.canBeInstantiatedOnlyOncePerProcess),
        tuple(sorted({one[1] for one in places if len(one) > 2 and one[0] == "binaries"})),
        {one.name: Unit.of(one.baseUnit) for one in found.unitDefinitions},
    )


def _variable(found: Any) -> Variable:  # noqa: ANN401 - FMPy has no types
    unit = found.unit or (found.declaredType.unit if found.declaredType is not None else None)
    low, high = (
        getattr(found, name) if getattr(found, name) is not None else getattr(found.declaredType, name, None)
        for name in ("min", "max")
    )
    is_array = bool(found.dimensions)
    start = None if is_array else _start(found.type, found.start)
    return Variable(
        found.name,
        int(found.valueReference),
        found.type,
        found.causality,
        start,
        unit or "",
        _number(low),
        _number(high),
        is_array,
    )


def _start(kind: str, text: Any) -> Any:  # noqa: ANN401 - as in the file
    if text is None or kind in ("String", "Binary", "Clock"):
        return text
    if kind == "Boolean":
        return str(text).strip() in ("true", "1")
    return float(text) if kind in _REALS else int(text)


def _number(text: Any) -> float | None:  # noqa: ANN401 - as in the file
    if text is None:
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def place() -> tuple[str, str]:
    """Return what FMI 2.0 and FMI 3.0 call this machine."""
    import fmpy  # noqa: PLC0415 - optional

    return fmpy.platform, fmpy.platform_tuple


def runs_here(description: Description) -> bool:
    """Return whether an FMU has a library for this machine."""
    return not set(place()).isdisjoint(description.platforms)
