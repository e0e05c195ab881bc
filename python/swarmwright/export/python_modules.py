"""User modules of an exported controller: copies of their Python code, and its loader."""

import ast
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.tracebacks import locate_definition
from swarmwright.controllers.kinds import kind_of
from swarmwright.controllers.kinds.modules.tables import catalogue_of, select_user_modules
from swarmwright.controllers.modules import grammar
from swarmwright.controllers.modules.registered import Kind, implementation
from swarmwright.controllers.source.text import MARK, plain
from swarmwright.export._base import Files, format_facts, render
from swarmwright.export.subject import Subject
from swarmwright.simulations.user_code import trust
from swarmwright.simulations.user_code.copying import Copy
from swarmwright.simulations.user_code.parts import Part, distributions

_CODE = "code"
"""Name of the folder with the copies."""
_SWARMWRIGHT = Path(__file__).parents[1]
_STAND_IN_ROOT = f'''"""What modules import. {MARK}."""

from swarmwright.controllers import modules as modules
'''
_STAND_IN = ("Behaviour", "Condition", "Parameter", "RandomNumbers", "Senses")
"""Names of `swarmwright.controllers.modules` that the exported folder provides."""
_STAND_IN_MODULES = ("swarmwright.controllers", "swarmwright.controllers.modules")


@dataclass(frozen=True)
class UserCode:
    """Files beside a controller with modules in Python."""

    files: Files
    """Content by path, relative to the controller."""
    words: str
    """Description for the controller's docstring."""


@dataclass(frozen=True)
class _Source:
    """The code of a behaviour or a condition."""

    main: str
    """Path of the defining file, one of `files`."""
    module: str | None
    """Name under which it is imported; None for a file that is loaded by its path."""
    files: Mapping[str, bytes]
    """Content by path below a folder of modules."""
    digests: Mapping[str, str]
    packages: tuple[str, ...]
    """Imported installed packages."""


def has_user_modules(subject: Subject) -> bool:
    """Whether a controller has a behaviour or a condition in Python."""
    return bool(kind_of(subject.specification).swarm)


def export_user_modules(subject: Subject, prefix: str) -> UserCode:
    """Export the code of user modules with a loader that works without Swarmwright.

    Raises InputError for code that was changed since it was loaded or that imports other parts of Swarmwright
    than the base classes of modules, and for different files of the same name.
    """
    catalogue = catalogue_of(subject.specification)
    files: dict[str, bytes] = {}
    kinds: dict[str, list[str]] = {"behaviour": [], "condition": []}
    packages, main_digests, imported = {"numpy"}, {}, set()
    for role, parts, columns in (
        ("behaviour", select_user_modules(catalogue.behaviours), catalogue.behaviour_columns),
        ("condition", select_user_modules(catalogue.conditions), catalogue.condition_columns),
    ):
        for part in parts:
            kind: Kind = implementation(role, part)  # type: ignore[call-overload] # one of the two
            source = _source_of(kind, part)
            _check_imports(source)
            for path, data in source.files.items():
                if files.setdefault(path, data) != data:
                    raise InputError(
                        f"{locate_definition(kind)}: {part.name}: its {path} differs from that of another "
                        "module, but both are copied to the same path; rename one of them"
                    )
            packages |= set(source.packages)
            main_digests[source.main] = source.digests[source.main]
            # A file that is loaded by its path does not hide a module of the same name.
            imported |= {_top(path) for path in source.files if source.module or path != source.main}
            arguments = f"{source.main!r}, {source.module!r}, {kind.__qualname__!r}"
            kinds[role].append(f"    _Module({arguments}, {dict(columns[part.name])!r}),")
    return UserCode(
        {
            f"{prefix}_modules/__init__.py": render(
                "python_own_modules.txt",
                {
                    "p": prefix,
                    "facts": format_facts(subject, "").rstrip(),
                    "digests": "\n".join(
                        f'    "{path}": "{_sha256(files[path])}",' for path in sorted(files)
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
            **{f"{prefix}_modules/{_CODE}/{path}": files[path] for path in sorted(files)},
        },
        _words(main_digests, sorted(packages), prefix),
    )


def copy_of(file: Path) -> str:
    """Return the text of a file of Swarmwright for an exported folder."""
    return f"# {MARK}; changes here are lost.\n{file.read_text(encoding='utf-8')}"


def _words(main_digests: Mapping[str, str], packages: list[str], prefix: str) -> str:
    lines = [
        "",
        f"The folder {prefix}_modules must lie beside this file; it needs {plain(', '.join(packages))}.",
        "It has the code of behaviours and conditions with which the controller was designed:",
        "",
        *(f"    {plain(path)}  SHA-256 {digest}" for path, digest in sorted(main_digests.items())),
    ]
    return "\n".join(lines)


def _top(path: str) -> str:
    return path.partition("/")[0].partition(".")[0]


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _source_of(kind: Kind, entry: grammar.Module) -> _Source:
    """Return the source of a class. Raises InputError if it is missing or was changed since it was loaded."""
    from swarmwright.simulations.loading import file_of  # noqa: PLC0415 - imports user code

    path = file_of(kind)
    if path is None:
        raise InputError(f"{entry.name}: is not defined in a file, so its code cannot be exported")
    try:
        source = _read_copy(path) or _read_original(kind, entry, path)
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from error
    if entry.sha256 and trust.digest_of(source.digests) != entry.sha256:
        raise InputError(
            f"{path}: differs from the code with which the controller was designed "
            f"(SHA-256 {entry.sha256[:16]}..); export in a new process, which uses the run's copy"
        )
    return source


def _read_copy(path: Path) -> _Source | None:
    """Return the source from a run's copy; None for other files."""
    held = Copy.find_containing(path)
    if held is None:
        return None
    copy, copied = held
    files = {file_name: (copy.folder / copied.name / file_name).read_bytes() for file_name in copied.digests}
    part = Part.from_file("", "", path)
    return _Source(copied.main, copied.module, files, copied.digests, distributions([part]))


def _read_original(kind: Kind, entry: grammar.Module, path: Path) -> _Source:
    part = Part.from_file("", "", path) if entry.file else Part.from_module("", "", kind.__module__)
    if part is None:
        raise InputError(f"{entry.name}: {kind.__module__} has no Python source, so it cannot be exported")
    files = {file_name: file.data for file_name, file in part.files.items()}
    return _Source(part.main, part.module, files, part.digests, distributions([part]))


def _check_imports(source: _Source) -> None:
    """Raise InputError if the code imports parts of Swarmwright that the exported folder lacks."""
    for path, data in source.files.items():
        if not path.endswith(".py"):
            continue
        for line, name in _find_forbidden_imports(ast.parse(data)):
            raise InputError(
                f"{path}:{line}: imports {name}, but an exported controller provides only "
                f"{', '.join(_STAND_IN)} of swarmwright.controllers.modules; move other imports into "
                "functions or under `if __name__ == '__main__':`"
            )


def _find_forbidden_imports(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name of imports from Swarmwright that are not exported."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) in _NOT_IMPORTED:
            yield from _find_forbidden_imports(ast.Module(node.orelse, []))
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
            yield from _find_forbidden_imports(node)


_NOT_IMPORTED = {"__name__ == '__main__'", "TYPE_CHECKING", "typing.TYPE_CHECKING"}
"""Conditions that do not hold when a module is imported."""
