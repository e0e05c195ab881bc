"""Quadrotors that spread over an area."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarmwright.simulations.mujoco._robots import RANGES, SECTORS, Numbers, Robots
from swarmwright.simulations.parameters import Parameter

_GRAVITY = 9.81
_MASS = 0.5  # kg
_INERTIA = np.array([0.0025, 0.0025, 0.0045])  # kg m^2
_ARM = 0.1  # rotors at (+-ARM, +-ARM), metres
_DRAG = 0.02  # torque about the axis for a thrust of 1 N, N m
_THRUST_N = 3.0  # thrust of a rotor, N
_TOP_SPEED_M_S = 1.0  # m/s
_HEIGHT = 1.0  # height of flight, metres

_QUADROTOR = """
<body name="robot{i}">
  <freejoint/>
  <inertial pos="0 0 0" mass="0.5" diaginertia="0.0025 0.0025 0.0045"/>
  <geom type="cylinder" size="0.18 0.03" rgba="0 0.45 0.7 0.25"/>
  <geom type="box" size="0.05 0.03 0.02" material="robot" group="2" contype="0" conaffinity="0"/>
  <geom type="box" size="0.012 0.012 0.012" pos="0.055 0 0" material="nose" group="2" contype="0"
    conaffinity="0"/>
  {rotors}
