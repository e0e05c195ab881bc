"""Names of a model and names of a simulation: the same one, written differently."""

import re
from collections.abc import Iterable
from typing import Any

from swarmwright.core.suggestions import did_you_mean
from swarmwright.simulations import catalogue

_ALIASES = {"swarmmembers": ("numAgents", "robots"), "steps": ("maxSteps", "steps")}
"""Names that Modelio's CPSwarm module writes into each problem -> names in built-in simulations."""
AGENTS = ("numAgents", "robots")
"""Parameters of built-in simulations with the number of agents."""


def folded(name: str) -> str:
    """Return a name without case and signs: `numAgents`, `num_agents` and `Num Agents` are the same."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def title_of(names: Iterable[str]) -> str | None:
    """Return the built-in simulation that has one of these names; None for no one."""
    by_folded = {folded(title): title for title in catalogue.titles()}
    return next((by_folded[folded(name)] for name in names if folded(name) in by_folded), None)


class Known:
    """The parameters of a simulation, as far as they are known here."""

    def __init__(self, simulation: str) -> None:
        described = catalogue.is_described(simulation)
        self.description: dict[str, Any] | None = catalogue.description(simulation) if described else None
        self.simulation = simulation

    @property
    def parameters(self) -> dict[str, Any] | None:
        """Name -> type, default; None where any may exist."""
        return None if self.description is None else (self.description["parameters"] or None)

    def name(self, name: str) -> str | None:
        """Return what the simulation calls a parameter; None if it has none like it."""
        known = self.parameters
        if known is None:
            return name
        by_folded = {folded(one): one for one in known}
        for candidate in (name, *_ALIASES.get(folded(name), ())):
            if folded(candidate) in by_folded:
                return by_folded[folded(candidate)]
        return None

    @property
    def agents(self) -> str | None:
        """The parameter with the number of agents; None where there is none, or where any may exist."""
        return (
            None if self.parameters is None else next((one for one in AGENTS if one in self.parameters), None)
        )

    def missing(self, name: str) -> str:
        """Say that there is no such parameter."""
        return f"{self.simulation} has no parameter {name!r}{did_you_mean(name, self.parameters or ())}"
