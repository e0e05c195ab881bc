"""Robots in MuJoCo, three-dimensional physics with contacts: rovers, quadrotors, and the arena's missions.

`swarmwright serve swarmwright.simulations.mujoco:Rovers`, or in an experiment
`simulation: swarmwright.simulations.mujoco:Quadrotors`.

Source: Todorov, Erez, Tassa, MuJoCo: A physics engine for model-based control, IROS 2012.
"""

from swarmwright.simulations.mujoco._library import load as _load

undrawable = _load()
"""Exception that explains why MuJoCo cannot draw on this machine; None if it can."""

from swarmwright.simulations.mujoco._robots import Missions, Quadrotors, Robots, Rovers  # noqa: E402

__all__ = ["Missions", "Quadrotors", "Robots", "Rovers"]
