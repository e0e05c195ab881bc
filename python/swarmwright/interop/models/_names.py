"""Names of a model and names of a simulation: the same one, written differently.

Numbers in files of modelling tools, which are text there.
"""

import math
from collections.abc import Iterable
from typing import Any

from swarmwright.common.suggestions import alike, did_you_mean, fold_name
from swarmwright.interop.models._parts import Place, Problems
from swarmwright.simulations import catalogue

_ALIASES = {"swarmmembers": ("numAgents", "robots"), "steps": ("maxSteps", "steps")}
"""Names that Modelio's CPSwarm module writes into each problem -> names in built-in simulations."""
AGENTS = ("numAgents", "robots")
"""Parameters of built-in simulations with the number of agents."""


def title_of(names: Iterable[str]) -> str | None:
    """Return the built-in simulation that has one of these names; None for no one."""
    titles = list(catalogue.titles())
    return next((titles[found[0]] for name in names if (found := alike(name, titles))), None)


class Known:
    """The parameters of a simulation, as far as they are known here."""

    def __init__(self, simulation: str) -> None:
        described = catalogue.has_description(simulation)
        self.description: dict[str, Any] | None = catalogue.description(simulation) if described else None
        self.simulation = simulation

    @property
    def parameters(self) -> dict[str, Any] | None:
        """Name -> type, default; None where any may exist."""
        return None if self.description is None else (self.description["parameters"] or None)

    def name(self, name: str) -> str | None:
        """Return what the simulation calls a parameter; None if it has none like it, or several."""
        if self.parameters is None:
            return name
        found = self._like(name)
        return found[0] if len(found) == 1 else None

    def is_ambiguous(self, name: str) -> bool:
        """Whether the simulation has several parameters that a name may stand for."""
        return len(self._like(name)) > 1

    def _like(self, name: str) -> list[str]:
        known = list(self.parameters or ())
        for candidate in (name, *_ALIASES.get(fold_name(name), ())):
            if found := alike(candidate, known):
                return [known[index] for index in found]
        return []

    @property
    def agents(self) -> str | None:
        """The parameter with the number of agents; None where there is none, or where any may exist."""
        return (
            None
            if self.parameters is None
            else next((name for name in AGENTS if name in self.parameters), None)
        )

    def number_of(self, kind: str) -> str | None:
        """Return the parameter with the number of agents of a kind, numScouts or scouts; None without one."""
        return kind if self.parameters is None else self.name(f"num {kind}") or self.name(kind)

    def missing(self, name: str) -> str:
        """Say that there is no such parameter, or more than one."""
        if self.is_ambiguous(name):
            which = " or ".join(map(repr, self._like(name)))
            return f"{name!r} may be the parameter {which} of {self.simulation}; write one of these names"
        return f"{self.simulation} has no parameter {name!r}{did_you_mean(name, self.parameters or ())}"


def whole_of(text: str, place: Place, problems: Problems) -> int | None:
    """Return a whole number; None after noting that a text is none."""
    try:
        value = int(text) if "_" not in text else None
    except ValueError:
        value = None
    if value is None or abs(value) >= 2**63:
        problems.add(place, f"{text[:80]!r} found, expected a whole number")
        return None
    return value


def number_of(text: str, place: Place, problems: Problems) -> float | None:
    """Return a finite number, Java's `0.15f` as 0.15; None after noting that a text is none."""
    digits = text[:-1] if text[-1:] in {"f", "F", "d", "D"} else text
    try:
        value = float(digits) if "_" not in digits else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        problems.add(place, f"{text[:80]!r} found, expected a number such as 0.15")
        return None
    return value
