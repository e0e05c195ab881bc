"""Comparison of the current source with a run's copy, and warnings about changes."""

import ast
import difflib
import dis
import hashlib
import os
import platform
import reprlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName, is_command, is_environment
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.user_code.copying import CopiedPart, Copy, list_paths_beside
from swarmwright.simulations.user_code.parts import (
    Part,
    Source,
    is_plug_in,
    read_plug_in,
    read_simulation,
    with_data,
)

LINES = 60
"""Largest number of lines of a difference."""
_SHOWN_CHARACTERS = 200
"""Largest number of characters of a displayed line."""


def read_current(copy: Copy, copied_part: CopiedPart) -> Part | None:
    """Return the current source at the origin of a copy; None if it no longer exists.

    A file is searched at its path relative to the run folder, then in and beside the run folder, then at its
    absolute path. Raises InputError if it cannot be read.
    """
    part = _read_current_code(copy, copied_part)
    return None if part is None else with_data(part, copied_part.patterns)


def _read_current_code(copy: Copy, copied: CopiedPart) -> Part | None:
    """Return the current source without data files."""
    if is_plug_in(copied.name) and not copied.in_file:
        try:
            return read_plug_in(copied.name, copied.component)
        except InputError:
            return None  # not installed, which is reported when it is used
    if is_environment(copied.component):
        return read_simulation(copied.component)
    if is_command(copied.component):
        return _read_current_command(copy, copied)
    if copied.module is not None:
        part = Part.from_module(copied.name, copied.component, copied.module)
        if part is not None or "." in copied.module:
            return part
    for path in _list_candidates(copy.run, copied):
        if path.is_file():
            return Part.from_file(copied.name, copied.component, path)
    return None


def _read_current_command(copy: Copy, copied: CopiedPart) -> Part | None:
    """Return the current files of a command; its definition is part of the run and cannot change."""
    imported = set(copied.digests) - {copied.main} - copied.data
    for path in _list_candidates(copy.run, copied):
        with suppress(InputError):
            part = read_simulation(SimulationName.parse(copied.component).with_file(path))
            if part is not None and (not imported or imported & set(part.files)):
                return part
    return None


@dataclass(frozen=True)
class Choice:
    """The source that is used for a component of a run."""

    part: Part
    copied: bool
    """Whether the source is the copy."""
    current: Part | None
    """If it is the copy: the current source at its origin, if any."""


def choose(copy: Copy, copied: CopiedPart) -> Choice:
    """Choose the current source if it equals the copy, else the copy.

    Of the data files, the copy has only those that the experiment names. Raises InputError if the copy was
    changed.
    """
    current = read_current(copy, copied)
    if current is not None and current.digests == dict(copied.digests):
        return Choice(current, copied=False, current=None)
    folder = copy.folder / copied.name
    files = {location: Source(folder / location, copy.read(copied, location)) for location in copied.digests}
    names = copied.name, copied.component, copied.main, copied.module
    part = Part(*names, files, frozenset(), copied.data, copied.patterns)
    return Choice(part, copied=True, current=current)


def _list_candidates(run: Path, copied: CopiedPart) -> Iterator[Path]:
    yield Path(os.path.normpath(run.resolve() / copied.relative_origin))
    yield from list_paths_beside(run, copied.origin)
    yield copied.origin


def list_files(simulation: str) -> dict[str, str]:
    """Return the current files of a class: path -> SHA-256, in hexadecimal.

    Empty for classes without source and for a run's copy. Raises InputError.
    """
    location = SimulationName.parse(simulation).location
    if not location or Copy.find_containing(Path(location)) is not None:
        return {}
    part = read_simulation(simulation)
    if part is None:
        return {}
    # A command's definition is not a file.
    virtual = part.main if is_command(simulation) else None
    return {str(file.origin): file.digest for name, file in part.files.items() if name != virtual}


