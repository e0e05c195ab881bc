"""Systems of FMUs: System Structure and Parameterization (SSP) 1.0, files `.ssp`.

Supported are connections with linear transformations or tables of values, and parameter sets with mappings.
"""

import io
import math
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    Unit,
    Variable,
    describe_expected,
    describe_for_coupling,
    fits,
    get_defined_units,
    get_platforms,
    get_stop_time,
    has_library,
    read_xml,
)

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
_SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
_SSM = "{http://ssp-standard.org/SSP1/SystemStructureParameterMapping}"
_KINDS = ("Real", "Integer", "Boolean", "String", "Enumeration")
_TYPES = {
    "ParameterBinding": "application/x-ssp-parameter-set",
    "ParameterMapping": "application/x-ssp-parameter-mapping",
}

Read = Callable[[str, str], ET.Element]
"""Called with the name of a file in the SSP and of its XML schema; returns its root element."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a parameter set."""

    kind: str
    text: str
    unit: str
    base: Unit | None
    """The unit, if the set defines it."""


def bindings(element: ET.Element, read: Read) -> Iterator[tuple[str, Parameter, ET.Element | None]]:
    """Yield the name of a variable, its parameter, and its mapping entry or None.

    Later parameters replace earlier ones. With a mapping, parameters that it does not name are left out.

    Args:
        element: a system or a component.
        read: see `Read`.

    Raises InputError for sources that are not supported.
    """
    for binding in element.iterfind(f"{SSD}ParameterBindings/{SSD}ParameterBinding"):
        prefix = binding.get("prefix", "")
        parameters = {f"{prefix}{name}": parameter for name, parameter in _parameters(binding, read)}
        mapping = binding.find(f"{SSD}ParameterMapping")
        if mapping is None:
            yield from ((name, parameter, None) for name, parameter in parameters.items())
            continue
        root = _read_source(mapping, read, f"{_SSM}ParameterMapping", "SystemStructureParameterMapping.xsd")
        for entry in () if root is None else root.iterfind(f"{_SSM}MappingEntry"):
            if entry.get("source") in parameters:
                yield entry.get("target", ""), parameters[entry.get("source", "")], entry


def _parameters(binding: ET.Element, read: Read) -> Iterator[tuple[str, Parameter]]:
    root = _read_source(binding, read, f"{_SSV}ParameterSet", "SystemStructureParameterValues.xsd")
    if root is None:
        return
    units = {
        element.get("name", ""): Unit.parse(element.find(f"{SSC}BaseUnit"))
        for element in root.iterfind(f"{_SSV}Units/{SSC}Unit")
    }
    for element in root.iterfind(f"{_SSV}Parameters/{_SSV}Parameter"):
        name = element.get("name", "")
        kind, value = next(
            ((kind, child) for kind in _KINDS if (child := element.find(f"{_SSV}{kind}")) is not None),
            ("", None),
        )
        if value is None:
            raise InputError(f"parameter {name}: is not of the type {', '.join(_KINDS)}")
        unit = value.get("unit", "")
        yield name, Parameter(kind, value.get("value", ""), unit, units.get(unit))


def _read_source(element: ET.Element, read: Read, root: str, schema: str) -> ET.Element | None:
    """Return the content of a binding or mapping, inline or in a file; None if there is none."""
    tag = element.tag.removeprefix(SSD)
    kind, source = element.get("type"), element.get("source")
    if kind not in (None, _TYPES[tag]):
        raise InputError(f"{tag}: the type {kind} is not supported, expected {_TYPES[tag]}")
    if element.get("sourceBase", "SSD") != "SSD":
        raise InputError(
            f"{tag} {source}: files inside components (sourceBase) are not supported; move it to the SSP"
        )
    if source:
        return read(source, schema)
    inline = element.find(f"{SSD}ParameterValues") if tag == "ParameterBinding" else element
    return None if inline is None else inline.find(root)


