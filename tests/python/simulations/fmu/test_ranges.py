"""What the scaled numbers of FMUs stand for, in the description and in what is exported."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import swarmwright
from swarmwright import Experiment, optimize
from swarmwright.export import EXPORTERS
from swarmwright.export.exporting import write
from swarmwright.simulations import catalogue
from swarmwright.simulations.fmu.program import Coupled
from swarmwright.simulations.fmu.ssp import Linear, describe, read_system, write_system
from tests.python.export.specifications import ALL, subject

pytestmark = pytest.mark.slow


def attached(folder: Path) -> Experiment:
    """An FMU whose inputs are in metres, and an experiment that scales one of them."""
    names = {"sensor_names": ["thrust", "steer", "brake"], "actuator_names": ["dist", "speed"]}
    units = {"sensor_units": ["N", "rad", ""], "actuator_units": ["m", ""]}
    made = replace(subject(ALL["layered-tanh-0"]), description={**names, **units})
    write(EXPORTERS.get("fmu")().files(made, "plant"), folder)
    return Experiment.from_mapping(
        {
            "simulation": {
                "fmu": str(folder / "plant.fmu"),
                "steps": 3,
                "metrics": {"dist": "last(actuators.dist)"},
                "sensors": [{"variable": "actuators.dist", "range": [0, 10]}, "actuators.speed"],
                "actuators": [
                    {"variable": "sensors.thrust", "range": [0, 100]},
                    {"variable": "sensors.steer"},
                ],
            },
            "fitness": "dist",
            "controller": {"kind": "layered", "hidden": []},
            "method": {"kind": "nnga", "population": 4, "generations": 1},
        }
    )


def test_a_range_reaches_the_description_and_the_export(tmp_path: Path) -> None:
    experiment = attached(tmp_path)
    assert catalogue.ranges(experiment.simulation, {}) == {
        "sensor_ranges": [[0, 10, "m"], None],
        "actuator_ranges": [[0, 100, "N"], None],
    }
    describe = catalogue.description(experiment.simulation)
    assert (describe["sensor_units"], describe["actuator_units"]) == (["", ""], ["", "rad"])
    run = optimize(experiment, servers="in-process", out=tmp_path / "run")
    swarmwright.export_controller(run, to="c", output=tmp_path / "robot", prefix="robot", verify=True)
    header = (tmp_path / "robot" / "robot.h").read_text()
    assert "actuators.dist, -1 to 1 for 0 to 10 m, scaled: " in header
    assert "sensors.thrust, -1 to 1 for 0 to 100 N */" in header
    assert "sensors.steer in rad, -1 to 1 */" in header


@pytest.mark.parametrize("form", ["fmu", "fmu3"])
def test_coupled_with_its_world_a_scaled_controller_gives_the_fitness_of_the_run(
    form: str, tmp_path: Path
) -> None:
    run = optimize(attached(tmp_path), servers="in-process", out=tmp_path / "run")
    swarmwright.export_controller(run, to=form, output=tmp_path, prefix="robot")
    names = {"dist": ("plant.actuators.dist", "robot.sensors.actuators_dist"),
             "speed": ("plant.actuators.speed", "robot.sensors.actuators_speed"),
             "thrust": ("robot.actuators.sensors_thrust", "plant.sensors.thrust"),
             "steer": ("robot.actuators.sensors_steer", "plant.sensors.steer")}  # fmt: skip
    files = {name: tmp_path / f"{name}.fmu" for name in ("robot", "plant")}
    data, scaled = write_system("system", files, [":".join(ends) for ends in names.values()])
    assert scaled == {
        ":".join(names["dist"]): "robot.sensors.actuators_dist is -1 to 1 for 0 to 10 m",
        ":".join(names["thrust"]): "robot.actuators.sensors_thrust is -1 to 1 for 0 to 100 N",
    }
    file = tmp_path / "system.ssp"
    file.write_bytes(data)
    by = {one.start[1]: one.transformation for one in read_system(file).connections}
    assert by["actuators.sensors_thrust"] == Linear(50.0, 50.0)
    assert by["actuators.dist"] == Linear(0.2, -1.0)
    system = Coupled(str(file), read_system(file), tmp_path / "unpacked", "gauss_seidel")
    system.begin({}, 0.0, 10.0)
    size = describe(file).step_size
    assert size is not None
    for step in range(3):
        system.step(step * size, size)
    assert np.float32(system.get(describe(file).variables["plant.actuators.dist"])) == run.best.fitness
    system.end()


def test_scaled_variables_say_so(tmp_path: Path) -> None:
    """Actuators have limits; two that are scaled in the same way are connected as they are."""
    specification = ALL["layered-direct"]
    known: dict[str, list[object]] = {}
    for which in ("sensor", "actuator"):
        others = int(specification[f"{which}s"]) - 1
        known[f"{which}_names"] = ["goal", *map(str, range(others))]
        known[f"{which}_ranges"] = [(0, 5, "km"), *[None] * others]
    made = replace(subject(specification), description=known)
    write(EXPORTERS.get("fmu3")().files(made, "robot"), tmp_path)
    file = tmp_path / "robot.fmu"
    variables = describe(file).variables
    actuator = variables["actuators.goal"]
    assert {variables["sensors.goal"].stands_for, actuator.stands_for} == {(0.0, 5.0, "km")}
    assert (actuator.minimum, actuator.maximum) == (-1, 1)
    assert write_system("pair", {"a": file, "b": file}, ["a.actuators.goal:b.sensors.goal"])[1] == {}


@pytest.mark.parametrize("unit", ["", "km"])
def test_a_variable_without_limits_is_converted_only_if_it_has_a_unit(unit: str, tmp_path: Path) -> None:
    """Without a unit, it may be a scaled one of an FMU of an earlier version, which does not say so."""
    specification = ALL["layered-direct"]
    known: dict[str, list[object]] = {}
    for which in ("sensor", "actuator"):
        count = int(specification[f"{which}s"])
        known[f"{which}_names"] = ["goal", *map(str, range(count - 1))]
        known[f"{which}_units"] = [unit, *[""] * (count - 1)]
    ranges = {"actuator_ranges": [(0, 5, "km"), *[None] * (int(specification["actuators"]) - 1)]}
    files = {name: tmp_path / f"{name}.fmu" for name in ("scaled", "other")}
    for name, description in (("scaled", known | ranges), ("other", known)):
        made = replace(subject(specification), description=description)
        write(EXPORTERS.get("fmu3")().files(made, name), tmp_path)
    sensor = describe(files["other"]).variables["sensors.goal"]
    assert (sensor.minimum, sensor.maximum, sensor.unit) == (None, None, unit)
    connection = "scaled.actuators.goal:other.sensors.goal"
    words = {connection: "scaled.actuators.goal is -1 to 1 for 0 to 5 km"} if unit else {}
    assert write_system("pair", files, [connection])[1] == words
