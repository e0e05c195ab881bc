"""Behaviours and conditions in Python beside an exported controller: copies of their code, and its loader."""

import ast
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.tracebacks import locate_definition
from swarmwright.controllers.kinds import kind_of
from swarmwright.controllers.kinds.modules.tables import catalogue_of, own_modules
from swarmwright.controllers.modules import grammar
from swarmwright.controllers.modules.registered import Kind, implementation
from swarmwright.controllers.source.text import MARK, plain
from swarmwright.export._base import Files, facts, render
from swarmwright.export.subject import Subject
from swarmwright.simulations.user_code import trust
from swarmwright.simulations.user_code.copying import Copy
from swarmwright.simulations.user_code.parts import Part, distributions

_CODE = "code"
"""Where the copies lie, in the folder beside the controller."""
_SWARMWRIGHT = Path(__file__).parents[1]
_STAND_IN_ROOT = f'''"""What modules import. {MARK}."""

from swarmwright.controllers import modules as modules
'''
_STAND_IN = ("Behaviour", "Condition", "Parameter", "RandomNumbers", "Senses")
"""What the exported folder has of `swarmwright.controllers.modules`."""
_STAND_IN_MODULES = ("swarmwright.controllers", "swarmwright.controllers.modules")


@dataclass(frozen=True)
class OwnPython:
    """What a controller with behaviours or conditions in Python has beside it."""

    files: Files
    """By their places beside the controller."""
    words: str
    """About them, for the controller's docstring."""


@dataclass(frozen=True)
class _Source:
    """The code of a behaviour or a condition."""

    main: str
    """The file that has it, one of `files`."""
    module: str | None
    """What it is imported as; None for a file that is loaded by its path."""
    files: Mapping[str, bytes]
    """By their places below a folder of modules."""
    digests: Mapping[str, str]
    packages: tuple[str, ...]
    """Installed packages that it imports."""


def has_own(subject: Subject) -> bool:
    """Return whether a controller has a behaviour or a condition that is not the engine's."""
    return bool(kind_of(subject.specification).swarm)


def own_python(subject: Subject, prefix: str) -> OwnPython:
    """Return the code of behaviours and conditions, and what loads it without Swarmwright.

    Raises InputError for code that was changed since it was loaded, that imports more of Swarmwright than
    classes of behaviours and conditions, and where two have different files of one name.
    """
    known = catalogue_of(subject.specification)
    files: dict[str, bytes] = {}
    kinds: dict[str, list[str]] = {"behaviour": [], "condition": []}
    packages, named, imported = {"numpy"}, {}, set()
    for what, parts, places in (
        ("behaviour", own_modules(known.behaviours), known.behaviour_places),
        ("condition", own_modules(known.conditions), known.condition_places),
    ):
        for part in parts:
            kind: Kind = implementation(what, part)  # type: ignore[call-overload] # one of the two
            source = _source_of(kind, part)
            _check_imports(source)
            for place, data in source.files.items():
                if files.setdefault(place, data) != data:
                    raise InputError(
                        f"{locate_definition(kind)}: {part.name}: its {place} is not that of another "
                        "module, and both "
                        "would be copied to the same place; rename one of them"
                    )
            packages |= set(source.packages)
            named[source.main] = source.digests[source.main]
            # A file that is loaded by its path hides no module of its name.
            imported |= {_top(place) for place in source.files if source.module or place != source.main}
            where = f"{source.main!r}, {source.module!r}, {kind.__qualname__!r}"
            kinds[what].append(f"    _Module({where}, {dict(places[part.name])!r}),")
    return OwnPython(
        {
            f"{prefix}_modules/__init__.py": render(
                "python_own_modules.txt",
                {
                    "p": prefix,
                    "facts": facts(subject, "").rstrip(),
                    "digests": "\n".join(
                        f'    "{place}": "{_sha256(files[place])}",' for place in sorted(files)
                    ),
                    "names": ", ".join(repr(name) for name in ["swarmwright", *sorted(imported)]),
                    "behaviours": "\n".join(kinds["behaviour"]),
                    "conditions": "\n".join(kinds["condition"]),
                    "first_behaviour": str(len(grammar.BEHAVIOURS)),
                    "first_condition": str(len(grammar.CONDITIONS)),
                    "transitions": str(int(subject.specification["transitions"])),
                },
            ),
            f"{prefix}_modules/_apart.py": copy_of(_SWARMWRIGHT / "simulations" / "isolation.py"),
            f"{prefix}_modules/{_CODE}/swarmwright/__init__.py": _STAND_IN_ROOT,
            f"{prefix}_modules/{_CODE}/swarmwright/controllers/__init__.py": f'"""{MARK}."""\n',
            f"{prefix}_modules/{_CODE}/swarmwright/controllers/modules.py": copy_of(
                _SWARMWRIGHT / "controllers" / "modules" / "_base.py"
            ),
            **{f"{prefix}_modules/{_CODE}/{place}": files[place] for place in sorted(files)},
        },
        _words(named, sorted(packages), prefix),
    )