def start_value(
    name: str,
    variable: Variable,
    parameter: Parameter,
    entry: ET.Element | None,
    units: "Callable[[], Linear]",
) -> Any:  # noqa: ANN401 - of the type of the variable
    """Return the value that a parameter sets. Raises InputError if the variable cannot have it.

    Args:
        name: name of the variable, `component.variable`.
        variable: the variable.
        parameter: the parameter.
        entry: entry of a parameter mapping, if any.
        units: returns the conversion to the variable's unit.
    """
    if variable.type == "String":
        return parameter.text
    keeps_unit = entry is not None and entry.get("suppressUnitConversion") in ("true", "1")
    to_unit = units() if variable.is_real and not keeps_unit else IDENTITY
    linear = (parse_linear(entry) if entry is not None else None) or IDENTITY
    table = None if entry is None else parse_table(entry, None, variable, name)
    value = _parse_parameter(name, variable, parameter)
    changed = linear(to_unit(value))
    changed = changed if table is None else table(changed)
    if variable.type in INTEGERS and changed == changed // 1:
        changed = int(changed)
    if not fits(variable, changed):
        raise InputError(
            f"{name}: the value {parameter.text!r} is not of the type {variable.type}, expected "
            f"{describe_expected(variable)}"
        )
    return changed


def _parse_parameter(name: str, variable: Variable, parameter: Parameter) -> Any:  # noqa: ANN401 - as above
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
"""Booleans in XML."""
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

    def compose(self, first: "Linear") -> "Linear":
        """Return the composition of `first` and then this."""
        return Linear(self.factor * first.factor, self.factor * first.offset + self.offset)


@dataclass(frozen=True)
class Table:
    """A table of values and their results; other values stay unchanged."""

    entries: Mapping[float, float]

    def __call__(self, value: float) -> float:
        """Return the transformed value."""
        return self.entries.get(value, value)


Transformation = Linear | Table
IDENTITY = Linear()


def parse_linear(element: ET.Element) -> Linear | None:
    """Return the linear transformation of a connection or mapping entry; None without one."""
    transformation = element.find(f"{SSC}{_LINEAR}")
    if transformation is None:
        return None
    return Linear(float(transformation.get("factor", "1")), float(transformation.get("offset", "0")))


def parse_table(element: ET.Element, source: Variable | None, target: Variable, label: str) -> Table | None:
    """Return the mapping transformation of a connection or mapping entry; None without one.

    SSP, section "Transformation Choice": entries are unambiguous, and their targets are values of the target.

    Args:
        element: the connection or mapping entry.
        source: the variable at the start of a connection; None for a parameter, whose type is the target's.
        target: the variable that receives the values.
        label: beginning of messages.

    Raises InputError if it does not fit the types, has two entries for the same value, or results in a value
    that the target cannot have.
    """
    candidates = [(kind, element.find(f"{SSC}{kind}")) for kind in (_BOOLEAN, _INTEGER, _ENUMERATION)]
    kind, transformation = next(
        ((kind, candidate) for kind, candidate in candidates if candidate is not None), ("", None)
    )
    if transformation is None:
        return None
    allowed = {
        _BOOLEAN: ("Boolean",),
        _INTEGER: INTEGERS,
        _ENUMERATION: ("Enumeration",),
    }[kind]
    for variable in (target,) if source is None else (source, target):
        if variable.type not in allowed:
            raise InputError(
                f"{label}: {kind} is for variables of the type {' or '.join(allowed[:2])}, but "
                f"{variable.name} has the type {variable.type}"
            )
    entries: dict[float, float] = {}
    for entry in transformation.iterfind(f"{SSC}MapEntry"):
        words = entry.get("source", ""), entry.get("target", "")
        before = _value(kind, words[0], source or target, label)
        if before in entries:
            raise InputError(f"{label}: the {kind} has two entries with the source {words[0]!r}")
        entries[before] = _value(kind, words[1], target, label)
    table = Table(entries)
    for after in entries.values():
        if not fits(target, after):
            raise InputError(
                f"{label}: the {kind} has the target {after}, but {target.name} is "
                f"{describe_expected(target)}"
            )
    for item, item_label in () if source is None else zip(source.items, source.labels, strict=True):
        if not fits(target, table(item)):
            raise InputError(
                f"{label}: the {kind} keeps {item_label}, {item}, but {target.name} is "
                f"{describe_expected(target)}; add an entry for it"
            )
    return table


