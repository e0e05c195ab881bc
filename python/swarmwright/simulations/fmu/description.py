"""Descriptions of FMUs: variables, their types and values, and the layout of FMUs of whole swarms.

The latter have variables `agent[1].NAME`, `agent[2].NAME`, .., as `export-fmu` writes them.
"""

import importlib.util
import itertools
import math
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from swarmwright.common import archives, xml
from swarmwright.common.errors import InputError, describe_exception
from swarmwright.common.ranges import Range
from swarmwright.common.temporary import TemporaryFolder

_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Unit:
    """A unit, defined by SI base units."""

    exponents: tuple[int, ...]
    """Exponents of kg, m, s, A, K, mol, cd, rad."""
    factor: float = 1.0
    offset: float = 0.0

    @classmethod
    def parse(cls, base: Any) -> "Unit | None":  # noqa: ANN401 - an element or FMPy's object
        """Return the unit of a BaseUnit of XML or FMPy; None for None."""
        if base is None:
            return None
        get = base.get if hasattr(base, "get") else lambda name, default: getattr(base, name, default)
        return cls(
            tuple(int(get(name, 0) or 0) for name in _BASE),
            float(get("factor", 1.0) or 1.0),
            float(get("offset", 0.0) or 0.0),
        )

    def attributes(self) -> dict[str, str]:
        """Return the attributes of a BaseUnit that differ from the defaults."""
        exponents = zip(_BASE, self.exponents, strict=True)
        attributes = {name: str(exponent) for name, exponent in exponents if exponent}
        attributes |= {"factor": repr(self.factor)} if self.factor != 1.0 else {}
        return attributes | ({"offset": repr(self.offset)} if self.offset else {})


def get_defined_units(units: Mapping[str, Unit | None]) -> dict[str, Unit]:
    """Return the units that are defined by SI base units."""
    return {name: unit for name, unit in units.items() if unit is not None}


class Conversions(Mapping[str, Mapping[str, tuple[float, float]]]):
    """Mapping unit -> other unit -> factor and offset of the conversion.

    A unit is converted to its display units, and to units of the same SI base units and their display units.
    FMI 3.0, section 2.4.4: base = factor unit + offset; display unit = factor unit + offset.

    Conversions of a unit are computed on access, as their total number is quadratic.

    Args:
        units: unit definitions, as read by FMPy.
        inverse: display units that are left out because they are reciprocals.
    """

    def __init__(self, units: Sequence[Any], inverse: set[str]) -> None:
        self._units, self._inverse = {unit.name: unit for unit in units}, inverse
        self._bases = {unit.name: Unit.parse(unit.baseUnit) for unit in units}

    def __getitem__(self, unit: str) -> Mapping[str, tuple[float, float]]:
        """Return the units that a unit can be converted to, with factor and offset."""
        source, base = self._units[unit], self._bases[unit]
        conversions = {unit: (1.0, 0.0)}
        for target in self._units.values():
            target_base = self._bases[target.name]
            if (
                target is source
                or base is None
                or target_base is None
                or base.exponents != target_base.exponents
            ):
                continue
            # By way of the value in base units.
            factor, offset = (
                base.factor / target_base.factor,
                (base.offset - target_base.offset) / target_base.factor,
            )
            conversions[target.name] = (factor, offset)
            for display_unit in target.displayUnits:
                conversions.setdefault(display_unit.name, _compose((factor, offset), display_unit))
        # The unit's own definitions take precedence over those by way of other units.
        conversions.update(
            {display_unit.name: _compose((1.0, 0.0), display_unit) for display_unit in source.displayUnits}
        )
        return {name: conversion for name, conversion in conversions.items() if name not in self._inverse}

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the units."""
        return iter(self._units)

    def __len__(self) -> int:
        """Return the number of units."""
        return len(self._units)


def _compose(conversion: tuple[float, float], display_unit: Any) -> tuple[float, float]:  # noqa: ANN401 - FMPy has no types
    factor = float(display_unit.factor)
    return conversion[0] * factor, conversion[1] * factor + float(display_unit.offset)


def find_inverse_units(description: bytes) -> set[str]:
    """Return the names of display units (FMI 3.0) that are reciprocals, which FMPy does not report."""
    root = ET.fromstring(description)  # noqa: S314 - expat limits entities
    return {
        element.get("name", "")
        for element in root.iter("DisplayUnit")
        if element.get("inverse") in ("true", "1")
    }


AGENT = "{agent}"
"""Stands for an agent's number, from 1, in names of variables."""
_AGENT_VARIABLE = re.compile(r"agent\[(\d{1,9})\]\.(.+)")
_ACTS = "acts"
_METRICS = "metrics."


