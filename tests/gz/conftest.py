"""Tests in a real Gazebo Fortress, which `make test-gz` names; skipped where it is missing."""

import os
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.gazebo.conftest import broker, cleanup, launch
from tests.gazebo.machine import FORTRESS, GazeboServer, Serve

__all__ = ["broker", "cleanup", "launch", "serve"]

WHY_NOT = os.environ.get("SWARMWRIGHT_NO_GZ") or "SWARMWRIGHT_GZ is not set: run `make test-gz`"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip all tests of this folder, visibly, where there is no Gazebo Fortress."""
    if os.environ.get("SWARMWRIGHT_GZ"):
        return
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.skip(reason=f"no Gazebo Fortress: {WHY_NOT}"))


@pytest.fixture
def serve(tmp_path: Path, cleanup: ExitStack) -> Serve:
    def start(url: str, *options: str | int, **more: Any) -> GazeboServer:
        server = GazeboServer(url, *options, cwd=tmp_path, gazebo=FORTRESS, **more)
        cleanup.callback(server.stop)
        return server

    return start