def _value(kind: str, word: str, variable: Variable, label: str) -> float:
    """Return the value of an entry."""
    try:
        if kind == _BOOLEAN:
            return BOOLEANS[word]
        if kind == _INTEGER:
            return int(word)
        return variable.items[variable.labels.index(word)]
    except (KeyError, ValueError):
        available = f"; {variable.name} has {', '.join(variable.labels) or 'no named items'}"
        hint = available if kind == _ENUMERATION else ""
        raise InputError(
            f"{label}: the {kind} has an entry with {word!r}, which is not a value{hint}"
        ) from None


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
    """Transformation of the value."""


@dataclass(frozen=True)
class System:
    """The system in an SSP."""

    name: str
    sources: Mapping[str, str]
    """The file of each component in the archive, in the order of the description."""
    components: Mapping[str, Description]
    connections: tuple[Connection, ...]
    starts: Mapping[str, Any]
    """Values of the parameter sets, by `component.variable`."""
    start_time: float | None = None
    """Start time of the default experiment; None without one."""
    stop_time: float | None = None


def describe(file: Path, start: Mapping[str, Any] | None = None) -> Description:
    """Return the description of an FMU or an SSP. Raises InputError if the file is neither.

    Variables of an SSP are named `component.variable`; connected inputs are local. Structural parameters in
    `start` set the sizes of an FMU's arrays.
    """
    return _flatten(file, read_system(file)) if file.suffix == ENDING else fmus.describe(file, start)


def read_system(file: Path) -> System:
    """Return the system in an SSP. Raises InputError."""
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
        root = _read_root(file, archive, STRUCTURE, "SystemStructureDescription.xsd")
        top = root.find(f"{SSD}System")
        assert top is not None  # the schema requires it
        elements = list(top.iterfind(f"{SSD}Elements/*"))
        unsupported = [element.get("name", "") for element in elements if element.tag != f"{SSD}Component"]
        if unsupported:
            raise InputError(
                f"{file}: {STRUCTURE}: {', '.join(unsupported)}: nested systems and signal dictionaries are "
                "not supported; export a single system of components"
            )
        sources = {element.get("name", ""): _source(file, element) for element in elements}
        if not sources:
            raise InputError(f"{file}: {STRUCTURE}: the system has no components")
        system = System(top.get("name") or file.stem, sources, _components(file, sources), (), {})
        experiment = root.find(f"{SSD}DefaultExperiment")
        try:
            system = replace(system, connections=tuple(_connections(system, root)))
            starts = _starts(file, archive, system, [*elements, top])
            times = [_time(experiment, key) for key in ("startTime", "stopTime")]
        except (InputError, ValueError) as error:
            raise InputError(f"{file}: {STRUCTURE}: {error}") from None
    return replace(system, starts=starts, start_time=times[0], stop_time=times[1])


def _time(experiment: ET.Element | None, key: str) -> float | None:
    """Return a time of the default experiment; None without one."""
    text = None if experiment is None else experiment.get(key)
    return None if text is None or not math.isfinite(float(text)) else float(text)


def _components(file: Path, sources: Mapping[str, str]) -> dict[str, Description]:
    """Return the description of each component's FMU."""
    components, sizes = {}, {}
    with TemporaryFolder("ssp") as folder:
        for source in dict.fromkeys(sources.values()):
            fmu = extract(file, source, folder)
            components[source] = fmus.describe_for_coupling(fmu)
            with archives.open_archive(fmu, "an FMU") as archive:
                sizes[source] = fmu.stat().st_size + archives.count_unpacked_bytes(archive)
    # Each component is unpacked separately.
    archives.check_size(
        file, sum(sizes[sizes_of] for sizes_of in sources.values()), "its components unpack to"
    )
    return {name: components[source] for name, source in sources.items()}


