"""FMUs for model exchange, with arrays, terminals and units: FMPy's own simulation, mistakes."""

import contextlib
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu

from swarmwright import Experiment, InputError, RunError
from swarmwright.simulations.command.fmu_definition import Channel, FmuOptions
from swarmwright.simulations.fmu.description import describe
from swarmwright.simulations.fmu.instances import unpack
from swarmwright.simulations.fmu.program import Episodes, ExchangeInstance
from tests.python.simulations.fmu.built import BALL_2, BALL_3, FLEET, ROBOTS, TERMINALS, build
from tests.python.simulations.fmu.test_fmu import controller_of, score

pytestmark = pytest.mark.slow  # compiles FMUs


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with Ball2.fmu, Ball3.fmu and Robots3.fmu."""
    folder = tmp_path_factory.mktemp("models")
    build(folder, "ball", BALL_2)
    build(folder, "ball", BALL_3)
    build(folder, "robots", ROBOTS, TERMINALS)
    return folder


def experiment(
    file: Path, fitness: str, parameters: dict[str, Any] | None = None, **simulation: Any
) -> Experiment:
    return Experiment.from_mapping(
        {"simulation": {"fmu": str(file), **simulation}, "fitness": fitness, "parameters": parameters or {}}
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Ball2", "Ball3"])
@pytest.mark.parametrize("solver", ["CVode", "Euler"])
def test_model_exchange_has_the_bits_of_fmpy(models: Path, tmp_path: Path, name: str, solver: str) -> None:
    """Without a change of the inputs, all steps; the ball bounces several times."""
    file = models / f"{name}.fmu"
    expected = simulate_fmu(
        str(file),
        solver=solver,
        output=["height", "speed"],
        output_interval=0.1,
        stop_time=2.0,
        record_events=False,
    )
    known = describe(file)
    instance = ExchangeInstance(known, unpack(str(file), tmp_path), "ball", solver)
    variables = [known.variables[one] for one in ("height", "speed")]
    for _ in range(2):  # again in the same instance
        instance.begin({}, 0.0, 2.0)
        found = [instance.numbers(variables)]
        for step in range(20):
            assert not instance.step(step * 0.1, 0.1)
            found.append(instance.numbers(variables))
        assert found == [[height, speed] for _, height, speed in expected.tolist()]
    instance.end()


def episodes(file: Path, **options: Any) -> Episodes:
    """Episodes in this process, each in a folder of their own, since a loaded library is not replaced."""
    with contextlib.chdir(tempfile.mkdtemp(dir=file.parent)):
        return Episodes(FmuOptions(fmu=str(file), **options).attachment())


@pytest.mark.parametrize("name", ["Ball2", "Ball3"])
def test_inputs_are_events(models: Path, name: str) -> None:
    """Pushed as hard as it weighs, the ball rests; -1 to 1 is the input's range, 0 to 20 m/s^2."""
    ball = episodes(models / f"{name}.fmu", steps=8)
    ball.reset({}, 1)
    rest = 9.81 / 20 * 2 - 1
    assert ball.step([[rest]])["sensors"] == [[pytest.approx(1.0), pytest.approx(0.0, abs=1e-12)]]
    ((height, speed),) = ball.step([[-1.0]])["sensors"]
    # Falling for 0.1 s, with drag.
    assert speed == pytest.approx(-9.81 / 0.1 * (1 - math.exp(-0.01)), rel=1e-5)
    assert 1 - 0.5 * 9.81 * 0.01 < height < 1 - 0.49 * 9.81 * 0.01
    ((_, slower),) = ball.step([[1.0]])["sensors"]
    assert slower > speed + 0.9


@pytest.mark.slow
def test_solvers_and_parameters(models: Path) -> None:
    file, metrics = models / "Ball2.fmu", {"height": "mean"}
    one, other = (
        score(experiment(file, "height", metrics=metrics, solver=name)) for name in ("cvode", "euler")
    )
    assert one != other
    assert one == score(experiment(file, "height", metrics=metrics))
    assert score(experiment(file, "height", {"bounce": 0.1}, metrics=metrics)) != one


