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


class Apart:
    """Modules of a folder, which import one another, and the rest as any module does.

    Elsewhere in the process their names keep their meaning: other code that imports `helper` does not get the
    folder's, and the folder's modules never get another one, not even by imports within functions, which run
    later. Neither `sys.path` nor, in the end, `sys.modules` holds anything of it.

    Args:
        folder: where they are.
        names: of modules and packages in it, at its top.
        importable: returns the name by which a module can be imported elsewhere, of its name in the folder.
            The module knows that name, and the process knows the module by it, so that what it defines can be
            pickled. Packages keep their own names.
    """

    def __init__(self, folder: Path, names: set[str], importable: Callable[[str], str] | None = None) -> None:
        self._folder = folder
        self.names = names
        """Of the modules and packages that are the folder's."""
        self.importable = importable
        self._modules: dict[str, ModuleType] = {}
        self._inside = False
        self.builtins = {**vars(builtins), "__import__": self._import}
        """What the modules find as their built-ins, by which their import statements come here."""

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Let the names mean this folder's modules for the time of a `with` block."""
        with _lock:
            if self._inside:
                yield
                return
            others = self._taken()
            sys.modules.update(self._modules)
            sys.meta_path.insert(0, self)
            self._inside = True
            try:
                yield
            finally:
                self._inside = False
                sys.meta_path.remove(self)
                self._modules = self._taken()
                sys.modules.update(others)

    def load(self, name: str, path: Path) -> ModuleType:
        """Return the module of a file; its name stays known to the process. Raises whatever its code does."""
        spec = spec_from_file_location(name, path, loader=_Loader(name, str(path), self))
        assert spec is not None
        assert spec.loader is not None
        module = module_from_spec(spec)
        with self.entered():
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
        """Find a module of the folder, as `sys.meta_path` asks for it."""
        if name.partition(".")[0] not in self.names:
            return None
        spec = PathFinder.find_spec(name, [str(self._folder)] if path is None else path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(name, spec.loader.path, self)
        return spec

    def _taken(self) -> dict[str, ModuleType]:
        """Take all modules of these names out of `sys.modules`."""
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
        with self.entered():
            return __import__(name, globals, locals, fromlist, level)


class FromSource(SourceFileLoader):
    """Loads a module from its source, without leaving or reading bytecode.

    Python takes bytecode for that of a file whose size and second of change are the same, so that an edit
    may have no effect.
    """

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002 - as Python calls it
        """Return the compiled source."""
        path = self.path
        code: CodeType = self.source_to_code(self.get_data(path), path)
        return code


class _Loader(FromSource):
    """Loads a module of such a folder."""

    def __init__(self, name: str, path: str, apart: Apart) -> None:
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
