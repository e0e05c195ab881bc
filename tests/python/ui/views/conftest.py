"""A window on any folder of runs."""

from collections.abc import Callable
from pathlib import Path

import pytest
from starlette.applications import Starlette

from swarmwright.ui.app import create_app


@pytest.fixture
def open_app(complete_list: None) -> Callable[[Path], Starlette]:  # noqa: ARG001 - a fixture
    """Return what opens a window on a folder of runs."""
    return lambda folder: create_app(folder, token=None)
