"""An application whose list of runs is complete from the start: nothing runs the watcher in tests."""

from collections.abc import Callable
from pathlib import Path

import pytest
from starlette.applications import Starlette

from swarmwright.ui.app import create_app
from swarmwright.ui.window import Window


@pytest.fixture
def open_app(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], Starlette]:
    """Return what opens a window on a folder of runs."""
    build = Window.__init__

    def complete(self: Window, folder: Path, *, read_only: bool = False) -> None:
        build(self, folder, read_only=read_only)
        self.index.refresh()

    monkeypatch.setattr(Window, "__init__", complete)
    return lambda folder: create_app(folder, token=None)
