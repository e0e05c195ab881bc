"""The random number that machines and trees of modules sense, in FMUs: given by the importer, or drawn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.fmi1 import FMICallException

from swarmwright.export.exporting import write
from swarmwright.export.fmu_driver import Driver
from swarmwright.export.sequences import Sequences
from tests.python.export.fmus import FORMS, begin, exporter, got, instance, parameter, put, written
from tests.python.export.specifications import ALL, subject

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("form", FORMS)
def test_a_random_number_is_drawn_with_a_seed(form: str, tmp_path: Path) -> None:
    """From 0 to 1, another one in each sample, by the seed alone; it is kept with the state."""
    file = written("modules", form, tmp_path)
    variables = {one.name: one for one in read_model_description(str(file)).modelVariables}
    number, seed = variables["sensors.sensor_8"], variables["seed"]
    assert (float(number.min), float(number.max)) == (0.0, 1.0)
    assert (seed.causality, seed.start, seed.min) == ("parameter", "0", "0")
    assert "each step takes sensors.sensor_8; above 0: the FMU draws" in seed.description
    fmu = instance(file, tmp_path / "x")
    actuators = [one.valueReference for one in variables.values() if one.name.startswith("actuators.")]

    def onwards(begin: int) -> list[list[float]]:
        found = []
        for step in range(begin, 200):
            fmu.doStep(currentCommunicationPoint=float(step), communicationStepSize=1.0)
            found.append(got(fmu, [number.valueReference, *actuators]))
        return found

    runs = []
    for one in (1, 1, 2):
        parameter(fmu, seed.valueReference, one)
        begin(fmu)
        runs.append(onwards(0))
        fmu.reset()
    assert runs[0] == runs[1] != runs[2]
    drawn = np.array(runs[0])[:, 0]
    assert (drawn >= 0).all()
    assert (drawn < 1).all()
    assert len(set(drawn.tolist())) == 200
    assert abs(drawn.mean() - 0.5) < 0.1
    sensed = np.zeros((200, 9), np.float32)
    sensed[:, 8] = drawn
    expected = Sequences.compute(ALL["modules"], np.arange(200) == 0, sensed).actuators
    assert np.array(runs[0], np.float32)[:, 1:].tobytes() == expected.tobytes()
    parameter(fmu, seed.valueReference, 1)
    begin(fmu)
    for step in range(100):
        fmu.doStep(currentCommunicationPoint=float(step), communicationStepSize=1.0)
    state = fmu.getFMUstate() if form == "fmu" else fmu.getFMUState()
    assert onwards(100) == runs[0][100:]
    (fmu.setFMUstate if form == "fmu" else fmu.setFMUState)(state)
    assert onwards(100) == runs[0][100:]
    (fmu.freeFMUstate if form == "fmu" else fmu.freeFMUState)(state)
    fmu.freeInstance()


@pytest.mark.parametrize("form", FORMS)
def test_a_random_number_that_stays_the_same_is_warned_of_once(form: str, tmp_path: Path) -> None:
    with Driver(written("modules", form, tmp_path)) as driver:
        fmu, number = driver.instance._fmu, 2 + 8
        begin(fmu)
        said = []
        for step, value in enumerate([0.5, 0.5, 0.25, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]):
            driver.instance._last = ""
            put(fmu, [number], [value])
            fmu.doStep(currentCommunicationPoint=float(step), communicationStepSize=1.0)
            said.append(driver.instance._last)
        assert said[5].startswith("sensors.sensor_8 is the same in 3 successive samples: set a new random")
        assert not any(said[:5] + said[6:])
        with pytest.raises(FMICallException):
            parameter(fmu, 2 + 9 + 2, 1)
        assert driver.instance._last.startswith(
            "seed is a parameter: it can be set until initialization ends"
        )
        fmu.reset()
        for reference, value, words in (
            (13, -1, "seed must be 0 or above"),
            (12, 1, "to set: the variable with"),
        ):
            with pytest.raises(FMICallException):
                parameter(fmu, reference, value)
            assert words in driver.instance._last


@pytest.mark.parametrize("form", FORMS)
def test_only_random_numbers_have_a_seed(form: str, tmp_path: Path) -> None:
    file = written("mealy_fsm", form, tmp_path)
    assert "seed" not in [one.name for one in read_model_description(str(file)).modelVariables]
    named = replace(subject(ALL["mealy_fsm"]), description={"sensor_names": ["a", "b", "random"]})
    write(exporter(form).files(named, "robot"), tmp_path)
    variables = {one.name: one for one in read_model_description(str(file)).modelVariables}
    assert variables["seed"].causality == "parameter"
    assert (variables["sensors.random"].max, variables["sensors.a"].max) == ("1", None)
