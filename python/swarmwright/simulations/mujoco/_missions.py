"""The arena's missions in MuJoCo."""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarmwright.simulations.physics import Physics, PushedObject, RobotModel, World

_STEP = 0.005
"""Seconds of a step of MuJoCo."""
_THICKNESS = 0.05
"""Thickness of walls, metres."""
_SERVO = 0.01
"""Seconds in which a drive reaches its speed unless its largest force limits it."""


class Missions(Physics):
    """Robots are cylinders that stay upright on the floor, and touch walls, objects and each other.

    Drives are speed servos along the robot, across it and around its axis. The forces of the first two are
    limited to the acceleration of the model's drive; the wheels of a differential drive resist being pushed
    sideways with the same force. Objects lie on the floor, with gravity and friction.
    """

    title = "arena-mujoco"
    determinism = "bitwise"

    def start(
        self,
        world: World,
        changed: bool,
        robots: NDArray[np.float32],
        objects: NDArray[np.float32],
        seed: int,  # noqa: ARG002 - there is no randomness
    ) -> None:
        """Start an episode."""
        if changed:
            self._model = mujoco.MjModel.from_xml_string(_xml(world))
            self._data = mujoco.MjData(self._model)
            self._parts = round(world.tick / _STEP)
            self._robots, self._heights = (
                len(robots),
                [pushed_object.height / 2 for pushed_object in world.objects],
            )
        mujoco.mj_resetData(self._model, self._data)
        at = 3 * self._robots
        self._data.qpos[:at] = robots.ravel()
        for (x, y, heading), height in zip(objects.tolist(), self._heights, strict=True):
            turned = (math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2))
            self._data.qpos[at : at + 7] = (x, y, height, *turned)
            at += 7
        mujoco.mj_forward(self._model, self._data)

    def step(self, motions: NDArray[np.float32]) -> None:
        """Advance by one tick."""
        self._data.ctrl[:] = motions.ravel()
        mujoco.mj_step(self._model, self._data, self._parts)

    def poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the poses of robots and objects."""
        at = 3 * self._robots
        objects = self._data.qpos[at:].reshape(-1, 7)
        w, x, y, z = objects[:, 3:].T
        heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return self._data.qpos[:at].reshape(-1, 3), np.column_stack([objects[:, :2], heading])


def _xml(world: World) -> str:
    bodies = [_robot(index, world.model(index)) for index in range(len(world.robots))]
    drives = [_drive(index, world.model(index)) for index in range(len(world.robots))]
    objects = [_object(index, pushed_object) for index, pushed_object in enumerate(world.objects)]
    walls = [
        f'<geom type="box" pos="{box.x} {box.y} {box.height / 2}" euler="0 0 {box.angle}" '
        f'size="{box.length / 2} {box.thickness / 2} {box.height / 2}"/>'
        for box in world.wall_boxes(_THICKNESS)
    ]
    return f"""<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{_STEP}" integrator="implicitfast" cone="elliptic"/>
  <size memory="256M"/>
  <default><geom condim="3" friction="0.3 0.005 0.0001" priority="0"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" contype="2" conaffinity="2"/>
    {"".join(walls)}
    {"".join(bodies)}
    {"".join(objects)}
  </worldbody>
  <actuator>{"".join(drives)}</actuator>
</mujoco>"""


def _robot(index: int, model: RobotModel) -> str:
    """Return the body of a robot, without gravity, so that it does not fall over."""
    half = model.height / 2
    return (
        f'<body name="robot{index}" gravcomp="1"><joint type="slide" axis="1 0 0"/>'
        '<joint type="slide" axis="0 1 0"/>'
        f'<joint type="hinge" axis="0 0 1"/><site name="robot{index}"/><geom type="cylinder" '
        f'pos="0 0 {half}" size="{model.radius} {half}" mass="{model.mass}"/></body>'
    )


def _drive(index: int, model: RobotModel) -> str:
    gain, most = model.mass / _SERVO, model.mass * model.acceleration
    inertia = model.mass * model.radius**2 / 2
    along, across, around = ("1 0 0 0 0 0", "0 1 0 0 0 0", "0 0 0 0 0 1")
    return "".join(
        f'<velocity site="robot{index}" gear="{axis}" kv="{gain}" forcerange="-{most} {most}"/>'
        for axis in (along, across)
    ) + (f'<velocity site="robot{index}" gear="{around}" kv="{inertia / _SERVO}"/>')


def _object(index: int, pushed: PushedObject) -> str:
    half = pushed.height / 2
    form = (
        f'type="cylinder" size="{pushed.radius} {half}"'
        if pushed.radius
        else f'type="box" size="{pushed.width / 2} {pushed.depth / 2} {half}"'
    )
    return (
        f'<body name="object{index}"><freejoint/><geom {form} mass="{pushed.mass}" contype="3" '
        f'conaffinity="3" '
        f'priority="1" friction="{pushed.friction} 0.005 0.0001"/></body>'
    )
