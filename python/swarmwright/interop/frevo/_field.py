"""FREVO's fields: where agents, exits and blockades of Emergency Exit are.

Reads a field that FREVO's field editor saved: a serialized Java object.

Grammar: Java Object Serialization Specification, version 6.0, chapter 6. Only what such a file consists of is
known: objects of two classes without serialization methods, arrays of them, null and references. Nothing is
executed.
"""

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Any, cast

from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes
from swarmwright.experiment.parameter_files import read_object
from swarmwright.interop.frevo._document import Section
from swarmwright.simulations import catalogue

_NULL, _REFERENCE, _CLASS, _OBJECT, _STRING, _ARRAY, _END = 0x70, 0x71, 0x72, 0x73, 0x74, 0x75, 0x78
_FIRST_HANDLE = 0x7E0000
_SERIALIZABLE = 0x02
_LARGEST_FILE_BYTES = 1 << 27  # bytes


class _UnreadableError(Exception):
    """What is wrong, and the byte where."""


@dataclass
class _Class:
    name: str
    fields: list[tuple[str, str]] = field(default_factory=list)
    """Type code and name."""


class _Stream:
    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0
        self._handles: list[Any] = []

    def take(self, form: str) -> int:
        size = struct.calcsize(form)
        if self._at + size > len(self._data):
            raise _UnreadableError("the file ends in the middle of something")
        (value,) = struct.unpack_from(form, self._data, self._at)
        self._at += size
        return cast("int", value)

    def text(self) -> str:
        length = self.take(">H")
        raw = self._data[self._at : self._at + length]
        self._at += length
        return raw.decode("utf-8", "replace")

    def content(self) -> Any:  # noqa: ANN401 - null, text, array or object
        code = self.take(">B")
        if code == _NULL:
            return None
        if code == _REFERENCE:
            index = self.take(">I") - _FIRST_HANDLE
            if not 0 <= index < len(self._handles):
                raise _UnreadableError("a reference leads nowhere")
            return self._handles[index]
        if code == _STRING:
            text = self.text()
            self._handles.append(text)
            return text
        if code == _CLASS:
            return self._class()
        if code == _ARRAY:
            return self._array()
        if code == _OBJECT:
            return self._object()
        raise _UnreadableError(f"{code:#04x} found at byte {self._at - 1}, which has no place in a field")

    def start(self) -> Any:  # noqa: ANN401 - the first content
        if (self.take(">H"), self.take(">H")) != (0xACED, 5):
            raise _UnreadableError("it does not begin like a serialized Java object")
        return self.content()

    def _class(self) -> _Class:
        made = _Class(self.text())
        self.take(">q")
        self._handles.append(made)
        if self.take(">B") != _SERIALIZABLE:
            raise _UnreadableError(f"the class {made.name} has a custom serialization")
        for _ in range(self.take(">H")):
            code = chr(self.take(">B"))
            made.fields.append((code, self.text()))
            if code in "[L":
                self.content()  # the name of the type
        if self.take(">B") != _END or self.content() is not None:
            raise _UnreadableError(f"the class {made.name} is derived from another")
        return made

    def _described(self) -> _Class:
        made = self.content()
        if not isinstance(made, _Class):
            raise _UnreadableError("a class is missing")
        return made

    def _array(self) -> list[Any]:
        described = self._described()
        items: list[Any] = []
        self._handles.append(items)
        if not described.name.startswith("[L"):
            raise _UnreadableError(f"an array of the type {described.name} has no place in a field")
        items.extend(self.content() for _ in range(self.take(">i")))
        return items

    def _object(self) -> dict[str, Any]:
        described = self._described()
        values: dict[str, Any] = {"": described.name}
        self._handles.append(values)
        for code, name in described.fields:
            if code == "I":
                values[name] = self.take(">i")
            elif code in "[L":
                values[name] = self.content()
            else:
                raise _UnreadableError(f"{described.name}.{name} is of a type that has no place in a field")
        return values


def read_field(path: Path) -> dict[str, Any]:
    """Return the field of a `.ser` file: width, height, exits, agents, blockades.

    Raises InputError when the file holds something else.
    """
    try:
        read = _Stream(read_bytes(path, _LARGEST_FILE_BYTES)).start()
        return _field(read)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (_UnreadableError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InputError(f"{path}: is not a field of FREVO's Emergency Exit: {reason}") from None


def _field(read: Any) -> dict[str, Any]:  # noqa: ANN401 - whatever the file held
    if not isinstance(read, dict) or read.get("") != "emergencyexit.Field":
        found = read.get("") if isinstance(read, dict) else type(read).__name__
        raise _UnreadableError(f"it holds {found}; expected emergencyexit.Field")
    result: dict[str, Any] = {"width": read.get("width"), "height": read.get("height")}
    for key, name in (("exits", "EmergencyExits"), ("agents", "agents"), ("blockades", "blockades")):
        points = read.get(name)
        if not isinstance(points, list):
            raise _UnreadableError(f"{name} is missing")
        for point in points:
            if not isinstance(point, dict) or point.get("") != "java.awt.Point":
                raise _UnreadableError(f"{name} holds an object that is not a point")
        result[key] = [[point.get("x"), point.get("y")] for point in points]
    return result


_SHAPE = '{"width": 20, "height": 20, "exits": [[x, y], ..], "agents": [..], "blockades": [..]}'


@dataclass(frozen=True)
class FieldFile:
    """A field, and the file it was read from."""

    path: Path
    value: dict[str, Any]

    @property
    def is_json(self) -> bool:
        """Whether an experiment can name the file; a Java object must be written out."""
        return self.path.suffix.lower() != ".ser"


def find_field(problem: Section, session: Path, given: Path | None) -> FieldFile:
    """Return the field of a session: the given file, or the one beside the session that it names.

    The session names a `.ser` file, a serialized Java object; beside the session a `.json` file of the same
    name (in any case) comes first.

    Raises InputError when there is none, saying where it was looked for.
    """
    named = problem.take_text("Filename", "Components/Problems/EmergencyExit/emergencyexit/Stadium.ser")
    if given is not None:
        return FieldFile(given, _read(given))
    stem = PureWindowsPath(named).stem  # knows both kinds of slashes
    neighbours = sorted(session.parent.iterdir())
    for ending in (".json", ".ser"):
        for path in neighbours:
            if path.name.lower() == f"{stem}{ending}".lower():
                return FieldFile(path, _read(path))
    raise problem.error(
        "Filename",
        f"the field {named!r} is not there: put {stem}.ser or {stem}.json beside {session.name}, or give the "
        f"file with --field FILE; as JSON it is {_SHAPE}",
    )


def _read(path: Path) -> dict[str, Any]:
    value = read_field(path) if path.suffix.lower() == ".ser" else read_object(path)
    try:
        mistakes = catalogue.parameter_mistakes("emergency_exit", {"field": value})
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if mistakes:
        raise InputError("\n".join(f"{path}: {mistake}" for mistake in mistakes))
    return value


def as_yaml(value: dict[str, Any]) -> list[str]:
    """Return a field as lines of YAML, to be put under its key."""
    lines: list[str] = []
    for key, part in value.items():
        if not isinstance(part, list):
            lines.append(f"{key}: {json.dumps(part)}")
            continue
        cells = [json.dumps(cell) for cell in part]
        rows = [", ".join(cells[start : start + 10]) for start in range(0, len(cells), 10)]
        lines += [f"{key}: [", *(f"  {row}," for row in rows), "]"]
    return lines
