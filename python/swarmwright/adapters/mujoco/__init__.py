"""Robots in MuJoCo, three-dimensional physics with contacts: rovers, quadrotors, and the arena's missions.

`swarmwright serve swarmwright.adapters.mujoco:Rovers`, or in an experiment
`simulation: swarmwright.adapters.mujoco:Quadrotors`.

Source: Todorov, Erez, Tassa, MuJoCo: A physics engine for model-based control, IROS 2012.
"""

from swarmwright.adapters.mujoco._library import load as _load

undrawable = _load()
"""Why MuJoCo cannot draw here, known from importing it; None where it can."""

from swarmwright.adapters.mujoco._missions import Missions  # noqa: E402
from swarmwright.adapters.mujoco._quadrotors import Quadrotors  # noqa: E402
from swarmwright.adapters.mujoco._robots import Robots  # noqa: E402
from swarmwright.adapters.mujoco._rovers import Rovers  # noqa: E402

__all__ = ["Missions", "Quadrotors", "Robots", "Rovers"]
