"""What is written about an episode."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Caption:
    """A title, and facts below it."""

    title: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    """Name and value of each."""
