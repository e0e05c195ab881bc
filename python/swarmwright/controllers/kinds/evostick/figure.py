"""The figure of EvoStick's network."""

from dataclasses import replace
from typing import TYPE_CHECKING

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.kinds.evostick.code import as_layered
from swarmwright.controllers.kinds.layered.figure import draw as draw_layered

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of an `evostick` network."""
    layered = as_layered(drawing.specification)
    return draw_layered(replace(drawing, specification={**layered, "kind": drawing.specification["kind"]}))
