"""Swarms of robots in MuJoCo, three-dimensional rigid-body physics with contacts: rovers and quadrotors.

`swarmwright serve swarmwright.adapters.mujoco:Rovers`, or in an experiment
`simulation: swarmwright.adapters.mujoco:Quadrotors`.

Source: Todorov, Erez, Tassa, MuJoCo: A physics engine for model-based control, IROS 2012.
"""

from swarmwright._errors import InputError

try:
    import mujoco as _mujoco  # noqa: F401 - whether it is there
except ModuleNotFoundError as error:
    raise InputError("mujoco is not installed; pip install 'swarmwright[mujoco]'") from error

from swarmwright.adapters.mujoco._quadrotors import Quadrotors
from swarmwright.adapters.mujoco._robots import Robots
from swarmwright.adapters.mujoco._rovers import Rovers

__all__ = ["Quadrotors", "Robots", "Rovers"]