def check_unchanged(files: Mapping[str, str]) -> None:
    """Raise InputError if a file has changed since `list_files` was called."""
    for name, digest in files.items():
        try:
            data = Path(name).read_bytes()
        except OSError as error:
            raise InputError(f"{name}: can no longer be read: {error.strerror}") from error
        if hashlib.sha256(data).hexdigest() != digest:
            raise InputError(
                f"{name}: was edited since this run was started, so a new server would compute different "
                "results; restore it, and continue with `swarmwright resume`"
            )


def summarize_changes(copied: CopiedPart, part: Part) -> str:
    """Return the differences in files as a phrase."""
    now = part.digests
    edited = [
        location
        for location in copied.digests
        if location in now and copied.digests[location] != now[location]
    ]
    words = [f"{shorten_path(part.files[location].origin)} was edited" for location in edited]
    before, after = (SimulationName.parse(either.component).label for either in (copied, part))
    if before != after:
        words.append(f"class {after} instead of {before}")
    words += [
        f"{location} {'was deleted' if location in copied.data else 'was removed from the imports'}"
        for location in copied.digests
        if location not in now
    ]
    words += [
        f"{shorten_path(part.files[location].origin)} "
        f"{'is new' if location in part.data else 'was added to the imports'}"
        for location in now
        if location not in copied.digests
    ]
    return ", ".join(words)


def format_difference(copy: Copy, copied: CopiedPart, part: Part) -> str:
    """Return a unified diff from the copy to the current source, of at most `LINES` lines.

    Raises InputError if the copy itself was changed.
    """
    lines: list[str] = []
    for location in sorted({*copied.digests, *part.files}):
        old = copy.read(copied, location) if location in copied.digests else b""
        source = part.files.get(location)
        new = b"" if source is None else source.data
        if old == new:
            continue
        before = (
            str(shorten_path(copy.folder / copied.name / location))
            if location in copied.digests
            else os.devnull
        )
        after = os.devnull if source is None else str(shorten_path(source.origin))
        lines += _format_unified(old, new, before, after)
    more = len(lines) - LINES
    if more > 0:
        lines = [*lines[:LINES], f".. and {more} more lines"]
    return "\n".join(lines)


def _format_unified(old: bytes, new: bytes, before: str, after: str) -> list[str]:
    try:
        texts = old.decode().splitlines(), new.decode().splitlines()
    except UnicodeDecodeError:
        return [f"binary files {before} and {after} differ"]
    lines = [_printable(line) for line in difflib.unified_diff(*texts, before, after, lineterm="")]
    return lines or [f"{before} and {after} differ in the ends of their lines"]


def _printable(line: str) -> str:
    """Replace terminal control characters in a line, as the copy may come from anyone."""
    clean = "".join(sign if sign.isprintable() or sign == "\t" else "\ufffd" for sign in line)
    return clean if len(clean) <= _SHOWN_CHARACTERS else f"{clean[:_SHOWN_CHARACTERS]} .."


def shorten_path(path: Path) -> Path:
    """Return a path relative to the working folder if it is inside."""
    folder = Path.cwd()
    return path.relative_to(folder) if path.is_relative_to(folder) else path


def warn_of_copy(copy: Copy, copied: CopiedPart, current: Part, hint: str = "") -> None:
    """Warn once that the run's copy is used because the original has changed.

    hint: a remedy to append, beginning with a semicolon; it does not make the warning a different one.
    """
    changes = summarize_changes(copied, current)
    text = f"{shorten_path(copy.run.absolute())}: {changes} since the run; its copy in the run folder is used"
    warn_once(f"{text}{hint}", key=text)


PYTHON = "python"
"""Key of Python's version; bytecode, and thus fingerprints, differ between versions."""
_IGNORED = {"__annotations__", "__dict__", "__doc__", "__firstlineno__", "__module__", "__weakref__"}
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...))
_EDITED = (
    "was edited after this process imported it, so this process runs the old code, but servers and the copy "
    "in the run have the edited file; start again in a new process (in a notebook: restart the kernel)"
)
_RELOADED = "__autoreload_class__."
"""Prefix of the qualified names of methods that IPython's autoreload has replaced."""


