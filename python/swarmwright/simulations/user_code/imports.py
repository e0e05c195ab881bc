"""Which files a module's code consists of, found by its import statements without running any of it."""

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
    """The files of a module and of what it imports, directly or not, also within functions.

    Followed are modules that lie outside folders of installed packages, editable installs among them. Imports
    by computed names (`importlib.import_module(name)`) are not seen.
    """

    def __init__(self) -> None:
        self.files: dict[str, Path] = {}
        """Where a module lies below a folder of modules, `package/module.py` -> its file."""
        self.packages: set[str] = set()
        """Installed packages that are imported, by the names by which they are imported."""
        self._home = ""
        self._main: Path | None = None
        self._places: list[str] = []
        self._open: list[tuple[Path, str]] = []

    @classmethod
    def of_file(cls, path: Path) -> "Walk":
        """Begin at a file that is loaded by its path. Raises OSError when it cannot be read."""
        walk = cls()
        walk._places = [str(path.parent)]
        walk._main = walk.files[path.name] = path
        walk._open.append((path, ""))
        walk._go()
        return walk

    @classmethod
    def of_module(cls, name: str, *, installed: bool = True) -> "Walk":
        """Begin at a module that is imported by its name; no files when there is none, or none in Python.

        installed: whether to follow modules of the same package if that is an installed one.
        Raises OSError when a file cannot be read.
        """
        walk = cls()
        walk._home = name.partition(".")[0] if installed else ""
        walk._follow(name, ())
        walk._go()
        return walk

    def _go(self) -> None:
        while self._open:
            path, package = self._open.pop()
            for module, names in _imports(path.read_bytes(), package):
                self._follow(module, names)

    def _follow(self, module: str, names: Sequence[str]) -> None:
        parts = module.split(".")
        places: Sequence[str] | None = None
        for depth in range(1, len(parts) + 1):
            places = self._take(parts[:depth], places)
            if places is None:
                return
        for name in names:
            self._take([*parts, name], places)

    def _take(self, parts: list[str], places: Sequence[str] | None) -> Sequence[str] | None:
        """Note the file of a module; return where its submodules are, None where they are not followed."""
        name = ".".join(parts)
        if parts[0] in sys.stdlib_module_names or parts[0] in _OWN:
            return None
        spec = self._top(name) if places is None else _found(name, places)
        if spec is None or spec.origin in _NO_FILE:
            return None
        inner = spec.submodule_search_locations
        if spec.origin is None:  # a folder without __init__.py
            return None if inner is None else list(inner)
        file = Path(spec.origin).absolute()
        if not file.is_file():
            return None  # imported in this process, and deleted since
        above = len(parts) if inner is not None else len(parts) - 1
        folder = file.parents[min(above, len(file.parents) - 1)]
        if parts[0] != self._home and _holds_installed(folder):
            self.packages.add(parts[0])
            return None
        place = "/".join([*parts, file.name] if inner is not None else [*parts[:-1], file.name])
        if place not in self.files:
            self.files[place] = file
            if file.suffix == ".py":
                self._open.append((file, name if inner is not None else ".".join(parts[:-1])))
        return None if inner is None else list(inner)

    def hidden(self) -> set[str]:
        """The modules beside the file, if the process would import other ones by the name of any of them.

        Two files in different folders may each have a `helper.py` beside them, and so may a script.
        """
        beside = {
            place.partition("/")[0].partition(".")[0]
            for place, file in self.files.items()
            if file != self._main and str(file.parents[place.count("/")]) in self._places
        }
        changed = any(
            (usual := _usual(name)) is not None and _place(usual) != _place(_found(name, self._places))
            for name in beside
        )
        return beside if changed else set()

    def _top(self, name: str) -> ModuleSpec | None:
        usual = _usual(name)
        beside = _found(name, self._places)
        if usual is None or (beside is not None and not _is_installed(usual)):
            return beside or usual or _found(name, [str(Path.cwd())])
        return usual


def _usual(name: str) -> ModuleSpec | None:
    """Return what the process imports by a name without a point; nothing is imported."""
    try:
        return importlib.util.find_spec(name)
    except (ImportError, ValueError, AttributeError):
        return None


def _place(spec: ModuleSpec | None) -> Path | None:
    """Return the file of a module, or its folder where it is one without `__init__.py`."""
    if spec is None:
        return None
    places = [spec.origin] if spec.origin is not None else list(spec.submodule_search_locations or ())
    return Path(places[0]).resolve() if places else None


def _is_installed(spec: ModuleSpec) -> bool:
    if spec.origin is None or spec.origin in _NO_FILE:
        return spec.origin is not None
    file = Path(spec.origin).absolute()
    return _holds_installed(file.parents[0 if spec.submodule_search_locations is None else 1])


def _found(name: str, places: Sequence[str]) -> ModuleSpec | None:
    try:
        return PathFinder.find_spec(name, list(places))
    except (ImportError, ValueError):
        return None
    except KeyError:  # a folder without __init__.py in a package that is not imported
        below = name.rpartition(".")[2]
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = [
            str(Path(place) / below) for place in places if (Path(place) / below).is_dir()
        ]
        return spec


def _imports(source: bytes, package: str) -> Iterator[tuple[str, list[str]]]:
    """Yield every module that is imported, and what is taken from it, which may be modules, too."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError):
        return  # reported where it is imported
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
    """Whether modules in a folder were put there by an installer, or belong to Python."""
    if folder.name in {"site-packages", "dist-packages"}:
        return True
    if str(folder) in {sysconfig.get_path("stdlib"), sysconfig.get_path("platstdlib")}:
        return True
    return next(folder.glob("*.dist-info"), None) is not None
