"""Matching of a model's names with those of a simulation, and parsing of numbers in model files."""

import math
from collections.abc import Iterable
from typing import Any

from swarmwright.common.suggestions import alike, did_you_mean, fold_name
from swarmwright.interop.models._parts import Location, Problems
from swarmwright.simulations import catalogue

_ALIASES = {"swarmmembers": ("numAgents", "robots"), "steps": ("maxSteps", "steps")}
"""Names that Modelio's CPSwarm module writes into each problem -> names in built-in simulations."""
AGENTS = ("numAgents", "robots")
"""Parameters of built-in simulations with the number of agents."""


def find_title(names: Iterable[str]) -> str | None:
    """Return the built-in simulation with one of these names; None if there is none."""
    titles = list(catalogue.titles())
    return next((titles[indices[0]] for name in names if (indices := alike(name, titles))), None)


class SimulationParameters:
    """The parameters of a simulation, if it is described."""

    def __init__(self, simulation: str) -> None:
        described = catalogue.has_description(simulation)
        self.description: dict[str, Any] | None = catalogue.description(simulation) if described else None
        self.simulation = simulation

    @property
    def parameters(self) -> dict[str, Any] | None:
        """Name -> type, default; None if the simulation is not described, or takes any parameters."""
        return None if self.description is None else (self.description["parameters"] or None)

    def find(self, name: str) -> str | None:
        """Return the simulation's name of a parameter; None without a match, or with several."""
        if self.parameters is None:
            return name
        matches = self._find_matches(name)
        return matches[0] if len(matches) == 1 else None

    def is_ambiguous(self, name: str) -> bool:
        """Whether the simulation has several parameters that a name may stand for."""
        return len(self._find_matches(name)) > 1

    def _find_matches(self, name: str) -> list[str]:
        names = list(self.parameters or ())
        for candidate in (name, *_ALIASES.get(fold_name(name), ())):
            if indices := alike(candidate, names):
                return [names[index] for index in indices]
        return []

    @property
    def agents(self) -> str | None:
        """The parameter with the number of agents; None without one, or if `parameters` is None."""
        return (
            None
            if self.parameters is None
            else next((name for name in AGENTS if name in self.parameters), None)
        )

    def find_agents_of(self, kind: str) -> str | None:
        """Return the parameter with the number of agents of a kind, e.g. numScouts; None without one."""
        return kind if self.parameters is None else self.find(f"num {kind}") or self.find(kind)

    def describe_problem(self, name: str) -> str:
        """Return the message for an unknown or ambiguous parameter."""
        if self.is_ambiguous(name):
            candidates = " or ".join(map(repr, self._find_matches(name)))
            return f"{name!r} is ambiguous in {self.simulation}: {candidates}; write one of these names"
        return f"{self.simulation} has no parameter {name!r}{did_you_mean(name, self.parameters or ())}"


def parse_integer(text: str, location: Location, problems: Problems) -> int | None:
    """Parse an integer; add a problem and return None for other text."""
    try:
        value = int(text) if "_" not in text else None
    except ValueError:
        value = None
    if value is None or abs(value) >= 2**63:
        problems.add(location, f"{text[:80]!r} found, expected a whole number")
        return None
    return value


def parse_number(text: str, location: Location, problems: Problems) -> float | None:
    """Parse a finite number, also Java's `0.15f`; add a problem and return None for other text."""
    digits = text[:-1] if text[-1:] in {"f", "F", "d", "D"} else text
    try:
        value = float(digits) if "_" not in digits else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        problems.add(location, f"{text[:80]!r} found, expected a number such as 0.15")
        return None
    return value