@pytest.mark.slow
def test_what_fails_in_a_solver_is_said(models: Path) -> None:
    wrong = experiment(
        models / "Ball2.fmu",
        "height",
        actuators=[{"variable": "push", "range": [60, 70]}],
        metrics={"height": "last"},
    )
    with pytest.raises(RunError, match=r"the integration from 0 s: the FMU reports an error without"):
        score(wrong)


def test_units_are_converted(models: Path) -> None:
    file = models / "Ball2.fmu"
    known = describe(file).conversions
    assert known["m/s"]["km/h"] == (4.0, 0.0)
    assert known["m/s"]["knot"] == (1.9438444924406, 0.0)
    assert known["K"]["degC"] == (1.0, -273.15)
    assert known["km/h"]["knot"] == (0.25 * 1.9438444924406, 0.0)
    rows = {}
    for unit in ("m/s", "km/h"):
        ball = episodes(file, sensors=[{"variable": "speed", "unit": unit}], actuators=["push"])
        ball.reset({}, 1)
        rows[unit] = [ball.step([[-1.0]])["sensors"][0][0] for _ in range(5)]
    assert rows["km/h"] == [4.0 * one for one in rows["m/s"]]
    assert min(rows["m/s"]) < -0.5
    fast = [{"variable": "speed", "unit": "km/h", "range": [-8, 8]}]
    ball = episodes(file, sensors=fast, actuators=["push"])
    ball.reset({}, 1)
    assert ball.step([[-1.0]])["sensors"][0][0] == pytest.approx(rows["m/s"][0] / 2)


@pytest.mark.slow
def test_actuators_have_units_too(tmp_path: Path) -> None:
    text = BALL_2.replace('start="0" min="0" max="20"', 'start="0" min="0" max="20" unit="m/s"')
    file = build(tmp_path, "ball", text)
    made = FmuOptions(fmu=str(file), actuators=[Channel(variable="push", unit="km/h")])
    assert made.channels("actuators")[0].range == (0.0, 80.0)
    heights = []
    for unit in ("m/s", "km/h"):
        ball = episodes(file, actuators=[{"variable": "push", "unit": unit}])
        ball.reset({}, 1)
        heights.append([ball.step([[0.3]])["sensors"] for _ in range(5)])
    assert heights[0] == heights[1]


@pytest.mark.slow
def test_arrays_and_terminals(models: Path) -> None:
    file, gap = models / "Robots3.fmu", {"gap": "last(place[3,2])"}
    whole = experiment(file, "gap", metrics=gap)
    assert (whole.sensors, whole.actuators) == (6, 6)
    named = experiment(file, "gap", metrics=gap, sensors=["place"], actuators=["speed"])
    terminals = experiment(
        file, "gap", metrics=gap, sensors=[{"terminal": "swarm.seen"}], actuators=[{"terminal": "swarm"}]
    )
    assert score(whole) == score(named) == score(terminals)
    part = experiment(
        file, "gap", metrics=gap, sensors=["place[1,1]", "place[3,2]"], actuators=["speed[3,2]"]
    )
    assert (part.sensors, part.actuators) == (2, 1)

    rows = experiment(
        file, "gap", agents=3, metrics={"gap": "last(place[1,1])"}, sensors=["place[{agent}]"],
        actuators=["speed[{agent}]"], steps=8,
    )  # fmt: skip
    assert (rows.sensors, rows.actuators) == (2, 2)
    found = score(rows)
    controllers = [controller_of(rows) for _ in range(3)]
    for one in controllers:
        one.reset()
    places = np.arange(6).reshape(3, 2) * 0.25
    for _ in range(8):
        speeds = [one(row.astype(np.float32)) for one, row in zip(controllers, places, strict=True)]
        places += 0.125 * np.array(speeds, np.float64)
    assert found == places[0, 0]
    assert math.isfinite(found)


