"""What an FMU announces, as far as a simulation needs it.

FMUs of whole swarms: variables named `agent[1].NAME`, `agent[2].NAME`, .., as `export-fmu` writes them.

Values that variables of FMUs can have by their types: whole numbers within limits, booleans, text.
"""

import importlib.util
import itertools
import math
import re
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from swarmwright.common import archives, xml
from swarmwright.common.errors import InputError, describe_exception
from swarmwright.common.ranges import Range
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.simulations.fmu.units import Conversions, Unit, inverse_units

AGENT = "{agent}"
"""Stands for an agent's number, from 1, in names of variables."""
_OF_AGENT = re.compile(r"agent\[(\d{1,9})\]\.(.+)")
_ACTS = "acts"
_METRICS = "metrics."


@dataclass(frozen=True)
class Layout:
    """What the variables of such an FMU are."""

    agents: int
    sensors: list[str]
    """Names with {agent}."""
    actuators: list[str]
    acts: str | None
    """The output that says whether an agent acts, with {agent}; None: all of them always do."""
    metrics: Mapping[str, str]
    """Variable of each metric."""
    fitness: str | None
    """The output that is the fitness."""
    done: str | None
    """The output that says that the episode has ended."""


def layout(description: "Description") -> Layout | None:
    """Return the layout of an FMU; None where its outputs have no names of agents."""
    outputs, inputs = (
        [variable.name for variable in description.of_causality(causality)]
        for causality in ("output", "input")
    )
    numbers = {int(found[1]) for found in map(_OF_AGENT.fullmatch, outputs) if found is not None}
    agents = next(number for number in range(1, len(numbers) + 2) if number not in numbers) - 1
    if not agents:
        return None
    sensors, actuators = (_of_first(names) for names in (outputs, inputs))
    known = description.variables
    return Layout(
        agents,
        [f"agent[{AGENT}].{name}" for name in sensors if name != _ACTS],
        [f"agent[{AGENT}].{name}" for name in actuators],
        f"agent[{AGENT}].{_ACTS}" if _ACTS in sensors else None,
        {name.removeprefix(_METRICS): name for name in outputs if name.startswith(_METRICS)},
        "fitness" if "fitness" in outputs else None,
        "done" if "done" in outputs and known["done"].type == "Boolean" else None,
    )


def stop_time(description: "Description") -> float | None:
    """Return when episodes of an FMU end; None where it does not say so beforehand.

    An exported simulation says it by its output `done`: its stop time is that of the parameters at the
    export, and others can make episodes longer.
    """
    found = layout(description) if description.is_exported else None
    return description.stop_time if found is None or found.done is None else None


def _of_first(names: list[str]) -> list[str]:
    found = map(_OF_AGENT.fullmatch, names)
    return [child[2] for child in found if child is not None and child[1] == "1"]


_REALS = ("Real", "Float32", "Float64")
INTEGERS = (
    "Integer", "Enumeration", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64",
)  # fmt: skip
_NUMBERS = (*_REALS, *INTEGERS, "Boolean")
VERSIONS = ("2.0", "3.0")
TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
STRUCTURAL = "structuralParameter"
"""The causality of parameters of FMI 3.0 that sizes of arrays depend on."""
RANGE = "swarmwright.range"
"""The annotation of a scaled variable: what -1 and 1 stand for, `<Range low=".." high=".." unit=".."/>`."""
_DESCRIPTION = "modelDescription.xml"
_LARGEST_XML_BYTES = 1 << 26
_MOST_NODES = 1_000_000
"""Elements and attributes of an XML file, of which FMPy and this module take about 500 bytes each."""
_DEEPEST_NESTING = 200
_MOST_ELEMENTS = 10_000
"""Of an array variable."""
_MOST_VARIABLES = 500_000
"""With the elements of arrays."""
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
    shape: tuple[int, ...] = ()
    """Of an array: its sizes."""
    elements: tuple[str, ...] = ()
    """Of an array of numbers: the names of these, such as x[1] or x[2,1], which are variables, too."""
    index: int = 0
    """Of an element: its place in the array, row by row."""
    count: int = 1
    """Of an element: how many the array has."""
    items: tuple[int, ...] = ()
    """Of an enumeration: the values that it can have."""
    labels: tuple[str, ...] = ()
    """Of an enumeration: the names of these values, in the same order."""
    stands_for: Range | None = None
    """What -1 and 1 stand for, of a scaled variable of an FMU that Swarmwright exported."""

    @property
    def is_number(self) -> bool:
        """Whether it is one number or boolean."""
        return not self.is_array and self.type in _NUMBERS

    @property
    def is_real(self) -> bool:
        """Whether it may have a fraction."""
        return self.type in _REALS


