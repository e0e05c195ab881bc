"""The files that a simulation which is a command consists of."""

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
from swarmwright.simulations.command.process import resolved_word
from swarmwright.simulations.user_code.imports import Walk

_SYSTEM = ("/usr", "/bin", "/lib", "/sbin", "/etc", "/dev", "/proc")


def definition_of(options: Definition) -> bytes:
    """Return the definition as text that is the same in every folder."""
    values = options.model_dump(exclude_defaults=True, exclude={"folder"})
    return f"{json.dumps(values, sort_keys=True, indent=2)}\n".encode()


def sources_of(options: Definition) -> tuple[str, dict[str, Path]]:
    """Return the files that a definition names, and what those in Python import, by their places.

    A place is relative to a folder that all of them are in. The first of the two is the place that the
    definition gets in a copy, in its own folder. Raises InputError for named files that are not there.
    """
    here = Path(options.folder).resolve()
    near, far = set[Path](), set[Path]()
    for path, is_relative in _named(options, here):
        if _belongs(path):
            (near if is_relative else far).update(_with_imports(path))
    # What is named by its whole path has that in every copy, wherever the experiment file is.
    far -= near
    inside = [path for path in near if path.is_relative_to(here.parent)]
    root = Path(os.path.commonpath([here, *(path.parent for path in inside)]))
    places = {
        path.relative_to(root).as_posix()
        if path in near and path.is_relative_to(root)
        else str(path).lstrip("/"): path
        for path in near | far
    }
    main = (here / SimulationName.DEFINITION).relative_to(root).as_posix()
    return main, dict(sorted(places.items()))


def digest(options: Definition) -> str:
    """Return the SHA-256, in hexadecimal, of a definition and its files."""
    whole = hashlib.sha256(definition_of(options))
    for place, path in sources_of(options)[1].items():
        whole.update(f"\n{place} {hashlib.sha256(path.read_bytes()).hexdigest()}".encode())
    return whole.hexdigest()


def _belongs(path: Path) -> bool:
    """Whether a file is the user's, and not an installed program."""
    installed = path.parent.name in {"bin", "sbin"} or str(path.resolve()).startswith(_SYSTEM)
    return not installed and path.stat().st_size <= work_files.LARGEST_BYTES


def _with_imports(path: Path) -> set[Path]:
    if path.suffix != ".py":
        return {path}
    try:
        return {path, *Walk.of_file(path).files.values()}
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _named(options: Definition, here: Path) -> Iterator[tuple[Path, bool]]:
    """Yield the files that a definition names, and whether by paths that are relative to its folder."""
    for key, names in options.named_files():
        for name in names:
            if key == "command":
                yield from _in_word(name, here)
                continue
            path, is_relative = (here / name).absolute(), not Path(name).is_absolute()
            if key in {"sources", "files"} and path.is_dir():
                for file in work_files.within(path):
                    yield Path(os.path.normpath(file)), is_relative
            elif _is_file(path):
                yield Path(os.path.normpath(path)), is_relative
            else:
                raise InputError(f"{key}: {path}: there is no such file")


def _in_word(word: str, here: Path) -> Iterator[tuple[Path, bool]]:
    """Yield the files that a word of a command names, as `_named` does."""
    for name in (word, word.partition("=")[2]):
        path = Path(resolved_word(name.replace("{here}", str(here)), here))
        if path.is_absolute() and _is_file(path):
            yield path, not Path(name).is_absolute()


def _is_file(path: Path) -> bool:
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except (OSError, ValueError):
        return False
