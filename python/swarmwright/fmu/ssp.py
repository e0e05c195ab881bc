"""Systems of FMUs: System Structure and Parameterization (SSP) 1.0, files `.ssp`."""

import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree as ET

from swarmwright.core.errors import InputError, explained
from swarmwright.core.suggestions import did_you_mean
from swarmwright.fmu import description as fmus
from swarmwright.fmu.description import Description, Variable, place, runs_here
from swarmwright.fmu.layout import stop_time
from swarmwright.fmu.units import Unit, units_of
from swarmwright.fmu.values import expected, fits

Algorithm = Literal["jacobi", "gauss_seidel"]
"""How the components of a system are stepped."""
STRUCTURE = "SystemStructure.ssd"
VERSION = "SSP 1.0"
ENDING = ".ssp"
_FMU_TYPES = (None, "application/x-fmu-sharedlibrary")
_SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
_SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
_MOST_FAULTS = 300


@dataclass(frozen=True)
class Connection:
    """An output of a component that is the input of another: end = factor * start + offset."""

    start: tuple[str, str]
    """Component and variable."""
    end: tuple[str, str]
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class System:
    """What an SSP holds."""

    name: str
    sources: Mapping[str, str]
    """The file of each component in the archive, in the order of the description."""
    components: Mapping[str, Description]
    connections: tuple[Connection, ...]
    starts: Mapping[str, Any]
    """Values of the parameter sets, by `component.variable`."""


def described(file: Path, start: Mapping[str, Any] | None = None) -> Description:
    """Return what an FMU or an SSP announces. Raises InputError where the file is neither.

    Variables of an SSP are named `component.variable`; inputs that are connected are local. Arrays of an FMU
    have the sizes that structural parameters in `start` give them.
    """
    return _flat(file, system_of(file)) if file.suffix == ENDING else fmus.described(file, start)


def system_of(file: Path) -> System:
    """Return what an SSP holds. Raises InputError."""
    try:
        changed = file.stat().st_mtime_ns
    except OSError:
        raise InputError(f"{file}: there is no such file") from None
    return _system(file, changed)


@lru_cache(maxsize=16)
def _system(file: Path, _changed: int) -> System:
    if not fmus.is_installed():
        raise InputError(fmus.NEEDS)
    from fmpy.ssp.ssd import Component, read_ssd  # noqa: PLC0415 - optional

    try:
        found = read_ssd(str(file))
        with zipfile.ZipFile(file) as archive:
            root = ET.fromstring(archive.read(STRUCTURE))  # noqa: S314 - entities from outside are not read
    except Exception as error:  # noqa: BLE001 - whatever a broken file leads to
        raise InputError(f"{file}: is not an SSP: {explained(error)[:_MOST_FAULTS]}") from None
    others = [one.name for one in found.system.elements if not isinstance(one, Component)]
    if others:
        raise InputError(
            f"{file}: {STRUCTURE}: {', '.join(others)}: systems inside of systems and signal dictionaries "
            "are not supported; export one system of components"
        )
    sources = {one.name: _source(file, one) for one in found.system.elements}
    if not sources:
        raise InputError(f"{file}: {STRUCTURE}: the system has no components")
    with tempfile.TemporaryDirectory(prefix="swarmwright-ssp-") as folder:
        components = {
            name: fmus.for_coupling(extracted(file, source, Path(folder))) for name, source in sources.items()
        }
    known = System(found.system.name or file.stem, sources, components, (), {})
    try:
        known = replace(known, connections=tuple(_connections(known, root)))
        return replace(known, starts=dict(_starts(known, found.system)))
    except InputError as error:
        raise InputError(f"{file}: {STRUCTURE}: {error}") from None


def extracted(file: Path, source: str, folder: Path) -> Path:
    """Take the FMU of a component out of an SSP. Raises InputError where it is not there."""
    try:
        with zipfile.ZipFile(file) as archive:
            return Path(archive.extract(source, folder))
    except (KeyError, OSError, zipfile.BadZipFile, RuntimeError) as error:
        raise InputError(f"{file}: {source}: cannot be taken out: {explained(error)}") from None


def _source(file: Path, component: Any) -> str:  # noqa: ANN401 - FMPy has no types
    source = component.source or ""
    if component.type not in _FMU_TYPES or not source.endswith(".fmu"):
        raise InputError(
            f"{file}: {STRUCTURE}: {component.name}: its source is {source or 'missing'}, expected an FMU in "
            "the archive, resources/NAME.fmu"
        )
    return str(source)


def variable_of(system: System, name: str) -> Variable:
    """Return the variable `component.variable`. Raises InputError, which names what there is."""
    component, _, variable = name.partition(".")
    if component not in system.components:
        known = list(system.components)
        hint = did_you_mean(component, known) or f"; available: {', '.join(known)}"
        raise InputError(f"{name}: there is no component {component!r}{hint}")
    found = system.components[component].variables.get(variable)
    if found is None:
        known = list(system.components[component].variables)
        few = ", ".join(known[:20]) + (", .." if len(known) > 20 else "")
        hint = did_you_mean(variable, known) or f"; available: {few}"
        raise InputError(f"{name}: the FMU of {component} has no variable {variable!r}{hint}")
    return found


