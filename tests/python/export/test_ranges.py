"""Sensors and actuators that a simulation scales: every form says what -1 and 1 stand for."""

import io
import re
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import onnx
import pytest
import yaml
from fmpy import read_model_description
from fmpy.validation import validate_fmu

from swarmwright import Experiment
from swarmwright.controllers.scxml import read
from swarmwright.export import EXPORTERS, Subject
from swarmwright.export.exporting import write
from swarmwright.export.simulation_fmu import Address, proxy_model
from swarmwright.export.verification import verify
from tests.python.export.specifications import ALL, subject

NAME = "fully_meshed-tanh-6"
RANGES: dict[str, Any] = {
    "sensor_names": ["dist", "speed", "goal x"],
    "actuator_names": ["thrust", "heading"],
    "sensor_units": ["m", "", "m"],
    "sensor_ranges": [(0, 10), [-2e-7, 2e-7, "m/s"], None],
    "actuator_ranges": [(0, 100, "N"), None],
}
DIST, SPEED, THRUST = (
    "-1 to 1 for 0 to 10 m",
    "-1 to 1 for -2e-07 to 2e-07 m/s",
    "-1 to 1 for 0 to 100 N",
)
CONVERSION = "VALUE = LOW + (X + 1) / 2 * (HIGH - LOW)"


def scaled(name: str = NAME, **changes: Any) -> Subject:
    return replace(subject(ALL[name]), description={**RANGES, **changes})


def texts(form: str, made: Subject) -> dict[str, str]:
    files = EXPORTERS.get(form)().files(made, "robot")
    return {name: text for name, text in files.items() if isinstance(text, str)}


@pytest.mark.parametrize(
    ("form", "file", "dist", "thrust"),
    [
        ("c", "robot.h", f"dist, {DIST} */", f"thrust, {THRUST} */"),
        ("cpp", "robot.hpp", f"dist, {DIST} */", f"thrust, {THRUST} */"),
        ("c", "robot_arduino/robot_arduino.ino", f"dist: {DIST} */", f"thrust: {THRUST} */"),
        ("python", "robot.py", f'"dist",  # {DIST}', f'"thrust",  # {THRUST}'),
        ("micropython", "robot.py", f'"dist",  # {DIST}', f'"thrust",  # {THRUST}'),
        ("ros1", "config/mapping.template.yaml", f'"dist"            # {DIST}', f"# {THRUST}"),
    ],
)
def test_sources_say_it(form: str, file: str, dist: str, thrust: str) -> None:
    text = texts(form, scaled())[file]
    assert dist in text
    assert thrust in text
    assert (CONVERSION in text) == (file in ("robot.h", "robot.hpp", "robot.py"))
    plain = texts(form, subject(ALL[NAME]))[file]
    assert not re.search("1 for|LOW \\+", plain)


def test_state_machines_say_it(tmp_path: Path) -> None:
    text = texts("scxml", scaled("mealy_fsm"))["robot.scxml"]
    assert f"dist: {DIST}\n" in text
    assert CONVERSION in text
    (tmp_path / "robot.scxml").write_text(text)
    assert read(tmp_path / "robot.scxml").specification()


@pytest.mark.slow
@pytest.mark.parametrize("form", ["fmu", "fmu3"])
def test_fmus_say_it_and_scaled_variables_have_no_unit(form: str, tmp_path: Path) -> None:
    write(EXPORTERS.get(form)().files(scaled(), "robot"), tmp_path)
    file = str(tmp_path / "robot.fmu")
    assert validate_fmu(file) == []
    description = read_model_description(file)
    known = {one.name: (one.description, one.unit) for one in description.modelVariables}
    assert known["sensors.dist"] == (f"dist, {DIST}", None)
    assert known["sensors.goal_x"] == ("goal x, any finite number", "m")
    assert known["actuators.thrust"] == (f"thrust, {THRUST}", None)
    assert known["actuators.heading"] == ("heading, -1 to 1", None)
    assert CONVERSION in description.description
    page = zipfile.ZipFile(file).read("documentation/index.html").decode()
    assert CONVERSION in page
    assert f"thrust, {THRUST}" in page


