"""Copies of source in run folders: `code/1/simulation/gather.py`, and a manifest that says where it was."""

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, Self

from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes
from swarmwright.common.json_text import loads
from swarmwright.common.simulation_names import SimulationName, is_in_file
from swarmwright.simulations.user_code.parts import Part, part_of

FOLDER = "code"
"""Where copies lie in a run folder, one in a folder for each version: 1, 2, .."""
_MANIFEST = "manifest.json"
_LARGEST_FILE_BYTES = 1 << 28
"""Bytes of one file of a copy."""


@dataclass(frozen=True)
class Kept:
    """One component's source, as a copy has it."""

    name: str
    """simulation, controller, method or ranking"""
    component: str
    """What the experiment called it."""
    main: str
    module: str | None
    digests: Mapping[str, str]
    origin: Path
    """Where the main file was, absolute."""
    beside: str
    """Where it was, seen from the run folder."""
    data: frozenset[str] = frozenset()
    """Places of the files that it reads and does not import."""
    patterns: tuple[str, ...] = ()
    """By which the experiment named them."""

    @property
    def in_file(self) -> bool:
        """Whether the experiment named it by its file."""
        return SimulationName.parse(self.component).file is not None


@dataclass(frozen=True)
class Copy:
    """One version of the source, in a run folder."""

    folder: Path

    @classmethod
    def write(cls, run: Path, version: int, parts: Sequence[Part]) -> Self:
        """Write a version, replacing what a killed process may have left. Raises OSError."""
        copy = cls(run / FOLDER / str(version))
        if copy.folder.exists():
            shutil.rmtree(copy.folder)
        described = {}
        for part in parts:
            for place, source in part.files.items():
                target = copy.folder / part.name / place
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(source.data)
                if os.access(source.origin, os.X_OK):
                    target.chmod(target.stat().st_mode | 0o100)
            described[part.name] = {
                "component": part.component,
                "main": part.main,
                "module": part.module,
                "origin": str(part.origin),
                "beside": os.path.relpath(part.origin, run.resolve()),
                "sha256": part.digests,
                **({"patterns": part.patterns, "data": sorted(part.data)} if part.patterns else {}),
            }
        text = json.dumps({"version": version, "parts": described}, indent=2, ensure_ascii=False)
        (copy.folder / _MANIFEST).write_text(f"{text}\n", encoding="utf-8")
        return copy

    @classmethod
    def of(cls, run: Path, version: int) -> Self | None:
        """Return a version, None where there is none."""
        copy = cls(run / FOLDER / str(version))
        return copy if (copy.folder / _MANIFEST).is_file() else None

    @classmethod
    def holding(cls, path: Path) -> "tuple[Self, Kept] | None":
        """Return the copy that a file belongs to, and the component; None for a file in no copy."""
        for folder in path.parents:
            if folder.parent.name == FOLDER and (folder / _MANIFEST).is_file():
                copy = cls(folder)
                kept = copy.parts.get(path.relative_to(folder).parts[0])
                return None if kept is None else (copy, kept)
        return None

    @property
    def run(self) -> Path:
        """The run folder."""
        return self.folder.parents[1]

    @property
    def version(self) -> int:
        """From 1 on."""
        return int(self.folder.name)

    @cached_property
    def parts(self) -> dict[str, Kept]:
        """The components, by section. Raises InputError when the manifest cannot be read."""
        file = self.folder / _MANIFEST
        try:
            described: dict[str, Any] = loads(file.read_text(encoding="utf-8"))["parts"]
            return {_inside(name): _kept(name, written) for name, written in described.items()}
        except OSError as error:
            raise InputError(f"{file}: cannot be read: {error.strerror}") from error
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise InputError(f"{file}: is damaged: {error!r}") from error

    @property
    def digest(self) -> str:
        """SHA-256, in hexadecimal, of all that was copied."""
        return digest_of({name: kept.digests for name, kept in self.parts.items()})

    def place(self, kept: Kept) -> Path:
        """Return the copy of a component's main file."""
        return self.folder / kept.name / kept.main

    def place_in_run(self, kept: Kept) -> str:
        """Return the path of the copy of a component's main file within the run folder."""
        return self.place(kept).relative_to(self.run).as_posix()

    def read(self, kept: Kept, place: str) -> bytes:
        """Return the copy of a file. Raises InputError when it is not what was copied."""
        path = self.folder / kept.name / place
        try:
            data = read_bytes(path, _LARGEST_FILE_BYTES)
        except OSError as error:
            raise InputError(
                f"{path}: this copy of the run's code cannot be read: {error.strerror}"
            ) from error
        if hashlib.sha256(data).hexdigest() != kept.digests[place]:
            raise InputError(
                f"{path}: was edited, but copies of a run's code are kept as they were; restore it, or name "
                "the file to use: --simulation FILE:Class"
            )
        return data


