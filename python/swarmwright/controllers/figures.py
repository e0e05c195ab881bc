"""Controllers as figures: networks, state machines, sets of parameters."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from swarmwright.common.plain_figures import use_plain_settings
from swarmwright.controllers.drawing import Drawing, Names
from swarmwright.controllers.kinds import draw_controller

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Names", "figure"]


@use_plain_settings()
def figure(
    specification: Mapping[str, Any],
    *,
    title: str = "",
    simulation: Mapping[str, Any] | None = None,
    options: Mapping[str, Any] | None = None,
    first_color: int = 0,
) -> "Figure":
    """Return a matplotlib figure of a controller.

    Args:
        specification: the controller as plain values, see protocol/schemas/controller.schema.json.
        title: above the figure.
        simulation: its description, for the names of sensors and actuators; without it, they are numbered.
        options: the experiment's `controller`, which knows the ranges of parameters.
        first_color: index of the colour of state 0; each group of a team has its own colours.

    Raises:
        InputError: a controller of this kind cannot be drawn.
    """
    return draw_controller(Drawing(specification, title, simulation, options or {}, first_color))