</body>
"""
_ROTORS = ((1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1))
"""Position of each rotor in x and y, and the direction of its torque."""
_MIXER = np.linalg.inv([[1, _ARM * y, -_ARM * x, _DRAG * turn] for x, y, turn in _ROTORS]).T
"""(thrust, torque about x, y, z) -> thrusts of the rotors."""


class Quadrotors(Robots):
    """Quadrotors spread to see as much of the floor as possible; each sees a disc of the floor below it.

    An autopilot keeps a quadrotor upright, facing x, 1 m above the floor, at the commanded velocity. A
    quadrotor that touches anything falls down and stays there.

    Sensors (10): 8 range sensors around, beginning at x, counterclockwise, 0 (nothing within `range`) to 1
    (touching); the velocity in x and y, 1 at full speed.
    Actuators (2): the velocity in x and y, 1 is 1 m/s.
    Fitness: the share of the floor that is seen, the mean over the last quarter of the episode.
    """

    title = "mujoco quadrotors"
    sensors = SECTORS + 2
    actuators = 2
    sensor_names = (*RANGES, "velocity x", "velocity y")
    actuator_names = ("velocity x", "velocity y")
    sensor_units = (*("",) * SECTORS, "m/s", "m/s")  # 1 is 1 m/s
    actuator_units = ("m/s", "m/s")
    parameters = {  # noqa: RUF012 - as in the base class
        **Robots.parameters,
        "view": Parameter(
            1.2, "Radius of the disc that each sees below it, metres.", minimum=0.1, maximum=100.0
        ),
    }
    metrics = {  # noqa: RUF012 - as in the base class
        "covered": "Share of the floor that is seen at the end.",
        "crashed": "Quadrotors that touched something.",
        "closest": "The smallest distance between two flying quadrotors in the episode, metres.",
    }
    physics_step, physics_steps = 0.01, 10
    radius, clearance = 0.18, 0.3
    spread = 0.5
    clear = 0.25

    def robot(self, number: int) -> str:
        """Return the body of a quadrotor, with a site for each rotor."""
        rotors = "".join(
            f'<site name="rotor{number}{index}" pos="{x * _ARM} {y * _ARM} 0"/>'
            f'<geom type="cylinder" size="0.07 0.004" pos="{x * _ARM} {y * _ARM} 0.02" material="dark" '
            'group="2" contype="0" conaffinity="0"/>'
            for index, (x, y, _) in enumerate(_ROTORS)
        )
        return _QUADROTOR.format(i=number, rotors=rotors)

    def motors(self, number: int) -> str:
        """Return the rotors, each with a thrust and a proportional torque."""
        return "".join(
            f'<motor site="rotor{number}{index}" gear="0 0 1 0 0 {turn * _DRAG}" ctrlrange="0 {_THRUST_N}"/>'
            for index, (_, _, turn) in enumerate(_ROTORS)
        )

    def start(self, places: Numbers, headings: Numbers) -> None:
        """Place hovering quadrotors, all facing x."""
        super().start(places, 0 * headings)
        self._height = min(_HEIGHT, self.arena.height / 2)
        self.data.qpos[self._free[:, 2]] = self._height

    def prepare(self) -> None:
        """Reset the counters."""
        self._flies = np.full(self.agents, True)
        self._sum, self._counted, self._closest = 0.0, 0, np.inf
        self._closest = self._find_closest_distance()

    def step(self, actions: NDArray[np.float32]) -> Numbers:
        """Advance by one step of control."""
        for _ in range(self.physics_steps):
            self._steer(_TOP_SPEED_M_S * actions.astype(float))
            mujoco.mj_step(self.model, self.data)
            self._flies &= ~self._touches()
        self.remaining_steps -= 1
        self._closest = min(self._closest, self._find_closest_distance())
        if self.late:
            self._sum += self._measure_coverage()
            self._counted += 1
        return self.look()

    def acting(self) -> NDArray[np.bool_]:
        """Return which quadrotors fly."""
        return self._flies

    def look(self) -> Numbers:
        """Return the sensor values."""
        around = self.read_ranges(np.zeros(self.agents))
        return np.hstack([around, self.data.qvel[self._speeds[:, :2]] / _TOP_SPEED_M_S])

    @property
    def drawn_radius(self) -> float:
        """Radius of the disc that a quadrotor sees, metres."""
        return self._view

    def states(self) -> list[str]:
        """Return which quadrotors fly."""
        return ["free" if flies else "crashed" for flies in self._flies]

    @property
    def message(self) -> str:
        """Caption of a picture."""
        return f"{100 * self._measure_coverage():.0f} % of the floor is seen"

    def fitness(self) -> float:
        """Return the share of the floor that is seen, the mean of the last quarter."""
        return float(self._sum / self._counted) if self._counted else self._measure_coverage()

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        closest = self._closest if np.isfinite(self._closest) else 0.0
        crashed = float((~self._flies).sum())
        return {"covered": self._measure_coverage(), "crashed": crashed, "closest": closest}

    def _steer(self, velocities: Numbers) -> None:
        """Run the autopilots. velocities: commands, (agents, 2), m/s.

        A cascade from velocity to acceleration, to the direction of thrust, to torques. Lee, Leok,
        McClamroch, Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010.
        """
        motion, axes = self.data.qvel[self._speeds], self.frames()
        climb = np.clip(self._height - self.positions()[:, 2], -1, 1)
        pull = np.clip(3.0 * (np.column_stack([velocities, climb]) - motion[:, :3]), -4, 4)
        pull[:, 2] += _GRAVITY
        up = axes[:, :, 2]
        thrust = _MASS * (pull * up).sum(axis=1)
        lean = np.cross(up, pull / np.linalg.norm(pull, axis=1, keepdims=True))
        lean[:, 2] -= np.arctan2(axes[:, 1, 0], axes[:, 0, 0])  # face x
        turn = (axes * lean[:, :, None]).sum(axis=1)  # in the axes of the robot
        torque = _INERTIA * (120.0 * turn - 20.0 * motion[:, 3:])
        forces = (np.column_stack([thrust, torque])[:, :, None] * _MIXER.T[None]).sum(axis=1)
        self.data.ctrl[:] = np.where(self._flies[:, None], np.clip(forces, 0, _THRUST_N), 0.0).ravel()

    def _touches(self) -> NDArray[np.bool_]:
        """Return which quadrotors touch anything, including floor and ceiling, (agents,)."""
        low = self.positions()[:, 2]
        touched: NDArray[np.bool_] = self.touching() | (low < 0.06) | (low > self.arena.height)
        return touched

    def _measure_coverage(self) -> float:
        """Return the share of the floor that flying quadrotors see."""
        places = self.positions()[self._flies, None, :2]
        is_visible = ((self._cells - places) ** 2).sum(axis=2) <= self._view**2
        return float(is_visible.any(axis=0).mean())

    def _find_closest_distance(self) -> float:
        """Return the smallest distance between flying quadrotors, infinite for fewer than two."""
        places = self.positions()[self._flies]
        if len(places) < 2:
            return float("inf")
        distances = ((places[:, None] - places[None]) ** 2).sum(axis=2)
        return float(np.sqrt(distances[~np.eye(len(places), dtype=bool)].min()))

    def _make(self, parameters: dict[str, Any]) -> None:
        super()._make(parameters)
        self._view: float = parameters["view"]
        self._speeds = self.model.jnt_dofadr[self.model.body_jntadr[self._bodies]][:, None] + np.arange(6)
        width, depth = self.arena.width, self.arena.depth
        x, y = (
            (np.arange(count) + 0.5) / count * size - size / 2 for count, size in ((40, width), (40, depth))
        )
        self._cells = np.stack(np.meshgrid(x, y), axis=2).reshape(1, -1, 2)