def _read_root(file: Path, archive: zipfile.ZipFile, name: str, schema: str) -> ET.Element:
    """Return the root of an XML file of an SSP. Raises InputError unless it is valid by its schema."""
    from fmpy.ssp.ssd import validate_tree  # noqa: PLC0415 - optional
    from lxml import etree  # noqa: PLC0415 - comes with FMPy

    try:
        data = read_xml(archive, file, name)
        validate_tree(etree.fromstring(data), schema)
        return ET.fromstring(data)  # noqa: S314 - it has been checked
    except Exception as error:  # noqa: BLE001 - whatever a broken file leads to
        words = (
            str(error) if isinstance(error, InputError) else f"{file}: {name}: {describe_exception(error)}"
        )
        raise InputError(f"{file}: is not an SSP: {words.removeprefix(f'{file}: ')[:_MOST_FAULTS]}") from None


def extract(file: Path, source: str, folder: Path) -> Path:
    """Extract the FMU of a component from an SSP. Raises InputError if it is missing."""
    with archives.open_archive(file, "an SSP") as archive:
        try:
            return Path(archive.extract(source, folder))
        except (KeyError, OSError, *archives.DAMAGED) as error:
            raise InputError(f"{file}: {source}: cannot be extracted: {describe_exception(error)}") from None


def _source(file: Path, component: ET.Element) -> str:
    source = component.get("source", "")
    if component.get("type") not in _FMU_TYPES or not source.endswith(".fmu"):
        raise InputError(
            f"{file}: {STRUCTURE}: {component.get('name')}: its source is {source or 'missing'}, expected an "
            "FMU in the archive, resources/NAME.fmu"
        )
    return source


def find_variable(system: System, name: str) -> Variable:
    """Return the variable `component.variable`. Raises InputError, with available names."""
    component, _, variable = name.partition(".")
    if component not in system.components:
        names = list(system.components)
        hint = suggest_or_list(component, names)
        raise InputError(f"{name}: there is no component {component!r}{hint}")
    variable_ = system.components[component].variables.get(variable)
    if variable_ is None:
        names = list(system.components[component].variables)
        few = ", ".join(names[:20]) + (", .." if len(names) > 20 else "")
        hint = did_you_mean(variable, names) or f"; available: {few}"
        raise InputError(f"{name}: the FMU of {component} has no variable {variable!r}{hint}")
    return variable_


def check_connection(system: System, start: str, end: str) -> tuple[Variable, Variable]:
    """Return the variables of a connection.

    Raises InputError for an unknown name, a start that is not an output, an end that is not an input, and for
    text and arrays.
    """
    variables = find_variable(system, start), find_variable(system, end)
    for variable, name, causality in zip(variables, (start, end), ("output", "input"), strict=True):
        if variable.causality != causality:
            raise InputError(
                f"{name} has the causality {variable.causality}, expected {causality}; write {causality}s as "
                f"{'the start' if causality == 'output' else 'the end'} of a connection"
            )
        if not variable.is_number:
            kind = "an array" if variable.is_array else f"of the type {variable.type}"
            raise InputError(f"{name} is {kind}; only numbers and booleans can be connected")
    return variables


def _connections(system: System, root: ET.Element) -> Iterator[Connection]:
    units = {
        element.get("name", ""): Unit.parse(element.find(f"{SSC}BaseUnit"))
        for element in root.iterfind(f"{SSD}Units/{SSC}Unit")
    }
    sources: dict[str, str] = {}
    for element in root.iterfind(f"{SSD}System/{SSD}Connections/{SSD}Connection"):
        names = [element.get(f"{side}Element") for side in ("start", "end")]
        if None in names:
            continue  # a connection with the outside of the system, which does not exist
        start, end = (
            f"{element.get(f'{side}Element')}.{element.get(f'{side}Connector')}" for side in ("start", "end")
        )
        if [find_variable(system, name).causality for name in (start, end)] == ["input", "output"]:
            start, end = end, start  # the direction follows from the variables
        check_connection(system, start, end)
        if end in sources:
            raise InputError(f"{end} is connected twice, to {sources[end]} and to {start}")
        sources[end] = start
        ends = _parts(start), _parts(end)
        yield Connection(*ends, _transformation(system, element, ends, units))


