"""The field of FREVO's Emergency Exit: positions of agents, exits and blockades.

Reads a field that FREVO's field editor saved, a serialized Java object. The grammar is that of the Java
Object Serialization Specification, version 6.0, chapter 6. The parser supports the parts that occur in such a
file: objects of two classes without serialization methods, arrays of them, null and references. It executes
nothing.
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
    """A problem in a serialized Java object."""


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
            raise _UnreadableError("the file is truncated")
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
                raise _UnreadableError("a reference has no target")
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
        raise _UnreadableError(f"{code:#04x} found at byte {self._at - 1}, which is not part of a field")

    def start(self) -> Any:  # noqa: ANN401 - the first content
        if (self.take(">H"), self.take(">H")) != (0xACED, 5):
            raise _UnreadableError("it does not begin with the header of a serialized Java object")
        return self.content()

    def _class(self) -> _Class:
        described = _Class(self.text())
        self.take(">q")
        self._handles.append(described)
        if self.take(">B") != _SERIALIZABLE:
            raise _UnreadableError(f"the class {described.name} has a custom serialization")
        for _ in range(self.take(">H")):
            code = chr(self.take(">B"))
            described.fields.append((code, self.text()))
            if code in "[L":
                self.content()  # the name of the type
        if self.take(">B") != _END or self.content() is not None:
            raise _UnreadableError(f"the class {described.name} has a base class")
        return described

    def _read_class_description(self) -> _Class:
        described = self.content()
        if not isinstance(described, _Class):
            raise _UnreadableError("a class is missing")
        return described

    def _array(self) -> list[Any]:
        described = self._read_class_description()
        items: list[Any] = []
        self._handles.append(items)
        if not described.name.startswith("[L"):
            raise _UnreadableError(f"a field has no arrays of type {described.name}")
        items.extend(self.content() for _ in range(self.take(">i")))
        return items

    def _object(self) -> dict[str, Any]:
        described = self._read_class_description()
        values: dict[str, Any] = {"": described.name}
        self._handles.append(values)
        for code, name in described.fields:
            if code == "I":
                values[name] = self.take(">i")
            elif code in "[L":
                values[name] = self.content()
            else:
                raise _UnreadableError(f"{described.name}.{name} has a type that does not occur in a field")
        return values


def read_field(path: Path) -> dict[str, Any]:
    """Return the field of a `.ser` file: width, height, exits, agents, blockades.

    Raises InputError for other contents.
    """
    try:
        content = _Stream(read_bytes(path, _LARGEST_FILE_BYTES)).start()
        return _field(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (_UnreadableError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InputError(f"{path}: is not a field of FREVO's Emergency Exit: {reason}") from None


def _field(content: Any) -> dict[str, Any]:  # noqa: ANN401 - any content of the file
    if not isinstance(content, dict) or content.get("") != "emergencyexit.Field":
        actual = content.get("") if isinstance(content, dict) else type(content).__name__
        raise _UnreadableError(f"it contains {actual}; expected emergencyexit.Field")
    result: dict[str, Any] = {"width": content.get("width"), "height": content.get("height")}
    for key, name in (("exits", "EmergencyExits"), ("agents", "agents"), ("blockades", "blockades")):
        points = content.get(name)
        if not isinstance(points, list):
            raise _UnreadableError(f"{name} is missing")
        for point in points:
            if not isinstance(point, dict) or point.get("") != "java.awt.Point":
                raise _UnreadableError(f"{name} contains an object that is not a point")
        result[key] = [[point.get("x"), point.get("y")] for point in points]
    return result


_SHAPE = '{"width": 20, "height": 20, "exits": [[x, y], ..], "agents": [..], "blockades": [..]}'


@dataclass(frozen=True)
class FieldFile:
    """A field and its file."""

    path: Path
    value: dict[str, Any]

    @property
    def is_json(self) -> bool:
        """Whether an experiment can refer to the file; a Java object is written into the experiment."""
        return self.path.suffix.lower() != ".ser"


def find_field(problem: Section, session: Path, field_file: Path | None) -> FieldFile:
    """Return the field of a session: that of `field_file`, or of the file beside the session.

    The session names a `.ser` file, a serialized Java object. A `.json` file of the same name (in any case)
    beside the session takes precedence.

    Raises InputError, which names the expected files, if there is no field.
    """
    name = problem.take_text("Filename", "Components/Problems/EmergencyExit/emergencyexit/Stadium.ser")
    if field_file is not None:
        return FieldFile(field_file, _read(field_file))
    stem = PureWindowsPath(name).stem  # accepts slashes and backslashes
    neighbours = sorted(session.parent.iterdir())
    for ending in (".json", ".ser"):
        for path in neighbours:
            if path.name.lower() == f"{stem}{ending}".lower():
                return FieldFile(path, _read(path))
    raise problem.error(
        "Filename",
        f"the field {name!r} is missing; put {stem}.ser or {stem}.json beside {session.name}, or name "
        f"its file with --field FILE, in JSON {_SHAPE}",
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


def format_field(value: dict[str, Any]) -> list[str]:
    """Return a field as lines of YAML below its key."""
    lines: list[str] = []
    for key, part in value.items():
        if not isinstance(part, list):
            lines.append(f"{key}: {json.dumps(part)}")
            continue
        cells = [json.dumps(cell) for cell in part]
        rows = [", ".join(cells[start : start + 10]) for start in range(0, len(cells), 10)]
        lines += [f"{key}: [", *(f"  {row}," for row in rows), "]"]
    return lines
