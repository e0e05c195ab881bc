"""Missions of the arena in Gazebo: servers side by side, one of which dies; mistakes; conformance."""

import os
import shlex
import signal
import socket
import subprocess
from contextlib import closing
from pathlib import Path

import pytest

from swarmwright import Controller, Experiment, Run, simulate
from swarmwright.conformance import check_server
from tests.gazebo.machine import EXPERIMENT, YARD, Launch, Serve, command, optimize
from tests.system.brokers import BrokerProcess
from tests.system.runs import attempts, record

pytestmark = pytest.mark.timeout(200)


@pytest.mark.parametrize("option", ["wheels", "body", str(YARD)], ids=["wheels", "body", "yard"])
def test_motion_walls_rays_objects_repetition_and_memory(option: str) -> None:
    done = subprocess.run(
        [*command("test_physics"), option], capture_output=True, text=True, timeout=180, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("drive", ["wheels", "body"])
def test_robots_that_are_told_to_go_straight_do(drive: str, broker: BrokerProcess, serve: Serve) -> None:
    """With the noise of their drives they turn as much as in the arena, and so come as far apart."""
    serve(broker.url, "--drive", drive)
    mission = {
        "walls": {"rectangle": [60, 60]},
        "start": {"disc": {"radius": 2}},
        "fitness": "distance_to_center",
    }
    parameters = {"mission": mission, "robots": 12, "duration": 25, "seed": 7}
    here = Experiment.from_mapping(
        {"simulation": "arena", "parameters": parameters, "controller": {"kind": "evostick"}}
    )
    weights = [0.0] * 48 + [5.0, 5.0]  # the last two are those of the biases
    straight = Controller(
        {"kind": "evostick", "version": 1, "sensors": 24, "actuators": 2, "weights": weights}
    )
    there = here.replace(simulation="arena-gazebo")
    expected = simulate(here, straight, servers="in-process")
    assert expected > 2.5, "metres: most of 25 s at 0.12 m/s"
    assert simulate(there, straight, broker=broker.url) == pytest.approx(expected, rel=0.03)


def test_one_server_two_of_which_one_is_killed_and_all_modes_have_one_record(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path
) -> None:
    first = serve(broker.url, server=1)
    for mode in ("offloaded", "stepwise", "batched"):
        program = optimize(launch, broker.url, tmp_path, mode, f"mode: {mode}\n")
        assert program.wait(100) == 0, program.stderr
    expected = record(tmp_path / "offloaded")
    assert record(tmp_path / "stepwise") == record(tmp_path / "batched") == expected

    second = serve(broker.url, server=2)
    program = optimize(launch, broker.url, tmp_path, "two", "mode: stepwise\n")
    second.until(lambda one: "busy" in one.stderr, "second server at work")
    second.signal(signal.SIGKILL)
    assert second.process.wait(10) == -signal.SIGKILL
    assert program.wait(100) == 0, program.stderr
    assert record(tmp_path / "two") == expected
    assert any(attempt["server"] == 1 for attempt in attempts(tmp_path / "two"))
    assert first.process.poll() is None


def test_what_was_evolved_in_the_arena_is_transferred(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path
) -> None:
    serve(broker.url)
    path = tmp_path / "here.yaml"
    path.write_text(EXPERIMENT.replace("arena-gazebo", "arena"))
    program = launch("optimize", path, "--servers", "local", "--out", "here")
    assert program.wait() == 0, program.stderr
    program = launch(
        "transfer", "here", "--to", "arena-gazebo", "--seeds", "3", "--csv", "table.csv",
        "--broker", broker.url,
    )  # fmt: skip
    assert program.wait(100) == 0, program.stderr
    assert (tmp_path / "table.csv").read_text().count("arena-gazebo") == 10 * 3


def test_objects_are_pushed(broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path) -> None:
    serve(broker.url)
    change = "parameters: {mission: collective_transport, robots: 6, duration: 2}\n"
    path = tmp_path / "push.yaml"
    path.write_text(EXPERIMENT.replace(EXPERIMENT.splitlines()[1] + "\n", change))
    program = launch("optimize", path, "--broker", broker.url, "--out", "push")
    assert program.wait(150) == 0, program.stderr
    assert len(Run.open(tmp_path / "push").record.fitness) == 3 * 8


def test_the_conformance_kit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    server = shlex.join(command("swarmwright-gazebo"))
    report = check_server(
        command=f"{server} --broker {{broker}} --id {{id}} --step-timeout 1",
        parameters={"mission": "aac", "robot": "e-puck-rm1.2", "robots": 3, "duration": 2},
        step_timeout=1,
        rules=["-S6.5,-S6.9,-S6.13,-S11.2,-S12,-S16"],
        sensors=9,
        actuators=2,
    )
    assert report.ok, str(report)
    assert set(report.list_ids("skipped")) == {"S8.1", "S8.2", "S9.7", "S9.14"}


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (["--step", "1"], 2, "--step: 1 found, expected seconds from 0.0001 to 0.1"),
        (["--drive", "tracks"], 2, '--drive: "tracks" found, expected wheels or body'),
        (["--rays=some"], 2, '--rays: "some" found, expected gazebo or engine'),
        (["--master-port", "70000"], 2, "--master-port: 70000 found, expected a port from 0 to 65535"),
        (["--save-world", "missing/world.sdf"], 2, "--save-world: missing/world.sdf cannot be written"),
        (["--robots", "3"], 2, "--robots: unknown"),
        (["--step"], 2, "--step: expected a value after it"),
        ([], 1, "localhost:1"),
    ],
)
def test_wrong_arguments(options: list[str], status: int, message: str, serve: Serve) -> None:
    server = serve("mqtt://localhost:1", *options, wait=False)
    assert server.wait(60) == status
    assert message in server.stderr
    assert len(server.stderr.splitlines()) < 20


