"""Reading the files of a bundle that somebody hands over, before anything in them is believed."""

import stat
from collections.abc import Collection
from pathlib import Path

from swarmwright.common import archives
from swarmwright.common.errors import InputError
from swarmwright.common.untrusted import one_line
from swarmwright.export.bundle import MANIFEST

_LARGEST_BUNDLE_BYTES = 1 << 28
"""Bytes of all files of a bundle."""


def read_files(path: Path) -> dict[str, bytes]:
    """Return the files of a bundle by name, of the archive or of the folder that it was unpacked to.

    Raises InputError when it cannot be read, has no manifest, or has files that no bundle has: a name outside
    its folder, a link or a device, one name twice, or too many bytes.
    """
    if path.is_dir():
        return _read_folder(path)
    with archives.opened(path, "a bundle") as archive:
        for info in archive.infolist():
            if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise InputError(_not_plain(path, info.filename))
        infos = [info for info in archive.infolist() if not info.is_dir()]  # other programs add folders
        _check_size(path, sum(info.file_size for info in infos))
        names = [info.filename for info in infos]
        if len(set(names)) < len(names):
            raise InputError(f"{path}: has a file twice: {one_line(_twice(names))}")
        _check_manifest(path, names)
        return {name: archives.content(archive, path, name, _LARGEST_BUNDLE_BYTES) for name in names}


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
                raise InputError(_not_plain(folder, name))
        _check_size(folder, sum(file.stat().st_size for file in files.values()))
        return {name: file.read_bytes() for name, file in files.items()}
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror or error}") from error


def _not_plain(path: Path, name: str) -> str:
    return f"{path}: {one_line(name)}: is not a plain file; no bundle has others"


def _check_name(path: Path, name: str) -> None:
    """Raise InputError for a name that some programs unpack to a place outside the bundle's folder."""
    if archives.is_outside(name):
        raise InputError(
            f"{path}: {one_line(name)}: is not a name inside a folder (absolute, with .., a backslash or a "
            "drive letter); no bundle has such names"
        )


def _check_size(path: Path, size: int) -> None:
    if size > _LARGEST_BUNDLE_BYTES:
        raise InputError(
            f"{path}: has more than {_LARGEST_BUNDLE_BYTES >> 20} MiB of files; no bundle is so large"
        )


def _check_manifest(path: Path, names: Collection[str]) -> None:
    if MANIFEST not in names:
        raise InputError(
            f"{path}: is not a bundle: it has no {MANIFEST}; "
            "`swarmwright export RUN --bundle FILE.zip` makes one"
        )


def _twice(names: list[str]) -> str:
    return next(name for name in names if names.count(name) > 1)
