"""Vehicles that evolved controllers accelerate, among others that follow SUMO's models."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.simulations.parameters import Parameter
from swarmwright.simulations.sumo._traffic import Traffic

_ALL_CHECKS, _NO_CHECKS = 31, 32
"""Speed modes: all of SUMO's checks; none, not even of the right of way."""


class Vehicles(Traffic):
    """Vehicles of one type are accelerated by controllers, the others by SUMO's models.

    Agents are the vehicles of the type `type`, in the order in which they depart; they act while they are on
    the road.

    Sensors: own speed; how near the vehicle ahead is, 0 (none within `range`) to 1 (bumper to bumper); how
    much faster it is; the same two of the vehicle behind. Speeds are shares of `fastest`, 1 at most.
    Actuators: acceleration, 1 and -1 are the most and the least of the vehicle's type.
    Fitness: the mean speed of all vehicles, m/s.

    A task for one agent, 21 others on a ring: Stern et al., Dissipation of stop-and-go waves via control of
    autonomous vehicles, Transportation Research Part C 89, 2018.
    """

    title = "sumo vehicles"
    sensors, actuators = 5, 1
    sensor_names = ("speed", "near ahead", "faster ahead", "near behind", "faster behind")
    actuator_names = ("acceleration",)
    parameters = {  # noqa: RUF012 - as in the base class
        **Traffic.parameters,
        "agents": Parameter(1, "Vehicles that are agents, at most.", minimum=1, maximum=10_000),
        "type": Parameter("agent", "The vType of vehicles that are agents."),
        "range": Parameter(50.0, "How far vehicles sense others, metres.", minimum=1.0, maximum=1000.0),
        "fastest": Parameter(15.0, "The speed that reads 1, m/s.", minimum=0.1, maximum=100.0),
        "safe": Parameter(True, "Whether SUMO brakes agents that would collide otherwise."),
    }

    def begin(self, parameters: dict[str, Any], lately: list[str]) -> NDArray[np.float64]:
        """Forget the vehicles of the episode before."""
        self._kind, self._safe = parameters["type"], parameters["safe"]
        self._range, self._fastest = parameters["range"], parameters["fastest"]
        kinds = self.sumo.vehicletype.getIDList()
        if self._kind not in kinds:
            there = ", ".join(kind for kind in kinds if not kind.startswith("DEFAULT_")) or "none"
            raise InputError(f"type: the configuration has no vType {self._kind!r}; available: {there}")
        self.agents: list[str] = []
        self._most = parameters["agents"]
        return self.look(lately)

    def act(self, actions: NDArray[np.float32]) -> None:
        """Accelerate until the next action."""
        vehicle = self.sumo.vehicle
        for index in self._acting:
            one, action = self.agents[index], float(actions[index, 0])
            most = vehicle.getAccel(one) if action > 0 else vehicle.getDecel(one)
            vehicle.setAcceleration(one, action * most, self.interval)

    def look(self, lately: list[str]) -> NDArray[np.float64]:
        """Return what the agents sense; rows of those that are not on the road are 0."""
        vehicle = self.sumo.vehicle
        for one in lately:
            if len(self.agents) < self._most and vehicle.getTypeID(one) == self._kind:
                vehicle.setSpeedMode(one, _ALL_CHECKS if self._safe else _NO_CHECKS)
                self.agents.append(one)
        there = set(self.vehicles)
        self._acting = [index for index, one in enumerate(self.agents) if one in there]
        seen = np.zeros((self._most, 5))
        for index in self._acting:
            one = self.agents[index]
            speed = vehicle.getSpeed(one)
            seen[index, 0] = min(speed / self._fastest, 1)
            ahead, behind = vehicle.getLeader(one, self._range), vehicle.getFollower(one, self._range)
            for column, other in ((1, ahead), (3, behind)):
                if other is not None and other[0]:
                    # SUMO leaves out the gap that the vehicle behind keeps when it stands.
                    gap = other[1] + vehicle.getMinGap(one if column == 1 else other[0])
                    seen[index, column] = 1 - min(max(gap / self._range, 0), 1)
                    faster = (vehicle.getSpeed(other[0]) - speed) / self._fastest
                    seen[index, column + 1] = min(max(faster, -1), 1)
        return seen

    def acting(self) -> list[int]:
        """Return which agents are on the road."""
        return self._acting

    def fitness(self) -> float:
        """Return the mean speed of all vehicles, m/s."""
        return self.measure()["speed"]

    def state(self, vehicle: str) -> str:
        """Return what pictures call a vehicle: agent, waiting or driving."""
        return "agent" if vehicle in self.agents else super().state(vehicle)
