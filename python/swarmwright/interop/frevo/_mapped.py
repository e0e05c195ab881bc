"""The mapping of FREVO's entries: lines of an experiment, and reasons for omitted entries."""

from dataclasses import dataclass, field
from typing import Any

from swarmwright.interop.frevo._document import Section
from swarmwright.interop.frevo._field import FieldFile

EMERGENCY_EXIT = "emergency_exit"
"""Title of FREVO's Emergency Exit here."""


@dataclass(frozen=True)
class Line:
    """A line of the experiment file: key, value, and the name that FREVO has for it."""

    key: str
    value: Any
    comment: str


@dataclass
class Mapped:
    """The lines of each section of an experiment, and what was left out of each.

    simulation: as experiments name it. parameters, controller, method, ranking: lines of these sections.
    not_parameters, not_controller, not_method, not_ranking, not_config: entries of FREVO's problem,
    representation, method, ranking and sessionconfig that were left out, each with the reason. field_file: of
    the field, where a session names one. notes: differences from FREVO, for the user.
    """

    seed: Line
    simulation: str = EMERGENCY_EXIT
    controller_kind: str = "fully_meshed"
    method_kind: str = "nnga"
    ranking_kind: str = "absolute"
    parameters: list[Line] = field(default_factory=list)
    controller: list[Line] = field(default_factory=list)
    method: list[Line] = field(default_factory=list)
    ranking: list[Line] = field(default_factory=list)
    mutation: Line | None = None
    """How the method changes genes, an option of the controller here; None when it does not."""
    field_file: FieldFile | None = None
    not_parameters: list[str] = field(default_factory=list)
    not_controller: list[str] = field(default_factory=list)
    not_method: list[str] = field(default_factory=list)
    not_ranking: list[str] = field(default_factory=list)
    not_config: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def one_line(text: str) -> str:
    """Return text from a file in a form that can be part of a comment."""
    line = " ".join(text.split())[:80]
    return "".join(letter if letter.isprintable() else "?" for letter in line)


def not_used(section: Section, reason: str) -> list[str]:
    """Return a reason for each entry that was not taken, and take it."""
    return [f"{key} = {one_line(section.shown(key))}: {reason}" for key in section.left]
