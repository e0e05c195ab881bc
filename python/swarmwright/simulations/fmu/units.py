"""Units of FMUs, and conversions between them: value in SI base units = factor * value + offset."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

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
