"""Files of bundles, which are read as untrusted."""

import stat
from collections.abc import Collection
from pathlib import Path

from swarmwright.common import archives
from swarmwright.common.errors import InputError
from swarmwright.common.untrusted import escape_line

FORMAT = 1
"""Version of the archive's layout."""
MANIFEST = "manifest.json"
CONTROLLER = "controller.json"
EVALUATION = "evaluation.json"
_LARGEST_BUNDLE_BYTES = 1 << 28
"""Largest size of all files of a bundle, in bytes."""


def read_files(path: Path) -> dict[str, bytes]:
    """Return the files of a bundle by name, from the archive or its unpacked folder.

    Raises InputError when it cannot be read, has no manifest, or has invalid files: names outside its folder,
    links or devices, duplicate names, or too many bytes.
    """
    if path.is_dir():
        return _read_folder(path)
    with archives.open_archive(path, "a bundle") as archive:
        for info in archive.infolist():
            if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise InputError(_describe_special_file(path, info.filename))
        infos = [info for info in archive.infolist() if not info.is_dir()]  # other programs add folders
        _check_size(path, sum(info.file_size for info in infos))
        names = [info.filename for info in infos]
        if len(set(names)) < len(names):
            raise InputError(f"{path}: duplicate file name {escape_line(_find_duplicate(names))}")
        _check_manifest(path, names)
        return {name: archives.read_entry(archive, path, name, _LARGEST_BUNDLE_BYTES) for name in names}


def _read_folder(folder: Path) -> dict[str, bytes]:
    """Return the files of an unpacked bundle by name; links are not followed."""
    try:
        files = {
            file.relative_to(folder).as_posix(): file
            for file in sorted(folder.rglob("*"))
            if file.is_symlink() or not file.is_dir()
        }
        _check_manifest(folder, files)
        for name, file in files.items():
            _check_name(folder, name)
            if file.is_symlink() or not file.is_file():
                raise InputError(_describe_special_file(folder, name))
        _check_size(folder, sum(file.stat().st_size for file in files.values()))
        return {name: file.read_bytes() for name, file in files.items()}
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror or error}") from error


def _describe_special_file(path: Path, name: str) -> str:
    return f"{path}: {escape_line(name)}: is not a regular file; the archive was not written by Swarmwright"


def _check_name(path: Path, name: str) -> None:
    """Raise InputError for a name that some programs unpack outside the bundle's folder."""
    if archives.is_outside(name):
        raise InputError(
            f"{path}: {escape_line(name)}: is not a path inside the folder (absolute, or with .., a "
            "backslash or a drive letter); the archive was not written by Swarmwright"
        )


def _check_size(path: Path, size: int) -> None:
    if size > _LARGEST_BUNDLE_BYTES:
        raise InputError(f"{path}: its files exceed the limit of {_LARGEST_BUNDLE_BYTES >> 20} MiB")


def _check_manifest(path: Path, names: Collection[str]) -> None:
    if MANIFEST not in names:
        raise InputError(
            f"{path}: is not a bundle, because {MANIFEST} is missing; create a bundle with "
            "`swarmwright export RUN --bundle FILE.zip`"
        )


def _find_duplicate(names: list[str]) -> str:
    return next(name for name in names if names.count(name) > 1)
