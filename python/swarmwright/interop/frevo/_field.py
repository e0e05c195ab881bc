"""FREVO's fields: where agents, exits and blockades of Emergency Exit are."""

import json
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.experiment.parameter_files import read_object
from swarmwright.interop.frevo import _java
from swarmwright.interop.frevo._document import Section
from swarmwright.simulations import catalogue

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
    value = _java.read_field(path) if path.suffix.lower() == ".ser" else read_object(path)
    problem = catalogue.parameters_problem("emergency_exit", {"field": value})
    if problem is not None:
        raise InputError(f"{path}: {problem.removeprefix('parameter ')}")
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
