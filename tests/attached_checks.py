"""What is expected of every simulator with a plug-in of ours, checked on a real one."""

import csv
import re
import signal
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from swarmwright.cli.templates import missions
from tests.attached import Attached, Simulator, build, memory, script
from tests.conftest import Run
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.processes import Program
from tests.system.runs import attempts, evaluations, record

EXPERIMENT = """\
simulation: gather
requirements: {dimensions: 2}
parameters: {duration: 4}
controller: {kind: layered, hidden: [4]}
method: {kind: nnga, population: 12, generations: 3}
fitness: "way - distance_to_center"
seed: 3
"""


def five_hundred(text: str) -> str:
    """The experiment with as many evaluations, each of one episode."""
    method = "method: {kind: random_search, population: 500, generations: 1}"
    return re.sub(r"^method: .*$", method, text, count=1, flags=re.MULTILINE)


def modes_agree(
    simulator: Simulator,
    embedded: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    cleanup: ExitStack,
) -> None:
    """One record in each mode, with one process or several, and each time."""
    folder = experiment(EXPERIMENT).parent
    cleanup.callback(Attached(simulator, embedded.url, 1, cwd=folder).stop)
    records = []
    for mode in ("offloaded", "stepwise", "batched"):
        path = experiment(f"{EXPERIMENT}mode: {mode}\n", f"{mode}.yaml")
        program = launch("optimize", path, "--broker", embedded.url, "--out", mode)
        assert program.wait(120) == 0, program.stderr
        records.append(record(folder / mode))
    cleanup.callback(Attached(simulator, embedded.url, 2, cwd=folder).stop)
    path = experiment(f"{EXPERIMENT}mode: offloaded\n")
    program = launch("optimize", path, "--broker", embedded.url, "--out", "two")
    assert program.wait(120) == 0, program.stderr
    assert {entry["server"] for entry in attempts(folder / "two")} == {1, 2}
    records.append(record(folder / "two"))
    assert all(other == records[0] for other in records[1:])


def loss_changes_nothing(
    simulator: Simulator,
    embedded: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    cleanup: ExitStack,
) -> None:
    """One of two is killed while it evaluates: the record is that of one server."""
    text = EXPERIMENT.replace("duration: 4", "duration: 9").replace("generations: 3", "generations: 8")
    path = experiment(text)
    first = Attached(simulator, embedded.url, 1, cwd=path.parent)
    cleanup.callback(first.stop)
    assert launch("optimize", path, "--broker", embedded.url, "--out", "one").wait(120) == 0
    second = Attached(simulator, embedded.url, 2, cwd=path.parent)
    cleanup.callback(second.stop)
    program = launch("optimize", path, "--broker", embedded.url, "--json", "--out", "killed")
    program.until(lambda it: any('"generation": 1,' in line for line in it.lines), "second generation")
    second.signal(signal.SIGKILL)
    assert program.wait(120) == 0, program.stderr
    assert record(path.parent / "killed") == record(path.parent / "one")


def conforms(simulator: Simulator, program: Run, folder: Path) -> None:
    """The conformance kit finds nothing."""
    server = script(simulator, folder)
    result = program(
        "conformance",
        "server",
        "--exec",
        f"{server} {{broker}} {{id}}",
        "--simulation",
        "gather",
        "--parameters",
        '{"duration": 2}',
        timeout=500,
    )
    assert result.returncode == 0, result.stdout + result.stderr


def memory_is_flat(
    simulator: Simulator,
    embedded: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    cleanup: ExitStack,
) -> None:
    """A thousand episodes in one process."""
    path = experiment(five_hundred(EXPERIMENT.replace("duration: 4", "duration: 0.5")))
    server = Attached(simulator, embedded.url, 1, cwd=path.parent)
    cleanup.callback(server.stop)
    sizes = []
    for name in ("first", "second"):
        program = launch("optimize", path, "--broker", embedded.url, "--out", name)
        assert program.wait(200) == 0, program.stderr
        sizes.append(memory(server.pid))
        assert len(evaluations(path.parent / name)) == 500
    assert sizes[1] - sizes[0] < 1000, sizes
    assert record(path.parent / "first") == record(path.parent / "second")