def _kept(name: str, described: Mapping[str, Any]) -> Kept:
    module = described["module"]
    return Kept(
        name=name,
        component=str(described["component"]),
        main=_inside(described["main"]),
        module=None if module is None else str(module),
        digests={_inside(place): str(digest) for place, digest in described["sha256"].items()},
        origin=Path(described["origin"]),
        beside=str(described["beside"]),
        data=frozenset(map(str, described.get("data", ()))),
        patterns=tuple(map(str, described.get("patterns", ()))),
    )


def _inside(place: str) -> str:
    """Return a path below the copy as it is. Raises ValueError for one that leads out of it."""
    path = PurePosixPath(place)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise ValueError(f"{place!r} lies outside the copy")
    return place


def with_files(
    experiment: Mapping[str, Any], place: Callable[[str, str], str | None]
) -> dict[str, dict[str, Any]]:
    """Return the sections of an experiment that name plug-ins by their files, with other files.

    Args:
        experiment: plain values, with the sections controller, method and ranking.
        place: returns the file of a part, see `Part.name`, None where it stays; its second argument is the
            name.

    """
    found = {"controller": _with_modules(experiment["controller"], place)}
    for section in ("method", "ranking"):
        values = experiment[section]
        found[section] = {**values, "kind": _placed(values["kind"], section, place)}
    return found


def _with_modules(controller: Mapping[str, Any], place: Callable[[str, str], str | None]) -> dict[str, Any]:
    values = dict(controller)
    for what, key in (("behaviour", "behaviours"), ("condition", "conditions")):
        names = values.get(key)
        if isinstance(names, list):
            values[key] = [
                _placed(name, part_of(what, name), place) if isinstance(name, str) else name for name in names
            ]
    return values


def _placed(name: str, part: str, place: Callable[[str, str], str | None]) -> str:
    if not is_in_file(name):
        return name
    found = place(part, name)
    return name if found is None else SimulationName.parse(name).in_file(found)


def beside(run: Path, file: Path) -> list[Path]:
    """Return where a file that was copied together with a run folder may be: in it, or next to it."""
    return [run / file.name, run.parent / file.name]


def digest_of(parts: Mapping[str, Mapping[str, str]]) -> str:
    """Return the SHA-256, in hexadecimal, of components' files: section -> place -> their SHA-256."""
    lines = sorted(
        f"{name}/{place} {digest}\n" for name, part in parts.items() for place, digest in part.items()
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def display_name(simulation: str) -> str:
    """Return a simulation's name for people; of a class that a run has a copy of, what it was called."""
    parsed = SimulationName.parse(simulation)
    if parsed.is_command:
        return parsed.label
    if parsed.file is None:
        return simulation
    try:
        held = Copy.holding(parsed.file)
    except InputError:
        held = None
    if held is None:
        return simulation
    _, kept = held
    return parsed.in_file(kept.module or kept.main)


def holds_copies_alone(run: Path) -> bool:
    """Whether `remove` would leave nothing of the folder of copies."""
    known = _copied(run)
    return not (run / FOLDER).is_symlink() and all(
        entry in known or "__pycache__" in entry.parts or (entry.is_dir() and not entry.is_symlink())
        for entry in (run / FOLDER).rglob("*")
    )


def _copied(run: Path) -> set[Path]:
    """Return the manifests of the copies in a run folder, and the files that they name."""
    found = set()
    for manifest in (run / FOLDER).glob(f"*/{_MANIFEST}"):
        found.add(manifest)
        copy = Copy(manifest.parent)
        with suppress(InputError):
            found |= {
                copy.folder / kept.name / place for kept in copy.parts.values() for place in kept.digests
            }
    return found


def remove(run: Path) -> None:
    """Delete the copies in a run folder, but no other files beside them."""
    for file in _copied(run):
        file.unlink(missing_ok=True)
    for folder in sorted((run / FOLDER).glob("**/"), reverse=True):  # inner ones first
        if folder.is_symlink():
            continue
        if folder.name == "__pycache__":
            shutil.rmtree(folder)
        elif not any(folder.iterdir()):
            folder.rmdir()