def fingerprint(simulation: str) -> str | None:
    """Return a digest of the code of a class of a notebook; None for other simulations.

    It covers methods and constants of the class and its bases in the notebook, and the functions and
    constants of the notebook that they use, but not comments, line numbers, lists and mappings, which code
    may change.
    """
    parsed = SimulationName.parse(simulation)
    module = sys.modules.get("__main__")
    if parsed.module != "__main__" or module is None:
        return None
    kind = getattr(module, simulation.rpartition(":")[2], None)
    if not isinstance(kind, type):
        return None
    text = "\n".join(_describe_value(kind, vars(module), set()))
    return hashlib.sha256(text.encode(errors="backslashreplace")).hexdigest()[:16]


def fingerprints(simulation: str) -> dict[str, str]:
    """Return the fingerprint of a class by its name, for the record of a session; {} for others."""
    digest = fingerprint(simulation)
    return {} if digest is None else {simulation: digest}


def is_other(simulation: str, versions: Mapping[str, str]) -> bool:
    """Return whether a class of this notebook has changed since a session with these versions.

    False if that cannot be determined.
    """
    before = versions.get(simulation)
    if before is None or versions.get(PYTHON) != platform.python_version():
        return False
    return fingerprint(simulation) not in {None, before}


def _describe_value(value: object, namespace: Mapping[str, Any], visited: set[int]) -> Iterator[str]:
    """Yield the content of a class, function or constant of a notebook; each once."""
    value = getattr(value, "__func__", value)  # of a static or class method
    if isinstance(value, property):
        yield from _describe_value(value.fget, namespace, visited)
        yield from _describe_value(value.fset, namespace, visited)
    elif isinstance(value, type | FunctionType):
        if value.__module__ != "__main__":
            yield f"{value.__module__}.{value.__qualname__}"
        elif id(value) not in visited:
            visited.add(id(value))
            yield from (_describe_class if isinstance(value, type) else _describe_function)(
                value, namespace, visited
            )
    else:
        yield _format_constant(value)


def _describe_class(kind: Any, namespace: Mapping[str, Any], visited: set[int]) -> Iterator[str]:  # noqa: ANN401 - a class
    for name, value in sorted(vars(kind).items()):
        if name not in _IGNORED:
            yield f"{kind.__qualname__}.{name}"
            yield from _describe_value(value, namespace, visited)
    for base in kind.__bases__:
        yield from _describe_value(base, namespace, visited)


def _describe_function(function: Any, namespace: Mapping[str, Any], visited: set[int]) -> Iterator[str]:  # noqa: ANN401 - a function
    yield _format_constant((function.__defaults__, tuple(sorted((function.__kwdefaults__ or {}).items()))))
    for code in _iterate_code(function.__code__):
        yield _format_constant(
            (code.co_code, code.co_names, code.co_varnames, code.co_freevars, code.co_consts)
        )
        for name in _globals_of(code):
            value = namespace.get(name)
            if isinstance(value, type | FunctionType) and value.__module__ == "__main__":
                yield from _describe_value(value, namespace, visited)
            elif name in namespace and _is_plain(value):
                yield f"{name} = {_format_constant(value)}"


