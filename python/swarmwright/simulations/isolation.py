"""Importing the modules of a folder isolated from others of the same names in this process."""

import builtins
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

_lock = threading.RLock()


class IsolatedModules:
    """The modules of a folder, isolated from modules of the same names in the rest of the process.

    Code outside that imports `helper` does not get the folder's module, and the folder's modules always get
    their own `helper`, even in imports within functions, which run later. `sys.path` and `sys.modules` are
    restored after each import.

    Args:
        folder: folder of the modules.
        names: names of the top-level modules and packages in it.
        importable: maps the name of a module in the folder to the name by which the process can import it,
            so that objects it defines can be pickled. Packages keep their own names.
    """

    def __init__(self, folder: Path, names: set[str], importable: Callable[[str], str] | None = None) -> None:
        self._folder = folder
        self.names = names
        """Names of the folder's modules and packages."""
        self.importable = importable
        self._modules: dict[str, ModuleType] = {}
        self._inside = False
        self.builtins = {**vars(builtins), "__import__": self._import}
        """The modules' built-ins, whose `__import__` handles their import statements."""

    @contextmanager
    def activate(self) -> Iterator[None]:
        """Bind the names to this folder's modules within a `with` block."""
        with _lock:
            if self._inside:
                yield
                return
            outside_modules = self._pop_modules()
            sys.modules.update(self._modules)
            sys.meta_path.insert(0, self)
            self._inside = True
            try:
                yield
            finally:
                self._inside = False
                sys.meta_path.remove(self)
                self._modules = self._pop_modules()
                sys.modules.update(outside_modules)

    def load(self, name: str, path: Path) -> ModuleType:
        """Import a file, and keep it in `sys.modules`. Raises any exception of its code."""
        spec = spec_from_file_location(name, path, loader=_Loader(name, str(path), self))
        assert spec is not None
        assert spec.loader is not None
        module = module_from_spec(spec)
        with self.activate():
            sys.modules[name] = module
            try:
                spec.loader.exec_module(module)
            except BaseException:
                del sys.modules[name]
                raise
        return module

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a module of the folder; called through `sys.meta_path`."""
        if name.partition(".")[0] not in self.names:
            return None
        spec = PathFinder.find_spec(name, [str(self._folder)] if path is None else path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(name, spec.loader.path, self)
        return spec

    def _pop_modules(self) -> dict[str, ModuleType]:
        """Remove all modules of these names from `sys.modules` and return them."""
        names = [name for name in sys.modules if name.partition(".")[0] in self.names]
        return {name: sys.modules.pop(name) for name in names}

    def _import(
        self,
        name: str,
        globals: Mapping[str, Any] | None = None,  # noqa: A002 - as in Python
        locals: Mapping[str, Any] | None = None,  # noqa: A002 - as in Python
        fromlist: Sequence[str] = (),
        level: int = 0,
    ) -> ModuleType:
        if level == 0 and name.partition(".")[0] not in self.names:
            return __import__(name, globals, locals, fromlist, level)
        with self.activate():
            return __import__(name, globals, locals, fromlist, level)


class FromSource(SourceFileLoader):
    """A loader that neither reads nor writes bytecode.

    Python uses cached bytecode if a file's size and modification time in seconds match, so that an edit may
    have no effect.
    """

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002 - as Python calls it
        """Return the compiled source."""
        path = self.path
        code: CodeType = self.source_to_code(self.get_data(path), path)
        return code


class _Loader(FromSource):
    """Loader of an isolated module."""

    def __init__(self, name: str, path: str, apart: IsolatedModules) -> None:
        super().__init__(name, path)
        self._apart = apart

    def exec_module(self, module: ModuleType) -> None:
        """Run the module's code."""
        module.__dict__["__builtins__"] = self._apart.builtins
        importable = self._apart.importable
        inside = module.__name__.partition(".")[0] in self._apart.names and not hasattr(module, "__path__")
        if importable is None or not inside:
            super().exec_module(module)
            return
        name = module.__name__ = importable(module.__name__)
        sys.modules[name] = module
        try:
            super().exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
