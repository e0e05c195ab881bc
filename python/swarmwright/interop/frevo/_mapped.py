"""The mapping of FREVO's entries: lines of an experiment, and reasons for omitted entries."""

from dataclasses import dataclass, field
from typing import Any

from swarmwright.interop.frevo._document import Section
from swarmwright.interop.frevo._field import FieldFile

EMERGENCY_EXIT = "emergency_exit"
"""Title of FREVO's Emergency Exit here."""


@dataclass(frozen=True)
class Line:
    """A line of the experiment file: key, value, and the name of the entry in FREVO as a comment."""

    key: str
    value: Any
    comment: str


@dataclass
class Mapped:
    """The lines of each section of an experiment, and the omitted entries.

    simulation: its name in the experiment. parameters, controller, method, ranking: lines of these sections.
    not_parameters, not_controller, not_method, not_ranking, not_config: omitted entries of FREVO's problem,
    representation, method, ranking and sessionconfig, each with the reason. field_file: the field, if the
    session has one. notes: differences from FREVO, for the user.
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
    """How the method mutates genes, which is an option of the controller in Swarmwright; None: not at all."""
    field_file: FieldFile | None = None
    not_parameters: list[str] = field(default_factory=list)
    not_controller: list[str] = field(default_factory=list)
    not_method: list[str] = field(default_factory=list)
    not_ranking: list[str] = field(default_factory=list)
    not_config: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def to_single_line(text: str) -> str:
    """Return a text of a file as a single line for a comment."""
    line = " ".join(text.split())[:80]
    return "".join(letter if letter.isprintable() else "?" for letter in line)


def report_unused(section: Section, reason: str) -> list[str]:
    """Return the reason for each unused entry, and mark the entries as used."""
    return [f"{key} = {to_single_line(section.take_raw(key))}: {reason}" for key in section.unused_keys]
