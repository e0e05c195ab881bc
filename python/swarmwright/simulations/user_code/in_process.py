"""What this process executes, which may be other code than files and earlier sessions of a run have.

Classes of notebooks have no file: changes are seen by fingerprints of their code. A module is not imported
again after an edit: the process executes what it imported, while a run keeps a copy of what the file holds.
"""

import ast
import dis
import hashlib
import platform
import reprlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from types import CodeType, FunctionType, ModuleType
from typing import Any

from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.user_code.changes import near
from swarmwright.simulations.user_code.parts import Part, Source

PYTHON = "python"
"""Whose version decides whether fingerprints can be compared: bytecode differs between versions."""
_IGNORED = {"__annotations__", "__dict__", "__doc__", "__firstlineno__", "__module__", "__weakref__"}
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...))
_EDITED = (
    "was edited after this process imported it; it executes what it imported, servers and the copy in the "
    "run have the edited file: begin again in a new process (in a notebook: restart the kernel)"
)
_RELOADED = "__autoreload_class__."
"""What the names of methods begin with that IPython's autoreload has replaced in a class."""


def fingerprint(simulation: str) -> str | None:
    """Return what is the same for a class of a notebook as long as its code is; None for others.

    Methods and constants of the class and of its bases in the notebook count, and functions and constants of
    the notebook that they name. Comments, line numbers, and lists and mappings, which code may change, do
    not.
    """
    parsed = SimulationName.parse(simulation)
    module = sys.modules.get("__main__")
    if parsed.module != "__main__" or module is None:
        return None
    kind = getattr(module, simulation.rpartition(":")[2], None)
    if not isinstance(kind, type):
        return None
    text = "\n".join(_described(kind, vars(module), set()))
    return hashlib.sha256(text.encode(errors="backslashreplace")).hexdigest()[:16]


def fingerprints(simulation: str) -> dict[str, str]:
    """Return the fingerprint of a class by its name, for the record of a session; {} for others."""
    found = fingerprint(simulation)
    return {} if found is None else {simulation: found}


def is_other(simulation: str, versions: Mapping[str, str]) -> bool:
    """Whether a class of this notebook is known to have other code than in a session with these versions."""
    before = versions.get(simulation)
    if before is None or versions.get(PYTHON) != platform.python_version():
        return False
    return fingerprint(simulation) not in {None, before}


def _described(value: object, known: Mapping[str, Any], seen: set[int]) -> Iterator[str]:
    """Yield what makes a value of a notebook: a class, a function, a constant; each once."""
    value = getattr(value, "__func__", value)  # of a static or class method
    if isinstance(value, property):
        yield from _described(value.fget, known, seen)
        yield from _described(value.fset, known, seen)
    elif isinstance(value, type | FunctionType):
        if value.__module__ != "__main__":
            yield f"{value.__module__}.{value.__qualname__}"
        elif id(value) not in seen:
            seen.add(id(value))
            yield from (_class if isinstance(value, type) else _function)(value, known, seen)
    else:
        yield _words(value)


def _class(kind: Any, known: Mapping[str, Any], seen: set[int]) -> Iterator[str]:  # noqa: ANN401 - a class
    for name, value in sorted(vars(kind).items()):
        if name not in _IGNORED:
            yield f"{kind.__qualname__}.{name}"
            yield from _described(value, known, seen)
    for base in kind.__bases__:
        yield from _described(base, known, seen)


def _function(function: Any, known: Mapping[str, Any], seen: set[int]) -> Iterator[str]:  # noqa: ANN401 - a function
    yield _words((function.__defaults__, tuple(sorted((function.__kwdefaults__ or {}).items()))))
    for code in _within(function.__code__):
        yield _words((code.co_code, code.co_names, code.co_varnames, code.co_freevars, code.co_consts))
        for name in _globals_of(code):
            value = known.get(name)
            if isinstance(value, type | FunctionType) and value.__module__ == "__main__":
                yield from _described(value, known, seen)
            elif name in known and _is_plain(value):
                yield f"{name} = {_words(value)}"


def _within(code: CodeType) -> Iterator[CodeType]:
    """Yield code and what is defined in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _within(constant)


def _globals_of(code: CodeType) -> list[str]:
    """Return the names of the notebook that code reads and does not write."""
    used: dict[str, set[str]] = {"LOAD_GLOBAL": set(), "STORE_GLOBAL": set()}
    for instruction in dis.get_instructions(code):
        if instruction.opname in used:
            used[instruction.opname].add(str(instruction.argval))
    return sorted(used["LOAD_GLOBAL"] - used["STORE_GLOBAL"])


def _words(value: object) -> str:
    """Return what is the same for equal values, in every process."""
    if isinstance(value, frozenset):
        return f"set{sorted(map(_words, value))}"
    if isinstance(value, tuple):
        return f"tuple{list(map(_words, value))}"
    return repr(value) if isinstance(value, _PLAIN) else f"an object of {type(value).__qualname__}"


def _is_plain(value: object) -> bool:
    """Whether a value is made of numbers and text alone, and cannot change."""
    if isinstance(value, tuple | frozenset):
        return all(map(_is_plain, value))
    return isinstance(value, _PLAIN)


def warn_of_edits(parts: Sequence[Part]) -> None:
    """Warn of source that was edited after this process imported it, and of constants with other values."""
    if not parts:
        return  # modules of a process may be thousands
    modules = {
        file: module for module in list(sys.modules.values()) if (file := getattr(module, "__file__", None))
    }
    for source in (source for part in parts for source in part.files.values()):
        module = modules.get(str(source.origin))
        text = None if module is None else _difference(module, source)
        if text is not None:
            warn_once(f"{near(source.origin)}: {text}")


def _difference(module: ModuleType, source: Source) -> str | None:
    """Return how a module differs from its source, and what to do; None where it does not.

    What differs in comments and line numbers alone is the same.
    """
    if source.origin.suffix != ".py":
        return None
    try:
        tree = ast.parse(source.data)
        whole = compile(tree, module.__file__ or "", "exec", dont_inherit=True)
    except (SyntaxError, ValueError):
        return _EDITED  # it could not have been imported
    written = {(code.co_qualname, _content(code)) for code in _within(whole)}
    if any((name, _content(code)) not in written for name, code in _functions(module)):
        return _EDITED
    for name, value in _constants(tree):
        here = vars(module).get(name, value)
        if isinstance(here, bool | int | float | str | tuple) and repr(here) != repr(value):
            held, written_value = reprlib.repr(here), reprlib.repr(value)
            return (
                f"{name} is {held} in this process and {written_value} in the file, which "
                "servers and the copy in the run have: if the program sets it, make it a parameter of the "
                "simulation; if the file was edited, begin again in a new process (in a notebook: restart "
                "the kernel)"
            )
    return None


def _content(code: CodeType) -> str:
    """Return what a function does, without where it is."""
    return repr([
        (inner.co_code, inner.co_names, inner.co_varnames, inner.co_freevars, _words(inner.co_consts))
        for inner in _within(code)
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
    """Yield names and values of constants: in capitals, with a literal, assigned once."""
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
