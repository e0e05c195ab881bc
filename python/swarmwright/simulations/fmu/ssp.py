"""Systems of FMUs: System Structure and Parameterization (SSP) 1.0, files `.ssp`.

Parameter bindings of SSP: start values from parameter sets, with mappings, units and transformations.

Transformations of SSP between a value and where it goes: linear, or by a table of values.
"""

import math
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree as ET

from swarmwright.common import archives
from swarmwright.common.errors import InputError, describe_exception
from swarmwright.common.suggestions import did_you_mean, suggest_or_list
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.fmu import description as fmus
from swarmwright.simulations.fmu.description import (
    INTEGERS,
    Description,
    Variable,
    checked_xml,
    expected,
    fits,
    place,
    runs_here,
    stop_time,
)
from swarmwright.simulations.fmu.units import Unit, units_of

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
_SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
_SSM = "{http://ssp-standard.org/SSP1/SystemStructureParameterMapping}"
_KINDS = ("Real", "Integer", "Boolean", "String", "Enumeration")
_TYPES = {
    "ParameterBinding": "application/x-ssp-parameter-set",
    "ParameterMapping": "application/x-ssp-parameter-mapping",
}

Read = Callable[[str, str], ET.Element]
"""Takes the name of a file in the SSP and of its XML schema, and returns its root element."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a set."""

    kind: str
    text: str
    unit: str
    base: Unit | None
    """The unit, where the set defines it."""


def bindings(element: ET.Element, read: Read) -> Iterator[tuple[str, Parameter, ET.Element | None]]:
    """Yield the name of a variable, the parameter for it, and the mapping entry where there is one.

    In the order in which they count: later ones replace earlier ones. With a mapping, parameters that it does
    not name are left out.

    Args:
        element: a system or a component.
        read: see `Read`.

    Raises InputError for sources that are not supported.
    """
    for binding in element.iterfind(f"{SSD}ParameterBindings/{SSD}ParameterBinding"):
        prefix = binding.get("prefix", "")
        found = {f"{prefix}{name}": one for name, one in _parameters(binding, read)}
        mapping = binding.find(f"{SSD}ParameterMapping")
        if mapping is None:
            yield from ((name, parameter, None) for name, parameter in found.items())
            continue
        root = _source_of(mapping, read, f"{_SSM}ParameterMapping", "SystemStructureParameterMapping.xsd")
        for entry in () if root is None else root.iterfind(f"{_SSM}MappingEntry"):
            if entry.get("source") in found:
                yield entry.get("target", ""), found[entry.get("source", "")], entry


def _parameters(binding: ET.Element, read: Read) -> Iterator[tuple[str, Parameter]]:
    root = _source_of(binding, read, f"{_SSV}ParameterSet", "SystemStructureParameterValues.xsd")
    if root is None:
        return
    units = {
        element.get("name", ""): Unit.of(element.find(f"{SSC}BaseUnit"))
        for element in root.iterfind(f"{_SSV}Units/{SSC}Unit")
    }
    for element in root.iterfind(f"{_SSV}Parameters/{_SSV}Parameter"):
        name = element.get("name", "")
        kind, value = next(
            ((kind, found) for kind in _KINDS if (found := element.find(f"{_SSV}{kind}")) is not None),
            ("", None),
        )
        if value is None:
            raise InputError(f"parameter {name}: is not of the type {', '.join(_KINDS)}")
        unit = value.get("unit", "")
        yield name, Parameter(kind, value.get("value", ""), unit, units.get(unit))


def _source_of(element: ET.Element, read: Read, root: str, schema: str) -> ET.Element | None:
    """Return what a binding or mapping holds, inline or in a file; None for nothing."""
    tag = element.tag.removeprefix(SSD)
    kind, source = element.get("type"), element.get("source")
    if kind not in (None, _TYPES[tag]):
        raise InputError(f"{tag}: the type {kind} is not supported, expected {_TYPES[tag]}")
    if element.get("sourceBase", "SSD") != "SSD":
        raise InputError(
            f"{tag} {source}: files inside of components (sourceBase) are not supported; put it into the SSP"
        )
    if source:
        return read(source, schema)
    inline = element.find(f"{SSD}ParameterValues") if tag == "ParameterBinding" else element
    return None if inline is None else inline.find(root)


