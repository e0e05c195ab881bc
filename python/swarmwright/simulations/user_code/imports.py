"""The files of a module's code, found by its import statements without running it."""

import ast
import importlib.util
import sys
import sysconfig
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

_NO_FILE = {"built-in", "frozen"}
_OWN = {"swarmwright", "swarmwright_files"}


class Walk:
    """The files of a module and of its direct and indirect imports, including those within functions.

    Only modules outside folders of installed packages are followed, including editable installs. Imports with
    computed names (`importlib.import_module(name)`) are not detected.
    """

    def __init__(self) -> None:
        self.files: dict[str, Path] = {}
        """Location of a module below its import folder, `package/module.py` -> its file."""
        self.packages: set[str] = set()
        """Import names of the installed packages that are imported."""
        self._home = ""
        self._main: Path | None = None
        self._folders: list[str] = []
        self._pending: list[tuple[Path, str]] = []

    @classmethod
    def from_file(cls, path: Path) -> "Walk":
        """Begin at a file that is loaded by its path. Raises OSError if it cannot be read."""
        walk = cls()
        walk._folders = [str(path.parent)]
        walk._main = walk.files[path.name] = path
        walk._pending.append((path, ""))
        walk._follow_all()
        return walk

    @classmethod
    def from_module(cls, name: str, *, installed: bool = True) -> "Walk":
        """Begin at a module that is imported by its name; no files if it is missing or not in Python.

        installed: whether to follow modules of the same package if it is installed.
        Raises OSError if a file cannot be read.
        """
        walk = cls()
        walk._home = name.partition(".")[0] if installed else ""
        walk._follow(name, ())
        walk._follow_all()
        return walk

    def _follow_all(self) -> None:
        while self._pending:
            path, package = self._pending.pop()
            for module, names in _imports(path.read_bytes(), package):
                self._follow(module, names)

    def _follow(self, module: str, names: Sequence[str]) -> None:
        parts = module.split(".")
        folders: Sequence[str] | None = None
        for depth in range(1, len(parts) + 1):
            folders = self._add_module(parts[:depth], folders)
            if folders is None:
                return
        for name in names:
            self._add_module([*parts, name], folders)

    def _add_module(self, parts: list[str], folders: Sequence[str] | None) -> Sequence[str] | None:
        """Add the file of a module; return the folders of its submodules, None if they are not followed."""
        name = ".".join(parts)
        if parts[0] in sys.stdlib_module_names or parts[0] in _OWN:
            return None
        spec = self._find_top_level(name) if folders is None else _find_in(name, folders)
        if spec is None or spec.origin in _NO_FILE:
            return None
        inner = spec.submodule_search_locations
        if spec.origin is None:  # a folder without __init__.py
            return None if inner is None else list(inner)
        file = Path(spec.origin).absolute()
        if not file.is_file():
            return None  # deleted since this process imported it
        above = len(parts) if inner is not None else len(parts) - 1
        folder = file.parents[min(above, len(file.parents) - 1)]
        if parts[0] != self._home and _holds_installed(folder):
            self.packages.add(parts[0])
            return None
        location = "/".join([*parts, file.name] if inner is not None else [*parts[:-1], file.name])
        if location not in self.files:
            self.files[location] = file
            if file.suffix == ".py":
                self._pending.append((file, name if inner is not None else ".".join(parts[:-1])))
        return None if inner is None else list(inner)

    def find_shadowed_modules(self) -> set[str]:
        """Return the modules beside the file if the process would import others by any of their names.

        For example, two files in different folders, or a script, may each have a `helper.py` beside them.
        """
        beside = {
            location.partition("/")[0].partition(".")[0]
            for location, file in self.files.items()
            if file != self._main and str(file.parents[location.count("/")]) in self._folders
        }
        changed = any(
            (usual := _find_normally(name)) is not None
            and _locate(usual) != _locate(_find_in(name, self._folders))
            for name in beside
        )
        return beside if changed else set()

    def _find_top_level(self, name: str) -> ModuleSpec | None:
        usual = _find_normally(name)
        beside = _find_in(name, self._folders)
        if usual is None or (beside is not None and not _is_installed(usual)):
            return beside or usual or _find_in(name, [str(Path.cwd())])
        return usual


def _find_normally(name: str) -> ModuleSpec | None:
    """Return the module that the process would import by a name without a dot, without importing it."""
    try:
        return importlib.util.find_spec(name)
    except (ImportError, ValueError, AttributeError):
        return None


def _locate(spec: ModuleSpec | None) -> Path | None:
    """Return the file of a module, or its folder if it has no `__init__.py`."""
    if spec is None:
        return None
    paths = [spec.origin] if spec.origin is not None else list(spec.submodule_search_locations or ())
    return Path(paths[0]).resolve() if paths else None


def _is_installed(spec: ModuleSpec) -> bool:
    if spec.origin is None or spec.origin in _NO_FILE:
        return spec.origin is not None
    file = Path(spec.origin).absolute()
    return _holds_installed(file.parents[0 if spec.submodule_search_locations is None else 1])


def _find_in(name: str, folders: Sequence[str]) -> ModuleSpec | None:
    try:
        return PathFinder.find_spec(name, list(folders))
    except (ImportError, ValueError):
        return None
    except KeyError:  # a folder without __init__.py in a package that is not imported
        below = name.rpartition(".")[2]
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = [
            str(Path(folder) / below) for folder in folders if (Path(folder) / below).is_dir()
        ]
        return spec


def _imports(source: bytes, package: str) -> Iterator[tuple[str, list[str]]]:
    """Yield every imported module, and the names imported from it, which may be modules."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError):
        return  # reported when it is imported
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, []
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:
                above = package.split(".") if package else []
                if len(above) < node.level:
                    continue
                base = above[: len(above) - node.level + 1]
                module = ".".join([*base, *([module] if module else [])])
            if module:
                yield module, [alias.name for alias in node.names if alias.name != "*"]


@cache
def _holds_installed(folder: Path) -> bool:
    """Return whether the modules in a folder were installed, or belong to Python."""
    if folder.name in {"site-packages", "dist-packages"}:
        return True
    if str(folder) in {sysconfig.get_path("stdlib"), sysconfig.get_path("platstdlib")}:
        return True
    return next(folder.glob("*.dist-info"), None) is not None
