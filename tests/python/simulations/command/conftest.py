"""What the tests of commands share."""

from pathlib import Path

import pytest

from tests.python.simulations.command.processes import Traced


@pytest.fixture
def traced(tmp_path: Path) -> Traced:
    return Traced(tmp_path)