@dataclass(frozen=True)
class Layout:
    """Roles of the variables of an FMU of a whole swarm."""

    agents: int
    sensors: list[str]
    """Names with {agent}."""
    actuators: list[str]
    """Names with {agent}."""
    acts: str | None
    """The output that tells whether an agent acts, with {agent}; None if all always act."""
    metrics: Mapping[str, str]
    """Metric -> its variable."""
    fitness: str | None
    """The output with the fitness."""
    done: str | None
    """The output that tells whether the episode has ended."""


def find_layout(description: "Description") -> Layout | None:
    """Return the layout of an FMU of a whole swarm; None for other FMUs."""
    outputs, inputs = (
        [variable.name for variable in description.get_variables(causality)]
        for causality in ("output", "input")
    )
    numbers = {int(match[1]) for match in map(_AGENT_VARIABLE.fullmatch, outputs) if match is not None}
    agents = next(number for number in range(1, len(numbers) + 2) if number not in numbers) - 1
    if not agents:
        return None
    sensors, actuators = (_list_first_agent(names) for names in (outputs, inputs))
    variables = description.variables
    return Layout(
        agents,
        [f"agent[{AGENT}].{name}" for name in sensors if name != _ACTS],
        [f"agent[{AGENT}].{name}" for name in actuators],
        f"agent[{AGENT}].{_ACTS}" if _ACTS in sensors else None,
        {name.removeprefix(_METRICS): name for name in outputs if name.startswith(_METRICS)},
        "fitness" if "fitness" in outputs else None,
        "done" if "done" in outputs and variables["done"].type == "Boolean" else None,
    )


def get_stop_time(description: "Description") -> float | None:
    """Return the stop time of an FMU; None if the length of its episodes is not fixed.

    The stop time of an exported simulation with an output `done` depends on its parameters at the export.
    """
    swarm_layout = find_layout(description) if description.is_exported else None
    return description.stop_time if swarm_layout is None or swarm_layout.done is None else None


def _list_first_agent(names: list[str]) -> list[str]:
    matches = map(_AGENT_VARIABLE.fullmatch, names)
    return [match[2] for match in matches if match is not None and match[1] == "1"]


