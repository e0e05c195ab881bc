"""Emergency Exit on a real roscore: what the agents log is what the engine computes."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from swarmwright import _engine
from tests.python.export.specifications import Specification, machine, network
from tests.ros1.machine import ROOT, Master, Workspace, end

RANDOM: dict[str, Any] = {"steps": 30, "width": 12, "height": 12, "numAgents": 8, "numBlockades": 15}
THRESHOLDS = [[0.0], [0.0], *([[0.5]] * 4), [], [], [], []]
CONTROLLERS: dict[str, Specification] = {
    "layered": network("layered", "tanh", [-1.0, 1.0], sensors=10, hidden=[6, 4]),
    "layered-relu": network("layered", "relu", [-0.3, 2.7], seed=3, sensors=10),
    "fully_meshed": network("fully_meshed", "clamp", [0.0, 1.0], sensors=10),
    "fully_meshed-sigmoid": network("fully_meshed", "sigmoid", [0.0, 1.0], seed=2, sensors=10),
    "mealy_fsm": machine(THRESHOLDS),
}
Episode = tuple[list[list[list[float]]], float, float]


def engine(parameters: dict[str, Any], specification: Specification) -> Episode:
    """Cells of all agents after each step, the sum of the distances, and the fitness, of the engine."""
    episode = _engine.Episode("emergency_exit", parameters, json.dumps(specification))
    cells = [_cells(episode)]
    while not episode.done:
        episode.step()
        cells.append(_cells(episode))
    return cells, episode.metrics(["distance"])[0], episode.fitness


def _cells(episode: _engine.Episode) -> list[list[float]]:
    scene = episode.scene()
    return [
        [body["x"] - 0.5, scene["height"] - body["y"] - 0.5]
        for body in scene["bodies"]
        if body["kind"] == "agent"
    ]


def launch(master: Master, file: Path, folder: Path, agents: int, *more: str) -> str:
    """Run an episode by its launch file; all that was said."""
    process = master.workspace.start(
        "roslaunch", "--wait", "emergency_exit", "emergency_exit.launch", f"parameters:={file}",
        f"agents:={agents}", f"logs:={folder}", *more,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    try:
        return str(process.communicate(timeout=100)[0])
    finally:
        end(process)


def logged(folder: Path, agents: int, steps: int) -> list[list[list[float]]]:
    """Cells of all agents after each step, read from their logs without the package's own reader."""
    logs = []
    for agent in range(agents):
        lines = (folder / f"agent_{agent}.csv").read_text(encoding="ascii").splitlines()[2:]
        rows = [[float(cell) for cell in line.split(",")] for line in lines]
        assert [row[0] for row in rows] == list(range(len(rows)))
        logs.append([row[1:3] for row in rows])
    # Agents that are out stay where they are.
    return [[log[min(step, len(log) - 1)] for log in logs] for step in range(steps + 1)]


def fitness(workspace: Workspace, folder: Path) -> dict[str, float]:
    """What `rosrun emergency_exit fitness` says."""
    said: dict[str, float] = json.loads(workspace.run("rosrun", "emergency_exit", "fitness", str(folder)))
    return said


def write(path: Path, parameters: dict[str, Any]) -> Path:
    """An experiment file with these parameters."""
    path.write_text(json.dumps({"simulation": "emergency_exit", "parameters": parameters}), encoding="utf-8")
    return path


@pytest.mark.timeout(200)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_agents_go_where_the_engines_go(name: str, master: Master, tmp_path: Path) -> None:
    specification = CONTROLLERS[name]
    master.workspace.compile(specification)
    seed = list(CONTROLLERS).index(name)
    cells, distance, expected = engine({**RANDOM, "seed": seed}, specification)
    assert cells[0] != cells[-1], "nobody has moved"
    # The seed of the file is another one.
    said = launch(master, write(tmp_path / "file.json", RANDOM), tmp_path / "logs", 8, f"seed:={seed}")
    assert "the episode is over" in said
    assert logged(tmp_path / "logs", 8, len(cells) - 1) == cells
    result = fitness(master.workspace, tmp_path / "logs")
    assert (result["fitness"], result["frevo_fitness"]) == (-distance, expected)


