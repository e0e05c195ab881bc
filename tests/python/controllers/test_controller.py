"""Controllers are callable on numpy arrays."""

import copy
import json
import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller, InputError, _engine
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers import controller as controllers
from swarmwright.controllers.controller import ControlledEpisodes
from swarmwright.controllers.kinds import describe_controller
from swarmwright.testing._common import representation


def specification(kind: str = "layered", seed: int = 1) -> dict[str, Any]:
    made = representation(kind, sensors=3, actuators=2)
    return made.specification(made.initial(Stream(seed, "test")))


@pytest.fixture(params=["layered", "fully_meshed"])
def controller(request: pytest.FixtureRequest) -> Controller:
    return Controller(specification(request.param))


def inputs(agents: int, steps: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    return (Stream(4, "inputs").unit(agents * steps * 3) * 2 - 1).astype(np.float32).reshape(steps, agents, 3)


def test_one_agent(controller: Controller) -> None:
    actuators = controller([0.5, -1, 0])
    assert actuators.shape == (2,)
    assert actuators.dtype == np.float32
    assert (np.abs(actuators) <= 1).all()
    assert (controller.sensors, controller.actuators) == (3, 2)


def test_a_linear_controller_by_hand() -> None:
    weights = [0.5, 1, 2, 3, -0.25, 0, 0, -1]
    linear = Controller(
        {
            "version": 1,
            "kind": "layered",
            "sensors": 3,
            "actuators": 2,
            "hidden": [],
            "activation": "linear",
            "output_range": [-1, 1],
            "weights": weights,
        }
    )
    assert linear([0.25, 0.125, -0.25]).tolist() == [0.25, 0.0]
    assert linear([1, 1, 1]).tolist() == [1.0, -1.0]  # limited to -1..1


def test_agents_of_a_swarm_do_not_touch_each_other() -> None:
    swarm = Controller(specification("fully_meshed"))
    alone = [Controller(specification("fully_meshed")) for _ in range(4)]
    for step in inputs(4, 5):
        together = swarm(step)
        assert together.shape == (4, 2)
        apart = np.stack([one(row) for one, row in zip(alone, step, strict=True)])
        assert together.tobytes() == apart.tobytes()


def test_state_is_kept_until_reset() -> None:
    controller = Controller(specification("fully_meshed"))
    rows = inputs(1, 3)[:, 0]
    first = [controller(row).tobytes() for row in rows]
    without_reset = controller(rows[0]).tobytes()
    controller.reset()
    assert [controller(row).tobytes() for row in rows] == first
    assert without_reset != first[0]


def test_the_number_of_agents_with_a_state_changes_with_reset_only() -> None:
    controller = Controller(specification("fully_meshed"))
    controller(inputs(3, 1)[0])
    advice = r"2 agent\(s\) now, 3 before, .*; if agents end at different steps, use Episodes\.run"
    with pytest.raises(InputError, match=advice):
        controller(inputs(2, 1)[0])
    controller.reset()
    assert controller(inputs(2, 1)[0]).shape == (2, 2)


@pytest.mark.parametrize("kind", ["layered", "evostick"])
def test_agents_without_a_state_may_be_any_number(kind: str) -> None:
    controller = Controller(specification(kind))
    rows = inputs(3, 1)[0]
    actuators = controller(rows)
    assert controller(rows[1:]).tobytes() == actuators[1:].tobytes()
    assert controller(rows[0]).tobytes() == actuators[0].tobytes()


def test_no_agents_have_no_actuators(controller: Controller) -> None:
    actuators = controller(np.zeros((0, 3)))
    assert actuators.shape == (0, controller.actuators)
    assert actuators.dtype == np.float32


@pytest.mark.parametrize(
    ("sensors", "words"),
    [
        ([1, 2], r"have the shape \(2,\); expected \(3,\)"),
        (np.zeros((2, 4)), r"have the shape \(2, 4\)"),
        (np.zeros((0, 2)), r"have the shape \(0, 2\)"),
        (1.0, "have the shape"),
        ([0, np.nan, 0], "not finite"),
        ([0, 1e300, 0], r"^sensors: 1e\+300 at \[1\] is too large for a 32-bit float, at most 3.40282e\+38$"),
        (["a", "b", "c"], "must be an array of numbers"),
    ],
)
def test_wrong_sensors(sensors: Any, words: str, controller: Controller) -> None:
    with pytest.raises(InputError, match=words):
        controller(sensors)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "magic"}, "magic"),
        ({"weights": [1.0]}, "weights"),
        ({"sensors": 0}, "sensors"),
        ({"weights": [float("nan")]}, "JSON"),
        ({"extra": 1}, "extra"),
    ],
)
def test_wrong_specifications(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=f"controller: .*{words}"):
        Controller(specification() | change)


