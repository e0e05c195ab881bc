"""Copies of source in run folders: `code/1/simulation/gather.py`, and a manifest with their origin."""

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
from swarmwright.simulations.user_code.parts import Part, format_part_name

FOLDER = "code"
"""Folder of copies in a run folder, with a subfolder for each version: 1, 2, .."""
_MANIFEST = "manifest.json"
_LARGEST_FILE_BYTES = 1 << 28
"""Largest size of a file of a copy in bytes."""


@dataclass(frozen=True)
class CopiedPart:
    """The source of a component in a copy."""

    name: str
    """simulation, controller, method or ranking"""
    component: str
    """Its name in the experiment."""
    main: str
    module: str | None
    digests: Mapping[str, str]
    origin: Path
    """Absolute path of the original main file."""
    relative_origin: str
    """Path of the original main file relative to the run folder."""
    data: frozenset[str] = frozenset()
    """Locations of the data files, which it reads and does not import."""
    patterns: tuple[str, ...] = ()
    """The experiment's patterns for the data files."""

    @property
    def in_file(self) -> bool:
        """Whether the experiment named it by its file."""
        return SimulationName.parse(self.component).file is not None


@dataclass(frozen=True)
class Copy:
    """A version of the source in a run folder."""

    folder: Path

    @classmethod
    def write(cls, run: Path, version: int, parts: Sequence[Part]) -> Self:
        """Write a version, replacing an incomplete one of a killed process. Raises OSError."""
        copy = cls(run / FOLDER / str(version))
        if copy.folder.exists():
            shutil.rmtree(copy.folder)
        described = {}
        for part in parts:
            for location, source in part.files.items():
                target = copy.folder / part.name / location
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
    def find(cls, run: Path, version: int) -> Self | None:
        """Return a version of a run; None if it does not exist."""
        copy = cls(run / FOLDER / str(version))
        return copy if (copy.folder / _MANIFEST).is_file() else None

    @classmethod
    def find_containing(cls, path: Path) -> "tuple[Self, CopiedPart] | None":
        """Return the copy and the component that a file belongs to; None if it is not in a copy."""
        for folder in path.parents:
            if folder.parent.name == FOLDER and (folder / _MANIFEST).is_file():
                copy = cls(folder)
                copied = copy.parts.get(path.relative_to(folder).parts[0])
                return None if copied is None else (copy, copied)
        return None

    @property
    def run(self) -> Path:
        """The run folder."""
        return self.folder.parents[1]

    @property
    def version(self) -> int:
        """Number of the version, from 1."""
        return int(self.folder.name)

    @cached_property
    def parts(self) -> dict[str, CopiedPart]:
        """The components, by section. Raises InputError if the manifest cannot be read."""
        file = self.folder / _MANIFEST
        try:
            described: dict[str, Any] = loads(file.read_text(encoding="utf-8"))["parts"]
            return {_check_location(name): _parse_part(name, written) for name, written in described.items()}
        except OSError as error:
            raise InputError(f"{file}: cannot be read: {error.strerror}") from error
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise InputError(f"{file}: damaged manifest: {error!r}") from error

    @property
    def digest(self) -> str:
        """SHA-256, in hexadecimal, of all copied files."""
        return compute_digest({name: copied.digests for name, copied in self.parts.items()})

    def main_path(self, copied: CopiedPart) -> Path:
        """Return the copy of a component's main file."""
        return self.folder / copied.name / copied.main

    def main_path_in_run(self, copied: CopiedPart) -> str:
        """Return the path of the copy of a component's main file within the run folder."""
        return self.main_path(copied).relative_to(self.run).as_posix()

    def read(self, copied: CopiedPart, location: str) -> bytes:
        """Return the bytes of a copied file. Raises InputError if the copy has been changed."""
        path = self.folder / copied.name / location
        try:
            data = read_bytes(path, _LARGEST_FILE_BYTES)
        except OSError as error:
            raise InputError(f"{path}: cannot read this copy of the run's code: {error.strerror}") from error
        if hashlib.sha256(data).hexdigest() != copied.digests[location]:
            raise InputError(
                f"{path}: this copy of the run's code was edited; restore it, or name another file with "
                "--simulation FILE:Class"
            )
        return data