_REALS = ("Real", "Float32", "Float64")
INTEGERS = (
    "Integer", "Enumeration", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64",
)  # fmt: skip
_NUMBERS = (*_REALS, *INTEGERS, "Boolean")
VERSIONS = ("2.0", "3.0")
TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
STRUCTURAL = "structuralParameter"
"""The causality of parameters of FMI 3.0 that determine the sizes of arrays."""
RANGE = "swarmwright.range"
"""The annotation of a scaled variable, the values of -1 and 1: `<Range low=".." high=".." unit=".."/>`."""
_DESCRIPTION = "modelDescription.xml"
_LARGEST_XML_BYTES = 1 << 26
_MOST_NODES = 1_000_000
"""Largest number of elements and attributes of an XML file, each of which takes about 500 bytes in memory."""
_DEEPEST_NESTING = 200
_MOST_ELEMENTS = 10_000
"""Largest number of elements of an array variable."""
_MOST_VARIABLES = 500_000
"""Largest number of variables, including elements of arrays."""
_MOST_FAULTS = 300
"""Largest number of characters of a library's message about an invalid file."""


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU."""

    name: str
    reference: int
    type: str
    """Type in modelDescription.xml: Real, Integer, Boolean, .. of FMI 2.0, Float64, Int32, .. of FMI 3.0."""
    causality: str
    """parameter, input, output, local, .."""
    start: Any
    """A number, a boolean or text; None if undefined."""
    unit: str
    minimum: float | None
    maximum: float | None
    is_array: bool
    shape: tuple[int, ...] = ()
    """For an array: its shape."""
    elements: tuple[str, ...] = ()
    """For an array of numbers: the names of its elements, such as x[1] or x[2,1], which are variables,
    too."""
    index: int = 0
    """For an element: its index in the array, row by row."""
    count: int = 1
    """For an element: the number of elements of the array."""
    items: tuple[int, ...] = ()
    """For an enumeration: its values."""
    labels: tuple[str, ...] = ()
    """For an enumeration: the names of its values, in the same order."""
    stands_for: Range | None = None
    """For a scaled variable of an exported FMU: the values that -1 and 1 stand for."""

    @property
    def is_number(self) -> bool:
        """Whether the variable is a single number or boolean."""
        return not self.is_array and self.type in _NUMBERS

    @property
    def is_real(self) -> bool:
        """Whether the variable may have a fraction."""
        return self.type in _REALS


@dataclass(frozen=True)
class Exchange:
    """Properties of an FMU for model exchange, whose equations a solver integrates."""

    identifier: str
    """Name of the library."""
    states: int
    """Number of continuous states."""
    indicators: int
    """Number of event indicators."""
    completes: bool
    """Whether the FMU must be notified of completed solver steps."""


@dataclass(frozen=True)
class Description:
    """An FMU for co-simulation, model exchange, or both."""

    version: str
    """2.0 or 3.0."""
    identifier: str
    """Name of the library for co-simulation; empty if not supported."""
    token: str
    """The GUID, or instantiation token."""
    variables: Mapping[str, Variable]
    start_time: float
    stop_time: float | None
    step_size: float | None
    tolerance: float | None
    """Relative tolerance that the FMU recommends for solvers."""
    only_once: bool
    """Whether a process can have only a single instance."""
    platforms: tuple[str, ...]
    """Platforms of its libraries, named like their folders: linux64, x86_64-linux, .."""
    units: Mapping[str, Unit | None] = field(default_factory=dict)
    """Units by name; None for units without a definition by SI base units."""
    conversions: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    """Unit -> other unit -> factor and offset of the conversion."""
    exchange: Exchange | None = None
    """Properties for model exchange; None if not supported."""
    terminals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Terminal (FMI 3.0) -> its variables; nested terminals have qualified names, such as robot.wheels."""
    is_exported: bool = False
    """Whether Swarmwright wrote it."""

    def get_variables(self, causality: str) -> list[Variable]:
        """Return the numeric variables of a causality."""
        return [
            variable
            for variable in self.variables.values()
            if variable.causality == causality and variable.is_number
        ]


def flatten(values: Any) -> list[Any]:  # noqa: ANN401 - a list, or lists in it
    """Return the values of nested lists, row by row."""
    return [item for part in values for item in flatten(part)] if isinstance(values, list) else [values]


def is_installed() -> bool:
    """Return whether FMPy is installed."""
    return importlib.util.find_spec("fmpy") is not None


NEEDS = "FMUs need FMPy, which is not installed; pip install 'swarmwright[fmi]'"


def describe(file: Path, start: Mapping[str, Any] | None = None) -> Description:
    """Return the description of an FMU; structural parameters in `start` set the sizes of arrays.

    Raises InputError if the file is not an FMU that can be stepped.
    """
    try:
        changed = file.stat().st_mtime_ns
    except OSError:
        raise InputError(f"{file}: there is no such file") from None
    sizes = ((name, value) for name, value in (start or {}).items() if type(value) is int and value > 0)
    return _describe(file, changed, tuple(sorted(sizes)))


def describe_for_coupling(file: Path) -> Description:
    """Return the description of an FMU for an SSP. Raises InputError unless it supports co-simulation."""
    description = describe(file)
    if not description.identifier:
        raise InputError(f"{file}: supports only model exchange; to couple it, export it for co-simulation")
    return description