def _transformation(
    system: System,
    connection: ET.Element,
    ends: tuple[tuple[str, str], tuple[str, str]],
    units: Mapping[str, Unit | None],
) -> Transformation:
    """Return the transformation of a connection: the conversion of units, then its own."""
    first, last = (system.components[name].variables[variable] for name, variable in ends)
    table = parse_table(connection, first, last, f"the connection from {'.'.join(ends[0])}")
    if table is not None:
        return table
    linear = parse_linear(connection)
    if connection.get("suppressUnitConversion") in ("true", "1"):
        return linear or IDENTITY
    try:
        start, end = (".".join(names) for names in ends)
        unit_conversion = conversion(system, start, end, first.unit, last.unit, units)
    except InputError:
        if linear is None:
            raise
        return linear  # it relates different quantities, such as a current and a force
    return unit_conversion if linear is None else linear.compose(unit_conversion)


def _parts(name: str) -> tuple[str, str]:
    component, _, variable = name.partition(".")
    return component, variable


def conversion(
    system: System, start: str, end: str, first: str, last: str, units: Mapping[str, Unit | None]
) -> Linear:
    """Return the conversion between units, as defined by the FMUs, or else by the system.

    Raises InputError for units of different quantities.
    """
    start_unit, end_unit = (
        get_defined_units(system.components[_parts(name)[0]].units).get(unit) or units.get(unit)
        for name, unit in ((start, first), (end, last))
    )
    about = f"{start} [{first}] and {end} [{last}]"
    return _conversion(
        start_unit, end_unit, (first, last), about, "the connection a linear transformation or"
    )


def _conversion(
    start_unit: Unit | None, end_unit: Unit | None, names: tuple[str, str], about: str, remedy: str
) -> Linear:
    if names[0] == names[1] or not all(names):
        return IDENTITY
    if start_unit is None or end_unit is None:
        raise InputError(
            f"{about}: the unit {names[0] if start_unit is None else names[1]} is not defined, so it cannot "
            f"be converted; give {remedy} suppressUnitConversion"
        )
    if start_unit.exponents != end_unit.exponents:
        raise InputError(f"{about}: these units are of different quantities")
    return Linear(
        start_unit.factor / end_unit.factor, (start_unit.offset - end_unit.offset) / end_unit.factor
    )


def _get_set_conversion(
    name: str, parameter: Parameter, unit: str, units: Mapping[str, Unit | None]
) -> Linear:
    """Return the conversion of a value of a parameter set to the unit of its variable."""
    about = f"{name} [{unit}]: a value in {parameter.unit}"
    base = parameter.base or units.get(parameter.unit)
    return _conversion(
        base, units.get(unit), (parameter.unit, unit), about, "an entry of a parameter mapping"
    )


def _starts(
    file: Path, archive: zipfile.ZipFile, system: System, elements: list[ET.Element]
) -> dict[str, Any]:
    """Return the values of all parameter sets; those of the system override those of its components.

    As SSP requires, later values override earlier ones, and names without a variable are ignored.
    """
    starts: dict[str, Any] = {}
    unknown: dict[str, None] = {}
    for element in elements:
        prefix = "" if element.tag == f"{SSD}System" else f"{element.get('name')}."
        for name, parameter, entry in bindings(element, partial(_read_root, file, archive)):
            full = f"{prefix}{name}"
            component, variable = _parts(full)
            description = system.components.get(component)
            if description is None or variable not in description.variables:
                unknown[full] = None
                continue
            convert = partial(
                _get_set_conversion, full, parameter, description.variables[variable].unit, description.units
            )
            starts[full] = start_value(full, description.variables[variable], parameter, entry, convert)
    if unknown:
        names = ", ".join(list(unknown)[:_SHOWN_NAMES]) + (", .." if len(unknown) > _SHOWN_NAMES else "")
        warn_once(f"{file}: parameter sets have values for {names}, which are not variables and are ignored")
    return starts