def checked(system: System, start: str, end: str) -> tuple[Variable, Variable]:
    """Return the variables of a connection.

    Raises InputError for an unknown name, for a start that is no output, an end that is no input, and where
    one is text or an array.
    """
    found = variable_of(system, start), variable_of(system, end)
    for one, name, causality in zip(found, (start, end), ("output", "input"), strict=True):
        if one.causality != causality:
            raise InputError(
                f"{name} has the causality {one.causality}, expected {causality}; write {causality}s as "
                f"{'the start' if causality == 'output' else 'the end'} of a connection"
            )
        if not one.is_number:
            kind = "an array" if one.is_array else f"of the type {one.type}"
            raise InputError(f"{name} is {kind}; only numbers and booleans can be connected")
    return found


def _connections(system: System, root: ET.Element) -> Iterator[Connection]:
    units = {
        one.get("name", ""): Unit.of(one.find(f"{_SSC}BaseUnit"))
        for one in root.iterfind(f"{_SSD}Units/{_SSC}Unit")
    }
    taken: dict[str, str] = {}
    for one in root.iterfind(f"{_SSD}System/{_SSD}Connections/{_SSD}Connection"):
        names = [one.get(f"{side}Element") for side in ("start", "end")]
        if None in names:
            continue  # from or to the outside, where nothing is connected
        start, end = (
            f"{one.get(f'{side}Element')}.{one.get(f'{side}Connector')}" for side in ("start", "end")
        )
        first, last = checked(system, start, end)
        if end in taken:
            raise InputError(f"{end} is connected twice, to {taken[end]} and to {start}")
        taken[end] = start
        linear = one.find(f"{_SSC}LinearTransformation")
        if linear is not None:
            factor, offset = float(linear.get("factor", "1")), float(linear.get("offset", "0"))
        elif one.get("suppressUnitConversion") == "true":
            factor, offset = 1.0, 0.0
        else:
            factor, offset = conversion(system, start, end, first.unit, last.unit, units)
        yield Connection(_parts(start), _parts(end), factor, offset)


def _parts(name: str) -> tuple[str, str]:
    component, _, variable = name.partition(".")
    return component, variable


def conversion(
    system: System, start: str, end: str, first: str, last: str, units: Mapping[str, Unit | None]
) -> tuple[float, float]:
    """Return factor and offset from one unit to another; those of the FMUs, else those of the system.

    Raises InputError for units of different quantities.
    """
    if first == last or not first or not last:
        return 1.0, 0.0
    one = units_of(system.components[_parts(start)[0]].units).get(first) or units.get(first)
    other = units_of(system.components[_parts(end)[0]].units).get(last) or units.get(last)
    if one is None or other is None:
        unknown = first if one is None else last
        raise InputError(
            f"{start} [{first}] and {end} [{last}]: the unit {unknown} is not defined, so that it cannot be "
            "converted; give the connection a linear transformation or suppressUnitConversion"
        )
    if one.exponents != other.exponents:
        raise InputError(f"{start} [{first}] and {end} [{last}]: these units are of different quantities")
    return one.factor / other.factor, (one.offset - other.offset) / other.factor


def _starts(system: System, found: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - FMPy has no types
    """Give the values of all parameter sets; those of a component come after those of the system."""
    for element, prefix in [(found, ""), *((one, f"{one.name}.") for one in found.elements)]:
        for binding in element.parameterBindings:
            mapped = {
                entry.source: (entry.target, entry.transformation)
                for mapping in binding.parameterMapping
                for entry in mapping.mappingEntries
            }
            for values in binding.parameterValues:
                for one in values.parameters:
                    target, linear = mapped.get(one.name, (one.name, None))
                    name = f"{prefix}{binding.prefix or ''}{target}"
                    variable = variable_of(system, name)
                    value = _value(variable, one.value, name)
                    if linear is not None:
                        value = float(linear.factor) * value + float(linear.offset)
                    yield name, value


def _value(variable: Variable, text: str, name: str) -> Any:  # noqa: ANN401 - of its type
    if variable.type == "String":
        return text
    try:
        if variable.type == "Boolean":
            return {"true": True, "1": True, "false": False, "0": False}[text]
        value = float(text) if variable.is_real else int(text)
    except (KeyError, ValueError):
        raise InputError(f"{name}: the value {text!r} is not of the type {variable.type}") from None
    if not fits(variable, value):
        raise InputError(
            f"{name}: the value {text!r} is not of the type {variable.type}, expected {expected(variable)}"
        )
    return value


def _flat(file: Path, system: System) -> Description:
    """Return a system as if it was one FMU."""
    ends = {one.end for one in system.connections}
    variables = {}
    for component, known in system.components.items():
        for name, one in known.variables.items():
            full = f"{component}.{name}"
            causality = "local" if (component, name) in ends else one.causality
            start = system.starts.get(full, one.start)
            elements = tuple(f"{component}.{element}" for element in one.elements)
            variables[full] = replace(one, name=full, causality=causality, start=start, elements=elements)
    every = list(system.components.values())
    missing = [one for one in every if not runs_here(one)]
    sizes = {one.step_size for one in every if one.step_size is not None}
    stops = [time for time in map(stop_time, every) if time is not None]
    return Description(
        version=VERSION,
        identifier=system.name,
        token=str(file),
        variables=variables,
        start_time=every[0].start_time,
        stop_time=min(stops, default=None),
        step_size=max(sizes, default=None),
        tolerance=None,
        only_once=any(one.only_once for one in every),
        platforms=missing[0].platforms if missing else place(),
        units={},
    )
