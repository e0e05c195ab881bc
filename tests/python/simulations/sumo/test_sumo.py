"""Vehicles and traffic lights in SUMO: what they sense and do, repeated episodes, mistakes."""

import hashlib
import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, optimize, simulate
from swarmwright.common import warn_once
from tests.python.records import same_record
from tests.python.simulations.sumo.roads import crossing, drivers, flows, ring, written

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        importlib.util.find_spec("libsumo") is None, reason="libsumo is not installed; make test-simulators"
    ),
]


def started(name: str, config: str, seed: int = 1, **parameters: Any) -> tuple[Any, Any]:
    """A simulation at its start, and what its agents sense."""
    from swarmwright.simulations import sumo

    kind = getattr(sumo, name)
    defaults = {name: one.default for name, one in kind.parameters.items()}
    simulation = kind()
    return simulation, simulation.reset({**defaults, "config": config, **parameters}, seed)


def acted(simulation: Any, *rows: float, steps: int = 1) -> Any:
    for _ in range(steps):
        seen = simulation.step(np.array(rows, np.float32)[:, None])
    return seen


def test_a_vehicle_accelerates_and_senses_those_ahead_and_behind(tmp_path: Path) -> None:
    config = written(tmp_path, ring(400), drivers(400, ["agent", "human", "agent", "human"], sigma=0))
    vehicles, seen = started("Vehicles", config, agents=3, range=100.0, fastest=30.0)
    assert seen.shape == (3, 5)
    assert vehicles.acting() == [0, 1]
    assert vehicles.agents == ["v0", "v2"]
    assert seen[2].tolist() == [0] * 5
    assert seen[:2, 1] == pytest.approx([0.05, 0.05], abs=0.01)  # 100 m less a vehicle of 5 m: 95 of 100
    assert seen[:2, 3] == pytest.approx([0.05, 0.05], abs=0.01)
    seen = acted(vehicles, 1, 0, 0, steps=5)
    v0, v2 = (vehicles.sumo.vehicle.getSpeed(one) for one in ("v0", "v2"))
    assert v0 == pytest.approx(5 * 1.3, rel=0.01)
    assert v2 < 0.7
    assert seen[0, 0] == pytest.approx(v0 / 30, rel=0.05)
    ahead = vehicles.sumo.vehicle.getSpeed("v1")
    assert seen[0, 2] == pytest.approx((ahead - v0) / 30, abs=0.01)
    speed = v0
    acted(vehicles, -1, 0, 0)
    assert vehicles.sumo.vehicle.getSpeed("v0") == pytest.approx(speed - 2, abs=0.1)


def test_sumo_brakes_agents_only_where_it_is_safe(tmp_path: Path) -> None:
    config = written(tmp_path, ring(), drivers(230, ["agent", *["human"] * 4], sigma=0))
    collisions = []
    for safe in (True, False):
        vehicles, _ = started("Vehicles", config, safe=safe, steps=60)
        acted(vehicles, 1, steps=60)
        assert vehicles.done()
        collisions.append(vehicles.measure()["collisions"])
    assert collisions[0] == 0
    assert collisions[1] > 0


def test_a_light_changes_when_it_is_told_to_and_was_green_long_enough(tmp_path: Path) -> None:
    lights, seen = started(
        "TrafficLights", written(tmp_path, crossing(), flows(0, 0.5)), green=5.0, steps=200
    )
    assert seen.shape == (1, 4)

    def state() -> str:
        return str(lights.sumo.trafficlight.getRedYellowGreenState("c"))

    seen = acted(lights, 1, steps=4)
    assert state() == "GrGr"  # less than 5 s
    acted(lights, -1, steps=80)
    assert state() == "GrGr"  # longer than its program has it
    seen = acted(lights, -1)
    assert seen[0] == pytest.approx([0, 10 / 13, 0, 1], abs=0.3)
    acted(lights, 1)
    assert state() == "yryr"
    seen = acted(lights, 1, steps=2)
    assert seen[0].tolist() == [0, 0, 0, 0]
    acted(lights, 1, steps=2)
    assert state() == "rGrG"
    acted(lights, -1, steps=60)
    assert state() == "rGrG"
    measured = lights.measure()
    assert measured["arrived"] > 10
    assert measured["waiting"] > 5
    assert lights.fitness() == -measured["waiting"]
    assert not lights.done()


def test_an_episode_ends_when_nobody_is_left(tmp_path: Path) -> None:
    routes = '<vehicle id="v" depart="0"><route edges="n_c c_s"/></vehicle>'
    lights, _ = started("TrafficLights", written(tmp_path, crossing(), routes))
    for _ in range(60):
        if lights.done():
            break
        acted(lights, -1)
    assert lights.done()
    assert lights.measure() == {
        "speed": pytest.approx(13, abs=1.5), "waiting": 0, "backlog": 0,
        "arrived": 1, "collisions": 0, "teleported": 0,
    }  # fmt: skip