def _flatten(file: Path, system: System) -> Description:
    """Return the description of a system as a single FMU."""
    ends = {connection.end for connection in system.connections}
    variables = {}
    for component, description in system.components.items():
        for name, variable in description.variables.items():
            full = f"{component}.{name}"
            causality = "local" if (component, name) in ends else variable.causality
            start = system.starts.get(full, variable.start)
            elements = tuple(f"{component}.{element}" for element in variable.elements)
            variables[full] = replace(
                variable, name=full, causality=causality, start=start, elements=elements
            )
    descriptions = list(system.components.values())
    missing = [description for description in descriptions if not has_library(description)]
    sizes = {description.step_size for description in descriptions if description.step_size is not None}
    stops = [time for time in map(get_stop_time, descriptions) if time is not None]
    return Description(
        version=VERSION,
        identifier=system.name,
        token=str(file),
        variables=variables,
        start_time=descriptions[0].start_time if system.start_time is None else system.start_time,
        stop_time=min(stops, default=None) if system.stop_time is None else system.stop_time,
        step_size=max(sizes, default=None),
        tolerance=None,
        only_once=any(description.only_once for description in descriptions),
        platforms=missing[0].platforms if missing else get_platforms(),
        units={},
    )


_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of all entries, so that the same system always gives the same bytes."""
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_CONNECTORS = {"parameter": "parameter", "input": "input", "output": "output"}


def component_files(words: Sequence[str]) -> dict[str, Path]:
    """Return the file of each component, given as `FILE.fmu`, which is named by its file, or `NAME=FILE.fmu`.

    Raises InputError for duplicate names, and names with other characters than letters, digits and _.
    """
    files: dict[str, Path] = {}
    for word in words:
        name, equals, file = word.partition("=")
        path = Path(file if equals else word)
        name = name if equals else path.stem
        if not _NAME.fullmatch(name):
            raise InputError(
                f"{word}: {name!r} is not a valid name of a component, expected letters, digits and _; "
                f"name it, NAME={path}"
            )
        if name in files:
            raise InputError(f"{word}: a component {name} already exists; write another name, OTHER={path}")
        files[name] = path
    return files


def write_system(
    name: str, files: Mapping[str, Path], connections: Sequence[str]
) -> tuple[bytes, dict[str, str]]:
    """Return an SSP 1.0 of FMUs, always the same bytes for the same FMUs, and a note for scaled connections.

    A variable that Swarmwright exported with a range is scaled to -1 to 1; its connection with a variable in
    physical units receives a linear transformation.

    Args:
        name: name of the system.
        files: file of each component, in the order in which gauss_seidel steps them.
        connections: connections `component.output:component.input`.

    Raises InputError for unknown names, wrong causalities, inputs that are connected twice, and units that
    cannot be converted.
    """
    components = {component: describe_for_coupling(file) for component, file in files.items()}
    system = System(name, {}, components, (), {})
    root = ET.Element(f"{{{_SSD}}}SystemStructureDescription", {"version": "1.0", "name": name})
    top = ET.SubElement(root, f"{{{_SSD}}}System", name=name)
    elements = ET.SubElement(top, f"{{{_SSD}}}Elements")
    for component, description in components.items():
        about = {
            "name": component,
            "source": f"resources/{component}.fmu",
            "type": "application/x-fmu-sharedlibrary",
        }
        component_element = ET.SubElement(elements, f"{{{_SSD}}}Component", about)
        _add_connectors(ET.SubElement(component_element, f"{{{_SSD}}}Connectors"), description)
    scaled: dict[str, str] = {}
    if connections:
        connection_list = ET.SubElement(top, f"{{{_SSD}}}Connections")
        sources: dict[str, str] = {}
        for text in connections:
            start, end = _split_connection(text)
            first, last = check_connection(system, start, end)
            scaling, words = _scaling(system, start, end, first, last)
            if end in sources:
                raise InputError(f"{text}: {end} is already connected to {sources[end]}")
            sources[end] = start
            component_element = ET.SubElement(
                connection_list, f"{{{_SSD}}}Connection", _attributes(start, end)
            )
            if scaling is not None:
                component_element.set("suppressUnitConversion", "true")  # it is part of the transformation
                about = {"factor": repr(scaling[0]), "offset": repr(scaling[1])}
                ET.SubElement(component_element, f"{{{_SSC}}}LinearTransformation", about)
                scaled[text] = words
    _add_units(root, components)
    ET.register_namespace("ssd", _SSD)
    ET.register_namespace("ssc", _SSC)
    ET.indent(root)
    text = f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
    contents = {STRUCTURE: text.encode()}
    contents |= {f"resources/{component}.fmu": file.read_bytes() for component, file in files.items()}
    return _zip_contents(contents), scaled


def _scaling(
    system: System, start: str, end: str, first: Variable, last: Variable
) -> tuple[tuple[float, float] | None, str]:
    """Return factor and offset between a scaled and an unscaled variable, and a note; None for other pairs.

    Raises InputError for units that cannot be converted.
    """
    start_range, end_range = first.stands_for, last.stands_for
    units = [
        variable.unit if range_ is None else range_.unit
        for variable, range_ in ((first, start_range), (last, end_range))
    ]
    unit_conversion = conversion(system, start, end, units[0], units[1], {})
    factor, offset = unit_conversion.factor, unit_conversion.offset
    if start_range == end_range or not (_is_known(first) and _is_known(last)):
        return None, ""
    words = []
    if start_range is not None:
        transform = start_range.to_value
        factor, offset = factor * transform[0], factor * transform[1] + offset
        words.append(f"{start} is {start_range.scaled_words}")
    if end_range is not None:
        transform = end_range.from_value
        factor, offset = factor * transform[0], transform[0] * offset + transform[1]
        words.append(f"{end} is {end_range.scaled_words}")
    return (factor, offset), ", ".join(words)


def _is_known(variable: Variable) -> bool:
    """Return whether it is known if a variable is scaled: by its range, its unit or its limits.

    Other variables may be scaled without declaring it, as in FMUs of other tools.
    """
    limits = variable.minimum, variable.maximum
    return variable.stands_for is not None or bool(variable.unit) or limits not in ((None, None), (-1.0, 1.0))


def _split_connection(text: str) -> tuple[str, str]:
    start, colon, end = text.partition(":")
    if not colon or "." not in start or "." not in end:
        raise InputError(f"{text}: expected COMPONENT.OUTPUT:COMPONENT.INPUT, such as world.x:radio.x")
    return start, end


def _attributes(start: str, end: str) -> dict[str, str]:
    first, last = start.partition("."), end.partition(".")
    return {
        "startElement": first[0],
        "startConnector": first[2],
        "endElement": last[0],
        "endConnector": last[2],
    }


def _add_connectors(parent: ET.Element, description: Description) -> None:
    for variable in description.variables.values():
        if variable.causality not in _CONNECTORS or variable.is_array:
            continue
        connector = ET.SubElement(
            parent, f"{{{_SSD}}}Connector", name=variable.name, kind=_CONNECTORS[variable.causality]
        )
        kind = _type(variable)
        unit = {"unit": variable.unit} if variable.unit and kind == "Real" else {}
        ET.SubElement(connector, f"{{{_SSC}}}{kind}", unit)


def _type(variable: Variable) -> str:
    """Return the type of a connector; enumerations are written as their numbers."""
    if variable.is_real:
        return "Real"
    return variable.type if variable.type in ("Boolean", "String", "Binary") else "Integer"


def _add_units(root: ET.Element, components: Mapping[str, Description]) -> None:
    units: dict[str, Unit] = {}
    for description in components.values():
        units |= get_defined_units(description.units)
    if not units:
        return
    unit_list = ET.SubElement(root, f"{{{_SSD}}}Units")
    for name, unit in sorted(units.items()):
        unit_element = ET.SubElement(unit_list, f"{{{_SSC}}}Unit", name=name)
        ET.SubElement(unit_element, f"{{{_SSC}}}BaseUnit", unit.attributes())


def _zip_contents(contents: Mapping[str, bytes]) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in contents.items():
            info = zipfile.ZipInfo(name, _DATE)
            info.compress_type = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, content)
    return data.getvalue()