def _iterate_code(code: CodeType) -> Iterator[CodeType]:
    """Yield code and all code defined in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _iterate_code(constant)


def _globals_of(code: CodeType) -> list[str]:
    """Return the global names that code reads and does not write."""
    used: dict[str, set[str]] = {"LOAD_GLOBAL": set(), "STORE_GLOBAL": set()}
    for instruction in dis.get_instructions(code):
        if instruction.opname in used:
            used[instruction.opname].add(str(instruction.argval))
    return sorted(used["LOAD_GLOBAL"] - used["STORE_GLOBAL"])


def _format_constant(value: object) -> str:
    """Return a text that is the same for equal values in every process."""
    if isinstance(value, frozenset):
        return f"set{sorted(map(_format_constant, value))}"
    if isinstance(value, tuple):
        return f"tuple{list(map(_format_constant, value))}"
    return repr(value) if isinstance(value, _PLAIN) else f"an object of {type(value).__qualname__}"


def _is_plain(value: object) -> bool:
    """Return whether a value is immutable and consists of numbers and text."""
    if isinstance(value, tuple | frozenset):
        return all(map(_is_plain, value))
    return isinstance(value, _PLAIN)


def warn_of_edits(parts: Sequence[Part]) -> None:
    """Warn of source that was edited after this process imported it, and of changed constants."""
    if not parts:
        return  # modules of a process may be thousands
    modules = {
        file: module for module in list(sys.modules.values()) if (file := getattr(module, "__file__", None))
    }
    for source in (source for part in parts for source in part.files.values()):
        module = modules.get(str(source.origin))
        text = None if module is None else _describe_difference(module, source)
        if text is not None:
            warn_once(f"{shorten_path(source.origin)}: {text}")


def _describe_difference(module: ModuleType, source: Source) -> str | None:
    """Return how a module differs from its source, and a remedy; None if it does not.

    Comments and line numbers are ignored.
    """
    if source.origin.suffix != ".py":
        return None
    try:
        tree = ast.parse(source.data)
        whole = compile(tree, module.__file__ or "", "exec", dont_inherit=True)
    except (SyntaxError, ValueError):
        return _EDITED  # it could not have been imported
    source_code = {(code.co_qualname, _format_code(code)) for code in _iterate_code(whole)}
    if any((name, _format_code(code)) not in source_code for name, code in _functions(module)):
        return _EDITED
    for name, value in _constants(tree):
        current = vars(module).get(name, value)
        if isinstance(current, bool | int | float | str | tuple) and repr(current) != repr(value):
            current_text, source_text = reprlib.repr(current), reprlib.repr(value)
            return (
                f"{name} is {current_text} in this process and {source_text} in the file, which "
                "servers and the copy in the run use: if the program sets it, make it a parameter of the "
                "simulation; if the file was edited, start again in a new process (in a notebook: restart "
                "the kernel)"
            )
    return None


def _format_code(code: CodeType) -> str:
    """Return the content of a function without its location."""
    return repr([
        (part.co_code, part.co_names, part.co_varnames, part.co_freevars, _format_constant(part.co_consts))
        for part in _iterate_code(code)
    ])  # fmt: skip


def _functions(module: ModuleType) -> Iterator[tuple[str, CodeType]]:
    """Yield the functions and methods that a module defines, with their qualified names."""
    for value in list(vars(module).values()):
        members, owner = [value], ""
        if isinstance(value, type) and value.__module__ == module.__name__:
            members, owner = list(vars(value).values()), f"{value.__qualname__}."
        for member in members:
            # Class methods, properties and cached properties hold their function.
            held = (getattr(member, name, None) for name in ("__func__", "fget", "func"))
            code = getattr(next(filter(None, held), member), "__code__", None)
            if isinstance(code, CodeType) and code.co_filename == module.__file__:
                name = code.co_qualname
                yield owner + name.removeprefix(_RELOADED) if name.startswith(_RELOADED) else name, code


def _constants(tree: ast.Module) -> Iterator[tuple[str, Any]]:
    """Yield names and values of constants: upper-case names that are assigned a literal once."""
    stored = [
        node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    ]
    for node in tree.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            name = node.targets[0].id
            if name.isupper() and stored.count(name) == 1:
                try:
                    yield name, ast.literal_eval(node.value)
                except (ValueError, TypeError):
                    continue