@lru_cache(maxsize=16)
def _describe(file: Path, _changed: int, parameters: tuple[tuple[str, int], ...]) -> Description:
    if not is_installed():
        raise InputError(NEEDS)
    try:
        with archives.open_archive(file, "an FMU") as archive:
            paths = [Path(name).parts for name in archive.namelist()]
            text = read_xml(archive, file, _DESCRIPTION)
            model = _read_with_fmpy(text)
            _add_limits(model.modelVariables, text)
            ranges = _ranges(text)
            inverse = find_inverse_units(text)
            has_terminals = TERMINALS in archive.namelist()
            terminals = parse_terminals(read_xml(archive, file, TERMINALS)) if has_terminals else {}
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a broken file leads to
        raise InputError(f"{file}: is not an FMU: {describe_exception(error)[:_MOST_FAULTS]}") from None
    version = next((supported for supported in VERSIONS if str(model.fmiVersion).startswith(supported)), None)
    if version is None:
        raise InputError(
            f"{file}: is an FMU of FMI {model.fmiVersion}, which is not supported; export it for FMI "
            f"{' or '.join(VERSIONS)}"
        )
    if model.coSimulation is None and model.modelExchange is None:
        raise InputError(
            f"{file}: supports only scheduled execution; export it for co-simulation or model exchange"
        )
    experiment = model.defaultExperiment
    try:
        sizes = dict(parameters)
        variables: dict[str, Variable] = {}
        types: dict[int, tuple[tuple[int, ...], tuple[str, ...]]] = {}
        for variable in model.modelVariables:
            for element in _iterate_elements(variable, sizes, types):
                variables[element.name] = replace(element, stands_for=ranges.get(element.name))
            if len(variables) > _MOST_VARIABLES:
                raise ValueError(f"has more than {_MOST_VARIABLES:,} variables and elements of arrays")
        exchange = _exchange(model)
        times = {
            key: None if experiment is None else _number(getattr(experiment, key))
            for key in ("startTime", "stopTime", "stepSize", "tolerance")
        }
    except ValueError as error:
        raise InputError(f"{file}: modelDescription.xml: {error}") from None
    return Description(
        version,
        "" if model.coSimulation is None else model.coSimulation.modelIdentifier,
        model.guid,
        variables,
        times["startTime"] or 0.0,
        times["stopTime"],
        times["stepSize"] or None,
        times["tolerance"] or None,
        bool((model.coSimulation or model.modelExchange).canBeInstantiatedOnlyOncePerProcess),
        tuple(sorted({parts[1] for parts in paths if len(parts) > 2 and parts[0] == "binaries"})),
        {
            unitDefinition.name: Unit.parse(unitDefinition.baseUnit)
            for unitDefinition in model.unitDefinitions
        },
        Conversions(model.unitDefinitions, inverse),
        exchange,
        terminals,
        (model.generationTool or "").startswith("Swarmwright "),
    )


def read_xml(archive: zipfile.ZipFile, file: Path, name: str) -> bytes:
    """Return an XML file in an archive, after checking that it is safe for parsers that build a tree.

    Raises InputError if it is missing, not valid, too large, or uses DTD declarations.
    """
    data = archives.read_entry(archive, file, name, _LARGEST_XML_BYTES)
    xml.check(data, f"{file}: {name}", _MOST_NODES, _DEEPEST_NESTING)
    return data


def _read_with_fmpy(text: bytes) -> Any:  # noqa: ANN401 - FMPy has no types
    """Read a checked model description with FMPy."""
    from fmpy import read_model_description  # noqa: PLC0415 - optional

    with TemporaryFolder("fmu") as folder:
        (folder / _DESCRIPTION).write_bytes(text)
        return read_model_description(str(folder), validate=False)


def _add_limits(variables: Any, text: bytes) -> None:  # noqa: ANN401 - FMPy has no types
    """Add min and max to unsigned integers of FMI 3.0, which FMPy reads only for other types."""
    root = ET.fromstring(text)  # noqa: S314 - expat limits entities
    unsigned = {
        element.get("name"): element
        for element in root.iterfind("ModelVariables/*")
        if element.tag.startswith("UInt")
    }
    for variable in variables:
        if variable.name in unsigned:
            variable.min, variable.max = (
                unsigned[variable.name].get("min"),
                unsigned[variable.name].get("max"),
            )


def _ranges(text: bytes) -> dict[str, Range]:
    """Return the ranges of scaled variables, see `RANGE`. Raises ValueError for an invalid range."""
    root = ET.fromstring(text)  # noqa: S314 - expat limits entities
    return {
        variable.get("name", ""): ranges
        for variable in root.iterfind("ModelVariables/*")
        for annotation in variable.iterfind("Annotations/*")
        if RANGE in (annotation.get("name"), annotation.get("type"))
        for element in annotation.iterfind("Range")
        if (
            ranges := Range.parse(
                (float(element.get("low", "")), float(element.get("high", "")), element.get("unit", ""))
            )
        )
    }


