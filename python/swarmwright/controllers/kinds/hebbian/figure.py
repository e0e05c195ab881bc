"""The figure of a network with Hebbian learning, before learning."""

from dataclasses import replace
from typing import TYPE_CHECKING

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.kinds.fully_meshed.figure import draw as draw_meshed
from swarmwright.controllers.kinds.hebbian.code import as_meshed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `hebbian` network."""
    specification = drawing.specification
    meshed = {**as_meshed(specification), "kind": specification["kind"]}
    rate = f"learning rate {specification['weights'][0]:.2g}"
    return draw_meshed(replace(drawing, specification=meshed), rate)
