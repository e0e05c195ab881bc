"""Teams: the drawings of the groups' controllers, one below the other."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.kinds import draw_controller, machine_of
from swarmwright.controllers.teams import parts_of
from swarmwright.display.figures.style import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DOTS_PER_INCH = 150


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `team`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    title = drawing.title
    pictures: list[NDArray[np.uint8]] = []
    color = 0
    for name, part in parts_of(drawing.specification).items():
        whole_title = f"{title}, {name}" if title else name
        figure = draw_controller(
            Drawing(part, whole_title, _select_group(drawing.simulation or {}, name), first_color=color)
        )
        machine = machine_of(part)
        color += 0 if machine is None else len(machine["states"])
        figure.set_dpi(_DOTS_PER_INCH)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()  # type: ignore[no-untyped-call]
        pictures.append(np.asarray(canvas.buffer_rgba()))  # type: ignore[no-untyped-call]
    sizes = np.array([picture.shape[:2] for picture in pictures])
    height, width = sizes[:, 0].sum() / _DOTS_PER_INCH, sizes[:, 1].max() / _DOTS_PER_INCH
    whole = new_figure(float(width), float(height))
    grid = whole.subplots(
        len(pictures), 1, squeeze=False, gridspec_kw={"height_ratios": sizes[:, 0].tolist()}
    )
    for axes, picture in zip(grid[:, 0], pictures, strict=True):
        axes.imshow(picture, interpolation="lanczos")
        axes.axis("off")
    return whole


def _select_group(simulation: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return the description of a group of agents, with the names of its sensors and actuators."""
    groups = simulation.get("groups") or ()
    return next((group for group in groups if group["name"] == name), simulation)
