"""Units in SI base units: value in base units = factor * value + offset.

Conversions between the units that an FMU defines.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Unit:
    """A unit."""

    exponents: tuple[int, ...]
    """Of kg, m, s, A, K, mol, cd, rad."""
    factor: float = 1.0
    offset: float = 0.0

    @classmethod
    def of(cls, base: Any) -> "Unit | None":  # noqa: ANN401 - an element or FMPy's object
        """Return the unit of a BaseUnit, of XML or of FMPy; None where there is none."""
        if base is None:
            return None
        get = base.get if hasattr(base, "get") else lambda name, default: getattr(base, name, default)
        return cls(
            tuple(int(get(name, 0) or 0) for name in _BASE),
            float(get("factor", 1.0) or 1.0),
            float(get("offset", 0.0) or 0.0),
        )

    def attributes(self) -> dict[str, str]:
        """Return the attributes of a BaseUnit that are not the default ones."""
        exponents = zip(_BASE, self.exponents, strict=True)
        found = {name: str(exponent) for name, exponent in exponents if exponent}
        found |= {"factor": repr(self.factor)} if self.factor != 1.0 else {}
        return found | ({"offset": repr(self.offset)} if self.offset else {})


def units_of(found: Mapping[str, Unit | None]) -> dict[str, Unit]:
    """Return those units that are defined by SI base units."""
    return {name: unit for name, unit in found.items() if unit is not None}


class Conversions(Mapping[str, Mapping[str, tuple[float, float]]]):
    """Unit -> other unit -> factor and offset, by which a value in the one becomes one in the other.

    A unit is converted to its display units, and to units of the same SI base units and their display units.
    FMI 3.0, section 2.4.4: base = factor unit + offset; display unit = factor unit + offset.

    Those of a unit are computed when they are asked for: all of them would be the square of their number.

    Args:
        units: unit definitions, as FMPy has read them.
        inverse: display units that are left out, since they are reciprocals.

    """

    def __init__(self, units: Sequence[Any], inverse: set[str]) -> None:
        self._units, self._inverse = {unit.name: unit for unit in units}, inverse
        self._bases = {unit.name: Unit.of(unit.baseUnit) for unit in units}

    def __getitem__(self, unit: str) -> Mapping[str, tuple[float, float]]:
        """Return the units that one is converted to, with factor and offset."""
        one, base = self._units[unit], self._bases[unit]
        others = {unit: (1.0, 0.0)}
        for other in self._units.values():
            to = self._bases[other.name]
            if other is one or base is None or to is None or base.exponents != to.exponents:
                continue
            # The value in base units is in between.
            factor, offset = base.factor / to.factor, (base.offset - to.offset) / to.factor
            others[other.name] = (factor, offset)
            for shown in other.displayUnits:
                others.setdefault(shown.name, _composed((factor, offset), shown))
        # Its own definitions come before those by way of others.
        others.update({shown.name: _composed((1.0, 0.0), shown) for shown in one.displayUnits})
        return {name: by for name, by in others.items() if name not in self._inverse}

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the units."""
        return iter(self._units)

    def __len__(self) -> int:
        """Return how many units there are."""
        return len(self._units)


def _composed(by: tuple[float, float], shown: Any) -> tuple[float, float]:  # noqa: ANN401 - FMPy has no types
    factor = float(shown.factor)
    return by[0] * factor, by[1] * factor + float(shown.offset)


def inverse_units(description: bytes) -> set[str]:
    """Return the names of display units of FMI 3.0 that are reciprocals, which FMPy does not tell apart."""
    root = ET.fromstring(description)  # noqa: S314 - expat limits entities
    return {
        element.get("name", "")
        for element in root.iter("DisplayUnit")
        if element.get("inverse") in ("true", "1")
    }
