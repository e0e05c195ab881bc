"""Servers, broker and tool are killed, stopped and started again in one run: the record is as if never."""

import json
import os
import random
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.processes import Program
from tests.system.runs import attempts, record, warnings

EXPERIMENT = """\
simulation: minisim
mode: {mode}
parameters: {{maxSteps: {steps}, speedAgents: {speed}, numDefenders: 2, speedDefenders: 0}}
method: {{kind: nnga, population: 10, generations: {generations}}}
ranking: {{episodes: 2}}
seed: 4
timeouts: {{discovery: 20, step: 1.5}}
"""
SERVERS = (1, 2, 3)
SECONDS = float(os.environ.get("SWARMWRIGHT_MISHAPS_SECONDS", "120"))
"""How long the long test disturbs; 3300 was run once."""


def described(mode: str, steps: int, generations: int) -> str:
    """The experiment; agents do not get far, so that no episode ends early."""
    return EXPERIMENT.format(mode=mode, steps=steps, generations=generations, speed=0.6 / steps)


class Stage:
    """A broker, servers and a tool, each of which can be harmed and helped up again."""

    def __init__(self, broker: BrokerProcess, launch: Launch, path: Path, incidents: list[str]) -> None:
        self.broker, self.launch, self.path = broker, launch, path
        self.incidents = incidents
        """What happened, for whoever reads a failure."""
        self.servers = {server: self._serve(server) for server in SERVERS}
        for program in self.servers.values():
            program.until_event("ready")
        self.seen = 0
        self.tool = launch("optimize", path, "--broker", broker.url, "--out", "result", "--json")

    def _serve(self, server: int) -> Program:
        arguments = ["serve", "minisim", "--broker", self.broker.url, "--id", server, "--count", 1, "--json"]
        program: Program = self.launch(*arguments, "--step-timeout", "3", "--wait", "60")
        return program

    def _pid(self, server: int) -> int:
        return int(self.servers[server].until_event("ready")["pid"])

    def kill_server(self, server: int) -> None:
        """Another takes its place; its supervisor, which would start it again, is killed first."""
        self.incidents.append(f"server {server} killed")
        for pid in (self.servers[server].pid, self._pid(server)):
            with suppress(ProcessLookupError):  # it has ended with its supervisor
                os.kill(pid, signal.SIGKILL)
        self.servers[server].process.wait(10)
        self.servers[server] = self._serve(server)

    def stop_server(self, server: int) -> None:
        """Longer than the tool waits for a step."""
        self.incidents.append(f"server {server} stopped")
        pid = self._pid(server)
        os.kill(pid, signal.SIGSTOP)
        time.sleep(2)
        os.kill(pid, signal.SIGCONT)

    def kill_broker(self, seconds: float = 1.0) -> None:
        self.incidents.append("broker killed")
        self.broker.kill()
        time.sleep(seconds)
        self.broker.start()

    def kill_tool(self) -> None:
        """Resumed, it goes on."""
        self.incidents.append("tool killed")
        self.tool.signal(signal.SIGKILL)
        self.tool.process.wait(10)
        self.tool = self.launch("resume", "result", "--broker", self.broker.url, "--json", "--wait", "60")
        self.seen = 0
        self.generations()

    def generations(self, more: int = 1) -> bool:
        """Wait for further generations; whether the tool is still at work."""
        self.seen = max(self.seen, len(self.tool.events())) + more

        def reached(tool: Program) -> bool:
            return len(tool.events()) >= self.seen or tool.process.poll() is not None

        self.tool.until(reached, f"generation; {self.incidents}", 60)
        return self.tool.process.poll() is None


@pytest.fixture
def stage(
    broker: BrokerProcess, launch: Launch, experiment: Experiment
) -> Callable[..., tuple[Stage, list[str]]]:
    """Sets the stage: `stage(mode, steps, generations)`."""

    def make(mode: str, steps: int, generations: int) -> tuple[Stage, list[str]]:
        path = experiment(described(mode, steps, generations))
        incidents: list[str] = []
        return Stage(broker, launch, path, incidents), incidents

    return make


def check(folder: Path, incidents: list[str], launch: Launch, quiet: Path) -> None:
    """The record is that of an undisturbed run, and the report has each incident."""
    local = launch("optimize", quiet, "--servers", "local", "--out", "local")
    assert local.wait(60 + SECONDS) == 0, local.stderr
    assert record(folder) == record(quiet.parent / "local"), incidents
    failed = [entry for entry in attempts(folder) if entry["error"]]
    told, errors = warnings(folder), [entry["error"] for entry in failed]
    assert sum("lost the broker" in text for text in told) >= ("broker killed" in incidents), told
    assert len(Run.open(folder).sessions) == 1 + incidents.count("tool killed")
    for server in SERVERS:
        for what, words in (("killed", "was lost"), ("stopped", "has not")):
            if f"server {server} {what}" in incidents:
                lines = [text for text in (*told, *errors) if f"server {server} " in text]
                # Another server may have had a copy of its work, and have been faster.
                lines += [entry["error"] for entry in failed if entry["server"] == server]
                accounts = (words, "was faster")
                assert any(account in text for text in lines for account in accounts), (server, what, lines)


@pytest.mark.parametrize(("mode", "steps"), [("stepwise", 150), ("batched", 1000)])
def test_one_after_the_other(stage: Any, launch: Launch, tmp_path: Path, mode: str, steps: int) -> None:
    play, incidents = stage(mode, steps, 20)
    for incident in (
        lambda: play.kill_server(2),
        lambda: play.stop_server(3),
        play.kill_broker,
        play.kill_tool,
    ):
        assert play.generations(), (play.tool.stderr, incidents)
        incident()
    assert play.tool.wait(50) == 0, play.tool.stderr
    check(tmp_path / "result", incidents, launch, play.path)


@pytest.mark.long
@pytest.mark.timeout(300 + 2 * SECONDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_for_minutes(stage: Any, launch: Launch, experiment: Experiment, tmp_path: Path, seed: int) -> None:
    """In any order, also before the one has been got over by the time of the next."""
    play, incidents = stage("stepwise", 150, 1_000_000)
    draw = random.Random(seed)
    assert play.generations(), play.tool.stderr
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        assert play.generations(draw.randint(0, 2)), (play.tool.stderr, incidents)
        match draw.randrange(6):
            case 0 | 1:
                play.kill_server(draw.choice(SERVERS))
            case 2 | 3:
                play.stop_server(draw.choice(SERVERS))
            case 4:
                play.kill_broker(draw.uniform(0.1, 5))
            case _:
                play.kill_tool()
    assert play.generations(), incidents
    play.tool.signal(signal.SIGINT)
    assert play.tool.wait(30) == 130, play.tool.stderr
    last = json.loads(play.tool.lines[-1])
    quiet = experiment(described("stepwise", 150, last["generations"]), "quiet.yaml")
    check(tmp_path / "result", incidents, launch, quiet)