@dataclass(frozen=True)
class Exchange:
    """What an FMU announces for model exchange, where a solver integrates its equations."""

    identifier: str
    """Of the library."""
    states: int
    indicators: int
    """Event indicators."""
    completes: bool
    """Whether it has to be told when a step of the solver is completed."""


@dataclass(frozen=True)
class Description:
    """An FMU for co-simulation, model exchange, or both."""

    version: str
    """2.0 or 3.0."""
    identifier: str
    """Of the library for co-simulation; empty where it is not for that."""
    token: str
    """The GUID, or instantiation token."""
    variables: Mapping[str, Variable]
    start_time: float
    stop_time: float | None
    step_size: float | None
    tolerance: float | None
    """Relative, that the FMU proposes for solvers."""
    only_once: bool
    """Whether a process can have one instance only."""
    platforms: tuple[str, ...]
    """Those that it has libraries for, as its folders are called: linux64, x86_64-linux, .."""
    units: Mapping[str, Unit | None] = field(default_factory=dict)
    """By name; None for those that are not defined by SI base units."""
    conversions: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    """Unit -> other unit -> factor and offset, by which a value in the one becomes one in the other."""
    exchange: Exchange | None = None
    """For model exchange; None where it is not for that."""
    terminals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Terminal of FMI 3.0 -> its variables; those in others by all names, such as robot.wheels."""
    is_exported: bool = False
    """Whether Swarmwright wrote it."""

    def of_causality(self, causality: str) -> list[Variable]:
        """Return the variables with one number, of a causality."""
        return [
            variable
            for variable in self.variables.values()
            if variable.causality == causality and variable.is_number
        ]


def flat(values: Any) -> list[Any]:  # noqa: ANN401 - a list, or lists in it
    """Return the values of nested lists in their order, row by row."""
    return [item for part in values for item in flat(part)] if isinstance(values, list) else [values]


def is_installed() -> bool:
    """Return whether FMPy is here."""
    return importlib.util.find_spec("fmpy") is not None


NEEDS = "FMUs are read by FMPy: pip install 'swarmwright[fmi]'"


def described(file: Path, start: Mapping[str, Any] | None = None) -> Description:
    """Return what an FMU announces; arrays have the sizes that structural parameters in `start` give them.

    Raises InputError where the file is not one that can be stepped.
    """
    try:
        changed = file.stat().st_mtime_ns
    except OSError:
        raise InputError(f"{file}: there is no such file") from None
    given = ((name, value) for name, value in (start or {}).items() if type(value) is int and value > 0)
    return _described(file, changed, tuple(sorted(given)))


def for_coupling(file: Path) -> Description:
    """Return the same of one to be coupled. Raises InputError unless it is for co-simulation."""
    found = described(file)
    if not found.identifier:
        raise InputError(f"{file}: is for model exchange only; export one for co-simulation to couple it")
    return found


@lru_cache(maxsize=16)
def _described(file: Path, _changed: int, given: tuple[tuple[str, int], ...]) -> Description:
    if not is_installed():
        raise InputError(NEEDS)
    try:
        with archives.open_archive(file, "an FMU") as archive:
            places = [Path(name).parts for name in archive.namelist()]
            text = checked_xml(archive, file, _DESCRIPTION)
            found = _by_fmpy(text)
            _add_limits(found.modelVariables, text)
            ranges = _ranges(text)
            inverse = inverse_units(text)
            has_terminals = TERMINALS in archive.namelist()
            terminals = terminals_of(checked_xml(archive, file, TERMINALS)) if has_terminals else {}
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a broken file leads to
        raise InputError(f"{file}: is not an FMU: {describe_exception(error)[:_MOST_FAULTS]}") from None
    version = next((supported for supported in VERSIONS if str(found.fmiVersion).startswith(supported)), None)
    if version is None:
        raise InputError(
            f"{file}: is an FMU of FMI {found.fmiVersion}; those of {' and '.join(VERSIONS)} work"
        )
    if found.coSimulation is None and found.modelExchange is None:
        raise InputError(
            f"{file}: is for scheduled execution only; export one for co-simulation or model exchange"
        )
    experiment = found.defaultExperiment
    try:
        sizes = dict(given)
        variables: dict[str, Variable] = {}
        types: dict[int, tuple[tuple[int, ...], tuple[str, ...]]] = {}
        for variable in found.modelVariables:
            for element in _with_elements(variable, sizes, types):
                variables[element.name] = replace(element, stands_for=ranges.get(element.name))
            if len(variables) > _MOST_VARIABLES:
                raise ValueError(f"has more than {_MOST_VARIABLES:,} variables and elements of arrays")
        exchange = _exchange(found)
        times = {
            key: None if experiment is None else _number(getattr(experiment, key))
            for key in ("startTime", "stopTime", "stepSize", "tolerance")
        }
    except ValueError as error:
        raise InputError(f"{file}: modelDescription.xml: {error}") from None
    return Description(
        version,
        "" if found.coSimulation is None else found.coSimulation.modelIdentifier,
        found.guid,
        variables,
        times["startTime"] or 0.0,
        times["stopTime"],
        times["stepSize"] or None,
        times["tolerance"] or None,
        bool((found.coSimulation or found.modelExchange).canBeInstantiatedOnlyOncePerProcess),
        tuple(sorted({one[1] for one in places if len(one) > 2 and one[0] == "binaries"})),
        {unitDefinition.name: Unit.of(unitDefinition.baseUnit) for unitDefinition in found.unitDefinitions},
        Conversions(found.unitDefinitions, inverse),
        exchange,
        terminals,
        (found.generationTool or "").startswith("Swarmwright "),
    )


def checked_xml(archive: zipfile.ZipFile, file: Path, name: str) -> bytes:
    """Return an XML file in an archive, which parsers that keep all of it can be given.

    Raises InputError where it is missing, is not valid, or has too much or what only a DTD can say.
    """
    data = archives.read_entry(archive, file, name, _LARGEST_XML_BYTES)
    xml.check(data, f"{file}: {name}", _MOST_NODES, _DEEPEST_NESTING)
    return data


def _by_fmpy(text: bytes) -> Any:  # noqa: ANN401 - FMPy has no types
    """Return what FMPy reads from a model description that has been checked."""
    from fmpy import read_model_description  # noqa: PLC0415 - optional

    with TemporaryFolder("fmu") as folder:
        (folder / _DESCRIPTION).write_bytes(text)
        return read_model_description(str(folder), validate=False)


def _add_limits(variables: Any, text: bytes) -> None:  # noqa: ANN401 - FMPy has no types
    """Give unsigned integers of FMI 3.0 their min and max, which FMPy reads for the other types only."""
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
    """Return the ranges of scaled variables, see `RANGE`. Raises ValueError for one that is not a range."""
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


def _exchange(found: Any) -> Exchange | None:  # noqa: ANN401 - FMPy has no types
    if found.modelExchange is None:
        return None
    return Exchange(
        found.modelExchange.modelIdentifier,
        int(found.numberOfContinuousStates or 0),
        int(found.numberOfEventIndicators or 0),
        bool(found.modelExchange.needsCompletedIntegratorStep),
    )


def _with_elements(
    found: Any,  # noqa: ANN401 - FMPy has no types
    given: Mapping[str, int],
    types: dict[int, tuple[tuple[int, ...], tuple[str, ...]]],
) -> Iterator[Variable]:
    """Yield a variable, and of an array of numbers its elements; `given` are values of parameters."""
    sizes = tuple(
        int(
            dimension.start
            if dimension.variable is None
            else given.get(dimension.variable.name, dimension.variable.start)
        )
        for dimension in found.dimensions or ()
    )
    whole = replace(_variable(found, types), shape=sizes)
    count = math.prod(sizes)
    if not whole.is_array or whole.type not in _NUMBERS or not 0 < count <= _MOST_ELEMENTS:
        yield whole
        return
    places = itertools.product(*(range(1, size + 1) for size in sizes))
    names = tuple(f"{whole.name}[{','.join(map(str, place))}]" for place in places)
    yield replace(whole, elements=names)
    for index, name in enumerate(names):
        yield replace(whole, name=name, is_array=False, shape=(), index=index, count=count)


def _variable(
    found: Any,  # noqa: ANN401 - FMPy has no types
    types: dict[int, tuple[tuple[int, ...], tuple[str, ...]]],
) -> Variable:
    unit = found.unit or (found.declaredType.unit if found.declaredType is not None else None)
    low, high = (
        getattr(found, name) if getattr(found, name) is not None else getattr(found.declaredType, name, None)
        for name in ("min", "max")
    )
    items, labels = _items(found, types)
    if items:  # an actuator's range, unless the enumeration is limited to some
        low, high = (
            limit if known is None else known for known, limit in ((low, items[0]), (high, items[-1]))
        )
    elif found.type.startswith("UInt") and high is not None:
        low = low or "0"
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
        items=items,
        labels=labels,
    )


def _items(
    found: Any,  # noqa: ANN401 - FMPy has no types
    types: dict[int, tuple[tuple[int, ...], tuple[str, ...]]],
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return values and names of an enumeration, in the order of the values; none where it defines none.

    types: those of types that variables before had, which thousands of variables may share.
    """
    declared = found.declaredType
    if found.type != "Enumeration" or declared is None:
        return (), ()
    if id(declared) not in types:
        listed = [(item.value, item.name) for item in declared.items]
        if any(value is None for value, _ in listed):  # FMI requires values, but FMPy reads it without
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