def _exchange(model: Any) -> Exchange | None:  # noqa: ANN401 - FMPy has no types
    if model.modelExchange is None:
        return None
    return Exchange(
        model.modelExchange.modelIdentifier,
        int(model.numberOfContinuousStates or 0),
        int(model.numberOfEventIndicators or 0),
        bool(model.modelExchange.needsCompletedIntegratorStep),
    )


def _iterate_elements(
    variable: Any,  # noqa: ANN401 - FMPy has no types
    parameters: Mapping[str, int],
    types: dict[int, tuple[tuple[int, ...], tuple[str, ...]]],
) -> Iterator[Variable]:
    """Yield a variable and, for an array of numbers, its elements; parameters: values by name."""
    sizes = tuple(
        int(
            dimension.start
            if dimension.variable is None
            else parameters.get(dimension.variable.name, dimension.variable.start)
        )
        for dimension in variable.dimensions or ()
    )
    whole = replace(_variable(variable, types), shape=sizes)
    count = math.prod(sizes)
    if not whole.is_array or whole.type not in _NUMBERS or not 0 < count <= _MOST_ELEMENTS:
        yield whole
        return
    positions = itertools.product(*(range(1, size + 1) for size in sizes))
    names = tuple(f"{whole.name}[{','.join(map(str, get_platforms))}]" for get_platforms in positions)
    yield replace(whole, elements=names)
    for index, name in enumerate(names):
        yield replace(whole, name=name, is_array=False, shape=(), index=index, count=count)


def _variable(
    variable: Any,  # noqa: ANN401 - FMPy has no types
    types: dict[int, tuple[tuple[int, ...], tuple[str, ...]]],
) -> Variable:
    unit = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
    low, high = (
        getattr(variable, name)
        if getattr(variable, name) is not None
        else getattr(variable.declaredType, name, None)
        for name in ("min", "max")
    )
    items, labels = _items(variable, types)
    if items:  # the default range of an actuator
        low, high = (
            limit if declared_limit is None else declared_limit
            for declared_limit, limit in ((low, items[0]), (high, items[-1]))
        )
    elif variable.type.startswith("UInt") and high is not None:
        low = low or "0"
    is_array = bool(variable.dimensions)
    start = None if is_array else _start(variable.type, variable.start)
    return Variable(
        variable.name,
        int(variable.valueReference),
        variable.type,
        variable.causality,
        start,
        unit or "",
        _number(low),
        _number(high),
        is_array,
        items=items,
        labels=labels,
    )


