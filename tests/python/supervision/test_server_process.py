"""The process of one simulation server."""

import json
import subprocess
import sys

import pytest

from tests.conftest import free_port
from tests.python.supervision import poison


@pytest.mark.parametrize("simulation", ["minisim", f"{poison.__file__}:Sound"])
def test_it_ends_quietly_when_its_parent_is_gone_before_it_serves(simulation: str) -> None:
    settings = {"simulation": simulation, "broker": f"mqtt://127.0.0.1:{free_port()}", "id": 1, "wait": 30.0}
    command = [sys.executable, "-m", "swarmwright.evaluation.server_process", "1", json.dumps(settings)]
    for _ in range(5):
        result = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=30, check=False
        )
        assert (result.returncode, result.stderr) == (0, "")