def copy_of(file: Path) -> str:
    """Return the text of a file of Swarmwright for an exported folder."""
    return f"# {MARK}; changes here are lost.\n{file.read_text(encoding='utf-8')}"


def _words(named: Mapping[str, str], packages: list[str], prefix: str) -> str:
    lines = [
        "",
        f"The folder {prefix}_modules must lie beside this file; it needs {plain(', '.join(packages))}.",
        "It has the code of behaviours and conditions with which the controller was designed:",
        "",
        *(f"    {plain(place)}  SHA-256 {digest}" for place, digest in sorted(named.items())),
    ]
    return "\n".join(lines)


def _top(place: str) -> str:
    return place.partition("/")[0].partition(".")[0]


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _source_of(kind: Kind, known: grammar.Module) -> _Source:
    """Return the source of a class. Raises InputError where it is not, or no longer, what was loaded."""
    from swarmwright.simulations.loading import file_of  # noqa: PLC0415 - what imports the code of users

    path = file_of(kind)
    if path is None:
        raise InputError(f"{known.name}: is not defined in a file, so there is no code to export")
    try:
        source = _copied(path) or _as_it_is(kind, known, path)
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from error
    if known.sha256 and trust.digest_of(source.digests) != known.sha256:
        raise InputError(
            f"{path}: is not the code with which the controller was designed "
            f"(SHA-256 {known.sha256[:16]}..); export in a new process, which takes the run's copy of it"
        )
    return source


def _copied(path: Path) -> _Source | None:
    """Return what a run has a copy of, None for a file that is no copy."""
    held = Copy.find_containing(path)
    if held is None:
        return None
    copy, kept = held
    files = {place: (copy.folder / kept.name / place).read_bytes() for place in kept.digests}
    part = Part.from_file("", "", path)
    return _Source(kept.main, kept.module, files, kept.digests, distributions([part]))


def _as_it_is(kind: Kind, known: grammar.Module, path: Path) -> _Source:
    part = Part.from_file("", "", path) if known.file else Part.from_module("", "", kind.__module__)
    if part is None:
        raise InputError(f"{known.name}: {kind.__module__} has no source in Python, so it cannot be exported")
    files = {place: file.data for place, file in part.files.items()}
    return _Source(part.main, part.module, files, part.digests, distributions([part]))


def _check_imports(source: _Source) -> None:
    """Raise InputError where importing the code needs more of Swarmwright than the exported folder has."""
    for place, data in source.files.items():
        if not place.endswith(".py"):
            continue
        for line, name in _of_swarmwright(ast.parse(data)):
            raise InputError(
                f"{place}:{line}: imports {name}, which an exported controller does not have: it has only "
                f"{', '.join(_STAND_IN)} of swarmwright.controllers.modules; "
                "import the rest within functions or under `if __name__ == '__main__':`"
            )


def _of_swarmwright(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name of what is imported from Swarmwright when a module is, and is not exported."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) in _NOT_IMPORTED:
            yield from _of_swarmwright(ast.Module(node.orelse, []))
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.startswith("swarmwright.") and alias.name not in _STAND_IN_MODULES:
                    yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            allowed = {
                "swarmwright": ("modules",),
                "swarmwright.controllers": ("modules",),
                "swarmwright.controllers.modules": _STAND_IN,
            }
            module = node.module or ""
            if not node.level and module.partition(".")[0] == "swarmwright":
                for alias in node.names:
                    if alias.name not in allowed.get(module, ()):
                        yield node.lineno, f"{module}.{alias.name}"
        else:
            yield from _of_swarmwright(node)


_NOT_IMPORTED = {"__name__ == '__main__'", "TYPE_CHECKING", "typing.TYPE_CHECKING"}
"""Conditions that do not hold when a module is imported."""
