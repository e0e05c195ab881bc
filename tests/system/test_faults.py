"""Servers that are slow, broken or deadly, and many at once: the record is as if nothing had been."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run
from tests.conftest import ROOT, environment
from tests.system import many_servers
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.processes import Program
from tests.system.runs import attempts, record, warnings

LAB = ROOT / "tests" / "system" / "lab.py"
EXPERIMENT = """\
simulation: lab
requirements: {dimensions: 1}
sensors: 2
actuators: 1
controller: {kind: layered, hidden: [3]}
method: {kind: nnga, population: 16, generations: 3}
ranking: {episodes: 2}
seed: 5
timeouts: {discovery: 10, step: 10}
"""
MANY = """\
simulation: minisim
mode: batched
parameters: {{maxSteps: 40, numDefenders: 0, speedAgents: 0.01}}
method: {{kind: random_search, population: 1500, generations: {generations}}}
seed: 2
"""
MODES = ["stepwise", "offloaded"]
ServeLab = Callable[..., Program]


@pytest.fixture
def serve_lab(embedded: BrokerProcess, launch: Launch) -> ServeLab:
    """Starts a server of the lab: `serve_lab(id, fault)`."""

    def start(server: int, fault: str = "none") -> Program:
        arguments = ["serve", f"{LAB}:Lab", "--broker", embedded.url, "--id", server, "--count", 1, "--json"]
        return launch(*arguments, env={"FAULT": fault})

    return start


@pytest.fixture
def expected(launch: Launch, experiment: Experiment) -> dict[str, Any]:
    """The record without servers and accidents."""
    path = experiment(EXPERIMENT.replace("simulation: lab", f"simulation: {LAB}:Lab"), "local.yaml")
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    assert local.wait() == 0, local.stderr
    return record(path.parent / "local")


def evolve(launch: Launch, path: Path, broker: BrokerProcess, mode: str) -> list[dict[str, Any]]:
    """Run to the end; what was attempted."""
    path.write_text(f"{path.read_text()}mode: {mode}\n")
    run = launch("optimize", path, "--broker", broker.url, "--out", "result")
    assert run.wait(50) == 0, run.stderr
    return attempts(path.parent / "result")


@pytest.mark.parametrize("mode", MODES)
def test_a_server_ten_times_slower_is_no_loss(
    embedded: BrokerProcess,
    serve_lab: ServeLab,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
    mode: str,
) -> None:
    for server, fault in ((1, "none"), (2, "slow")):
        serve_lab(server, fault).until_event("ready")
    path = experiment(EXPERIMENT)
    found = evolve(launch, path, embedded, mode)
    assert record(path.parent / "result") == expected
    errors = [entry["error"] for entry in found if entry["error"]]
    assert all("was faster" in error or "given up" in error for error in errors), errors
    done = dict.fromkeys((1, 2), 0)
    for entry in found:
        done[entry["server"]] += entry["candidates"] * entry["episodes"]
    assert done[1] > 2 * done[2] > 0, done


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("fault", "words"),
    [("nan", "sensor 0 of agent 0 is nan"), ("short", "observations of the shape (1, 1) returned")],
)
def test_a_server_that_answers_rubbish_costs_nothing(
    embedded: BrokerProcess,
    serve_lab: ServeLab,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
    mode: str,
    fault: str,
    words: str,
) -> None:
    for server, kind in ((1, "none"), (2, fault)):
        serve_lab(server, kind).until_event("ready")
    path = experiment(EXPERIMENT)
    found = evolve(launch, path, embedded, mode)
    assert record(path.parent / "result") == expected
    failed = [entry for entry in found if entry["error"]]
    assert failed
    assert all(entry["server"] == 2 and words in entry["error"] for entry in failed)
    told = [text for text in warnings(path.parent / "result") if words in text]
    assert told[0].startswith("an episode failed on server 2: ")
    assert all(text.startswith("server 2 is broken: ") for text in told[1:])
    assert len(told) <= 2


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("fault", ["constant", "off"])
def test_a_server_that_finds_something_else_is_found_out(
    embedded: BrokerProcess,
    serve_lab: ServeLab,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
    mode: str,
    fault: str,
) -> None:
    """Always the same fitness, or one that is 1 % off: no error, but not what two others find."""
    for server, kind in ((1, "none"), (2, fault), (3, "none")):
        serve_lab(server, kind).until_event("ready")
    # Half of its dozen results in the first generation are looked at: one at least.
    path = experiment(f"{EXPERIMENT}mode: {mode}\nfaults: {{audit: 0.5}}\n")
    run = launch("optimize", path, "--broker", embedded.url, "--out", "result")
    assert run.wait(50) == 0, run.stderr
    folder = path.parent / "result"
    assert record(folder) == expected
    told = [text for text in warnings(folder) if "gives wrong results" in text]
    assert len(told) == 1, warnings(folder)
    assert told[0].startswith("server 2 gives wrong results and is no longer used: candidate ")
    assert " are repeated" in told[0]
    assert "had already been used" not in told[0]
    incidents = next(line for line in run.lines if line.startswith("Incidents: "))
    assert "disagreements: " in incidents
    generations: dict[int, set[int]] = {1: set(), 2: set(), 3: set()}
    for attempt in Run.open(folder).attempts():
        generations[attempt.server].add(attempt.generation)
    assert generations == {1: {0, 1, 2}, 2: {0}, 3: {0, 1, 2}}


@pytest.mark.usefixtures("expected")
@pytest.mark.parametrize("mode", MODES)
def test_a_candidate_that_kills_servers_is_reported_and_the_run_goes_on(
    embedded: BrokerProcess,
    serve_lab: ServeLab,
    launch: Launch,
    experiment: Experiment,
    mode: str,
) -> None:
    local = Run.open(experiment().parent / "local")
    last = local.record.generation == local.record.generation.max()
    # Of the last generation, so that nothing is bred from what then has no fitness.
    number = int(last.nonzero()[0][-1])
    deadly = float(local.record.episodes[number, 0])
    servers = [serve_lab(server, f"poison={deadly!r}") for server in range(1, 6)]
    for program in servers:
        program.until_event("ready")
    path = experiment(EXPERIMENT)
    found = evolve(launch, path, embedded, mode)
    result = Run.open(path.parent / "result").record
    same = result.episodes.view("u8") == local.record.episodes.view("u8")
    lost = {(int(row), int(column)) for row, column in zip(*(~same).nonzero(), strict=True)}
    assert (number, 0) in lost
    assert all(local.record.episodes[place] == deadly for place in lost)
    assert (result.genomes == local.record.genomes).all()
    killed = [entry for entry in found if entry["error"] and "was lost" in entry["error"]]
    assert 2 <= len({entry["server"] for entry in killed}) <= 4, "one is left at least"
    candidate = int(result.candidate[number])
    assert any(entry["candidate"] <= candidate < entry["candidate"] + entry["candidates"] for entry in killed)


def _join(broker: BrokerProcess, processes: int, each: int) -> Iterator[subprocess.Popen[str]]:
    for index in range(processes):
        command = [
            sys.executable,
            "-P",
            many_servers.__file__,
            broker.url,
            str(10 + index * each),
            str(each),
        ]
        yield subprocess.Popen(
            command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(), cwd=ROOT
        )


def join_during_a_run(
    broker: BrokerProcess, launch: Launch, experiment: Experiment, processes: int, each: int
) -> None:
    """One server has a run for itself; then all others come at once, and get their share."""
    path = experiment(MANY.format(generations=1_000_000))
    running = list(_join(broker, processes, each))
    try:
        first = launch("serve", "minisim", "--broker", broker.url, "--id", 1, "--count", 1, "--json")
        first.until_event("ready")
        run = launch("optimize", path, "--broker", broker.url, "--out", "result", "--json")
        run.until(lambda program: len(program.lines) >= 1, "a generation")
        for process in running:
            assert process.stdin is not None
            process.stdin.write("\n")
            process.stdin.flush()
        run.until(lambda _: len(_used(path)) == 1 + processes * each, "work for all of them", 300)
        run.signal(signal.SIGINT)
        assert run.wait() == 130, run.stderr
    finally:
        for process in running:
            process.kill()
            process.communicate(timeout=10)
    generations = json.loads(run.lines[-1])["generations"]
    local = launch(
        "optimize", experiment(MANY.format(generations=generations)), "--servers", "local", "--out", "local"
    )
    assert local.wait() == 0, local.stderr
    assert record(path.parent / "result") == record(path.parent / "local")
    errors = [entry["error"] for entry in attempts(path.parent / "result") if entry["server"] != 1]
    assert all(error is None or error.endswith("was faster") for error in errors), set(errors)


@pytest.mark.timeout(300)
def test_many_servers_join_at_once(embedded: BrokerProcess, launch: Launch, experiment: Experiment) -> None:
    """64 during a run, which is given to all of them."""
    join_during_a_run(embedded, launch, experiment, processes=2, each=32)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_thousand_servers_join_at_once(
    broker: BrokerProcess, launch: Launch, experiment: Experiment
) -> None:
    """On either broker."""
    join_during_a_run(broker, launch, experiment, processes=8, each=125)


def _used(path: Path) -> set[int]:
    """Servers that have done something."""
    time.sleep(0.5)
    return {entry["server"] for entry in attempts(path.parent / "result") if entry["error"] is None}


def test_the_broker_is_away_for_five_seconds_and_keeps_what_it_had(
    tmp_path: Path, launch: Launch, experiment: Experiment, cleanup: Any
) -> None:
    """Mosquitto with persistence: what it brings back from before harms nobody."""
    broker = BrokerProcess("mosquitto", tmp_path / "broker", persistent=True)
    cleanup.callback(broker.stop)
    broker.start()
    path = experiment(
        "simulation: minisim\nmode: stepwise\nparameters: {maxSteps: 800, speedAgents: 0.005, "
        "numDefenders: 0}\n"
        "method: {kind: nnga, population: 8, generations: 3}\nseed: 9\n"
    )
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    assert local.wait() == 0, local.stderr
    servers = launch("serve", "minisim", "--broker", broker.url, "--id", 1, "--count", 2, "--json")
    servers.until_event("ready", 2)
    run = launch("optimize", path, "--broker", broker.url, "--out", "result", "--json")
    run.until(lambda program: len(program.lines) >= 1, "a generation")
    broker.kill()
    time.sleep(5)
    broker.start()
    assert run.wait(50) == 0, run.stderr
    assert record(path.parent / "result") == record(path.parent / "local")
    told = warnings(path.parent / "result")
    for words in ("lost the broker", "the broker is back"):
        assert sum(words in text for text in told) == 1, told
