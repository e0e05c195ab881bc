"""What is drawn of an episode."""

from dataclasses import dataclass

PARTS = ("trails", "rays", "links", "labels")
"""What can be drawn or left out."""


@dataclass(frozen=True)
class Shown:
    """What is drawn beside bodies: a page shows it at first, and can show all."""

    trails: bool = True
    rays: bool = False
    links: bool = False
    labels: bool = True
