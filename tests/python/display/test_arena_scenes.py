"""What scenes of the arena say of robots and walls, on pages, in pictures and on terminals."""

import json
import math
from typing import Any

import pytest

from swarmwright import _engine
from swarmwright.display._episode import Part, Recording, Shown, record
from swarmwright.display._look import Looks
from swarmwright.display.page import page_data

WALLS = {"rectangle": [4, 4]}
START = {"disc": {"radius": 1}}


def episode(parameters: dict[str, Any]) -> _engine.Episode:
    """An episode of e-pucks that stand."""
    controller = {
        "version": 1, "kind": "layered", "sensors": 24, "actuators": 2, "hidden": [], "activation": "tanh",
        "output_range": [-1, 1], "weights": [0.0] * 50,
    }  # fmt: skip
    return _engine.Episode("arena", {"duration": 2, "seed": 3, **parameters}, json.dumps(controller))


def recorded(parameters: dict[str, Any]) -> Recording:
    return record(episode(parameters))


@pytest.mark.parametrize(
    ("failure", "state"),
    [
        ({"kind": "stop"}, "stopped"),
        ({"kind": "slow", "factor": 0.5}, "slow"),
        ({"kind": "blind"}, "blind"),
        ({"kind": "mute"}, "mute"),
    ],
)
def test_legends_list_robots_that_fail(failure: dict[str, Any], state: str) -> None:
    parameters = {"robots": 10, "failures": [{**failure, "share": 0.3, "at": 1}]}
    recording = recorded(parameters)
    looks = Looks(recording.scenes)
    assert looks.names() == [("agent", ""), ("agent", state)]
    well, failing = (looks["agent", one] for one in ("", state))
    assert well.shape == failing.shape
    assert well.color != failing.color
    data, _ = page_data([Part(recording)], speed=1.0, shown=Shown())
    bodies = data["episodes"][0]["bodies"]
    assert dict(zip(bodies["looks"], bodies["most"], strict=True)) == {("agent", ""): 10, ("agent", state): 3}
    playing = episode(parameters)
    while not playing.done:
        playing.step()
    assert f"● {state} 3" in playing.text(100, False, 40, True)


def test_legends_list_robots_without_charge() -> None:
    robot = {"preset": "e-puck-rm1.1", "battery": {"standing": 1, "driving": 1}}
    looks = Looks(recorded({"robots": 3, "robot": robot}).scenes).plain()
    assert list(looks) == ["agent", "agent, empty"]


def test_coloured_stretches_of_walls_are_walls() -> None:
    mission = {
        "walls": {**WALLS, "colors": [{"side": 1, "color": "blue"}]}, "start": START, "fitness": "order",
        "lights": [
            {"at": [1, 1, 0.3], "intensity": 0, "color": "red"},
            {"at": [-1, 1, 0.3], "intensity": 0},
        ],
    }  # fmt: skip
    recording = recorded({"mission": mission, "robots": 1})
    looks = Looks(recording.scenes)
    assert set(looks.plain()) == {"agent", "wall, blue", "lamp, red"}
    assert looks["wall", "blue"].shape == "square"
    headings = [body.heading for body in recording.scenes[0].bodies if body.kind == "wall"]
    # Lines along the right side, which goes up.
    assert headings == pytest.approx([math.pi / 2] * 40)
    assert not recording.scenes[0].lights, "lamps that are off shed no light"


def test_what_is_measured_at_the_end_is_shown_as_if_it_ended_now() -> None:
    metrics = {"distance": {"kind": "mean_distance", "radius": 1, "most": 1.9}}
    fitness = {"offset": 1.9, "factors": {"distance": -1}}
    mission = {"walls": WALLS, "start": START, "metrics": metrics, "fitness": fitness}
    parameters = {"mission": mission, "robots": 12}
    playing = episode(parameters)
    while not playing.done:
        [distance] = playing.metrics(["distance"])
        assert 0 < distance < 1.9
        assert math.isclose(playing.fitness, 1.9 - distance, abs_tol=1e-12)
        playing.step()
    # They stand: little can be different at the end.
    so_far = recorded(parameters).fitness_so_far
    assert all(math.isclose(value, playing.fitness, abs_tol=0.05) for value in so_far)