def test_vehicles_that_cannot_enter_wait_too(tmp_path: Path) -> None:
    """Lights that let fewer vehicles into the network do not score better."""
    config = written(tmp_path, crossing(), flows(0.25, 0.25))
    found = []
    for period in (10, 40):
        lights, _ = started("TrafficLights", config, 7, steps=300)
        for step in range(1, 301):
            acted(lights, 1.0 if step % period == 0 else -1.0)
        measured = lights.measure()
        pending = set(lights.sumo.simulation.getPendingVehicles())
        assert measured["backlog"] == len(pending)
        assert lights.fitness() == -measured["waiting"]
        found.append((measured["waiting"], measured["backlog"], measured["speed"]))
    (often, seldom) = found
    assert often[1] > seldom[1] + 5
    assert often[0] > seldom[0] + 5
    assert often[2] < seldom[2]


def test_a_vehicle_that_gives_up_has_not_been_served(tmp_path: Path) -> None:
    config = written(tmp_path, crossing(), flows(0.5, 0))
    text = Path(config).read_text()
    measured = []
    for delay in ("-1", "5"):
        Path(config).write_text(text.replace("<step-", f'<max-depart-delay value="{delay}"/><step-', 1))
        lights, _ = started("TrafficLights", config, steps=100)
        acted(lights, 1, steps=10)
        acted(lights, -1, steps=90)  # red for those from the north
        measured.append(lights.measure())
    patient, impatient = measured
    assert impatient["backlog"] >= 10
    assert impatient["waiting"] == pytest.approx(patient["waiting"], rel=0.2)