def start_value(
    name: str, variable: Variable, one: Parameter, entry: ET.Element | None, units: "Callable[[], Linear]"
) -> Any:  # noqa: ANN401 - of the type of the variable
    """Return what a parameter sets a variable to. Raises InputError where it cannot have that value.

    Args:
        name: of the variable, `component.variable`.
        variable: what is set.
        one: the parameter.
        entry: of a parameter mapping.
        units: returns the conversion to the variable's unit.
    """
    if variable.type == "String":
        return one.text
    is_kept = entry is not None and entry.get("suppressUnitConversion") in ("true", "1")
    by = units() if variable.is_real and not is_kept else IDENTITY
    linear = (linear_of(entry) if entry is not None else None) or IDENTITY
    table = None if entry is None else table_of(entry, None, variable, name)
    value = _parsed_parameters(name, variable, one)
    changed = linear(by(value))
    changed = changed if table is None else table(changed)
    if variable.type in INTEGERS and changed == changed // 1:
        changed = int(changed)
    if not fits(variable, changed):
        raise InputError(
            f"{name}: the value {one.text!r} is not of the type {variable.type}, expected "
            f"{expected(variable)}"
        )
    return changed


def _parsed_parameters(name: str, variable: Variable, parameter: Parameter) -> Any:  # noqa: ANN401 - as above
    try:
        if variable.type == "Boolean":
            return BOOLEANS[parameter.text]
        if parameter.kind == "Enumeration" and parameter.text in variable.labels:
            return variable.items[variable.labels.index(parameter.text)]
        return float(parameter.text) if variable.is_real else int(parameter.text)
    except (KeyError, ValueError):
        items = f", one of {', '.join(variable.labels)}" if variable.labels else ""
        raise InputError(
            f"{name}: the value {parameter.text!r} is not of the type {variable.type}{items}"
        ) from None


SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
BOOLEANS = {"true": True, "1": True, "false": False, "0": False}
"""As XML writes them."""
_LINEAR = "LinearTransformation"
_BOOLEAN, _INTEGER, _ENUMERATION = (
    f"{kind}MappingTransformation" for kind in ("Boolean", "Integer", "Enumeration")
)


