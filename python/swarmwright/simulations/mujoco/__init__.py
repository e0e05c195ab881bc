"""Robots in MuJoCo, three-dimensional physics with contacts: rovers, quadrotors, and the arena's missions.

`swarmwright serve swarmwright.simulations.mujoco:Rovers`, or in an experiment
`simulation: swarmwright.simulations.mujoco:Quadrotors`.

Source: Todorov, Erez, Tassa, MuJoCo: A physics engine for model-based control, IROS 2012.
"""

import os

from swarmwright.common.errors import InputError

_DRAWING_ADVICE = (
    "without a screen, install OSMesa (Debian's package libosmesa6) and PyOpenGL, and set MUJOCO_GL=osmesa; "
    "with a graphics card, set MUJOCO_GL=egl (Debian's libegl1)"
)


def _load() -> Exception | None:
    """Import mujoco; return the exception that prevents drawing, None if it can draw.

    The renderer that MUJOCO_GL names is loaded with the library. If that fails, the library is imported
    without it, as only videos need it.

    Raises InputError if mujoco is not installed.
    """
    try:
        import mujoco
    except Exception as error:
        if getattr(error, "name", None) == "mujoco":
            raise InputError("mujoco is not installed; pip install 'swarmwright[mujoco]'") from error
        named = os.environ.get("MUJOCO_GL")
        if named is None:
            raise
        os.environ["MUJOCO_GL"] = "disable"
        try:
            import mujoco  # noqa: F401
        finally:
            os.environ["MUJOCO_GL"] = named
        return error
    return None


def cannot_draw(reason: Exception) -> InputError:
    """Return an error with advice on how to make MuJoCo draw."""
    named = os.environ.get("MUJOCO_GL")
    setting = f"MUJOCO_GL={named}" if named else "MUJOCO_GL is not set"
    words = f"{type(reason).__name__}: {reason}" if str(reason) else type(reason).__name__
    return InputError(f"MuJoCo cannot draw on this machine ({setting}; {words}); {_DRAWING_ADVICE}")


undrawable = _load()
"""Exception that explains why MuJoCo cannot draw on this machine; None if it can."""

from swarmwright.simulations.mujoco._robots import Missions, Quadrotors, Robots, Rovers  # noqa: E402

__all__ = ["Missions", "Quadrotors", "Robots", "Rovers"]
