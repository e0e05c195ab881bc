"""Runs that the window shows, and the application in this process."""

from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

import swarmwright
from swarmwright.ui.app import create_app
from swarmwright.ui.window import Window
from tests.python.records import EXPERIMENT


@pytest.fixture(scope="session")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the runs `run-1` and `run-2`, which tests do not change."""
    folder = tmp_path_factory.mktemp("runs")
    for seed in (1, 2):
        swarmwright.optimize(EXPERIMENT, servers="in-process", seed=seed, out=folder / f"run-{seed}")
    return folder


@pytest.fixture
def complete_list(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make lists of runs complete from the start: nothing runs the watcher here."""
    create = Window.__init__

    def create_complete(self: Window, folder: Path, **options: Any) -> None:
        create(self, folder, **options)
        self.index.refresh()

    monkeypatch.setattr(Window, "__init__", create_complete)


@pytest.fixture
def app(two_runs: Path, complete_list: None) -> Starlette:  # noqa: ARG001 - a fixture
    """Return an application that shows `two_runs`, without a token."""
    return create_app(two_runs, token=None)
