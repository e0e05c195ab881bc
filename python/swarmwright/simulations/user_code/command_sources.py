"""The files of a simulation that is a command."""

import hashlib
import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName
from swarmwright.simulations.command import work_files
from swarmwright.simulations.command.definition import Definition
from swarmwright.simulations.command.process import resolve_word
from swarmwright.simulations.user_code.imports import Walk

_SYSTEM = ("/usr", "/bin", "/lib", "/sbin", "/etc", "/dev", "/proc")


def definition_of(options: Definition) -> bytes:
    """Return the definition as text that does not depend on the folder."""
    values = options.model_dump(exclude_defaults=True, exclude={"folder"})
    return f"{json.dumps(values, sort_keys=True, indent=2)}\n".encode()


def sources_of(options: Definition) -> tuple[str, dict[str, Path]]:
    """Return the files that a definition names, and the imports of those in Python, by location.

    Locations are relative to a common folder. The first result is the location of the definition in a copy.
    Raises InputError for missing files.
    """
    folder = Path(options.folder).resolve()
    relative_files, absolute_files = set[Path](), set[Path]()
    for path, is_relative in _iterate_files(options, folder):
        if _belongs(path):
            (relative_files if is_relative else absolute_files).update(_with_imports(path))
    # A file named by its absolute path has that location in every copy, wherever the experiment file is.
    absolute_files -= relative_files
    inside = [path for path in relative_files if path.is_relative_to(folder.parent)]
    root = Path(os.path.commonpath([folder, *(path.parent for path in inside)]))
    located_paths = {
        path.relative_to(root).as_posix()
        if path in relative_files and path.is_relative_to(root)
        else str(path).lstrip("/"): path
        for path in relative_files | absolute_files
    }
    main = (folder / SimulationName.DEFINITION).relative_to(root).as_posix()
    return main, dict(sorted(located_paths.items()))


def digest(options: Definition) -> str:
    """Return the SHA-256, in hexadecimal, of a definition and its files."""
    whole = hashlib.sha256(definition_of(options))
    for location, path in sources_of(options)[1].items():
        whole.update(f"\n{location} {hashlib.sha256(path.read_bytes()).hexdigest()}".encode())
    return whole.hexdigest()


def _belongs(path: Path) -> bool:
    """Return whether a file is the user's rather than an installed program."""
    installed = path.parent.name in {"bin", "sbin"} or str(path.resolve()).startswith(_SYSTEM)
    return not installed and path.stat().st_size <= work_files.LARGEST_BYTES


def _with_imports(path: Path) -> set[Path]:
    if path.suffix != ".py":
        return {path}
    try:
        return {path, *Walk.from_file(path).files.values()}
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _iterate_files(options: Definition, folder: Path) -> Iterator[tuple[Path, bool]]:
    """Yield the files that a definition names, and whether their paths are relative to its folder."""
    for key, names in options.list_named_files():
        for name in names:
            if key == "command":
                yield from _iterate_files_in_word(name, folder)
                continue
            path, is_relative = (folder / name).absolute(), not Path(name).is_absolute()
            if key in {"sources", "files"} and path.is_dir():
                for file in work_files.iterate_files(path):
                    yield Path(os.path.normpath(file)), is_relative
            elif _is_file(path):
                yield Path(os.path.normpath(path)), is_relative
            else:
                raise InputError(f"{key}: {path}: there is no such file")


def _iterate_files_in_word(word: str, folder: Path) -> Iterator[tuple[Path, bool]]:
    """Yield the files that a word of a command names, like `_iterate_files`."""
    for name in (word, word.partition("=")[2]):
        path = Path(resolve_word(name.replace("{here}", str(folder)), folder))
        if path.is_absolute() and _is_file(path):
            yield path, not Path(name).is_absolute()


def _is_file(path: Path) -> bool:
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except (OSError, ValueError):
        return False