@pytest.mark.timeout(200)
@pytest.mark.parametrize(
    "parameters",
    [
        pytest.param({"update": "simultaneous", "seed": 2**40 + 5}, id="simultaneous-large-seed"),
        pytest.param({"width": 14, "height": 6, "seed": 3, "numAgents": 10}, id="below-the-last-row"),
    ],
)
def test_other_fields(parameters: dict[str, Any], master: Master, tmp_path: Path) -> None:
    specification = CONTROLLERS["layered"]
    master.workspace.compile(specification)
    whole = {**RANDOM, **parameters}
    cells, distance, expected = engine(whole, specification)
    launch(master, write(tmp_path / "file.json", whole), tmp_path / "logs", whole["numAgents"])
    assert logged(tmp_path / "logs", whole["numAgents"], len(cells) - 1) == cells
    result = fitness(master.workspace, tmp_path / "logs")
    assert (result["fitness"], result["frevo_fitness"]) == (-distance, expected)


@pytest.mark.timeout(200)
def test_all_get_out_before_the_end(master: Master, tmp_path: Path) -> None:
    # Actuators that say: to the right, always; the machine has one state and looks at nothing.
    right = {
        "version": 1, "kind": "mealy_fsm", "sensors": 10, "actuators": 2, "states": 1,
        "thresholds": [[]] * 10, "weights": [0.0, 1.0, 0.0],
    }  # fmt: skip
    master.workspace.compile(right)
    field = {"width": 5, "height": 2, "agents": [[3, 0], [0, 1]], "exits": [[4, 0], [4, 1]], "blockades": []}
    parameters = {"steps": 20, "field": field}
    cells, _, expected = engine(parameters, right)
    launch(master, write(tmp_path / "file.json", parameters), tmp_path / "logs", 2)
    assert logged(tmp_path / "logs", 2, len(cells) - 1) == cells
    result = fitness(master.workspace, tmp_path / "logs")
    assert result == {
        "fitness": 0.0, "frevo_fitness": expected, "agents": 2, "out": 2, "finished": 3, "distance": 0.0,
    }  # fmt: skip
    assert expected == (20 - 3) / 20


@pytest.mark.timeout(200)
def test_mistakes_are_named(master: Master, tmp_path: Path) -> None:
    file = write(tmp_path / "file.json", RANDOM)
    logs = tmp_path / "logs"
    logs.mkdir()
    earlier = logs / "agent_0.csv"
    earlier.write_text("of an earlier episode\n", encoding="ascii")
    said = launch(master, file, logs, 3)
    assert "agents: 3 were launched, but the field has 8: agents:=8" in said
    assert "Traceback" not in said
    assert earlier.read_text(encoding="ascii") == "of an earlier episode\n"
    assert "expected an absolute path: logs:=$PWD/logs" in launch(master, file, logs, 1, "logs:=logs")
    misspelt = write(tmp_path / "misspelt.json", {"step": 3})
    assert "unknown parameter 'step'; known are steps" in launch(master, misspelt, logs, 1)
    assert "is an experiment with 'minisim'" in launch(master, ROOT / "experiments/minisim.yaml", logs, 1)
    assert "cannot be written" in launch(master, file, logs, 8, f"logs:={file}/logs", "patience:=2")


@pytest.mark.timeout(200)
def test_an_agent_that_dies_is_named(master: Master, tmp_path: Path) -> None:
    # One of another field's controllers: seven sensors.
    master.workspace.compile(network("layered", "tanh", [-1.0, 1.0], sensors=7))
    said = launch(master, write(tmp_path / "file.json", RANDOM), tmp_path / "logs", 8, "patience:=2")
    assert (
        "the exported controller has 7 sensors and 2 actuators, but agents of Emergency Exit have 10 and 2"
        in said
    )
    assert "agent 0 did not ask for its turn within 2 s" in said
