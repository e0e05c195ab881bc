"""Writing exported files, without writing over what others have written."""

import hashlib
import logging
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import write_whole
from swarmwright.controllers.source.text import MARK, has_seal, is_edited
from swarmwright.export._base import file_bytes

DIGESTS = ".swarmwright-export"
"""Beside exported files: the SHA-256 of each text as it was written, as `sha256sum` has them. While files are
written, and after an export that was interrupted, it has those of both the earlier and the new ones."""
_DIGEST = re.compile(r"([0-9a-f]{64})  (.+)")
_GROUP = re.compile(rb"^[^\w\n]*Group {2,}(\S.*?)\s*$|Group: ([^;]+); Controller: ", re.MULTILINE)
"""The fact in the comment of a text, and in the description of an FMU."""
_SEARCHED = 1 << 16
"""Bytes at the beginning of a file in which the mark is looked for."""
_FORCE = "--force; in Python force=True"
"""How both the command and the function write over files."""
_REMEDY = f"name another output folder or prefix, or write over it ({_FORCE})"


def write(files: Mapping[str, str | bytes], folder: Path, *, force: bool = False) -> list[Path]:
    """Write files into a folder, which is made if needed; return their paths.

    One that users are to edit is kept where they have: the new one has `.new` behind its name, and a warning
    says so. Any other file that was edited is refused; `DIGESTS` has the digests by which this is noticed.

    force: write over files that Swarmwright did not export, and over edited ones.

    Raises InputError as `check_replaceable` does, and then writes nothing. Also where a file cannot be
    written; the export can be repeated then: what it has written so far does not count as edited.
    """
    check_replaceable(files, folder, force=force)
    paths = [folder / name for name in files]
    if not force:
        paths = [_destination(path, content) for path, content in zip(paths, files.values(), strict=True)]
    earlier = _digests(folder)
    texts = {name: content for name, content in files.items() if isinstance(content, str)}
    new = {name: {_sha256(file_bytes(text))} for name, text in texts.items()}
    if new:  # archives and copies say themselves what they are
        both = {name: digests | earlier.get(name, set()) for name, digests in new.items()}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _remember(folder, earlier | both)
        except OSError as error:
            raise InputError(f"{folder / DIGESTS}: cannot be written: {error.strerror}") from error
    for path, content in zip(paths, files.values(), strict=True):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(file_bytes(content))
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    if new:
        with suppress(OSError):  # all is written, and those of both are known
            _remember(folder, earlier | new)
    return paths


def check_replaceable(files: Mapping[str, str | bytes], folder: Path, *, force: bool) -> None:
    """Raise InputError where an export would write over what it may not, see `write`.

    That is a file of others, an edited one, a folder in the place of a file, the controller of another group
    of agents, or a module in the other dialect of Python, which has the same name.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file where a folder is expected; name another output folder")
    paths = [folder / name for name in files]
    digests, found = _digests(folder), dict[Path, bytes]()
    for path, (name, content) in zip(paths, files.items(), strict=True):
        if path.is_dir():
            raise InputError(f"{path}: is a folder where a file is to be written; name another output folder")
        if path.exists() and not force:
            found[path] = _read(path)
            _check_file(path, found[path], content, digests.get(name))
    for path, content in zip(paths, files.values(), strict=True):
        if path not in found:
            continue
        there, new = _group(found[path]), _group(file_bytes(content))
        if there and new and there != new:
            raise InputError(f"{path}: has the controller of the group {there}; {_REMEDY}")
        if path.suffix == ".py" and _swapped(found[path], content):
            raise InputError(f"{path}: is the export to the other one of Python and MicroPython; {_REMEDY}")


def _check_file(path: Path, there: bytes, content: str | bytes, digests: set[str] | None) -> None:
    """Raise InputError for a file that an export may not replace.

    One that has the new content already may be, and so may a sketch, which
    `_destination` keeps if it was edited.

    there: what it holds. digests: of it as it was exported, if known.
    """
    if there == file_bytes(content):
        return
    if digests is None or has_seal(content):
        if not _is_exported(path, there):
            raise InputError(f"{path}: is there already and was not exported by Swarmwright; {_REMEDY}")
        return
    # Editors and version control change the ends of lines.
    if digests.isdisjoint({_sha256(there), _sha256(there.replace(b"\r\n", b"\n"))}):
        raise InputError(f"{path}: has been edited since it was exported; {_REMEDY}")


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _digests(folder: Path) -> dict[str, set[str]]:
    """Return the digests of what was exported into a folder, by its path in it; see `DIGESTS`."""
    try:
        lines = (folder / DIGESTS).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return {}
    digests: dict[str, set[str]] = {}
    for found in map(_DIGEST.fullmatch, lines):
        if found:
            digests.setdefault(found[2], set()).add(found[1])
    return digests


def _group(content: bytes) -> str:
    """Return the group of agents whose controller an exported file has; empty where it has that of all."""
    found = _GROUP.search(content[:_SEARCHED])
    return (found[1] or found[2]).decode("utf-8", "replace") if found else ""


def _remember(folder: Path, digests: Mapping[str, set[str]]) -> None:
    """Write the digests of texts. Raises OSError, and then keeps those that were there."""
    lines = [f"{digest}  {name}\n" for name, of in sorted(digests.items()) for digest in sorted(of)]
    write_whole(folder / DIGESTS, "".join(lines).encode())


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _destination(path: Path, content: str | bytes) -> Path:
    """Return where a file is written: beside the one that is there if users were to edit it, and have."""
    if not has_seal(content) or not path.exists():
        return path
    there = _read(path)
    if there == file_bytes(content) or not is_edited(there):
        return path
    new = path.with_name(f"{path.name}.new")
    logging.getLogger("swarmwright").warning(
        "%s: has been edited since it was exported, and is kept; the new one is %s (%s: writes over it)",
        path,
        new.name,
        _FORCE,
    )
    return new


def check_case(files: Mapping[str, str | bytes], folder: Path, prefix: str) -> None:
    """Raise InputError where files of another prefix are there that differs in case only.

    Include guards, macros and enumerations are in capitals, so a program could not have both controllers;
    some systems would have one file for both.
    """
    for path in (folder / name for name in files):
        if not path.name.startswith(prefix) or not path.parent.is_dir():
            continue
        for other in sorted(path.parent.iterdir()):
            is_other = other.name != path.name and other.name.lower() == path.name.lower()
            if is_other and other.is_file() and _is_exported(other, _read(other)):
                there = other.name[: len(prefix)]
                raise InputError(
                    f"prefix: {prefix!r} differs from {there!r} of {other}, which is there already, in upper "
                    "and lower case only, and names in capitals would be the same; name another prefix "
                    f"or output folder, or write over those files with the prefix {there}"
                )


def _swapped(there: bytes, content: str | bytes) -> bool:
    """Return whether a module for Python would replace one for MicroPython, or the other way round."""
    new, old = (_first_line(text) for text in (file_bytes(content), there))
    begin = b'"""An evolved controller'
    return new.startswith(begin) and old.startswith(begin) and new != old


def _first_line(content: bytes) -> bytes:
    return content.split(b"\n", 1)[0]


def _is_exported(path: Path, content: bytes) -> bool:
    """Return whether a file was exported: it has the mark, or is a copy, as a package above it says."""
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
