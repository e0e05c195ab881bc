"""Fingerprints of classes of notebooks, which have no file: changes are seen by them."""

import dis
import hashlib
import platform
import sys
import types
from collections.abc import Iterator, Mapping
from typing import Any

from swarmwright.common.simulation_names import SimulationName

PYTHON = "python"
"""Whose version decides whether fingerprints can be compared: bytecode differs between versions."""
_IGNORED = {"__annotations__", "__dict__", "__doc__", "__firstlineno__", "__module__", "__weakref__"}
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...))


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
    total = hashlib.sha256()
    for line in _lines(kind, vars(module), set()):
        total.update(line.encode(errors="backslashreplace") + b"\n")
    return total.hexdigest()[:16]


def fingerprints(simulation: str) -> dict[str, str]:
    """Return the fingerprint of a class by its name, for the record of a session; {} for others."""
    found = fingerprint(simulation)
    return {} if found is None else {simulation: found}


def is_other(simulation: str, versions: Mapping[str, str]) -> bool:
    """Whether a class of this notebook is known to have other code than in a session with these versions."""
    before = versions.get(simulation)
    if before is None or versions.get(PYTHON) != platform.python_version():
        return False
    now = fingerprint(simulation)
    return now is not None and now != before


def _lines(kind: type, known: Mapping[str, Any], seen: set[int]) -> Iterator[str]:
    """Yield what makes a class, or what it calls, in the notebook."""
    if id(kind) in seen:
        return
    seen.add(id(kind))
    for base in kind.__mro__:
        if base.__module__ != "__main__":
            yield f"base {base.__module__}.{base.__qualname__}"
            continue
        for name, value in sorted(vars(base).items()):
            if name not in _IGNORED:
                yield f"{base.__qualname__}.{name}"
                yield from _value(value, known, seen)


def _value(value: object, known: Mapping[str, Any], seen: set[int]) -> Iterator[str]:
    if isinstance(value, staticmethod | classmethod):
        value = value.__func__
    if isinstance(value, property):
        for one in (value.fget, value.fset):
            yield from _value(one, known, seen)
    elif isinstance(value, types.FunctionType):
        if id(value) not in seen:
            seen.add(id(value))
            yield _words((value.__defaults__, tuple(sorted((value.__kwdefaults__ or {}).items()))))
            yield from _code(value.__code__, known, seen)
    elif isinstance(value, type) and value.__module__ == "__main__":
        yield from _lines(value, known, seen)
    elif _is_plain(value):
        yield _words(value)
    else:
        yield f"an object of {type(value).__qualname__}"


def _code(code: types.CodeType, known: Mapping[str, Any], seen: set[int]) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr((code.co_names, code.co_varnames, code.co_freevars))
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _code(constant, known, seen)
        else:
            yield _words(constant)
    for name in _globals_of(code):
        value = known.get(name)
        if isinstance(value, types.FunctionType | type) and value.__module__ == "__main__":
            yield from _value(value, known, seen)
        elif name in known and _is_plain(value):
            yield f"{name} = {_words(value)}"


def _globals_of(code: types.CodeType) -> list[str]:
    """Return the names of the notebook that code reads and does not write."""
    used, written = set(), set()
    for instruction in dis.get_instructions(code):
        if instruction.opname == "LOAD_GLOBAL":
            used.add(str(instruction.argval))
        elif instruction.opname == "STORE_GLOBAL":
            written.add(str(instruction.argval))
    return sorted(used - written)


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
