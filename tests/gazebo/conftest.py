"""Tests in a real Gazebo classic 11, which `make test-gazebo` sets up; skipped where it is missing."""

import os
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.gazebo.machine import GazeboServer, Launch, Serve
from tests.system.brokers import BrokerProcess
from tests.system.processes import Program

WHY_NOT = os.environ.get("SWARMWRIGHT_NO_GAZEBO") or "SWARMWRIGHT_GAZEBO is not set: run `make test-gazebo`"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip all tests of this folder, visibly, where there is no Gazebo."""
    if os.environ.get("SWARMWRIGHT_GAZEBO"):
        return
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.skip(reason=f"no Gazebo: {WHY_NOT}"))


@pytest.fixture
def cleanup() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def broker(tmp_path: Path, cleanup: ExitStack) -> BrokerProcess:
    process = BrokerProcess("embedded", tmp_path / "broker")
    cleanup.callback(process.stop)
    return process.start()


@pytest.fixture
def serve(tmp_path: Path, cleanup: ExitStack) -> Serve:
    def start(url: str, *options: str | int, **more: Any) -> GazeboServer:
        server = GazeboServer(url, *options, cwd=tmp_path, **more)
        cleanup.callback(server.stop)
        return server

    return start


@pytest.fixture
def launch(tmp_path: Path, cleanup: ExitStack) -> Launch:
    def start(*arguments: Any) -> Program:
        program = Program(*arguments, cwd=tmp_path)
        cleanup.callback(program.stop)
        return program

    return start
