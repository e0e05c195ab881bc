"""Whether modules in this process are what their files hold now: an import is not repeated after an edit."""

import ast
import reprlib
import sys
from collections.abc import Iterator, Sequence
from types import CodeType, ModuleType
from typing import Any

from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.user_code.changes import near
from swarmwright.simulations.user_code.parts import Part, Source

_EDITED = (
    "was edited after this process imported it; it executes what it imported, servers and the copy in the "
    "run have the edited file: begin again in a new process (in a notebook: restart the kernel)"
)
_RELOADED = "__autoreload_class__."
"""What the names of methods begin with that IPython's autoreload has replaced in a class."""


def warn_of_edits(parts: Sequence[Part]) -> None:
    """Warn of source that was edited after this process imported it, and of constants with other values.

    Of that the process executes what it imported, while a run keeps a copy of what the file holds.
    """
    if not parts:
        return  # modules of a process may be thousands
    modules = {
        file: module for module in list(sys.modules.values()) if (file := getattr(module, "__file__", None))
    }
    for part in parts:
        for source in part.files.values():
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
    if _functions_differ(module, whole):
        return _EDITED
    for name, value in _constants(tree):
        if name in vars(module) and _differ(vars(module)[name], value):
            here, there = reprlib.repr(vars(module)[name]), reprlib.repr(value)
            return (
                f"{name} is {here} in this process and {there} in the file, which servers and the copy in "
                "the run have: if the program sets it, make it a parameter of the simulation; if the file "
                "was edited, begin again in a new process (in a notebook: restart the kernel)"
            )
    return None


def _functions_differ(module: ModuleType, whole: CodeType) -> bool:
    """Whether functions or methods of a module are other ones than in its source, compiled."""
    written: dict[str, list[Any]] = {}
    for code in _within(whole):
        written.setdefault(code.co_qualname, []).append(_content(code))
    return any(_content(code) not in written.get(name, []) for name, code in _functions(module))


def _within(code: CodeType) -> Iterator[CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from _within(constant)


def _content(code: CodeType) -> tuple[Any, ...]:
    """Return what a function does, without where it is."""
    constants = tuple(
        _content(one) if isinstance(one, CodeType) else (type(one), repr(one)) for one in code.co_consts
    )
    return code.co_code, code.co_names, code.co_varnames, code.co_freevars, constants


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


def _differ(one: Any, other: Any) -> bool:  # noqa: ANN401 - constants
    return isinstance(one, bool | int | float | str | tuple) and repr(one) != repr(other)