def place() -> tuple[str, str]:
    """Return what FMI 2.0 and FMI 3.0 call this machine."""
    import fmpy  # noqa: PLC0415 - optional

    return fmpy.platform, fmpy.platform_tuple


def runs_here(description: Description) -> bool:
    """Return whether an FMU has a library for this machine."""
    return not set(place()).isdisjoint(description.platforms)


def terminals_of(text: bytes) -> Mapping[str, tuple[str, ...]]:
    """Return terminal -> its variables, in their order.

    Those of terminals within one belong to it, too, and have names such as robot.wheels. FMI 3.0, section
    2.4.9. Raises ET.ParseError for text that is not XML.
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
"""Items of an enumeration that a message names."""


def limits(variable: Variable) -> tuple[int, int] | None:
    """Return the lowest and the highest value of an integer or enumeration; None for other types."""
    if variable.items:
        return min(variable.items), max(variable.items)
    return _LIMITS.get(variable.type)


def is_unsigned(variable: Variable) -> bool:
    """Whether it is an integer that cannot be negative."""
    return variable.type in _UNSIGNED


def expected(variable: Variable) -> str | None:
    """Return in words what one value can be; None where there is none that can be given."""
    bounds = limits(variable)
    if variable.items:
        items = [str(item) for item in sorted(variable.items)]
        return f"one of {', '.join(items[:_MOST_ITEMS])}{', ..' if len(items) > _MOST_ITEMS else ''}"
    if bounds is not None:
        return f"an integer from {bounds[0]} to {bounds[1]}"
    return {"Boolean": "true or false", "String": "a string"}.get(
        variable.type, "a number" if variable.is_real else None
    )


def fits(variable: Variable, value: Any) -> bool:  # noqa: ANN401 - any value of a file
    """Whether one value is of a variable's type, within the limits of its type; 0 and 1 are booleans, too."""
    if variable.type == "String":
        return isinstance(value, str)
    if variable.type == "Boolean":
        return isinstance(value, bool) or (isinstance(value, int) and value in (0, 1))
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    if variable.is_real:
        return _is_finite(value)
    bounds = limits(variable)
    if bounds is None or value != value // 1:  # neither NaN nor an infinity is equal to what is left of it
        return False
    return value in variable.items if variable.items else bounds[0] <= value <= bounds[1]


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond binary64
        return False


