"""What the class of a simulation can show: scenes, which are drawn here, or pictures that it draws itself."""

from functools import cache
from typing import Literal

from swarmwright.common.errors import InputError
from swarmwright.simulations.base import Described, Simulation
from swarmwright.simulations.batches import BatchSimulation


@cache
def shown_as(kind: type[Simulation] | type[BatchSimulation]) -> Literal["scene", "picture"]:
    """Return what a class can show, scenes where it has both.

    Raises InputError with the reason where there is nothing to show.
    """
    if defines(kind, "scene"):
        return "scene"
    if issubclass(kind, Simulation) and defines(kind, "picture"):
        unshown = getattr(kind, "unshown", None)  # of environments of libraries
        reason = None if unshown is None else unshown()
        if reason is not None:
            raise InputError(reason)
        return "picture"
    if hasattr(kind, "runVisual"):
        raise InputError(f"{kind.__name__} is a command, whose episodes cannot be drawn here")
    raise InputError(
        f"{kind.__name__} has nothing to show: give it a method scene() that returns a "
        "swarmwright.display.Scene, or picture() that returns an image"
    )


@cache
def drawing(kind: type[Simulation]) -> type[Simulation]:
    """Return the class whose objects draw pictures: environments of libraries render only when asked to.

    Raises InputError where the environment cannot.
    """
    rendered = getattr(kind, "rendered", None)
    made: type[Simulation] = kind if rendered is None else rendered()
    return made


def defines(kind: type[Described], method: str) -> bool:
    """Return whether a class overrides a method."""
    found = getattr(kind, method, None)
    return found is not None and all(
        found is not getattr(base, method, None) for base in (Simulation, BatchSimulation)
    )