def test_a_master_port_that_is_taken(serve: Serve) -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        server = serve("mqtt://localhost:1", "--master-port", port, wait=False)
        assert server.wait(60) == 1
    assert f"--master-port {port}: Address already in use; another Gazebo may use it" in server.stderr


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("robots: 2000", "parameters.robots: 2000 robots do not fit into their start region"),
        ("robots: 0", "robots: 0 found"),
        ("mission: nowhere.yaml", "nowhere.yaml: there is no such file"),
    ],
)
def test_a_mission_that_cannot_be(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path, change: str, message: str
) -> None:
    server = serve(broker.url)
    name, _, _ = change.partition(":")
    old = {"robots": "robots: 4", "mission": "mission: aggregation"}[name]
    path = tmp_path / "wrong.yaml"
    path.write_text(EXPERIMENT.replace(old, change))
    program = launch("optimize", path, "--broker", broker.url, "--out", "wrong")
    assert program.wait(60) != 0
    assert message in program.stderr
    assert server.process.poll() is None


def test_a_crash_in_an_episode_leaves_nothing_running(
    broker: BrokerProcess, serve: Serve, launch: Launch, tmp_path: Path
) -> None:
    server = serve(broker.url, "--master-port", port := free_port())
    program = optimize(launch, broker.url, tmp_path, "crash", "timeouts: {discovery: 3, step: 5}\n")
    server.until(lambda one: "busy" in one.stderr, "server at work")
    server.signal(signal.SIGSEGV)
    assert server.process.wait(10) == -signal.SIGSEGV
    assert program.wait(100) != 0
    assert "no server" in program.stderr, "it was the only one"
    # Its master has ended with it: another server takes the port, and goes when it is asked to.
    again = serve(broker.url, "--master-port", port, server=3)
    again.signal(signal.SIGTERM)
    assert again.wait(10) == 0
    assert not mounted()


def free_port() -> int:
    with closing(socket.create_server(("127.0.0.1", 0))) as probe:
        return int(probe.getsockname()[1])


def mounted() -> list[str]:
    """What is mounted below the Debian 11 with Gazebo."""
    root = os.environ["SWARMWRIGHT_GAZEBO"]
    return [line for line in Path("/proc/mounts").read_text().splitlines() if f" {root}/" in line]
