"""Ctrl-C at moments at which it is inconvenient."""

import contextlib
import os
import random
import shlex
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run
from swarmwright.runs.folders import remove_run
from tests.python.cli.processes import children, gone, handles

pytestmark = pytest.mark.slow

ENDLESS = "simulation: minisim\nmethod: {population: 6, generations: 1000000}\nservers: 1\n"
OWN = """
from swarmwright import Simulation


class Own(Simulation):
    title, sensors, actuators = "own", 1, 1

    def reset(self, parameters, seed):
        self.steps = 0
        return [[0.5]]

    def step(self, actions):
        self.steps += 1
        return [[0.5]]

    def done(self):
        return self.steps > 1

    def fitness(self):
        return self.steps
"""
LARGE = "simulation: minisim\nmethod: {population: 400000, generations: 2}\nservers: local\n"


@pytest.mark.parametrize("goes_on", [False, True])
def test_a_second_one_says_how_to_go_on(start: Any, tmp_path: Path, goes_on: bool) -> None:
    (tmp_path / "endless.yaml").write_text(ENDLESS)
    if goes_on:
        process = start("optimize", "endless.yaml", "--out", "the run")
        assert "generations" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 130
        (tmp_path / "the run" / "best.json").unlink()
    arguments = ("resume", "the run") if goes_on else ("optimize", "endless.yaml", "--out", "the run")
    process = start(*arguments)
    while " of 1000000 generations  best" not in (line := process.stdout.readline()):
        assert line, process.communicate()
    servers = children(process.pid)
    # Servers that do not end hold up the end of the run, as those do that are within a long step.
    for server in servers:
        os.kill(server, signal.SIGSTOP)
    try:
        process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + 20
        while not (tmp_path / "the run" / "best.json").exists():  # written last, before servers end
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate(timeout=20)
    finally:
        for server in servers:
            with contextlib.suppress(ProcessLookupError):  # the system ends those that lost their parent
                os.kill(server, signal.SIGCONT)
    assert process.returncode == 130
    assert "resume 'the run'" in complaint
    assert "results so far are kept" in complaint
    assert "Traceback" not in complaint
    assert gone(servers)
    assert Run.open(tmp_path / "the run").generations > 0


@pytest.mark.timeout(180)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "watching", [("--log", "log.jsonl", "--log-level", "debug"), ("--metrics", "0"), ("--log", "-")]
)
def test_it_ends_in_order_at_any_moment_whoever_is_told_of_its_course(
    start: Any, tmp_path: Path, number: signal.Signals, watching: tuple[str, ...]
) -> None:
    (tmp_path / "endless.yaml").write_text(ENDLESS)
    moments = random.Random(3)
    for trial in range(4):
        folder = tmp_path / f"run {trial}"
        process = start("optimize", "endless.yaml", "--out", folder.name, *watching)
        while " of 1000000 generations  best" not in (line := process.stdout.readline()):
            assert line, process.communicate()
        time.sleep(moments.uniform(0, 0.2))
        process.send_signal(number)
        said, complaint = process.communicate(timeout=30)
        assert process.returncode == 130
        assert "Interrupted; the results so far are kept. Continue with:" in said
        assert [line for line in complaint.splitlines() if not line.startswith("{")] == []
        assert Run.open(folder).state == "interrupted"


@pytest.mark.timeout(120)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_says_so_also_while_it_starts(start: Any, tmp_path: Path, number: signal.Signals) -> None:
    (tmp_path / "endless.yaml").write_text(ENDLESS)
    moments = random.Random(4)
    for _ in range(8):
        process = start("optimize", "endless.yaml", "--out", "run", "--metrics", "0")
        while not handles(process.pid, signal.SIGTERM):  # before that, Python itself is being loaded
            assert process.poll() is None, process.communicate()
            time.sleep(0.005)
        time.sleep(moments.uniform(0, 0.65))
        process.send_signal(number)
        said, complaint = process.communicate(timeout=30)
        assert process.returncode == 130, complaint
        assert "Traceback" not in complaint
        assert "nterrupted" in said + complaint
        if (tmp_path / "run").exists():
            remove_run(tmp_path / "run")


def test_a_large_population_is_announced_and_may_be_interrupted(start: Any, tmp_path: Path) -> None:
    (tmp_path / "large.yaml").write_text(LARGE)
    process = start("optimize", "large.yaml", "--out", "large")
    assert "400,000 candidates with 49 genes each need " in (first := process.stderr.readline())
    assert first.rstrip().endswith(("and some time", "if the run is killed"))
    assert process.stderr.readline() == "swarmwright: generation 0: creating candidates\n"
    process.send_signal(signal.SIGINT)
    _, complaint = process.communicate(timeout=20)
    assert process.returncode == 130
    assert complaint == "swarmwright: interrupted\n"
    assert not (tmp_path / "large").exists()


def test_a_budget_below_what_there_is_is_refused_before_anything_is_said(
    program: Any, tmp_path: Path
) -> None:
    (tmp_path / "short.yaml").write_text(
        ENDLESS.replace("1000000", "4").replace("servers: 1", "servers: local")
    )
    assert program("optimize", "short.yaml", "--out", "run").returncode == 0
    result = program("resume", "run", "--generations", "2")
    assert result.returncode == 2
    assert result.stdout == ""
    assert "generations: 2 is less than the experiment's 4" in result.stderr


@pytest.mark.journey
def test_the_command_that_is_printed_goes_on_with_the_same_servers(
    start: Any, embedded_broker: str, tmp_path: Path
) -> None:
    """Broker and prefix that were given on the command line are not in the run's experiment.yaml."""
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "own.yaml").write_text(
        "simulation: own\nsensors: 1\nactuators: 1\ncontroller: {kind: layered, hidden: []}\n"
        "method: {population: 4, generations: 100000}\n"
    )
    where = ("--broker", embedded_broker, "--prefix", "mine")
    start("serve", "own.py:Own", *where)
    arguments: tuple[str, ...] = ("optimize", "own.yaml", "--out", "run", *where)
    for _ in range(2):
        process = start(*arguments)
        while " of 100000 generations  best" not in (line := process.stdout.readline()):
            assert line, process.communicate()
        process.send_signal(signal.SIGINT)
        said, complaint = process.communicate(timeout=30)
        assert process.returncode == 130, complaint
        command = said.split("Continue with:\n")[1].splitlines()[0]
        arguments = tuple(shlex.split(command[command.index("resume") :]))
    assert Run.open(tmp_path / "run").generations >= 2