def without_a_broker_it_ends(simulator: Simulator, folder: Path, port: int) -> None:
    """The reason is on standard error, and nothing runs on."""
    server = Attached(simulator, f"mqtt://127.0.0.1:{port}", 1, cwd=folder, ready=False)
    try:
        assert server.wait(30) != 0
    finally:
        server.stop()
    assert "no broker answers" in server.stderr + "\n".join(server.lines)


def a_bad_file(simulator: Simulator, folder: Path, text: str, *, url: str) -> str:
    """What it says of a file with mistakes, before it ends with a status that is not 0."""
    path = folder / f"bad{simulator.file.suffix}"
    path.write_text(text)
    server = Attached(simulator, url, 1, cwd=folder, file=path, ready=False)
    try:
        assert server.wait(30) != 0
    finally:
        server.stop()
    return server.stderr + "\n".join(server.lines)


SIDES = ("capture_the_flag", "pursuit", "soccer", "territory")
"""Missions of several kinds of robots, so that a number of robots alone is refused."""

MISSION = """\
simulation: arena-{name}
parameters: {{mission: aggregation, robots: 6, duration: 10}}
controller: {{kind: evostick}}
method: {{kind: evostick, population: 8, elites: 2, generations: 3}}
ranking: {{episodes: 2, seeds: new}}
validate: false
seed: 5
"""


class MissionServer(Program):
    """`swarmwright-argos` or `swarmwright-stage`, ready once made."""

    def __init__(self, simulator: Simulator, url: str, server: int, *, cwd: Path) -> None:
        program = build(simulator) / f"swarmwright-{simulator.name.lower()}"
        super().__init__(program, "--broker", url, "--id", server, cwd=cwd, program=())
        try:
            self.until_error("ready")
        except BaseException:
            self.stop()
            raise


def missions_agree(
    simulator: Simulator,
    embedded: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    cleanup: ExitStack,
) -> None:
    """One record in each mode, again after other missions, and with two servers of which one is killed."""
    text = MISSION.format(name=simulator.name.lower())
    folder = experiment(text).parent
    cleanup.callback(MissionServer(simulator, embedded.url, 1, cwd=folder).stop)
    records = []

    def evolve(text: str, name: str) -> None:
        program = launch("optimize", experiment(text), "--broker", embedded.url, "--out", name)
        assert program.wait(120) == 0, program.stderr

    for mode in ("offloaded", "stepwise", "batched"):
        evolve(f"{text}mode: {mode}\n", mode)
        records.append(record(folder / mode))
    evolve(text.replace("robots: 6", "robots: 3").replace("aggregation", "shelter"), "other")
    evolve(text, "again")
    records.append(record(folder / "again"))
    assert all(other == records[0] for other in records[1:])
    longer = text.replace("duration: 10", "duration: 60").replace("generations: 3", "generations: 6")
    evolve(longer, "one")
    second = MissionServer(simulator, embedded.url, 2, cwd=folder)
    cleanup.callback(second.stop)
    program = launch("optimize", experiment(longer), "--broker", embedded.url, "--json", "--out", "killed")
    program.until(lambda it: any('"generation": 1,' in line for line in it.lines), "second generation")
    second.signal(signal.SIGKILL)
    assert program.wait(120) == 0, program.stderr
    assert {entry["server"] for entry in attempts(folder / "killed")} == {1, 2}
    assert record(folder / "killed") == record(folder / "one")


