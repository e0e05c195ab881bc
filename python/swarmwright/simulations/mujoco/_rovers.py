"""Rovers with two driven wheels that gather."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarmwright.simulations.mujoco._robots import RANGES, SECTORS, Numbers, Robots

_TOP_WHEEL_SPEED_RAD_S = 10.0
"""Highest speed of a wheel, radians per second."""
_SPEED = 0.5
"""Highest speed of a rover, metres per second."""
_ROVER = """
<body name="robot{i}" pos="0 0 0.051">
  <freejoint/>
  <geom type="box" size="0.1 0.07 0.03" mass="1" material="robot"/>
  <geom type="box" size="0.02 0.03 0.01" pos="0.08 0 0.035" mass="0.01" material="nose" group="2"/>
  {casters}
  <body name="left{i}" pos="0 0.085 0"><joint name="left{i}" axis="0 1 0" armature="0.001"/>{wheel}</body>
  <body name="right{i}" pos="0 -0.085 0"><joint name="right{i}" axis="0 1 0" armature="0.001"/>{wheel}</body>
</body>
"""
# With MuJoCo's harder default contacts, accelerating rovers hop.
_CASTERS = "".join(
    f'<geom type="sphere" size="0.02" pos="{x} 0 -0.028" mass="0.02" material="dark" group="2" condim="1" '
    'solref="0.04 1"/>'
    for x in (0.08, -0.08)
)
_WHEEL = (
    '<geom type="ellipsoid" size="0.05 0.015 0.05" mass="0.1" material="dark" group="2" solref="0.04 1"/>'
)


class Rovers(Robots):
    """Rovers gather from random positions, around pillars.

    Sensors (12): 8 range sensors around the rover, beginning ahead, counterclockwise, 0 (nothing within
    `range`) to 1 (touching); cosine and sine of the bearing to the middle of all rovers, 0 for straight
    ahead; the distance to it over the arena's longer side; the speed ahead, 1 at full speed.
    Actuators (2): speed of the left and of the right wheel, 1 is 0.5 m/s ahead.
    Fitness: minus the distance of rovers from their middle, metres, the mean over the last quarter of the
    episode.
    """

    title = "mujoco rovers"
    sensors = SECTORS + 4
    actuators = 2
    sensor_names = (*RANGES, "bearing cosine", "bearing sine", "distance", "speed")
    actuator_names = ("left wheel", "right wheel")
    sensor_ranges = (*(None,) * (SECTORS + 3), (-_SPEED, _SPEED, "m/s"))
    actuator_ranges = ((-_SPEED, _SPEED, "m/s"), (-_SPEED, _SPEED, "m/s"))
    metrics = {  # noqa: RUF012 - as in the base class
        "distance": "Mean distance of rovers from their middle at the end, metres.",
        "touching": "Share of rovers that touch anything but the floor, mean over the episode.",
    }
    physics_step, physics_steps = 0.01, 10
    clear = 0.25  # transparent walls do not hide robots
    radius, clearance = 0.12, 0.2

    def robot(self, number: int) -> str:
        """Return the body of a rover."""
        return _ROVER.format(i=number, wheel=_WHEEL, casters=_CASTERS)

    def motors(self, number: int) -> str:
        """Return the motors of the wheels: speed servos with at most 0.2 N m."""
        limits = (
            f'kv="0.2" ctrlrange="-{_TOP_WHEEL_SPEED_RAD_S} {_TOP_WHEEL_SPEED_RAD_S}" forcerange="-0.2 0.2"'
        )
        return "".join(f'<velocity joint="{side}{number}" {limits}/>' for side in ("left", "right"))

    def start(self, places: Numbers, headings: Numbers) -> None:
        """Place rovers on their wheels."""
        super().start(places, headings)
        self.data.qpos[self._free[:, 2]] = 0.05

    def prepare(self) -> None:
        """Reset the counters."""
        self._sum, self._counted, self._touched = 0.0, 0, 0.0

    def step(self, actions: NDArray[np.float32]) -> Numbers:
        """Advance by one step of control."""
        self.data.ctrl[:] = _TOP_WHEEL_SPEED_RAD_S * actions.ravel()
        mujoco.mj_step(self.model, self.data, self.physics_steps)
        self.remaining_steps -= 1
        self._touched += float(self.touching().mean())
        if self.late:
            self._sum += self._distance()
            self._counted += 1
        return self.look()

    def look(self) -> Numbers:
        """Return the sensor values."""
        places, ahead = self.positions()[:, :2], self.frames()[:, :2, 0]
        headings = np.arctan2(ahead[:, 1], ahead[:, 0])
        way = places.mean(axis=0) - places
        bearing = np.arctan2(way[:, 1], way[:, 0]) - headings
        speed = (self.data.qvel[self._speeds] * ahead).sum(axis=1)
        side = max(self.arena.width, self.arena.depth)
        rest = (np.cos(bearing), np.sin(bearing), np.hypot(way[:, 0], way[:, 1]) / side, speed / _SPEED)
        return np.column_stack([self.read_ranges(headings), *rest])

    @property
    def message(self) -> str:
        """Caption of a picture."""
        return f"{self._distance():.2f} m from the middle"

    def fitness(self) -> float:
        """Return minus the mean distance from the middle in the last quarter."""
        return -self._sum / self._counted if self._counted else -self._distance()

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        return {
            "distance": self._distance(),
            "touching": self._touched / max(self.steps - self.remaining_steps, 1),
        }

    def _distance(self) -> float:
        way = self.positions()[:, :2]
        way = way - way.mean(axis=0)
        return float(np.hypot(way[:, 0], way[:, 1]).mean())

    def _make(self, parameters: dict[str, Any]) -> None:
        super()._make(parameters)
        first = self.model.jnt_dofadr[self.model.body_jntadr[self._bodies]]
        self._speeds = first[:, None] + np.arange(2)