@dataclass(frozen=True)
class Linear:
    """factor * value + offset."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, value: float) -> float:
        """Return the transformed value; of the identity, the value itself."""
        if (self.factor, self.offset) == (1.0, 0.0):
            return value
        return self.factor * value + self.offset

    def after(self, first: "Linear") -> "Linear":
        """Return both in one, `first` before this."""
        return Linear(self.factor * first.factor, self.factor * first.offset + self.offset)


@dataclass(frozen=True)
class Table:
    """Some values, and what they become; all others are kept."""

    entries: Mapping[float, float]

    def __call__(self, value: float) -> float:
        """Return the transformed value."""
        return self.entries.get(value, value)


Transformation = Linear | Table
IDENTITY = Linear()


def linear_of(element: ET.Element) -> Linear | None:
    """Return the linear transformation of a connection or mapping entry; None where it has none."""
    found = element.find(f"{SSC}{_LINEAR}")
    if found is None:
        return None
    return Linear(float(found.get("factor", "1")), float(found.get("offset", "0")))


def table_of(element: ET.Element, source: Variable | None, target: Variable, place: str) -> Table | None:
    """Return the mapping transformation of a connection or mapping entry; None where it has none.

    SSP, section "Transformation Choice": entries are unambiguous, and their targets values of the target.

    Args:
        element: the connection or mapping entry.
        source: the variable that a connection begins at; None for a parameter, whose type is the target's.
        target: the variable that gets the values.
        place: words for messages.

    Raises InputError for one that does not fit the types, has two entries for one value, or gives a value
    that the target cannot have.
    """
    of = [(kind, element.find(f"{SSC}{kind}")) for kind in (_BOOLEAN, _INTEGER, _ENUMERATION)]
    kind, found = next(((kind, candidate) for kind, candidate in of if candidate is not None), ("", None))
    if found is None:
        return None
    allowed = {
        _BOOLEAN: ("Boolean",),
        _INTEGER: INTEGERS,
        _ENUMERATION: ("Enumeration",),
    }[kind]
    for variable in (target,) if source is None else (source, target):
        if variable.type not in allowed:
            raise InputError(
                f"{place}: {kind} is for variables of the type {' or '.join(allowed[:2])}, but "
                f"{variable.name} has the type {variable.type}"
            )
    entries: dict[float, float] = {}
    for entry in found.iterfind(f"{SSC}MapEntry"):
        words = entry.get("source", ""), entry.get("target", "")
        before = _value(kind, words[0], source or target, place)
        if before in entries:
            raise InputError(f"{place}: the {kind} has two entries with the source {words[0]!r}")
        entries[before] = _value(kind, words[1], target, place)
    table = Table(entries)
    for after in entries.values():
        if not fits(target, after):
            raise InputError(
                f"{place}: the {kind} has the target {after}, but {target.name} is {expected(target)}"
            )
    for item, label in () if source is None else zip(source.items, source.labels, strict=True):
        if not fits(target, table(item)):
            raise InputError(
                f"{place}: the {kind} keeps {label}, {item}, but {target.name} is {expected(target)}; add an "
                "entry for it"
            )
    return table


def _value(kind: str, word: str, variable: Variable, place: str) -> float:
    """Return the value that an entry names."""
    try:
        if kind == _BOOLEAN:
            return BOOLEANS[word]
        if kind == _INTEGER:
            return int(word)
        return variable.items[variable.labels.index(word)]
    except (KeyError, ValueError):
        known = f"; {variable.name} has {', '.join(variable.labels) or 'no named items'}"
        hint = known if kind == _ENUMERATION else ""
        raise InputError(f"{place}: the {kind} has an entry with {word!r}, which is no value{hint}") from None


Algorithm = Literal["jacobi", "gauss_seidel"]
"""How the components of a system are stepped."""
STRUCTURE = "SystemStructure.ssd"
VERSION = "SSP 1.0"
ENDING = ".ssp"
_FMU_TYPES = (None, "application/x-fmu-sharedlibrary")
_MOST_FAULTS = 300
_SHOWN_NAMES = 10


@dataclass(frozen=True)
class Connection:
    """An output of a component that is the input of another."""

    start: tuple[str, str]
    """Component and variable."""
    end: tuple[str, str]
    transformation: Transformation = IDENTITY
    """What the value becomes on the way."""


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
    start_time: float | None = None
    """Of the default experiment; None where there is none."""
    stop_time: float | None = None


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
    with archives.open_archive(file, "an SSP") as archive:
        root = _parsed(file, archive, STRUCTURE, "SystemStructureDescription.xsd")
        top = root.find(f"{SSD}System")
        assert top is not None  # the schema requires it
        elements = list(top.iterfind(f"{SSD}Elements/*"))
        others = [element.get("name", "") for element in elements if element.tag != f"{SSD}Component"]
        if others:
            raise InputError(
                f"{file}: {STRUCTURE}: {', '.join(others)}: systems inside of systems and signal "
                "dictionaries are not supported; export one system of components"
            )
        sources = {element.get("name", ""): _source(file, element) for element in elements}
        if not sources:
            raise InputError(f"{file}: {STRUCTURE}: the system has no components")
        known = System(top.get("name") or file.stem, sources, _components(file, sources), (), {})
        experiment = root.find(f"{SSD}DefaultExperiment")
        try:
            known = replace(known, connections=tuple(_connections(known, root)))
            starts = _starts(file, archive, known, [*elements, top])
            times = [_time(experiment, key) for key in ("startTime", "stopTime")]
        except (InputError, ValueError) as error:
            raise InputError(f"{file}: {STRUCTURE}: {error}") from None
    return replace(known, starts=starts, start_time=times[0], stop_time=times[1])


def _time(experiment: ET.Element | None, key: str) -> float | None:
    """Return a time of the default experiment; None where it has none."""
    text = None if experiment is None else experiment.get(key)
    return None if text is None or not math.isfinite(float(text)) else float(text)


def _components(file: Path, sources: Mapping[str, str]) -> dict[str, Description]:
    """Return what the FMU of each component announces."""
    components, sizes = {}, {}
    with TemporaryFolder("ssp") as folder:
        for source in dict.fromkeys(sources.values()):
            fmu = extracted(file, source, folder)
            components[source] = fmus.for_coupling(fmu)
            with archives.open_archive(fmu, "an FMU") as archive:
                sizes[source] = fmu.stat().st_size + archives.count_unpacked_bytes(archive)
    # Each component is unpacked for itself.
    archives.check_size(
        file, sum(sizes[sizes_of] for sizes_of in sources.values()), "its components unpack to"
    )
    return {name: components[source] for name, source in sources.items()}


def _parsed(file: Path, archive: zipfile.ZipFile, name: str, schema: str) -> ET.Element:
    """Return the root of an XML file of an SSP. Raises InputError unless it is valid by its schema."""
    from fmpy.ssp.ssd import validate_tree  # noqa: PLC0415 - optional
    from lxml import etree  # noqa: PLC0415 - comes with FMPy

    try:
        data = checked_xml(archive, file, name)
        validate_tree(etree.fromstring(data), schema)
        return ET.fromstring(data)  # noqa: S314 - it has been checked
    except Exception as error:  # noqa: BLE001 - whatever a broken file leads to
        words = (
            str(error) if isinstance(error, InputError) else f"{file}: {name}: {describe_exception(error)}"
        )
        raise InputError(f"{file}: is not an SSP: {words.removeprefix(f'{file}: ')[:_MOST_FAULTS]}") from None


def extracted(file: Path, source: str, folder: Path) -> Path:
    """Take the FMU of a component out of an SSP. Raises InputError where it is not there."""
    with archives.open_archive(file, "an SSP") as archive:
        try:
            return Path(archive.extract(source, folder))
        except (KeyError, OSError, *archives.DAMAGED) as error:
            raise InputError(f"{file}: {source}: cannot be taken out: {describe_exception(error)}") from None


def _source(file: Path, component: ET.Element) -> str:
    source = component.get("source", "")
    if component.get("type") not in _FMU_TYPES or not source.endswith(".fmu"):
        raise InputError(
            f"{file}: {STRUCTURE}: {component.get('name')}: its source is {source or 'missing'}, expected an "
            "FMU in the archive, resources/NAME.fmu"
        )
    return source


def variable_of(system: System, name: str) -> Variable:
    """Return the variable `component.variable`. Raises InputError, which names what there is."""
    component, _, variable = name.partition(".")
    if component not in system.components:
        known = list(system.components)
        hint = suggest_or_list(component, known)
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
    for variable, name, causality in zip(found, (start, end), ("output", "input"), strict=True):
        if variable.causality != causality:
            raise InputError(
                f"{name} has the causality {variable.causality}, expected {causality}; write {causality}s as "
                f"{'the start' if causality == 'output' else 'the end'} of a connection"
            )
        if not variable.is_number:
            kind = "an array" if variable.is_array else f"of the type {variable.type}"
            raise InputError(f"{name} is {kind}; only numbers and booleans can be connected")
    return found


def _connections(system: System, root: ET.Element) -> Iterator[Connection]:
    units = {
        element.get("name", ""): Unit.of(element.find(f"{SSC}BaseUnit"))
        for element in root.iterfind(f"{SSD}Units/{SSC}Unit")
    }
    taken: dict[str, str] = {}
    for element in root.iterfind(f"{SSD}System/{SSD}Connections/{SSD}Connection"):
        names = [element.get(f"{side}Element") for side in ("start", "end")]
        if None in names:
            continue  # from or to the outside, where nothing is connected
        start, end = (
            f"{element.get(f'{side}Element')}.{element.get(f'{side}Connector')}" for side in ("start", "end")
        )
        if [variable_of(system, name).causality for name in (start, end)] == ["input", "output"]:
            start, end = end, start  # start and end do not say where data flows, the variables do
        checked(system, start, end)
        if end in taken:
            raise InputError(f"{end} is connected twice, to {taken[end]} and to {start}")
        taken[end] = start
        ends = _parts(start), _parts(end)
        yield Connection(*ends, _transformation(system, element, ends, units))


def _transformation(
    system: System,
    connection: ET.Element,
    ends: tuple[tuple[str, str], tuple[str, str]],
    units: Mapping[str, Unit | None],
) -> Transformation:
    """Return what values become in a connection: by units first, and then by its transformation."""
    first, last = (system.components[name].variables[variable] for name, variable in ends)
    table = table_of(connection, first, last, f"the connection from {'.'.join(ends[0])}")
    if table is not None:
        return table
    linear = linear_of(connection)
    if connection.get("suppressUnitConversion") in ("true", "1"):
        return linear or IDENTITY
    try:
        start, end = (".".join(names) for names in ends)
        by = conversion(system, start, end, first.unit, last.unit, units)
    except InputError:
        if linear is None:
            raise
        return linear  # of quantities that only it relates to one another, such as a current and a force
    return by if linear is None else linear.after(by)


def _parts(name: str) -> tuple[str, str]:
    component, _, variable = name.partition(".")
    return component, variable


def conversion(
    system: System, start: str, end: str, first: str, last: str, units: Mapping[str, Unit | None]
) -> Linear:
    """Return the conversion from one unit to another; by those of the FMUs, else those of the system.

    Raises InputError for units of different quantities.
    """
    one, other = (
        units_of(system.components[_parts(name)[0]].units).get(unit) or units.get(unit)
        for name, unit in ((start, first), (end, last))
    )
    about = f"{start} [{first}] and {end} [{last}]"
    return _conversion(one, other, (first, last), about, "the connection a linear transformation or")


def _conversion(
    one: Unit | None, other: Unit | None, names: tuple[str, str], about: str, remedy: str
) -> Linear:
    if names[0] == names[1] or not all(names):
        return IDENTITY
    if one is None or other is None:
        raise InputError(
            f"{about}: the unit {names[0] if one is None else names[1]} is not defined, so that it cannot be "
            f"converted; give {remedy} suppressUnitConversion"
        )
    if one.exponents != other.exponents:
        raise InputError(f"{about}: these units are of different quantities")
    return Linear(one.factor / other.factor, (one.offset - other.offset) / other.factor)


def _from_set(name: str, parameter: Parameter, unit: str, units: Mapping[str, Unit | None]) -> Linear:
    """Return the conversion of a value of a parameter set to the unit of its variable."""
    about = f"{name} [{unit}]: a value in {parameter.unit}"
    base = parameter.base or units.get(parameter.unit)
    return _conversion(
        base, units.get(unit), (parameter.unit, unit), about, "an entry of a parameter mapping"
    )


def _starts(
    file: Path, archive: zipfile.ZipFile, system: System, elements: list[ET.Element]
) -> dict[str, Any]:
    """Return the values of all parameter sets, those of the system after those of its components.

    As SSP has it: the later one of two values counts, and names without a variable are ignored.
    """
    starts: dict[str, Any] = {}
    unknown: dict[str, None] = {}
    for element in elements:
        prefix = "" if element.tag == f"{SSD}System" else f"{element.get('name')}."
        for name, given, entry in bindings(element, partial(_parsed, file, archive)):
            full = f"{prefix}{name}"
            component, variable = _parts(full)
            known = system.components.get(component)
            if known is None or variable not in known.variables:
                unknown[full] = None
                continue
            convert = partial(_from_set, full, given, known.variables[variable].unit, known.units)
            starts[full] = start_value(full, known.variables[variable], given, entry, convert)
    if unknown:
        names = ", ".join(list(unknown)[:_SHOWN_NAMES]) + (", .." if len(unknown) > _SHOWN_NAMES else "")
        warn_once(f"{file}: parameter sets have values for {names}, which are no variables: ignored")
    return starts


def _flat(file: Path, system: System) -> Description:
    """Return a system as if it was one FMU."""
    ends = {connection.end for connection in system.connections}
    variables = {}
    for component, known in system.components.items():
        for name, variable in known.variables.items():
            full = f"{component}.{name}"
            causality = "local" if (component, name) in ends else variable.causality
            start = system.starts.get(full, variable.start)
            elements = tuple(f"{component}.{element}" for element in variable.elements)
            variables[full] = replace(
                variable, name=full, causality=causality, start=start, elements=elements
            )
    every = list(system.components.values())
    missing = [description for description in every if not runs_here(description)]
    sizes = {description.step_size for description in every if description.step_size is not None}
    stops = [time for time in map(stop_time, every) if time is not None]
    return Description(
        version=VERSION,
        identifier=system.name,
        token=str(file),
        variables=variables,
        start_time=every[0].start_time if system.start_time is None else system.start_time,
        stop_time=min(stops, default=None) if system.stop_time is None else system.stop_time,
        step_size=max(sizes, default=None),
        tolerance=None,
        only_once=any(description.only_once for description in every),
        platforms=missing[0].platforms if missing else place(),
        units={},
    )