def missions_conform(simulator: Simulator, program: Run) -> None:
    """The conformance kit finds nothing."""
    server = build(simulator) / f"swarmwright-{simulator.name.lower()}"
    result = program(
        "conformance",
        "server",
        "--exec",
        f"{server} --broker {{broker}} --id {{id}} --step-timeout 2",
        "--simulation",
        f"arena-{simulator.name.lower()}",
        "--sensors",
        "24",
        "--actuators",
        "2",
        "--parameters",
        '{"mission": "aggregation", "robots": 3, "duration": 2}',
        "--step-timeout",
        "2",
        timeout=500,
    )
    assert result.returncode == 0, result.stdout + result.stderr


def missions_need_no_more_memory(
    simulator: Simulator,
    embedded: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    cleanup: ExitStack,
) -> None:
    """A thousand episodes in one process."""
    text = MISSION.format(name=simulator.name.lower()).replace("duration: 10", "duration: 1")
    path = experiment(five_hundred(text.replace("episodes: 2", "episodes: 1")))
    server = MissionServer(simulator, embedded.url, 1, cwd=path.parent)
    cleanup.callback(server.stop)
    sizes = []
    for name in ("first", "second"):
        program = launch("optimize", path, "--broker", embedded.url, "--out", name)
        assert program.wait(200) == 0, program.stderr
        sizes.append(memory(server.pid))
        assert len(evaluations(path.parent / name)) == 500
    assert sizes[1] - sizes[0] < 1000, sizes


def every_mission_runs(
    simulator: Simulator,
    embedded: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    cleanup: ExitStack,
    *,
    refused: Mapping[str, str],
) -> None:
    """Each built-in mission, with robots that drive on wheels and in any direction.

    refused: the missions that cannot be, and what the message names.
    """
    text = MISSION.format(name=simulator.name.lower()).replace("duration: 10", "duration: 2")
    folder = experiment(text).parent
    cleanup.callback(MissionServer(simulator, embedded.url, 1, cwd=folder).stop)
    refused = {**dict.fromkeys(SIDES, "kinds of robots"), **refused}
    for mission in missions():
        path = experiment(text.replace("aggregation", mission))
        program = launch("optimize", path, "--broker", embedded.url, "--out", mission)
        status = program.wait(120)
        assert (status != 0) == (mission in refused), program.stderr
        assert refused.get(mission, "") in program.stderr
    for robot in ("foot-bot", "kilobot", "turtlebot3", "point"):
        other = text.replace("{kind: evostick}", "{kind: layered, hidden: []}", 1)
        other = other.replace("{kind: evostick, population: 8, elites: 2", "{kind: nnga, population: 8")
        path = experiment(other.replace("robots: 6", f"robots: 4, robot: {robot}"))
        program = launch("optimize", path, "--broker", embedded.url, "--out", robot)
        assert program.wait(120) == 0, program.stderr
    path = experiment(text.replace("robots: 6", "robots: 20000"))
    program = launch("optimize", path, "--broker", embedded.url, "--out", "too-many")
    assert program.wait(120) != 0
    assert "robots" in program.stderr


def it_agrees_with_the_arena(
    simulator: Simulator,
    embedded: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    cleanup: ExitStack,
    *,
    within: float,
) -> None:
    """The mean fitness of a controller, with the same seeds, is not far from that in the arena."""
    text = MISSION.format(name=simulator.name.lower()).replace("duration: 10", "duration: 60")
    path = experiment(text.replace(f"arena-{simulator.name.lower()}", "arena"))
    assert launch("optimize", path, "--servers", "local", "--out", "here").wait() == 0
    cleanup.callback(MissionServer(simulator, embedded.url, 1, cwd=path.parent).stop)
    table = path.parent / "table.csv"
    to = f"arena-{simulator.name.lower()}"
    program = launch("transfer", "here", "--to", to, "--seeds", 20, "--csv", table, "--broker", embedded.url)
    assert program.wait(200) == 0, program.stderr
    with table.open() as file:
        rows = list(csv.DictReader(file))
    here, there = (
        sum(float(row[column]) for row in rows) / len(rows) for column in ("fitness", "fitness_in_target")
    )
    assert abs(here - there) <= within * abs(here), (here, there)