def native(variable: Variable, value: Any) -> Any:  # noqa: ANN401 - a number, boolean or text
    """Return a value as FMPy sets it: integers rounded, and clipped to their limits, beyond which C wraps."""
    if variable.type == "Boolean":
        return bool(value)
    bounds = limits(variable)
    return value if bounds is None else round(min(max(value, bounds[0]), bounds[1]))


def driven(variable: Variable, share: float, value: float) -> float:
    """Return what an actuator sets.

    share: the actuator, -1 to 1. value: the same in the range and the unit of the variable. A boolean is true
    above the middle, and an enumeration has the nearest of its items.
    """
    if variable.type == "Boolean":
        return float(share > 0.0)
    if variable.items:
        return min(variable.items, key=lambda item: abs(item - value))
    return value


def seed_of(variable: Variable, seed: int) -> int:
    """Return an episode's seed for a variable: modulo 2^31, or as many numbers from 0 as its type has."""
    if variable.type == "UInt64":
        return seed
    bounds = limits(variable)
    return seed % (_SEEDS if bounds is None else min(_SEEDS, bounds[1] + 1))


def takes_seeds(variable: Variable) -> bool:
    """Whether a variable can get the seed of an episode: one number, and not one of few items."""
    return variable.is_number and variable.type not in ("Boolean", "Enumeration")
