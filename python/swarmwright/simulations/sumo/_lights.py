"""Traffic lights that decide by themselves when to change."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.simulations.parameters import Parameter
from swarmwright.simulations.sumo._traffic import Traffic

_FOR_EVER_S = 1e6
"""Seconds of a phase that ends only when it is changed."""
_VEHICLE_M = 7.5
"""Metres of a lane that a waiting vehicle takes."""
_LONG_WAIT_S = 60.0
"""Seconds that make the sensor of time 1."""


@dataclass(frozen=True)
class _Green:
    """Lanes of a green phase: those that may drive, those that wait, and where the first lead to."""

    driving: tuple[str, ...]
    waiting: tuple[str, ...]
    exits: tuple[str, ...]


class TrafficLights(Traffic):
    """Each traffic light of the network changes to its next green phase when its controller says so.

    Phases, their order, and the times of yellow are those of the network's program; how long green lasts is
    the controller's decision, but not less than `green`.

    Sensors: share of the lanes with green on which vehicles wait; the same of lanes with red; share of the
    lanes behind the crossing, of those with green, that is taken; how long it has been green, in minutes, 1
    at most.
    Actuators: above 0 change to the next green phase.
    Fitness: minus the mean seconds that a vehicle waits.

    Source of the task: Gershenson, Self-organizing traffic lights, Complex Systems 16, 2005.
    """

    title = "sumo traffic lights"
    sensors, actuators = 4, 1
    sensor_names = ("waiting at green", "waiting at red", "taken behind", "green time")
    actuator_names = ("change",)
    parameters = {  # noqa: RUF012 - as in the base class
        **Traffic.parameters,
        "green": Parameter(5.0, "Seconds that a green phase lasts, at least.", minimum=0.0, maximum=600.0),
    }

    def begin(self, parameters: dict[str, Any], lately: list[str]) -> NDArray[np.float64]:
        """Read the programs of the lights."""
        lights, self._least = self.sumo.trafficlight, parameters["green"]
        self.lights = sorted(lights.getIDList())
        if not self.lights:
            raise InputError(f"config: {self._path}: the network has no traffic lights")
        self._phases = {light: self._program(light) for light in self.lights}
        self._since: dict[str, float | None] = dict.fromkeys(self.lights)
        lanes = {lane for phases in self._phases.values() for one in phases if one for lane in _all(one)}
        self._holds = {lane: max(self.sumo.lane.getLength(lane) / _VEHICLE_M, 1.0) for lane in sorted(lanes)}
        for light in self.lights:
            self._hold(light)
        return self.look(lately)

    def act(self, actions: NDArray[np.float32]) -> None:
        """Change those lights that are told to and have been green for long enough."""
        lights = self.sumo.trafficlight
        for light, (action,) in zip(self.lights, actions.tolist(), strict=True):
            since = self._since[light]
            if action > 0 and since is not None and self._now() - since >= self._least - 1e-6:
                lights.setPhase(light, (lights.getPhase(light) + 1) % len(self._phases[light]))
                self._since[light] = None
                self._hold(light)

    def look(self, lately: list[str]) -> NDArray[np.float64]:  # noqa: ARG002 - lights wait for no vehicle in particular
        """Return what the lights sense, (lights, 4)."""
        seen = np.zeros((len(self.lights), 4))
        for row, light in zip(seen, self.lights, strict=True):
            green = self._hold(light)
            if green is None:
                continue
            halting, taken = self.sumo.lane.getLastStepHaltingNumber, self.sumo.lane.getLastStepVehicleNumber
            row[0] = self._share(green.driving, halting)
            row[1] = self._share(green.waiting, halting)
            row[2] = self._share(green.exits, taken)
            row[3] = min((self._now() - (self._since[light] or 0.0)) / _LONG_WAIT_S, 1)
        return seen

    def fitness(self) -> float:
        """Return minus the mean waiting time, seconds."""
        return -self.measure()["waiting"]

    def _hold(self, light: str) -> _Green | None:
        """Keep a light green; return its phase, None while it changes."""
        lights = self.sumo.trafficlight
        green: _Green | None = self._phases[light][lights.getPhase(light)]
        if green is not None:
            lights.setPhaseDuration(light, _FOR_EVER_S)
            if self._since[light] is None:
                self._since[light] = self._now()
        return green

    def _now(self) -> float:
        return float(self.sumo.simulation.getTime())

    def _share(self, lanes: tuple[str, ...], count: Any) -> float:  # noqa: ANN401 - a function of SUMO's
        """Return which share of the lanes vehicles take."""
        return float(min(sum(map(count, lanes)) / max(sum(self._holds[lane] for lane in lanes), 1.0), 1.0))

    def _program(self, light: str) -> list[_Green | None]:
        """Return the phases of a light; None for those that lead from one green phase to the next."""
        lights = self.sumo.trafficlight
        running = lights.getProgram(light)
        logic = next(one for one in lights.getAllProgramLogics(light) if one.programID == running)
        links = lights.getControlledLinks(light)
        return [_green(phase.state, links) for phase in logic.phases]


def _green(state: str, links: Any) -> _Green | None:  # noqa: ANN401 - lists of SUMO's
    """Return the lanes of a phase, given its signals and the links that each signal controls."""
    if "y" in state or "Y" in state or not ("g" in state or "G" in state):
        return None
    driving, waiting, exits = set(), set(), set()
    for signal, controlled in zip(state, links, strict=False):
        for entry, leaving, _ in controlled:
            if signal in "gG":
                driving.add(entry)
                exits.add(leaving)
            else:
                waiting.add(entry)
    return _Green(tuple(sorted(driving)), tuple(sorted(waiting - driving)), tuple(sorted(exits)))


def _all(green: _Green) -> tuple[str, ...]:
    return (*green.driving, *green.waiting, *green.exits)