def test_metadata_of_models_says_it() -> None:
    data = EXPORTERS.get("onnx")().files(scaled(), "robot")["robot.onnx"]
    assert isinstance(data, bytes)
    known = {one.key: one.value for one in onnx.load(io.BytesIO(data)).metadata_props}
    assert known["sensors"].startswith(f"dist ({DIST}), speed ({SPEED}), goal x in m (")
    assert known["actuators"] == f"thrust ({THRUST}), heading (-1 to 1)"
    assert CONVERSION in known["conversion"]


@pytest.mark.parametrize("form", ["ros1", "ros2"])
def test_mappings_convert(form: str) -> None:
    text = texts(form, scaled())["config/mapping.template.yaml"]
    mapping = yaml.safe_load(text)
    sensors = {one["sensor"]: one for one in mapping["sensors"]}
    actuators = {one["actuator"]: one for one in mapping["actuators"]}
    assert (sensors["dist"]["scale"], sensors["dist"]["offset"]) == (0.2, -1)
    # Readers of YAML 1.1 take 1e-07 for text.
    assert (sensors["speed"]["scale"], sensors["speed"]["offset"]) == (5_000_000.0, 0)
    assert (actuators["thrust"]["scale"], actuators["thrust"]["offset"]) == (50, 50)
    assert "scale" not in sensors["goal x"]
    assert "scale and offset convert" in text
    tiny = texts(form, scaled(actuator_ranges=[(0, 2e-20), None]))["config/mapping.template.yaml"]
    assert yaml.safe_load(tiny)["actuators"][0]["scale"] == 1e-20


def test_topics_on_which_a_controller_was_evolved_stay_as_they_are() -> None:
    known = {"sensor": "dist", "topic": "range", "type": "sensor_msgs/Range", "scale": 3.0}
    made = replace(scaled(), topics={"sensors": [known]})
    mapping = yaml.safe_load(texts("ros2", made)["config/mapping.template.yaml"])
    assert mapping["sensors"][0] == known
    assert mapping["sensors"][1]["scale"] == pytest.approx(5e6)


def test_what_a_sender_writes_cannot_leave_a_comment() -> None:
    unit = "*/ int x; /* \n import os\u2028 --> <x/>"
    made = scaled("mealy_fsm", actuator_ranges=[(0, 1, unit), (0, 1)], actuator_units=["", unit])
    for form in ("c", "cpp"):
        assert all("*/ int x" not in text for text in texts(form, made).values())
    for form, file in (("python", "robot.py"), ("ros2", "config/mapping.template.yaml")):
        assert not re.search("^ *import os|\u2028", texts(form, made)[file], re.MULTILINE)
    assert "-->\n<scxml" in texts("scxml", made)["robot.scxml"].replace(" -->", "")
    for wrong in ([(0, 0), None], [(0, 10**400), None], "ab", [[0, 1, 2, 3], None]):
        with pytest.raises(ValueError, match="found, expected"):
            texts("c", scaled(actuator_ranges=wrong))


@pytest.mark.slow
def test_the_controller_is_the_same() -> None:
    made = scaled()
    exporter = EXPORTERS.get("c")()
    files = exporter.files(made, "robot")
    assert files["robot.c"] == exporter.files(subject(ALL[NAME]), "robot")["robot.c"]
    assert verify(exporter, made, "robot", files).ok


PLANT = """
from swarmwright import Simulation

class Plant(Simulation):
    sensors, actuators = 2, 1
    sensor_names, sensor_units, sensor_ranges = ["dist", "speed"], ["m", "m/s"], [(0, 10), None]
    actuator_names, actuator_ranges = ["thrust"], [(0, 100, "N")]

    def reset(self, parameters, seed):
        return [[0.0, 0.0]]

    def step(self, actions):
        return [[0.0, 0.0]]

    def done(self):
        return False

    def fitness(self):
        return 0.0
"""


def test_proxies_of_simulations_say_it(tmp_path: Path) -> None:
    (tmp_path / "plant.py").write_text(PLANT)
    experiment = Experiment.from_mapping({"simulation": f"{tmp_path}/plant.py:Plant"})
    model = proxy_model(experiment, Address("mqtt://localhost"))
    known = {one.name: (one.description, one.unit) for one in model.variables()}
    assert known["agent[1].sensors.dist"] == ("dist, -1 to 1 for 0 to 10 m", "")
    assert known["agent[1].sensors.speed"] == ("speed", "m/s")
    assert known["agent[1].actuators.thrust"] == ("thrust, -1 to 1 for 0 to 100 N", "")
