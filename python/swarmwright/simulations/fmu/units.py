"""Units in SI base units: value in base units = factor * value + offset."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

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
