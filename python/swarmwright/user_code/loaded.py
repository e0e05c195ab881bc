"""Whether modules in this process are what their files hold now: an import is not repeated after an edit."""

import ast
import sys
from collections.abc import Iterator, Sequence
from types import CodeType, ModuleType
from typing import Any

from swarmwright.user_code.changes import near
from swarmwright.user_code.notices import say
from swarmwright.user_code.parts import Part, Source


def warn_of_edits(parts: Sequence[Part]) -> None:
    """Warn of source that was edited after this process imported it.

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
            if module is not None and is_edited(module, source):
                say(
                    f"{near(source.origin)}: was edited after this process imported it; it executes what it "
                    "imported, servers and the copy in the run have the edited file: begin again in a new "
                    "process (in a notebook: restart the kernel)"
                )


def is_edited(module: ModuleType, source: Source) -> bool:
    """Whether functions, methods or constants of a module are other ones than in its source.

    What differs in comments and line numbers alone is the same.
    """
    if source.origin.suffix != ".py":
        return False
    try:
        tree = ast.parse(source.data)
        whole = compile(tree, module.__file__ or "", "exec", dont_inherit=True)
    except (SyntaxError, ValueError):
        return True  # it could not have been imported
    written: dict[str, list[Any]] = {}
    for code in _within(whole):
        written.setdefault(code.co_qualname, []).append(_content(code))
    for code in _functions(module):
        if _content(code) not in written.get(code.co_qualname, []):
            return True
    return any(
        name in vars(module) and _differ(vars(module)[name], value) for name, value in _constants(tree)
    )


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


def _functions(module: ModuleType) -> Iterator[CodeType]:
    """Yield the functions and methods that a module defines."""
    for value in list(vars(module).values()):
        members = [value]
        if isinstance(value, type) and value.__module__ == module.__name__:
            members = list(vars(value).values())
        for member in members:
            # Class methods, properties and cached properties hold their function.
            held = (getattr(member, name, None) for name in ("__func__", "fget", "func"))
            code = getattr(next(filter(None, held), member), "__code__", None)
            if isinstance(code, CodeType) and code.co_filename == module.__file__:
                yield code


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