@pytest.mark.slow
def test_options_of_a_configuration_that_break_episodes_have_no_effect(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chance, a port that is waited for, files beside the configuration, sockets."""
    monkeypatch.setattr(warn_once, "_given", set())
    monkeypatch.chdir(tmp_path)
    config = written(tmp_path, crossing(), flows(0.2, 0.3))
    plain, first = started("TrafficLights", config, 3)
    expected = [first.tolist(), acted(plain, -1, steps=50).tolist(), plain.measure()]
    detectors = (
        '<additional><inductionLoop id="d" lane="n_c_0" pos="10" period="10" file="detected.xml"/>'
        '<timedEvent type="SaveTLSStates" source="c" dest="states.xml"/></additional>'
    )
    (tmp_path / "add.xml").write_text(detectors)
    options = (
        '<random value="true"/><remote-port value="8813"/><gui-settings-file value="nowhere.xml"/>'
        '<tripinfo-output value="trips.xml"/><summary-output value="localhost:1"/><log value="log.txt"/>'
        '<save-state.times value="10"/><tripinfo-output.write-unfinished value="true"/>'
        '<additional-files value="add.xml"/><device.ssm.probability value="1"/>'
        '<device.ssm.file value="ssm.xml"/>'
    )
    Path(config).write_text(Path(config).read_text().replace("</conf", f"<output>{options}</output></conf"))
    for _ in range(2):
        lights, seen = started("TrafficLights", config, 3)
        assert [seen.tolist(), acted(lights, -1, steps=50).tolist(), lights.measure()] == expected
    lights.sumo.close()
    assert {one.name for one in tmp_path.iterdir()} == {"net.xml", "rou.xml", "town.sumocfg", "add.xml"}
    (said,) = [one.getMessage() for one in caplog.records]
    for name in ("random", "remote-port", "gui-settings-file", "tripinfo-output", "summary-output", "log,",
                 "save-state.times", "inductionLoop d", "timedEvent", "device.ssm.file"):  # fmt: skip
        assert name in said
    assert "write-unfinished" not in said
    # The tool says it, too, where its user sees it.
    one = Experiment.from_mapping(
        {
            "simulation": "swarmwright.simulations.sumo:TrafficLights",
            "parameters": {"config": config, "steps": 2},
        }
    )
    monkeypatch.setattr(warn_once, "_given", set())
    caplog.clear()
    simulate(one, servers=1)
    assert [record.getMessage() for record in caplog.records] == [f"parameters: {said}"]
    # Said only where they would do something.
    caplog.clear()
    Path(config).write_text(
        Path(config).read_text().replace(options, '<random value="false"/><remote-port value="0"/>')
    )
    started("TrafficLights", config, 3)
    assert not caplog.records


@pytest.mark.slow
def test_episodes_are_the_same_to_the_bit_and_follow_from_the_seed(tmp_path: Path) -> None:
    config = written(tmp_path, ring(), drivers(230, ["agent", *["human"] * 21]))

    def episode(seed: int) -> bytes:
        vehicles, seen = started("Vehicles", config, seed)
        rows = [seen]
        rows += [acted(vehicles, *np.tanh(rows[-1] @ [1, -1, 2, 0, 0])) for _ in range(100)]
        return np.array(rows).tobytes() + repr(vehicles.measure()).encode()

    first = episode(7)
    assert first != episode(8)
    assert all(episode(7) == first for _ in range(3))
    # In another process, too.
    code = (
        "import sys, hashlib; sys.path.insert(0, '.')\n"
        "from tests.python.simulations.sumo.test_sumo import *\n"
        f"vehicles, seen = started('Vehicles', {config!r}, 7)\nrows = [seen]\n"
        "rows += [acted(vehicles, *np.tanh(rows[-1] @ [1, -1, 2, 0, 0])) for _ in range(100)]\n"
        "print(hashlib.sha256(np.array(rows).tobytes() + repr(vehicles.measure()).encode()).hexdigest())"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == hashlib.sha256(first).hexdigest()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["Vehicles", "TrafficLights"])
def test_one_record_here_and_on_servers_in_every_mode(kind: str, tmp_path: Path) -> None:
    if kind == "Vehicles":
        config = written(tmp_path, ring(), drivers(230, ["agent", *["human"] * 5, "agent"]))
    else:
        config = written(tmp_path, crossing(), flows(0.2, 0.3))

    def experiment(mode: str) -> Experiment:
        return Experiment.from_mapping(
            {
                "simulation": f"swarmwright.simulations.sumo:{kind}",
                "parameters": {
                    "config": config,
                    "steps": 15,
                    **({"agents": 2} if kind == "Vehicles" else {}),
                },
                "controller": {"hidden": []},
                "method": {"population": 4, "generations": 1},
                "ranking": {"episodes": 2},
                "fitness": "fitness - 0.01 * waiting",
                "mode": mode,
            }
        )

    here = optimize(experiment("auto"), servers="in-process", out=tmp_path / "here")
    for mode, servers in (("stepwise", 1), ("batched", 1), ("offloaded", 2)):
        same_record(optimize(experiment(mode), servers=servers, out=tmp_path / mode), here)


def test_a_picture_has_roads_and_vehicles(tmp_path: Path) -> None:
    config = written(tmp_path, ring(), drivers(230, ["agent", "human"]))
    vehicles, _ = started("Vehicles", config)
    scene = vehicles.scene()
    assert [body.state for body in scene.bodies] == ["agent", "waiting"]
    assert len(scene.walls) == 4
    assert all(0 < body.x < scene.width and 0 < body.y < scene.height for body in scene.bodies)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({}, "config: missing; expected the path of a SUMO configuration"),
        ({"config": "nowhere.sumocfg"}, "config: .*nowhere.sumocfg: No such file or directory"),
        ({"config": "."}, "config: .*: is not a file"),
        ({"config": "/dev/zero"}, "config: /dev/zero: is not a file"),
        ({"config": "empty"}, "config: .*town.sumocfg: does not name a net-file"),
        ({"config": "broken-net"}, "config: .*net.xml: not valid XML: unclosed token: line 1"),
        ({"config": "no-routes"}, "config: .*rou.xml: No such file or directory"),
        ({"config": "wrong-edge"}, "config: .*: SUMO reports: The edge 'e7' within the route"),
        ({"config": "good", "type": "robot"}, "type: .* no vType 'robot'; available: agent, human"),
        ({"config": "good", "interval": 0.7}, "expected a multiple of SUMO's step-length, 0.5 s"),
    ],
)  # fmt: skip
def test_mistakes(parameters: dict[str, Any], words: str, tmp_path: Path) -> None:
    config = parameters.get("config", "")
    path = written(tmp_path, ring(), drivers(230, ["agent"]))
    if config == "empty":
        Path(path).write_text("<configuration/>")
    elif config == "broken-net":
        (tmp_path / "net.xml").write_text("<net><edge")
    elif config == "no-routes":
        (tmp_path / "rou.xml").unlink()
    elif config == "wrong-edge":
        written(tmp_path, ring(), '<vehicle id="v" depart="0"><route edges="e0 e7"/></vehicle>')
    if config:
        path = str(tmp_path / config) if config.endswith(("cfg", ".", "zero")) else path
        parameters = {**parameters, "config": path}
    one = Experiment.from_mapping(
        {"simulation": "swarmwright.simulations.sumo:Vehicles", "parameters": parameters}
    )
    with pytest.raises(InputError, match=words):
        simulate(one, servers="in-process")


def test_lights_where_there_are_none(tmp_path: Path) -> None:
    config = written(tmp_path, crossing(light=False), flows(0.1, 0.1))
    one = Experiment.from_mapping(
        {"simulation": "swarmwright.simulations.sumo:TrafficLights", "parameters": {"config": config}}
    )
    with pytest.raises(InputError, match=r"config: .*the network has no traffic lights"):
        simulate(one, servers="in-process")
