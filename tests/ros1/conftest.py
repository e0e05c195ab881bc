"""Tests on a real ROS 1 (Debian's), which `make test-ros1` installs and asks for; no other run needs it."""

import os
from collections.abc import Iterator

import pytest

from tests.ros1.machine import Driver, Master, Workspace

if not os.environ.get("SWARMWRIGHT_ROS1"):
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(scope="session")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """A catkin workspace with the package emergency_exit and the exported package of a controller."""
    return Workspace(tmp_path_factory.mktemp("workspace"))


@pytest.fixture(scope="session")
def master(workspace: Workspace) -> Iterator[Master]:
    """A running roscore."""
    with Master(workspace) as running:
        yield running


@pytest.fixture(scope="module")
def driver(master: Master) -> Iterator[Driver]:
    """A node that publishes and records."""
    with Driver(master) as running:
        yield running