def _parse_part(name: str, described: Mapping[str, Any]) -> CopiedPart:
    module = described["module"]
    return CopiedPart(
        name=name,
        component=str(described["component"]),
        main=_check_location(described["main"]),
        module=None if module is None else str(module),
        digests={_check_location(location): str(digest) for location, digest in described["sha256"].items()},
        origin=Path(described["origin"]),
        relative_origin=str(described["beside"]),
        data=frozenset(map(str, described.get("data", ()))),
        patterns=tuple(map(str, described.get("patterns", ()))),
    )


def _check_location(location: str) -> str:
    """Return a location unchanged. Raises ValueError if it is outside the copy."""
    path = PurePosixPath(location)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise ValueError(f"{location!r} is outside the copy")
    return location


def with_files(
    experiment: Mapping[str, Any], replace: Callable[[str, str], str | None]
) -> dict[str, dict[str, Any]]:
    """Return the sections of an experiment with the files of plug-ins replaced.

    Args:
        experiment: plain values, with the sections controller, method and ranking.
        replace: called with the name of a part, see `Part.name`, and of its file; returns another file, or
            None to keep it.
    """
    sections = {"controller": _with_modules(experiment["controller"], replace)}
    for section in ("method", "ranking"):
        values = experiment[section]
        sections[section] = {**values, "kind": _replace_file(values["kind"], section, replace)}
    return sections


def _with_modules(controller: Mapping[str, Any], replace: Callable[[str, str], str | None]) -> dict[str, Any]:
    values = dict(controller)
    for kind, key in (("behaviour", "behaviours"), ("condition", "conditions")):
        names = values.get(key)
        if isinstance(names, list):
            values[key] = [
                _replace_file(name, format_part_name(kind, name), replace) if isinstance(name, str) else name
                for name in names
            ]
    return values


def _replace_file(name: str, part: str, replace: Callable[[str, str], str | None]) -> str:
    if not is_in_file(name):
        return name
    file = replace(part, name)
    return name if file is None else SimulationName.parse(name).with_file(file)


def list_paths_beside(run: Path, file: Path) -> list[Path]:
    """Return the paths of a file in and next to a run folder, if it was copied together with the folder."""
    return [run / file.name, run.parent / file.name]


def compute_digest(parts: Mapping[str, Mapping[str, str]]) -> str:
    """Return the SHA-256, in hexadecimal, of components' files: section -> location -> SHA-256."""
    lines = sorted(
        f"{name}/{location} {digest}\n" for name, part in parts.items() for location, digest in part.items()
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def display_name(simulation: str) -> str:
    """Return a simulation's name for display; for a run's copy, its name in the experiment."""
    parsed = SimulationName.parse(simulation)
    if parsed.is_command:
        return parsed.label
    if parsed.file is None:
        return simulation
    try:
        containing = Copy.find_containing(parsed.file)
    except InputError:
        containing = None
    if containing is None:
        return simulation
    _, copied = containing
    return parsed.with_file(copied.module or copied.main)


def contains_only_copies(run: Path) -> bool:
    """Return whether `remove` would empty the folder of copies."""
    copied_files = _list_copied_files(run)
    return not (run / FOLDER).is_symlink() and all(
        entry in copied_files or "__pycache__" in entry.parts or (entry.is_dir() and not entry.is_symlink())
        for entry in (run / FOLDER).rglob("*")
    )


def _list_copied_files(run: Path) -> set[Path]:
    """Return the manifests of the copies in a run folder, and the files that they name."""
    files = set()
    for manifest in (run / FOLDER).glob(f"*/{_MANIFEST}"):
        files.add(manifest)
        copy = Copy(manifest.parent)
        with suppress(InputError):
            files |= {
                copy.folder / copied_part.name / location
                for copied_part in copy.parts.values()
                for location in copied_part.digests
            }
    return files


def remove(run: Path) -> None:
    """Delete the copies in a run folder, and leave other files."""
    for file in _list_copied_files(run):
        file.unlink(missing_ok=True)
    for folder in sorted((run / FOLDER).glob("**/"), reverse=True):  # inner ones first
        if folder.is_symlink():
            continue
        if folder.name == "__pycache__":
            shutil.rmtree(folder)
        elif not any(folder.iterdir()):
            folder.rmdir()
