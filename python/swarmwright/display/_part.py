"""An episode with what is known of its controller."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmwright.common.groups import Kind
from swarmwright.common.teams import is_team
from swarmwright.display._episode import Recording


@dataclass(frozen=True)
class Part:
    """One of the episodes that a page shows beside each other.

    name: what it is called there. controller: the specification of the controller of all agents, for drawings
    of state machines. sensor_names, actuator_names: of an agent; those without a name are numbered. kinds: of
    agents, where the simulation has several. step_seconds: of a step in the simulated world, where known.
    """

    recording: Recording
    name: str = ""
    controller: Mapping[str, Any] = field(default_factory=dict)
    sensor_names: Sequence[str] = ()
    actuator_names: Sequence[str] = ()
    kinds: Sequence[Kind] = ()
    step_seconds: float | None = None

    @classmethod
    def of(cls, shows: "Recording | Part") -> "Part":
        """Return an episode, with no more known of it where it is a recording."""
        return cls(shows) if isinstance(shows, Recording) else shows

    @property
    def kind_names(self) -> tuple[str, ...]:
        """The names of the kinds of agents, which bodies of the kind agent have as their state."""
        groups = self.controller["groups"] if is_team(self.controller) else ()
        return tuple(dict.fromkeys([*(kind.name for kind in self.kinds), *(one["name"] for one in groups)]))