@pytest.mark.slow
def test_start_values_of_arrays_and_their_sizes(tmp_path: Path) -> None:
    """A structural parameter sets sizes before initialization, again after each reset."""
    file = build(tmp_path, "robots", FLEET)
    assert describe(file).variables["place"].shape == (3, 2)
    rows = [[0.5, -1.0], [2.0, 0.0], [0.0, 4.0], [1.0, 1.0], [-3.0, 0.25]]
    for start in (rows, [one for row in rows for one in row]):
        fleet = episodes(file, start={"from": start, "count": 5})
        for _ in range(2):
            assert fleet.reset({}, 1)["sensors"] == [[one for row in rows for one in row]]
            [seen] = fleet.step([[0.5] * 10])["sensors"]
            assert seen == [one + 0.0625 for row in rows for one in row]
    made = experiment(
        file, "gap", metrics={"gap": "last(place[5,2])"}, start={"count": 5, "from": rows}, agents=5,
        sensors=["place[{agent}]"], actuators=["speed[{agent}]"], steps=8,
    )  # fmt: skip
    assert (made.sensors, made.actuators) == (2, 2)
    assert math.isfinite(score(made))
    mistakes: list[tuple[dict[str, Any], str]] = [
        ({"count": 5, "from": [0.0] * 6}, "from of .* has the shape 5 x 2; expected 10 values, .* not 6"),
        ({"count": 0}, "count of .* is a structural parameter, expected an integer from 1, not 0"),
        ({"count": [5]}, "count of .* is a single value, not a list"),
    ]
    for wrong, said in mistakes:
        with pytest.raises(InputError, match=said):
            experiment(file, "gap", metrics={"gap": "last(place[1,1])"}, start=wrong)


MISTAKES: tuple[tuple[dict[str, Any], str], ...] = (
    (
        {"sensors": [{"variable": "speed", "unit": "km/s"}]},
        "does not define a conversion from m/s, the unit of speed",
    ),
    ({"sensors": [{"variable": "speed", "unit": "kmh"}]}, "did you mean 'km/h'?"),
    (
        {"actuators": [{"variable": "push", "unit": "N"}]},
        "unit: push of .* has no unit, so N cannot be converted",
    ),
    ({"sensors": [{"terminal": "wheels"}]}, "has no terminal 'wheels'; available: none"),
    ({"sensors": [{"terminal": "a", "variable": "b"}]}, "write either a variable or a terminal"),
    ({"sensors": [{"range": [0, 1]}]}, "write either a variable or a terminal"),
    ({"solver": "rk4"}, "solver: must be one of cvode, euler, not 'rk4'"),
)


@pytest.mark.parametrize(("values", "said"), MISTAKES, ids=[said[:30] for _, said in MISTAKES])
def test_mistakes(models: Path, values: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        experiment(models / "Ball2.fmu", "height", **values)


def test_mistakes_with_arrays_and_solvers(models: Path) -> None:
    for values, said in (
        ({"solver": "cvode"}, "supports only co-simulation, with its own solver"),
        ({"sensors": [{"terminal": "swarm.sen"}]}, "did you mean 'swarm.seen'?"),
        (
            {"sensors": [{"terminal": "swarm.seen"}], "actuators": [{"terminal": "swarm.seen"}]},
            "has no input",
        ),
        ({"start": {"speed[1,1]": 1.0}}, r"start.speed\[1,1\]: .* is an element of an array; .* speed as"),
        ({"start": {"speed": 1.0}}, r"speed of .* has the shape 3 x 2; expected a list of 6 values, not 1"),
        ({"start": {"speed": [1.0] * 4}}, "has the shape 3 x 2; expected 6 values, row by row, not 4"),
        ({"start": {"speed": [[1, 2, 3], [4, 5, 6]]}}, "expected 3 rows of 2 values each"),
        ({"start": {"speed": [1, 2, 3, 4, 5, "a"]}}, "of the type Float64, expected a number, not 'a'"),
        ({"sensors": ["place[4,1]"]}, r"has no variable 'place\[4,1\]'"),
        (
            {"agents": 4, "sensors": ["place[{agent}]"], "actuators": ["speed[{agent}]"]},
            r"has no variable 'place\[4,1\]'",
        ),
    ):
        with pytest.raises(InputError, match=said):
            experiment(models / "Robots3.fmu", "0 * gap", metrics={"gap": "last(place[1,1])"}, **values)
