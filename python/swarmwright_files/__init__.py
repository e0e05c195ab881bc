"""Modules that Swarmwright imported by their file, under names that every process can import.

`swarmwright_files./home/me/maze%2Epy` is the module of `/home/me/maze.py`. With such a name, classes and
functions of the file can be pickled, and worker processes (multiprocessing, joblib, Gymnasium's vector
environments) find them. In an experiment, name the file itself: `/home/me/maze.py:Maze`.

This package lies beside `swarmwright`, not in it, so that `logging.getLogger(__name__)` in the file is no
child of Swarmwright's logger.
"""

import sys
from collections.abc import Sequence
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from types import ModuleType


class _Files(Loader):
    """Finds and loads the modules below this package."""

    def find_spec(
        self,
        name: str,
        path: Sequence[str] | None = None,  # noqa: ARG002 - as Python calls it
        target: ModuleType | None = None,  # noqa: ARG002 - as above
    ) -> ModuleSpec | None:
        """Return the spec of a module of a file, None for any other name."""
        return ModuleSpec(name, self) if name.startswith(f"{__name__}./") else None

    def exec_module(self, module: ModuleType) -> None:
        """Import the file. Raises InputError."""
        from swarmwright.simulations.loading import import_by_name  # noqa: PLC0415 - only where it is needed

        name = module.__name__
        sys.modules[name] = import_by_name(name)


sys.meta_path.append(_Files())
