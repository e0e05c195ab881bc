"""Tests in a real Gazebo classic 11, which `make test-gazebo` sets up; skipped where it is missing."""

import os
from pathlib import Path

import pytest

WHY_NOT = os.environ.get("SWARMWRIGHT_NO_GAZEBO") or "SWARMWRIGHT_GAZEBO is not set: run `make test-gazebo`"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip all tests of this folder, visibly, where there is no Gazebo."""
    if os.environ.get("SWARMWRIGHT_GAZEBO"):
        return
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.skip(reason=f"no Gazebo: {WHY_NOT}"))
