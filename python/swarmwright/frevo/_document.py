"""What is in FREVO's files: sections of entries, each section with the class that is to be used."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from swarmwright._errors import InputError
from swarmwright._suggest import did_you_mean
from swarmwright.frevo._xml import Element, read

MACHINE = "fsm.MealyFSM"
SECTIONS = {
    "problem": ("emergencyexit.EmergencyExit",),
    "method": ("nnga.NNGA", "CEA2D.CEA2D"),
    "representation": ("fullyMeshedNet.FullyMeshedNet", MACHINE),
    "ranking": ("AbsoluteRanking.AbsoluteRanking",),
}
"""Sections of a session, and the classes of each that have a counterpart here."""


@dataclass
class Section:
    """Entries by key.

    `take_*` reads one, FREVO's default where it is left out; what was not taken is left.
    """

    name: str
    element: Element
    entries: dict[str, Element] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)

    @property
    def class_name(self) -> str:
        """FREVO's class."""
        return self.element.attribute("class")

    def shown(self, key: str, default: str = "") -> str:
        """Return an entry's value as it stands in the file."""
        self.taken.add(key)
        return self.entries[key].attribute("value") if key in self.entries else default

    def error(self, key: str, message: str) -> InputError:
        """Return an error about an entry, to be raised."""
        element = self.entries.get(key, self.element)
        return InputError(f"{element.file}:{element.line}: {self.name}.{key}: {message}")

    def take_text(self, key: str, default: str, choices: tuple[str, ...] = ()) -> str:
        """Return text, one of the choices if there are any."""
        text = self.shown(key, default).strip()
        if choices and text not in choices:
            raise self.error(
                key, f"{text!r} found, expected one of {', '.join(choices)}{did_you_mean(text, choices)}"
            )
        return text

    def take_integer(self, key: str, default: int, least: int = -(2**63)) -> int:
        """Return a whole number of at least `least`."""
        text = self.shown(key, str(default)).strip()
        try:
            value = int(text)
        except ValueError:
            raise self.error(key, f"{text!r} found, expected a whole number") from None
        if value < least:
            raise self.error(key, f"{value} found, expected a whole number of at least {least}")
        return value

    def take_number(self, key: str, default: float) -> float:
        """Return a finite number, Java's `0.15f` as 0.15."""
        text = self.shown(key, str(default)).strip()
        value = java_number(text)
        if value is None:
            raise self.error(key, f"{text!r} found, expected a number such as 0.15f")
        return value

    def take_flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        return self.take_text(key, str(default).lower(), ("true", "false")) == "true"

    @property
    def left(self) -> list[str]:
        """Keys that nobody took, in the file's order."""
        return [key for key in self.entries if key not in self.taken]


@dataclass(frozen=True)
class Session:
    """A FREVO file: what was to be done, and in a result file the populations that came out."""

    path: Path
    root: Element
    config: Section
    problem: Section
    method: Section
    representation: Section
    ranking: Section


def java_number(text: str) -> float | None:
    """Return what Java's Float.parseFloat makes of a text; None when that is no finite number."""
    text = text.strip()
    if text[-1:] in {"f", "F", "d", "D"}:
        text = text[:-1]
    try:
        value = float(text) if "_" not in text else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def open_session(path: Path) -> Session:
    """Read a session or result file.

    Raises InputError, with file and line, when it is none, or names a class that has no counterpart here.
    """
    root = read(path)
    if root.tag != "frevo":
        raise root.error(
            "found as the outermost element; expected <frevo>, a session (.zse) or result (.zre)"
        )
    sections = {name: _section(root, name, f"{name}entry") for name in SECTIONS}
    for name, known in SECTIONS.items():
        _check_class(sections[name], known)
    has_config = bool(root.all("sessionconfig"))
    empty = Section("sessionconfig", root)
    config = _section(root, "sessionconfig", "configentry") if has_config else empty
    return Session(path=path, root=root, config=config, **sections)


def _section(root: Element, name: str, entry: str) -> Section:
    section = Section(name, root.one(name))
    for element in section.element.children:
        if element.tag != entry:
            raise element.error(f"found inside <{name}>; expected <{entry}>")
        key = element.attribute("key")
        element.attribute("value")
        if key in section.entries:
            first = section.entries[key].line
            raise element.error(f"the key {key} stands twice (first in line {first}); keep one")
        section.entries[key] = element
    return section


def _check_class(section: Section, known: tuple[str, ...]) -> None:
    if section.class_name not in known:
        raise section.element.error(
            f"the class {section.class_name!r} has no counterpart here"
            f"{did_you_mean(section.class_name, known)}; what can be taken over is {' or '.join(known)}"
        )
