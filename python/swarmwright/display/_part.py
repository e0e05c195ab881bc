"""An episode with what is known of its controller."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmwright.core.groups import Kind
from swarmwright.display._episode import Recording


@dataclass(frozen=True)
class Part:
    """One of the episodes that a page shows beside each other.

    name: what it is called there. controller: the specification of the controller of all agents, for drawings
    of state machines. sensor_names, actuator_names: of an agent; those without a name are numbered. kinds: of
    agents, where these have other sensors and actuators than each other.
    """

    recording: Recording
    name: str = ""
    controller: Mapping[str, Any] = field(default_factory=dict)
    sensor_names: Sequence[str] = ()
    actuator_names: Sequence[str] = ()
    kinds: Sequence[Kind] = ()
