"""Controllers as figures: networks, state machines, sets of parameters."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import InputError
from swarmwright.common.modules import is_modules
from swarmwright.common.plain_figures import plain
from swarmwright.common.teams import is_team
from swarmwright.controllers.figures.names import Names
from swarmwright.controllers.kinds.evostick.network import as_layered
from swarmwright.controllers.kinds.hebbian import meshed as hebbian
from swarmwright.controllers.kinds.neat import specification as neat

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Names", "figure"]


@plain()
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
        simulation: its description, for the names of sensors and actuators, which are numbered without.
        options: the experiment's `controller`, which knows the ranges of parameters.
        first_color: index of the colour of state 0; each group of a team has colours of its own.

    Raises:
        InputError: a controller of this kind cannot be drawn.
    """
    kind = specification.get("kind")
    if kind == "evostick":
        specification = {**as_layered(specification), "kind": kind}
    if kind == hebbian.KIND:
        rate = f"learning rate {specification['weights'][0]:.2g}"
        specification = {**hebbian.as_meshed(specification), "kind": kind, "activation": rate}
    if kind == neat.KIND:
        specification = {**specification, **neat.sizes(specification)}
    if kind in {"layered", "fully_meshed", "evostick", hebbian.KIND, neat.KIND}:
        from swarmwright.controllers.figures.network import draw as draw_network

        return draw_network(specification, Names.of(specification, simulation), title)
    if kind == "mealy_fsm":
        from swarmwright.controllers.figures.state_machine import draw as draw_machine

        return draw_machine(specification, Names.of(specification, simulation), title, first_color)
    if is_modules(specification):
        from swarmwright.controllers.figures.modules import draw as draw_modules

        return draw_modules(specification, title, first_color)
    if kind == "parameter_set":
        from swarmwright.controllers.figures.parameters import draw as draw_parameters

        return draw_parameters(specification, options or {}, title)
    if is_team(specification):
        from swarmwright.controllers.figures.team import draw as draw_team

        return draw_team(specification, title, simulation)
    raise InputError(f"controller: one of the kind {kind!r} cannot be drawn")
