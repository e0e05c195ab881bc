"""Parameter bindings of SSP: start values from parameter sets, with mappings, units and transformations."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

from swarmwright.common.errors import InputError
from swarmwright.simulations.fmu.description import INTEGERS, Variable
from swarmwright.simulations.fmu.transformations import BOOLEANS, IDENTITY, SSC, Linear, linear_of, table_of
from swarmwright.simulations.fmu.units import Unit
from swarmwright.simulations.fmu.values import expected, fits

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
            yield from ((name, one, None) for name, one in found.items())
            continue
        root = _source(mapping, read, f"{_SSM}ParameterMapping", "SystemStructureParameterMapping.xsd")
        for entry in () if root is None else root.iterfind(f"{_SSM}MappingEntry"):
            if entry.get("source") in found:
                yield entry.get("target", ""), found[entry.get("source", "")], entry


def _parameters(binding: ET.Element, read: Read) -> Iterator[tuple[str, Parameter]]:
    root = _source(binding, read, f"{_SSV}ParameterSet", "SystemStructureParameterValues.xsd")
    if root is None:
        return
    units = {
        one.get("name", ""): Unit.of(one.find(f"{SSC}BaseUnit"))
        for one in root.iterfind(f"{_SSV}Units/{SSC}Unit")
    }
    for one in root.iterfind(f"{_SSV}Parameters/{_SSV}Parameter"):
        name = one.get("name", "")
        kind, value = next(
            ((kind, found) for kind in _KINDS if (found := one.find(f"{_SSV}{kind}")) is not None), ("", None)
        )
        if value is None:
            raise InputError(f"parameter {name}: is not of the type {', '.join(_KINDS)}")
        unit = value.get("unit", "")
        yield name, Parameter(kind, value.get("value", ""), unit, units.get(unit))


def _source(element: ET.Element, read: Read, root: str, schema: str) -> ET.Element | None:
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
    name: str, variable: Variable, one: Parameter, entry: ET.Element | None, units: Callable[[], Linear]
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
    value = _parsed(name, variable, one)
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


def _parsed(name: str, variable: Variable, one: Parameter) -> Any:  # noqa: ANN401 - as above
    try:
        if variable.type == "Boolean":
            return BOOLEANS[one.text]
        if one.kind == "Enumeration" and one.text in variable.labels:
            return variable.items[variable.labels.index(one.text)]
        return float(one.text) if variable.is_real else int(one.text)
    except (KeyError, ValueError):
        items = f", one of {', '.join(variable.labels)}" if variable.labels else ""
        raise InputError(
            f"{name}: the value {one.text!r} is not of the type {variable.type}{items}"
        ) from None
