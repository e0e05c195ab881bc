"""Export of a candidate of a run, for `swarmwright export` and `swarmwright.export_controller`."""

import hashlib
import logging
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.common.arguments import check_arguments, text
from swarmwright.common.errors import InputError, RunError
from swarmwright.common.files import write_whole
from swarmwright.controllers.source.text import MARK, check_prefix, has_seal, is_edited, word_of
from swarmwright.export import EXPORTERS
from swarmwright.export._base import file_bytes
from swarmwright.export.subject import Subject, load_subject
from swarmwright.export.verification import Verification, verify

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

DIGESTS = ".swarmwright-export"
"""File beside exported files with the SHA-256 of each text as exported, in the format of `sha256sum`. While
files are written, and after an interrupted export, it has the digests of both the earlier and the new
files."""
_DIGEST = re.compile(r"([0-9a-f]{64})  (.+)")
_GROUP = re.compile(rb"^[^\w\n]*Group {2,}(\S.*?)\s*$|Group: ([^;]+); Controller: ", re.MULTILINE)
"""The group in the comment of a text, and in the description of an FMU."""
_SEARCHED = 1 << 16
"""Bytes at the beginning of a file that are searched for the mark."""
_FORCE = "--force; in Python force=True"
"""How to overwrite files with the command and the function."""
_REMEDY = f"choose another output folder or prefix, or overwrite it ({_FORCE})"


def write(files: Mapping[str, str | bytes], folder: Path, *, force: bool = False) -> list[Path]:
    """Write files into a folder, which is created if needed; return their paths.

    An edited file that is meant for editing is kept: the new file gets the suffix `.new`, with a warning.
    Other edited files are errors; `DIGESTS` has the digests that reveal edits.

    force: overwrite files that Swarmwright did not export, and edited files.

    Raises InputError like `check_replaceable`, before anything is written, and when a file cannot be written;
    the export can be repeated then, since written files do not count as edited.
    """
    check_replaceable(files, folder, force=force)
    paths = [folder / name for name in files]
    if not force:
        paths = [_destination(path, content) for path, content in zip(paths, files.values(), strict=True)]
    earlier = _read_digests(folder)
    texts = {name: content for name, content in files.items() if isinstance(content, str)}
    new = {name: {_sha256(file_bytes(text))} for name, text in texts.items()}
    if new:  # archives and copies contain their own mark
        both = {name: digests | earlier.get(name, set()) for name, digests in new.items()}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _write_digests(folder, earlier | both)
        except OSError as error:
            raise InputError(f"{folder / DIGESTS}: cannot be written: {error.strerror}") from error
    for path, content in zip(paths, files.values(), strict=True):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(file_bytes(content))
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    if new:
        with suppress(OSError):  # all files are written, and both digests are known
            _write_digests(folder, earlier | new)
    return paths


def check_replaceable(files: Mapping[str, str | bytes], folder: Path, *, force: bool) -> None:
    """Raise InputError if an export would overwrite protected files, see `write`.

    These are files of users, edited files, folders, the controller of another group of agents, and a module
    in the other dialect of Python with the same name.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, not a folder; choose another output folder")
    paths = [folder / name for name in files]
    digests, existing = _read_digests(folder), dict[Path, bytes]()
    for path, (name, content) in zip(paths, files.items(), strict=True):
        if path.is_dir():
            raise InputError(f"{path}: is a folder, not a file; choose another output folder")
        if path.exists() and not force:
            existing[path] = _read(path)
            _check_file(path, existing[path], content, digests.get(name))
    for path, content in zip(paths, files.values(), strict=True):
        if path not in existing:
            continue
        old_group, new_group = _find_group(existing[path]), _find_group(file_bytes(content))
        if old_group and new_group and old_group != new_group:
            raise InputError(f"{path}: contains the controller of the group {old_group}; {_REMEDY}")
        if path.suffix == ".py" and _is_other_dialect(existing[path], content):
            raise InputError(f"{path}: was exported to the other dialect, Python or MicroPython; {_REMEDY}")


def _check_file(path: Path, existing: bytes, content: str | bytes, digests: set[str] | None) -> None:
    """Raise InputError for a file that an export may not replace.

    A file with the new content may be replaced, and a sketch, which `_destination` keeps if it was edited.

    existing: its content. digests: digests of the exported file, if known.
    """
    if existing == file_bytes(content):
        return
    if digests is None or has_seal(content):
        if not _is_exported(path, existing):
            raise InputError(f"{path}: already exists and was not exported by Swarmwright; {_REMEDY}")
        return
    # Editors and version control may change line endings.
    if digests.isdisjoint({_sha256(existing), _sha256(existing.replace(b"\r\n", b"\n"))}):
        raise InputError(f"{path}: was edited after the export; {_REMEDY}")


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _read_digests(folder: Path) -> dict[str, set[str]]:
    """Return the digests of exported files in a folder, by path; see `DIGESTS`."""
    try:
        lines = (folder / DIGESTS).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return {}
    digests: dict[str, set[str]] = {}
    for match in map(_DIGEST.fullmatch, lines):
        if match:
            digests.setdefault(match[2], set()).add(match[1])
    return digests


def _find_group(content: bytes) -> str:
    """Return the group of agents of an exported controller; empty for all agents."""
    match = _GROUP.search(content[:_SEARCHED])
    return (match[1] or match[2]).decode("utf-8", "replace") if match else ""


def _write_digests(folder: Path, digests: Mapping[str, set[str]]) -> None:
    """Write the digests of texts. On OSError, the earlier digests are kept."""
    lines = [f"{digest}  {name}\n" for name, values in sorted(digests.items()) for digest in sorted(values)]
    write_whole(folder / DIGESTS, "".join(lines).encode())


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _destination(path: Path, content: str | bytes) -> Path:
    """Return the path for a file: beside the existing file if that is meant for editing and was edited."""
    if not has_seal(content) or not path.exists():
        return path
    existing = _read(path)
    if existing == file_bytes(content) or not is_edited(existing):
        return path
    new = path.with_name(f"{path.name}.new")
    logging.getLogger("swarmwright").warning(
        "%s: was edited after the export and is kept; the new file is %s (overwrite with %s)",
        path,
        new.name,
        _FORCE,
    )
    return new


def check_case(files: Mapping[str, str | bytes], folder: Path, prefix: str) -> None:
    """Raise InputError if files exist whose prefix differs in case only.

    Include guards, macros and enumerations are in upper case, so that a program cannot use both controllers;
    some file systems have a single file for both.
    """
    for path in (folder / name for name in files):
        if not path.name.startswith(prefix) or not path.parent.is_dir():
            continue
        for other in sorted(path.parent.iterdir()):
            is_other = other.name != path.name and other.name.lower() == path.name.lower()
            if is_other and other.is_file() and _is_exported(other, _read(other)):
                other_prefix = other.name[: len(prefix)]
                raise InputError(
                    f"prefix: {prefix!r} differs from {other_prefix!r} of the existing {other} in case only, "
                    "so that names in upper case would be equal; choose another prefix or output folder, or "
                    f"overwrite those files with the prefix {other_prefix}"
                )


def _is_other_dialect(existing: bytes, content: str | bytes) -> bool:
    """Whether a module for Python would replace one for MicroPython, or vice versa."""
    new, old = (_first_line(text) for text in (file_bytes(content), existing))
    begin = b'"""An evolved controller'
    return new.startswith(begin) and old.startswith(begin) and new != old


