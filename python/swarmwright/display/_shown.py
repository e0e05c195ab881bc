"""What is drawn of an episode."""

from dataclasses import dataclass
from typing import Literal

PARTS = ("trails", "rays", "links", "labels")
"""What can be drawn or left out."""


COLORS = ("auto", "state", "value", "controller")
"""What can give bodies their colours."""


@dataclass(frozen=True)
class Shown:
    """What is drawn beside bodies: a page shows it at first, and can show all.

    labels: True or False, or None: True, but on a page with more than 100 labelled bodies False at first.
    colors: what gives bodies their colours: their kind and state, their value, or the state of the agent's
    controller where that is a state machine. auto: the value where there is one, on a page the controller.
    """

    trails: bool = True
    rays: bool = False
    links: bool = False
    labels: bool | None = None
    colors: Literal["auto", "state", "value", "controller"] = "auto"
