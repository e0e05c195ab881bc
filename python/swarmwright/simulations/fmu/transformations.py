"""Transformations of SSP between a value and where it goes: linear, or by a table of values."""

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from swarmwright.common.errors import InputError
from swarmwright.simulations.fmu.description import INTEGERS, Variable
from swarmwright.simulations.fmu.values import expected, fits

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
    kind, found = next(((kind, one) for kind, one in of if one is not None), ("", None))
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
    for one in found.iterfind(f"{SSC}MapEntry"):
        words = one.get("source", ""), one.get("target", "")
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