def _first_line(content: bytes) -> bytes:
    return content.split(b"\n", 1)[0]


def _is_exported(path: Path, content: bytes) -> bool:
    """Whether a file was exported: it has the mark, or is a copy listed by a package above it."""
    if MARK.encode() in content[:_SEARCHED]:
        return True
    digest = _sha256(content).encode()
    for folder in path.parents:
        package = folder / "__init__.py"
        if package != path and package.is_file():
            text = _read(package)
            if MARK.encode() in text and digest in text:
                return True
    return False


PREFIX = "controller"


@dataclass(frozen=True)
class ExportResult:
    """An exported controller, and its comparison with the simulation."""

    files: list[Path]
    """The written files."""
    subject: Subject = field(repr=False)
    """The controller and its origin."""
    verification: Verification | None
    """Comparison with the simulation; None without `verify`."""


@check_arguments
def export_controller(
    run: "Run | str | PathLike[str]",
    *,
    to: str,
    output: str | PathLike[str] | None = None,
    generation: int | None = None,
    candidate: int | None = None,
    group: str | None = None,
    prefix: str | None = None,
    verify: bool = False,
    force: bool = False,
) -> ExportResult:
    """Export a controller as source code or as a model, for robots and other programs.

    The same run and candidate give the same bytes. The controller keeps its state between steps, as in
    the simulation, and its actuators are bit-identical.

    Args:
        run: a run, or its folder.
        to: "c", "cpp", "fmu", "fmu3", "machine", "micropython", "onnx", "python", "ros1", "ros2", "scxml",
            or a format of an installed package.
        output: folder to write to; by default, `prefix` in the current folder.
        generation: generation of the candidate, from 0; as in `Run.evaluation`.
        candidate: as in `Run.evaluation`; default: the best.
        group: group of agents whose controller is exported; required if groups have different controllers.
        prefix: prefix of files, functions and types, so that a program can contain several controllers; by
            default "controller", or the name of the group.
        verify: compile and run the controller, in 10,000 random sequences and in the run's episodes, and
            compare its actuators with the simulation's.
        force: overwrite files that Swarmwright did not export, or that were edited since.

    Raises:
        InputError: the candidate, group or format does not exist, the prefix is not an identifier, or differs
            in case only from that of existing files, a file cannot be overwritten, or a program that
            verification needs is not installed. Nothing is written then.
        RunError: the exported controller does not compile or run.

    Examples:
        >>> exported = swarmwright.export_controller("result", to="python", output="robot")
        >>> sorted(path.name for path in exported.files)
        ['controller.py', 'controller_test.py']

    See also: `export_bundle`, for every format in one archive with its proof.
    """
    from swarmwright.runs.run import open_run  # noqa: PLC0415 - with figures and more

    if prefix is None:
        prefix = PREFIX if group is None else _prefix_of(group)
    check_prefix(prefix)
    exporter = EXPORTERS.get(text("to", to, "the name of an export format"))()
    opened = open_run(run)
    subject = load_subject(opened, generation, candidate, group)
    files = exporter.files(subject, prefix)
    folder = Path(output if output is not None else prefix)
    check_case(files, folder, prefix)
    check_replaceable(files, folder, force=force)
    try:
        verification = _verify(exporter, subject, prefix, files) if verify else None
    except RunError:
        write(files, folder, force=force)  # for inspection
        raise
    return ExportResult(write(files, folder, force=force), subject, verification)


def _prefix_of(group: str) -> str:
    """Return the default prefix of a group of agents."""
    word = word_of(group)
    return word if word[:1].isalpha() else f"group_{word}"


_verify = verify