def test_a_controller_can_be_pickled_and_copied(controller: Controller) -> None:
    sensors = np.full(3, 0.5, np.float32)
    first = controller(sensors)
    controller(sensors)
    for again in (pickle.loads(pickle.dumps(controller)), copy.copy(controller), copy.deepcopy(controller)):
        assert again.specification == controller.specification
        assert again(sensors).tobytes() == first.tobytes()  # from the start of an episode


def test_saving_and_loading(controller: Controller, tmp_path: Path) -> None:
    controller.save(tmp_path / "c.json")
    loaded = Controller.load(tmp_path / "c.json")
    assert loaded.specification == controller.specification
    row = inputs(1, 1)[0, 0]
    assert loaded(row).tobytes() == controller(row).tobytes()


def test_loading_a_best_file_or_its_folder(tmp_path: Path) -> None:
    best = {"fitness": 0.0, "generation": 1, "candidate": 2, "controller": specification()}
    (tmp_path / "best.json").write_text(json.dumps(best))
    for path in (tmp_path, tmp_path / "best.json"):
        assert Controller.load(path).specification == specification()


def test_a_model_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "controller.onnx").write_bytes(b"\x08\x08\x12\x0bswarmwright\xc3\x28")
    with pytest.raises(InputError, match="is not a text file"):
        Controller.load(tmp_path / "controller.onnx")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is not valid JSON"),
        ("[1, 2]", "is not a controller"),
        ("{}", "controller: "),
        ("[" * 100_000, r"is nested too deeply|is not valid JSON"),
    ],
)
def test_files_that_hold_no_controller(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        Controller.load(tmp_path / "c.json")
    assert "c.json" in str(caught.value)
    with pytest.raises(InputError, match="file not found"):
        Controller.load(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("specification", "words"),
    [
        (
            {"kind": "layered", "sensors": 4, "actuators": 1, "hidden": [8], "activation": "tanh"},
            "layered, 4-8-1, tanh",
        ),
        ({"kind": "modules", "sensors": 9, "actuators": 2}, "modules (state machine)"),
        ({"kind": "modules", "sensors": 9, "actuators": 2, "form": "tree"}, "modules (behaviour tree)"),
        ({"kind": "mealy_fsm", "sensors": 9, "actuators": 2, "states": 3}, "mealy_fsm, 3 states"),
    ],
)
def test_only_networks_have_layers(specification: dict[str, Any], words: str) -> None:
    assert describe_controller(specification) == words


def test_the_specification_is_read_once_for_all_agents(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reading the text of a large network takes longer than a step of it."""
    read = []

    def reading(text: str) -> Any:
        read.append(text)
        return real(text)

    real = _engine.Controller
    monkeypatch.setattr(controllers, "_engine", SimpleNamespace(Controller=reading))
    swarm = Controller(specification("fully_meshed"))
    steps = inputs(6, 5)
    expected = [swarm(rows).tobytes() for rows in steps]
    swarm.reset()
    assert swarm(steps[0]).tobytes() == expected[0]
    many = ControlledEpisodes(swarm)
    episodes, agents = np.repeat(np.arange(2, dtype=np.uint32), 3), np.tile(np.arange(3, dtype=np.uint32), 2)
    assert [many(episodes, agents, rows).tobytes() for rows in steps] == expected
    assert len(read) == 1


@pytest.mark.parametrize("given", ["controller.json", "", " run/best.json"])
def test_a_path_leads_to_what_reads_files(given: str) -> None:
    with pytest.raises(InputError, match=r"^controller: must be a mapping or JSON text, .*Controller.load"):
        Controller(given)


def test_a_message_about_json_has_one_prefix() -> None:
    with pytest.raises(InputError, match=r"^controller: not JSON: "):
        Controller("{")
