"""The process of one simulation server."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from swarmwright import Experiment, RunError, simulate
from swarmwright.servers.supervision import server_exit
from swarmwright.servers.supervision.server_exit import ServerExit, split_output
from tests.conftest import free_port
from tests.python.servers.supervision import poison


@pytest.mark.slow
@pytest.mark.parametrize("simulation", ["minisim", f"{poison.__file__}:Sound"])
def test_it_ends_quietly_when_its_parent_is_gone_before_it_serves(simulation: str) -> None:
    settings = {"simulation": simulation, "broker": f"mqtt://127.0.0.1:{free_port()}", "id": 1, "wait": 30.0}
    command = [
        sys.executable,
        "-m",
        "swarmwright.servers.evaluation.server_process",
        "1",
        json.dumps(settings),
    ]
    for _ in range(5):
        result = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=30, check=False
        )
        assert (result.returncode, result.stderr) == (0, "")


READING = """
import subprocess
import numpy as np
from swarmwright import Simulation


class Reading(Simulation):
    sensors = actuators = 1

    def reset(self, parameters, seed):
        self.read = eval(parameters["code"])
        return np.zeros((1, 1))

    def step(self, actions):
        return np.zeros((1, 1))

    def done(self):
        return True

    def fitness(self):
        return float(len(self.read))
"""


@pytest.mark.slow
def test_standard_input_is_empty_for_simulations(tmp_path: Path) -> None:
    """It does not wait for the end of the process that has started the server."""
    (tmp_path / "reading.py").write_text(READING)

    def read(code: str) -> float:
        values = {"simulation": f"{tmp_path}/reading.py:Reading", "parameters": {"code": code}}
        return simulate(Experiment.from_mapping(values), servers=1)

    assert read("__import__('sys').stdin.read()") == 0
    assert read("subprocess.run('cat', stdout=-1).stdout") == 0
    with pytest.raises(RunError, match=r"Reading\.reset: EOFError: EOF when reading a line"):
        read("input('Go on? ')")


HUNG = (
    "Go on? Thread 0x00007f12 (most recent call first):",
    '  File "{user}", line 9 in reset',
    '  File "{ours}/simulations/host.py", line 100 in reset',
    "",
    "Current thread 0x00007f34 (most recent call first):",
    '  File "{ours}/evaluation/server_process.py", line 169 in <lambda>',
)


def exit_of(lines: list[str]) -> ServerExit:
    ours = Path(server_exit.__file__).parents[2]
    wrote, stack = split_output([line.format(user="/home/me/reading.py", ours=ours) for line in lines])
    return ServerExit(1, 2, -9, "made no step for 2 s", wrote, stack)


def test_the_place_is_the_simulation_s_or_none() -> None:
    ended = exit_of([line for line in HUNG if line])
    assert ended.description == "made no step for 2 s in reset (/home/me/reading.py:9) and was ended"
    assert ended.lines == ("Go on? ",)
    # A line of Swarmwright, which waits for something unknown, explains nothing.
    assert exit_of(["writing", *HUNG[4:]]).description == "made no step for 2 s and was ended"


def test_the_place_is_no_line_of_a_library() -> None:
    encoder = f'  File "{json.encoder.__file__}", line 430 in _iterencode_list'
    current = "Current thread 0x00007f34 (most recent call first):"
    by_user = exit_of([current, encoder, encoder, '  File "{user}", line 9 in step'])
    assert by_user.description == "made no step for 2 s in step (/home/me/reading.py:9) and was ended"
    assert exit_of([current, encoder]).description == "made no step for 2 s and was ended"
    # Of a deep recursion faulthandler writes the innermost hundred calls, without the line that began it.
    deep = exit_of([current, *[encoder] * 100, "  ..."])
    assert (
        " in a recursion of more than 100 calls, started by the simulation's code, in _iterencode_list ("
        in deep.description
    )