def _items(
    variable: Any,  # noqa: ANN401 - FMPy has no types
    types: dict[int, tuple[tuple[int, ...], tuple[str, ...]]],
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return values and names of an enumeration, in the order of the values; empty if it defines none.

    types: cache by type, as thousands of variables may share a type.
    """
    declared = variable.declaredType
    if variable.type != "Enumeration" or declared is None:
        return (), ()
    if id(declared) not in types:
        listed = [(item.value, item.name) for item in declared.items]
        if any(value is None for value, _ in listed):  # FMI requires values, but FMPy does not check
            listed = []
        pairs = sorted((int(value), name) for value, name in listed)
        types[id(declared)] = tuple(value for value, _ in pairs), tuple(name for _, name in pairs)
    return types[id(declared)]


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


def get_platforms() -> tuple[str, str]:
    """Return the names of this platform in FMI 2.0 and FMI 3.0."""
    import fmpy  # noqa: PLC0415 - optional

    return fmpy.platform, fmpy.platform_tuple


def has_library(description: Description) -> bool:
    """Return whether an FMU has a library for this platform."""
    return not set(get_platforms()).isdisjoint(description.platforms)


def parse_terminals(text: bytes) -> Mapping[str, tuple[str, ...]]:
    """Return the variables of each terminal, in order (FMI 3.0, section 2.4.9).

    Variables of nested terminals, with names such as robot.wheels, also belong to the outer terminal. Raises
    ET.ParseError for text that is not XML.
    """
    root = ET.fromstring(text)  # noqa: S314 - expat limits entities
    return {
        name: tuple(members)
        for element in root.findall("Terminals/Terminal")
        for name, members in _terminals_in(element, "")
    }


def _terminals_in(terminal: ET.Element, above: str) -> Iterator[tuple[str, list[str]]]:
    name = f"{above}{terminal.get('name', '')}"
    members = []
    for element in terminal:
        if element.tag == "TerminalMemberVariable":
            members.append(element.get("variableName", ""))
        elif element.tag == "Terminal":
            for inner, variables in _terminals_in(element, f"{name}."):
                if "." not in inner[len(name) + 1 :]:
                    members += variables
                yield inner, variables
    yield name, members


_SEEDS = 2**31
_WIDTHS = {"Int8": 8, "Int16": 16, "Int32": 32, "Int64": 64, "Integer": 32, "Enumeration": 32}
_SIGNED = {kind: (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for kind, bits in _WIDTHS.items()}
_UNSIGNED = {f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)}
_LIMITS: Mapping[str, tuple[int, int]] = {**_SIGNED, **_UNSIGNED}
_MOST_ITEMS = 20
"""Largest number of items of an enumeration in a message."""


def get_limits(variable: Variable) -> tuple[int, int] | None:
    """Return the lowest and the highest value of an integer or enumeration; None for other types."""
    if variable.items:
        return min(variable.items), max(variable.items)
    return _LIMITS.get(variable.type)


def is_unsigned(variable: Variable) -> bool:
    """Return whether a variable is an integer that cannot be negative."""
    return variable.type in _UNSIGNED


def describe_expected(variable: Variable) -> str | None:
    """Return a description of the possible values; None if the variable cannot be set."""
    bounds = get_limits(variable)
    if variable.items:
        items = [str(item) for item in sorted(variable.items)]
        return f"one of {', '.join(items[:_MOST_ITEMS])}{', ..' if len(items) > _MOST_ITEMS else ''}"
    if bounds is not None:
        return f"an integer from {bounds[0]} to {bounds[1]}"
    return {"Boolean": "true or false", "String": "a string"}.get(
        variable.type, "a number" if variable.is_real else None
    )


def fits(variable: Variable, value: Any) -> bool:  # noqa: ANN401 - any value of a file
    """Return whether a value has a variable's type and is within its limits; 0 and 1 are booleans, too."""
    if variable.type == "String":
        return isinstance(value, str)
    if variable.type == "Boolean":
        return isinstance(value, bool) or (isinstance(value, int) and value in (0, 1))
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    if variable.is_real:
        return _is_finite(value)
    bounds = get_limits(variable)
    if bounds is None or value != value // 1:  # NaN and infinities are not equal to their integer part
        return False
    return value in variable.items if variable.items else bounds[0] <= value <= bounds[1]


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond binary64
        return False


def convert_native(variable: Variable, value: Any) -> Any:  # noqa: ANN401 - a number, boolean or text
    """Convert a value for FMPy: round integers, and clip them to their limits, beyond which C wraps."""
    if variable.type == "Boolean":
        return bool(value)
    bounds = get_limits(variable)
    return value if bounds is None else round(min(max(value, bounds[0]), bounds[1]))


def convert_actuator(variable: Variable, share: float, value: float) -> float:
    """Convert an actuator to the value of its variable.

    share: the actuator, -1 to 1. value: the same in the range and unit of the variable. A boolean is true
    above the middle, and an enumeration has its nearest item.
    """
    if variable.type == "Boolean":
        return float(share > 0.0)
    if variable.items:
        return min(variable.items, key=lambda item: abs(item - value))
    return value


def reduce_seed(variable: Variable, seed: int) -> int:
    """Reduce an episode's seed for a variable: modulo 2^31, or modulo its type's number of values from 0."""
    if variable.type == "UInt64":
        return seed
    bounds = get_limits(variable)
    return seed % (_SEEDS if bounds is None else min(_SEEDS, bounds[1] + 1))


def takes_seeds(variable: Variable) -> bool:
    """Return whether a variable can receive an episode's seed: a number, but not a boolean or enumeration."""
    return variable.is_number and variable.type not in ("Boolean", "Enumeration")
