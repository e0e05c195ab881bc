"""An exported package for all conversations."""

import pytest

from tests.python.simulations.ros.network import SETUP, Package


@pytest.fixture(scope="session")
def package(tmp_path_factory: pytest.TempPathFactory) -> Package:
    """An exported package; where ROS 2 is, it is built with it."""
    made = Package(tmp_path_factory.mktemp("workspace"))
    if SETUP:
        made.build()
    return made
