"""Text of a peer in every parameter of every attached simulator: refused, or without effect."""

import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import pytest

from swarmwright import Experiment, InputError
from swarmwright.common.errors import engine_errors
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.command.ros import RosSimulation
from swarmwright.simulations.host import Host
from swarmwright.simulations.loading import load
from swarmwright.simulations.parameters import parse_parameters
from swarmwright.simulations.ros.episodes import _fill_word
from tests.python.simulations.command.test_hostile_parameters import HOSTILE
from tests.python.simulations.command.test_ros_definition import with_
from tests.python.simulations.sumo.roads import ring, written

SIMULATORS = [
    ("libsumo", "swarmwright.simulations.sumo", ["Vehicles", "TrafficLights"]),
    ("mujoco", "swarmwright.simulations.mujoco", ["Rovers", "Quadrotors"]),
    ("pyenki", "swarmwright.simulations.enki", ["EPucks", "Thymios"]),
]


@pytest.mark.parametrize(
    ("library", "module", "name"),
    [(library, module, one) for library, module, names in SIMULATORS for one in names],
)
def test_declared_parameters(
    library: str, module: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if find_spec(library) is None:
        if library != "pyenki":
            pytest.skip(f"{library} is not installed")
        try:
            import_module(module)
        except InputError as error:
            pytest.skip(str(error))
    monkeypatch.chdir(tmp_path)
    kind: type[Simulation] = getattr(import_module(module), name)
    town = tmp_path / "town"
    town.mkdir()
    given = {"config": written(town, ring(), "")} if library == "libsumo" else {}
    host = Host(kind)
    for parameter in parse_parameters(kind.parameters, name):
        for text in HOSTILE:
            with pytest.raises(InputError, match=rf"^{parameter}: "), engine_errors():
                host.reset({**given, parameter: text})
    assert list(tmp_path.iterdir()) == [town]


def test_parameters_that_are_not_declared_do_not_reach_a_simulation() -> None:
    class Recording(Simulation):
        sensors = actuators = 0
        parameters = {"gain": 1.0}  # noqa: RUF012 - as in the base class

        def reset(self, parameters: dict[str, Any], seed: int) -> None:  # noqa: ARG002
            self.given = parameters

        def step(self, actions: Any) -> None:
            pass

        def done(self) -> bool:
            return True

        def fitness(self) -> float:
            return 0.0

    host = Host(Recording)
    host.reset({"gain": 2, "LD_PRELOAD": "x", "here": "/etc"})
    assert host._object.given == {"gain": 2.0}  # type: ignore[union-attr]


@pytest.mark.parametrize("name", ["gymnasium:FrozenLake-v1", "pettingzoo:mpe2.simple_spread_v3"])
@pytest.mark.parametrize("text", ["../../x", "/etc/passwd", "~/x", "maps/../../x"])
def test_environments_get_no_paths_elsewhere(name: str, text: str) -> None:
    host = Host(cast(type[Simulation], load(name)))
    for value in (text, [text], {"a": [text]}):
        with (
            pytest.raises(
                InputError, match=r"^desc: .*is outside the server's folder, where parameters may not point; "
            ),
            engine_errors(),
        ):
            host.reset({"desc": value})


def made(experiment: Experiment) -> RosSimulation:
    return cast(RosSimulation, load(experiment.simulation)())


def ros(command: list[str], **changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            **with_(reset={"command": command}, **changes),
            "parameters": {"speed": 1},
        }
    )


def test_a_reset_command_of_ros_gets_no_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is refused before any process is started."""
    monkeypatch.chdir(tmp_path)
    commands = (["sh", "-c", "x {speed}"], ["./reset", "{speed}"], ["./reset", "a:={speed}"], ["{speed}"])
    for command in commands:
        simulation = made(ros(command))
        for text in HOSTILE:
            with pytest.raises(InputError, match=r"^speed: .* found, but reset\.command"):
                simulation.reset({"speed": text}, 1)
    with pytest.raises(
        InputError, match=r"^parameters\.speed: 'a' found, but reset\.command: \{speed\} is part of a word"
    ):
        ros(["./reset", "a:={speed}"]).replace(parameters={"speed": "a"})
    ros(["./reset", "a:={speed}"], choices={"speed": ["a", 1]}).replace(parameters={"speed": "a"})
    with pytest.raises(InputError, match=r"^speed: 'b' found, but .* has other choices"):
        made(ros(["./reset", "a:={speed}"], choices={"speed": ["a", 1]})).reset({"speed": "b"}, 1)


def test_the_words_of_a_reset_command_are_parsed_once(tmp_path: Path) -> None:
    (tmp_path / "reset.sh").write_text("")
    command = ["reset.sh", "{here}/x", "--speed={speed}", "${speed}", "{{speed}}", "{seed}"]
    simulation = made(ros(command, folder=str(tmp_path)))
    parts = [simulation._reset_parts(word) for word in simulation._reset_command]
    values = {"here": "/ours", "speed": 2.5, "seed": 3}
    assert [_fill_word(word, values) for word in parts] == [
        os.fspath(tmp_path / "reset.sh"),
        "/ours/x",
        "--speed=2.5",
        "${speed}",
        "{speed}",
        "3",
    ]
