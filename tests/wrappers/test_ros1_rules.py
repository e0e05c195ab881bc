"""The rules in the package emergency_exit for ROS, without ROS: many episodes against the engine's."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import _engine
from tests.python.export.specifications import network

ROOT = Path(__file__).parents[2]
STADIUM = json.loads((ROOT / "experiments" / "stadium.json").read_text(encoding="utf-8"))
WALKERS = [network("layered", "tanh", [-1.0, 1.0], seed=seed, sensors=10) for seed in range(3)]


@pytest.fixture(scope="module")
def package() -> Any:
    """The package's modules `fields`, `episode` and `logs`."""
    from importlib import import_module

    sys.path.insert(0, str(ROOT / "wrappers" / "ros1" / "emergency_exit" / "src"))
    try:
        return {name: import_module(f"emergency_exit.{name}") for name in ("fields", "episode", "logs")}
    finally:
        del sys.path[0]


def _play(package: Any, parameters: dict[str, Any], specification: dict[str, Any]) -> int:
    """Play an episode here and in the engine; the number of positions, all of which are the same."""
    whole = {**package["fields"].DEFAULTS, **parameters}
    field = package["fields"].field_of(whole)
    text = json.dumps(specification)
    engine = _engine.Episode("emergency_exit", parameters, text)
    controllers = [_engine.Controller(text) for _ in field.agents]
    episode = package["episode"].Episode(field, whole["steps"], whole["update"])
    seen: list[list[Any]] = []
    last = -1

    def ask(agents: list[int]) -> list[list[float]]:
        nonlocal last
        if agents[0] <= last or last < 0:  # the next step begins
            seen.append(list(episode.grid.places))
        last = agents[-1]
        sensors = [np.array(episode.grid.sense(agent), np.float32) for agent in agents]
        return [controllers[agent].step(one).tolist() for agent, one in zip(agents, sensors, strict=True)]

    episode.play(ask)
    for place in [*seen, episode.grid.places]:
        scene = engine.scene()
        agents = [body for body in scene["bodies"] if body["kind"] == "agent"]
        there = [(body["x"] - 0.5, scene["height"] - body["y"] - 0.5) for body in agents]
        assert place == there
        if not engine.done:
            engine.step()
    assert engine.done
    return len(field.agents) * (len(seen) + 1)


@pytest.mark.parametrize("update", ["sequential", "simultaneous"])
def test_every_position_is_the_engines(update: str, package: Any) -> None:
    positions = 0
    for seed in range(40):
        shape = [(20, 20, 10), (7, 7, 7), (16, 5, 16), (4, 30, 4)][seed % 4]
        width, height, agents = shape
        random = {
            "width": width, "height": height, "numAgents": agents, "numExits": 1 + seed % 3,
            "numBlockades": width * width // 8, "seed": seed * 2**33 + seed, "steps": 40, "update": update,
        }  # fmt: skip
        positions += _play(package, random, WALKERS[seed % 3])
    for specification in WALKERS:
        positions += _play(package, {"field": STADIUM, "update": update}, specification)
    assert positions > 20_000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: lines[:-1], "ends after 1 of 2 steps; the episode was interrupted"),
        (
            lambda lines: [lines[0].replace("abc", "def"), *lines[1:]],
            "is of another episode than agent_0.csv",
        ),
        (lambda lines: [*lines[:-1], "2,1,x,0.5,0"], "agent_1.csv:5: expected step 2"),
        (lambda lines: lines[1:], "is not the log of an agent"),
        (lambda _: [], "is not the log of an agent"),
        (lambda lines: lines[:2], "has no steps"),
    ],
)
def test_logs_that_are_incomplete_are_refused(
    change: Any, message: str, package: Any, tmp_path: Path
) -> None:
    def log(agent: int) -> list[str]:
        head = f"# agent {agent} of 2, steps 2, episode abc"
        return [head, "step,x,y,distance,out", "0,1,1,2.5,0", "1,1,1,2.5,0", "2,1,2,0.5,0"]

    def write(agent: int, lines: list[str]) -> None:
        (tmp_path / f"agent_{agent}.csv").write_text("".join(f"{line}\n" for line in lines), encoding="ascii")

    read = package["logs"].read
    with pytest.raises(package["logs"].LogError, match=r"agent_0\.csv: \[Errno 2\]"):
        read(tmp_path)
    write(0, log(0))
    write(1, log(1))
    assert read(tmp_path).fitness == -1.0
    write(1, change(log(1)))
    with pytest.raises(package["logs"].LogError) as refused:
        read(tmp_path)
    assert message in str(refused.value)
