"""What the scaled numbers of FMUs stand for, in the description and in what is exported."""

from dataclasses import replace
from pathlib import Path

import swarmwright
from swarmwright import Experiment, optimize
from swarmwright.export import EXPORTERS
from swarmwright.export.writing import write
from swarmwright.simulations import catalogue
from tests.python.export.specifications import ALL, subject


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
    described = catalogue.description(experiment.simulation)
    assert (described["sensor_units"], described["actuator_units"]) == (["", ""], ["", "rad"])
    run = optimize(experiment, servers="in-process", out=tmp_path / "run")
    swarmwright.export_controller(run, to="c", output=tmp_path / "robot", prefix="robot", verify=True)
    header = (tmp_path / "robot" / "robot.h").read_text()
    assert "actuators.dist, -1 to 1 for 0 to 10 m, scaled: " in header
    assert "sensors.thrust, -1 to 1 for 0 to 100 N */" in header
    assert "sensors.steer in rad, -1 to 1 */" in header
