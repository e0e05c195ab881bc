"""Controllers as FMUs, driven by FMPy: bits of the engine, samples in each period, states, mistakes."""

import io
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.build import build_platform_binary
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from swarmwright import InputError, RunError
from swarmwright.export import Subject
from swarmwright.export.exporting import write
from swarmwright.export.fmu_driver import Driver
from swarmwright.export.sequences import Sequences, draw_random_sequences, measure_difference
from tests.python.export.fmus import FORMS, KEEPS_STATE, begin, exporter, got, instance, put, written, zipped
from tests.python.export.specifications import ALL, hebbian, subject


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ALL)
def test_every_kind_has_the_same_bits(name: str, form: str, tmp_path: Path) -> None:
    file = written(name, form, tmp_path)
    sequences = draw_random_sequences(ALL[name], 30)
    assert measure_difference(sequences, exporter(form).run(tmp_path, "robot", sequences)) == (0.0, 0)
    assert validate_fmu(str(file)) == []


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_a_large_controller_needs_no_large_stack(form: str, tmp_path: Path) -> None:
    """A master may step it in a thread of its own; Hebbian controllers remember all their weights."""
    write(exporter(form).files(subject(hebbian(40, 1, 0.1)), "robot"), tmp_path)
    for name, content in zipped(tmp_path / "robot.fmu").items():
        if name.startswith("sources/"):
            (tmp_path / Path(name).name).write_bytes(content)
    frame = ["-Wframe-larger-than=4096", "-Werror"]  # bytes, less than the weights have
    done = subprocess.run(
        ["cc", "-std=c99", *frame, "-c", "robot_fmu.c", "-o", "robot_fmu.o"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_a_forgetful_or_wrong_one_is_found_out(form: str, tmp_path: Path) -> None:
    written(KEEPS_STATE, form, tmp_path)
    sequences = draw_random_sequences(ALL[KEEPS_STATE], 30, refused=False)
    always = np.ones_like(sequences.first)
    forgetful = Sequences(always, sequences.sensors, sequences.actuators, sequences.accepted)
    assert measure_difference(sequences, exporter(form).run(tmp_path, "robot", forgetful))[0] > 0.1
    accepts = draw_random_sequences(ALL[KEEPS_STATE], 300)
    assert not accepts.accepted.all()
    everything = Sequences(accepts.first, accepts.sensors, accepts.actuators, always[:1].repeat(len(accepts)))
    with pytest.raises(
        RunError,
        match=r"refused \(the step from .* s: sensors\..* is not a finite number, or beyond 32 bits; the",
    ):
        exporter(form).run(tmp_path, "robot", everything)


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_the_self_test(form: str, tmp_path: Path) -> None:
    for name in (KEEPS_STATE, "mealy_fsm", "modules"):
        written(name, form, tmp_path)
        assert exporter(form).self_test(tmp_path, "robot") == "robot_fmu_test.py"
    written("modules-other", form, tmp_path / "other")
    (tmp_path / "other" / "robot.fmu").replace(tmp_path / "robot.fmu")
    done = subprocess.run(
        [sys.executable, "robot_fmu_test.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "the actuators differ from those of the simulation" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("share", [0.25, 1.0, 3.0])
def test_it_samples_once_in_a_period_whatever_the_master_steps(
    form: str, share: float, tmp_path: Path
) -> None:
    """With a sum of 0.1 that drifts: 1,000 additions of 0.1 are not 100."""
    fmu = instance(written(KEEPS_STATE, form, tmp_path), tmp_path / "x")
    (fmu.setReal if form == "fmu" else fmu.setFloat64)([1], [0.1])
    begin(fmu)
    put(fmu, [2, 3, 4], [0.25, -0.5, 0.75])
    samples = 300
    time, size = 0.0, 0.1 * share
    for _ in range(round(samples / share)):
        fmu.doStep(currentCommunicationPoint=time, communicationStepSize=size)
        time += size
    first = np.zeros(samples, np.bool_)
    first[0] = True
    sensed = np.tile(np.array([0.25, -0.5, 0.75], np.float32), (samples, 1))
    expected = Sequences.compute(ALL[KEEPS_STATE], first, sensed).actuators[-1]
    assert np.array(got(fmu, [5, 6]), np.float32).tobytes() == expected.tobytes()
    fmu.terminate()
    fmu.freeInstance()


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_states_are_kept_set_and_serialized(form: str, tmp_path: Path) -> None:
    fmu = instance(written(KEEPS_STATE, form, tmp_path), tmp_path / "x")
    begin(fmu)

    def onwards() -> list[list[float]]:
        found = []
        for step in range(4, 8):
            put(fmu, [2, 3, 4], [0.1 * step, -0.2, 0.3])
            fmu.doStep(currentCommunicationPoint=float(step), communicationStepSize=1.0)
            found.append(got(fmu, [5, 6]))
        return found

    put(fmu, [2, 3, 4], [0.5, 0.5, -0.5])
    for step in range(4):
        fmu.doStep(currentCommunicationPoint=float(step), communicationStepSize=1.0)
    state = fmu.getFMUstate() if form == "fmu" else fmu.getFMUState()
    data = fmu.serializeFMUstate(state) if form == "fmu" else fmu.serializeFMUState(state)
    expected = onwards()
    (fmu.setFMUstate if form == "fmu" else fmu.setFMUState)(state)
    assert onwards() == expected
    fmu.reset()
    begin(fmu)
    assert got(fmu, [2, 3, 4, 5, 6]) == [0.0] * 5
    read = fmu.deSerializeFMUstate(data) if form == "fmu" else fmu.deserializeFMUState(data)
    (fmu.setFMUstate if form == "fmu" else fmu.setFMUState)(read)
    assert onwards() == expected
    for one in (state, read):
        (fmu.freeFMUstate if form == "fmu" else fmu.freeFMUState)(one)
    fmu.freeInstance()


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_instances_are_apart(form: str, tmp_path: Path) -> None:
    """One for each agent of a swarm, of one library."""
    file = written(KEEPS_STATE, form, tmp_path)
    agents = [instance(file, tmp_path / str(index)) for index in range(3)]
    found = []
    for index, agent in enumerate(agents):
        begin(agent)
        put(agent, [2, 3, 4], [0.3 * index, 0.1, 0.2])
    for step in range(5):
        for agent in agents:
            agent.doStep(currentCommunicationPoint=float(step), communicationStepSize=1.0)
    for agent in agents:
        found.append(got(agent, [5, 6]))
        agent.freeInstance()
    first = np.arange(5) == 0
    for index, actuators in enumerate(found):
        sensed = np.tile(np.array([0.3 * index, 0.1, 0.2], np.float32), (5, 1))
        assert (
            np.array(actuators, np.float32).tolist()
            == Sequences.compute(ALL[KEEPS_STATE], first, sensed).actuators[-1].tolist()
        )


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_mistakes_of_masters_are_errors(form: str, tmp_path: Path) -> None:
    file = written(KEEPS_STATE, form, tmp_path)
    with Driver(file) as driver:
        instance = driver.instance
        fmu = instance._fmu
        set_period = fmu.setReal if form == "fmu" else fmu.setFloat64
        for value, said in ((0.0, "above 0"), (-1.0, "above 0"), (float("nan"), "above 0")):
            with pytest.raises(FMICallException):
                set_period([1], [value])
            assert said in instance._last
        begin(fmu)
        with pytest.raises(FMICallException):
            set_period([1], [2.0])
        assert instance._last == (
            "period is a parameter: it can be set until initialization ends, and again after a reset"
        )
        for references in ([5], [99]):
            with pytest.raises(FMICallException):
                put(fmu, references, [1.0])
            assert instance._last.endswith(f"to set: the variable with the value reference {references[0]}")
        with pytest.raises(FMICallException):
            got(fmu, [99])
        for size in (-1.0, float("inf")):
            with pytest.raises(FMICallException):
                fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=size)
            assert "must have a finite time and a size of at least 0 s" in instance._last
        fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=1.0)
        data = (
            fmu.serializeFMUstate(fmu.getFMUstate())
            if form == "fmu"
            else fmu.serializeFMUState(fmu.getFMUState())
        )
        damaged = data[:-1] + bytes([data[-1] ^ 1])
        foreign = bytes(len(data))
        for wrong, said in ((foreign, "of this FMU"), (data[:-1], "of this FMU"), (damaged, "checksum")):
            with pytest.raises(FMICallException):
                (fmu.deSerializeFMUstate if form == "fmu" else fmu.deserializeFMUState)(wrong)
            assert said in instance._last
        if form == "fmu":  # whose numbers have 64 bits
            put(fmu, [2], [1e300])
            with pytest.raises(FMICallException):
                fmu.doStep(currentCommunicationPoint=1.0, communicationStepSize=1.0)
            assert "beyond 32 bits" in instance._last
    text = zipped(file)
    other = tmp_path / "other.fmu"
    token = read_model_description(str(file)).guid.encode()
    text["modelDescription.xml"] = text["modelDescription.xml"].replace(token, b"{another}")
    with zipfile.ZipFile(other, "w") as archive:
        for name, content in text.items():
            archive.writestr(name, content)
    with pytest.raises(RunError, match=r"FMPy cannot use other\.fmu"), Driver(other):
        pass


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_steps_that_do_not_begin_where_the_last_one_ended_are_errors(form: str, tmp_path: Path) -> None:
    """A gap of hours would take samples for hours; a step that is repeated or goes back would take none."""
    with Driver(written(KEEPS_STATE, form, tmp_path)) as driver:
        fmu = driver.instance._fmu

        def refused(time: float, size: float, said: str) -> None:
            with pytest.raises(FMICallException):
                fmu.doStep(currentCommunicationPoint=time, communicationStepSize=size)
            assert driver.instance._last == f"the step begins at {said} s"

        begin(fmu)
        refused(1e15, 1.0, "1e+15 s, the start time that was set up is 0")
        put(fmu, [2, 3, 4], [0.5, 0.5, -0.5])
        fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=1.0)
        once = got(fmu, [5, 6])
        for time in (0.0, 0.9, 1.1, 1e7, -1.0):
            refused(time, 1.0, f"{time:.15g} s, the last one ended at 1")
        refused(1.0005, 0.001, "1.0005 s, the last one ended at 1")
        assert got(fmu, [5, 6]) == once
        fmu.doStep(currentCommunicationPoint=1.0005, communicationStepSize=1.0)  # within a thousandth
        refused(1.0, 1.0, "1 s, the last one ended at 2.0005")


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_a_start_in_unix_time_leaves_room_for_rounding(form: str, tmp_path: Path) -> None:
    fmu = instance(written(KEEPS_STATE, form, tmp_path), tmp_path / "x")
    start = 1.7e9
    if form == "fmu":
        fmu.setupExperiment(startTime=start)
        fmu.enterInitializationMode()
    else:
        fmu.enterInitializationMode(startTime=start)
    fmu.exitInitializationMode()
    for step in range(300):  # the time is a multiple, not a sum
        fmu.doStep(currentCommunicationPoint=start + step * 0.001, communicationStepSize=0.001)
    fmu.freeInstance()


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_a_discarded_step_over_several_periods_changes_nothing(form: str, tmp_path: Path) -> None:
    """A node overflows in the third sample."""
    known = ALL["fully_meshed-relu-10"]
    weights = np.random.default_rng(0).uniform(-100, 100, len(known["weights"])).astype(np.float32)
    specification = {**known, "weights": weights.tolist()}
    write(exporter(form).files(subject(specification), "robot"), tmp_path)
    with Driver(tmp_path / "robot.fmu") as driver:
        fmu = driver.instance._fmu
        begin(fmu)

        def state() -> bytes:
            suffix = "state" if form == "fmu" else "State"
            kept = getattr(fmu, f"getFMU{suffix}")()
            data: bytes = getattr(fmu, f"serializeFMU{suffix}")(kept)
            getattr(fmu, f"freeFMU{suffix}")(kept)
            return data

        put(fmu, [2, 3, 4], [1e30] * 3)
        before = state()
        with pytest.raises(FMICallException) as refused:
            fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=30.0)
        assert refused.value.status == 2  # discard
        assert driver.instance._last == "the step was not made: a node overflows, sensors are too large"
        assert state() == before
        fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=1.0)
        assert any(got(fmu, [5, 6]))


@pytest.mark.slow
def test_event_mode_that_is_not_announced_is_refused(tmp_path: Path) -> None:
    file = written(KEEPS_STATE, "fmu3", tmp_path)
    description = read_model_description(str(file))
    extract(str(file), str(tmp_path / "x"))
    fmu = FMU3Slave(
        guid=description.guid,
        unzipDirectory=str(tmp_path / "x"),
        modelIdentifier="robot",
        instanceName="tested",
    )
    said: list[bytes] = []
    with pytest.raises(Exception, match="Failed to instantiate"):
        fmu.instantiate(eventModeUsed=True, logMessage=lambda *about: said.append(about[3]))
    assert said == [b"this FMU has no event mode; instantiate it without"]


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_calls_that_do_not_belong_to_a_phase_are_errors(form: str, tmp_path: Path) -> None:
    """FMI 2.0.4, section 4.2.4; FMI 3.0.1, section 2.3."""
    name = "fmi2" if form == "fmu" else "fmi3"
    with Driver(written(KEEPS_STATE, form, tmp_path)) as driver:
        fmu = driver.instance._fmu

        def step(time: float = 0.0) -> None:
            fmu.doStep(currentCommunicationPoint=time, communicationStepSize=1.0)

        def enter(stop: float | None = None) -> None:
            if form == "fmu":
                fmu.setupExperiment(startTime=0.0, stopTime=stop)
                fmu.enterInitializationMode()
            else:
                fmu.enterInitializationMode(startTime=0.0, stopTime=stop)

        def refused(call: Callable[[], object], said: str) -> None:
            with pytest.raises(FMICallException):
                call()
            assert driver.instance._last == said

        belongs = "but belongs between initialization and termination"
        early = "is called before initialization"
        refused(step, f"{name}DoStep {early}, {belongs}")
        refused(fmu.terminate, f"{name}Terminate {early}, {belongs}")
        refused(
            fmu.exitInitializationMode,
            f"{name}ExitInitializationMode {early}, but belongs in initialization mode",
        )
        enter(2.0)
        refused(
            fmu.enterInitializationMode,
            f"{name}EnterInitializationMode is called in initialization mode, but belongs before "
            "initialization",
        )
        refused(step, f"{name}DoStep is called in initialization mode, {belongs}")
        fmu.exitInitializationMode()
        step()
        step(1.0 + 1e-12)  # rounding errors of the master's sum
        refused(lambda: step(2.0), "the step goes past the stop time that was set up")
        fmu.terminate()
        refused(step, f"{name}DoStep is called after termination, {belongs}")
        refused(fmu.terminate, f"{name}Terminate is called after termination, {belongs}")
        fmu.reset()
        enter()
        fmu.exitInitializationMode()
        for time in range(4):
            step(float(time))


@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # FMPy's temporary folder
@pytest.mark.parametrize("form", FORMS)
def test_the_sources_in_it_are_built_by_others(form: str, tmp_path: Path) -> None:
    """FMPy's own build, with CMake and the standard's headers, in the place of our library."""
    file = written("layered-tanh-0", form, tmp_path)
    folder = tmp_path / "x"
    extract(str(file), str(folder))
    shutil.rmtree(folder / "binaries")
    build_platform_binary(folder)
    with zipfile.ZipFile(file, "w") as archive:
        for one in folder.rglob("*"):
            archive.write(one, one.relative_to(folder))
    sequences = draw_random_sequences(ALL["layered-tanh-0"], 30)
    assert measure_difference(sequences, exporter(form).run(tmp_path, "robot", sequences)) == (0.0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_another_master(form: str, tmp_path: Path) -> None:
    """FMPy's simulation with a table of inputs, by the names of the variables."""
    file = written("layered-tanh-0", form, tmp_path)
    names = [one.name for one in read_model_description(str(file)).modelVariables]
    inputs = [name for name in names if name.startswith("sensors.")]
    outputs = [name for name in names if name.startswith("actuators.")]
    assert (len(inputs), len(outputs)) == (3, 2)
    signals = np.zeros(10, [("time", float), *((name, float) for name in inputs)])
    signals["time"] = np.arange(10)
    sensed = np.random.default_rng(1).uniform(-1, 1, (10, 3)).astype(np.float32)
    for index, name in enumerate(inputs):
        signals[name] = sensed[:, index]
    result = simulate_fmu(str(file), stop_time=9, output_interval=1, input=signals, output=outputs)
    expected = Sequences.compute(ALL["layered-tanh-0"], np.arange(10) == 0, sensed).actuators
    found = np.column_stack([result[name] for name in outputs]).astype(np.float32)
    assert found[0].tolist() == [0.0, 0.0]
    # FMPy interpolates discrete inputs as held; what is sampled at t is there after the step from t.
    assert found[1:].tobytes() == expected[: len(found) - 1].tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_a_step_of_very_many_periods_is_an_error(form: str, tmp_path: Path) -> None:
    """It would compute for hours, and no master can interrupt it."""
    with Driver(written("mealy_fsm", form, tmp_path)) as driver:
        fmu = driver.instance._fmu
        (fmu.setReal if form == "fmu" else fmu.setFloat64)([1], [1e-300])
        begin(fmu)
        with pytest.raises(FMICallException):
            fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=1e-3)
        assert driver.instance._last == (
            "the step is one of 1e+297 periods of 1e-300 s, expected at most 1000000"
        )
        fmu.reset()
        begin(fmu)
        with pytest.raises(FMICallException):
            fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=1e7)
        fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=1e6)


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_a_master_that_takes_such_steps_ends(form: str, tmp_path: Path) -> None:
    """FMPy repeats a step of FMI 2.0 that is discarded."""
    code = "import fmpy, sys; fmpy.simulate_fmu(sys.argv[1], stop_time=4e6, output_interval=2e6)"
    arguments = [sys.executable, "-c", code, str(written("mealy_fsm", form, tmp_path))]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1
    assert "FMICallException" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_one_without_a_library_is_the_same_for_every_machine(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, name = subject(ALL["mealy_fsm"]), "robot_fmu_test.py"
    with monkeypatch.context() as patched:
        patched.setenv("CC", "/no/such/compiler")  # which it does not need
        write(exporter(form).portable().files(made, "robot"), tmp_path)
    inside = zipped(tmp_path / "robot.fmu")
    assert not [one for one in inside if one.startswith("binaries/")]
    done = subprocess.run([sys.executable, name], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "robot.fmu holds its C source alone: fmpy compile robot.fmu\n"
    sequences = draw_random_sequences(ALL["mealy_fsm"], 30)
    assert measure_difference(sequences, exporter(form).portable().run(tmp_path, "robot", sequences)) == (
        0.0,
        0,
    )
    assert exporter(form).portable().self_test(tmp_path, "robot") == name
    whole = zipped(tmp_path / "robot.fmu")
    write(exporter(form).files(made, "robot"), tmp_path)
    assert whole == zipped(tmp_path / "robot.fmu")


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_what_the_description_says(form: str, tmp_path: Path) -> None:
    file = written("mealy_fsm", form, tmp_path)
    description = read_model_description(str(file))
    assert description.fmiVersion == ("2.0" if form == "fmu" else "3.0")
    assert description.generationTool.startswith("Swarmwright ")
    assert description.coSimulation.canHandleVariableCommunicationStepSize
    variables = {one.name: one for one in description.modelVariables}
    assert variables["period"].unit == "s"
    assert float(variables["period"].start) == float(description.defaultExperiment.stepSize) > 0
    root = ET.fromstring(zipped(file)["modelDescription.xml"])
    assert root.find("CoSimulation") is not None
    page = zipped(file)["documentation/index.html"].decode()
    assert all(name in page for name in variables if "." in name)


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_names_and_units_are_those_of_the_simulation(form: str, tmp_path: Path) -> None:
    names = ["gr\u00f6\u00dfe", 'a\\ "<&>" */', "bell \x07"]
    described = {"sensor_names": names, "sensor_units": ["\N{DEGREE SIGN}", "\N{DEGREE SIGN}/s", "a\nb"]}
    made = replace(subject(ALL[KEEPS_STATE]), description=described)
    write(exporter(form).files(made, "robot"), tmp_path)
    assert validate_fmu(str(tmp_path / "robot.fmu")) == []
    description = read_model_description(str(tmp_path / "robot.fmu"))
    inputs = [one for one in description.modelVariables if one.causality == "input"]
    assert [one.description for one in inputs] == [
        f"{name}, any finite number" for name in [*names[:2], "bell \N{REPLACEMENT CHARACTER}"]
    ]
    assert [one.unit for one in inputs] == ["deg", "deg/s", "a b"]
    (degrees,) = [one for one in description.unitDefinitions if one.name == "deg"]
    assert (degrees.baseUnit.rad, float(degrees.baseUnit.factor)) == (1, np.deg2rad(1.0))


@pytest.mark.slow
def test_units_are_defined_however_they_are_written(tmp_path: Path) -> None:
    units = {
        "m/s²": ({"m": 1, "s": -2}, 1.0),
        "N·m": ({"kg": 1, "m": 2, "s": -2}, 1.0),
        "kΩ": ({"kg": 1, "m": 2, "s": -3, "A": -2}, 1e3),
        "µT": ({"kg": 1, "s": -2, "A": -1}, 1e-6),
        "%": ({}, 0.01),
        "mm": ({"m": 1}, 1e-3),
        "g": ({}, 1.0),
        "mg": ({}, 1.0),
        "deg": ({"rad": 1}, np.deg2rad(1.0)),
    }
    for first in (0, 3, 6):
        names = [*units][first : first + 3]
        made = replace(subject(ALL[KEEPS_STATE]), description={"sensor_units": names})
        write(exporter("fmu3").files(made, "robot"), tmp_path)
        assert validate_fmu(str(tmp_path / "robot.fmu")) == []
        found = {
            one.name: one.baseUnit
            for one in read_model_description(str(tmp_path / "robot.fmu")).unitDefinitions
        }
        for name in names:
            if name in ("g", "mg"):  # grams to some, the acceleration of gravity to others
                assert found[name] is None
                continue
            exponents, factor = units[name]
            assert float(found[name].factor) == factor
            for base in ("kg", "m", "s", "A", "rad"):
                assert getattr(found[name], base) == exponents.get(base, 0)


@pytest.mark.slow
def test_the_same_bytes_and_not_over_the_files_of_others(tmp_path: Path) -> None:
    made = [exporter("fmu").files(subject(ALL["mealy_fsm"]), "robot") for _ in range(2)]
    assert made[0] == made[1]
    write(made[0], tmp_path)
    write(made[0], tmp_path)  # over its own
    foreign = io.BytesIO()
    with zipfile.ZipFile(foreign, "w") as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription/>")
    (tmp_path / "robot.fmu").write_bytes(foreign.getvalue())
    with pytest.raises(InputError, match=r"robot\.fmu: already exists and was not exported by Swarmwright"):
        write(made[0], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_the_library_is_in_the_folder_of_the_machine_it_is_for(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With -m32 a compiler names the machine for which it writes without that option."""
    compiler = tmp_path / "cc32"
    compiler.write_text(
        "#!/bin/sh\n"
        'case "$*" in *-dumpmachine*) echo x86_64-linux-gnu;;\n'
        '*-E*) echo "machine: x86";;\n'
        '*) while [ "$1" != -o ]; do shift; done; echo library > "$2";; esac\n'
    )
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", f"{compiler} -m32")
    written("mealy_fsm", form, tmp_path)
    names = [name for name in zipped(tmp_path / "robot.fmu") if name.startswith("binaries/")]
    assert names == [f"binaries/{'linux32' if form == 'fmu' else 'x86-linux'}/robot.so"]
    monkeypatch.setenv("CC", "false")
    with pytest.raises(InputError, match="false: compiles for an unknown machine"):
        written("mealy_fsm", form, tmp_path)


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made = subject(ALL["mealy_fsm"])
    with pytest.raises(InputError, match="a parameter set has no inputs and outputs for an FMU"):
        exporter("fmu").files(Subject({"kind": "parameter_set"}), "robot")
    monkeypatch.setenv("CC", "/no/such/compiler")
    with pytest.raises(InputError, match="CC=/no/such/compiler: program not found"):
        exporter("fmu").files(made, "robot")
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="the library of an FMU needs cc, which is not installed"):
        exporter("fmu").files(made, "robot")
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(InputError, match=r"needs FMPy: pip install 'swarmwright\[fmi\]'"):
        exporter("fmu").run(tmp_path, "robot", draw_random_sequences(ALL["mealy_fsm"], 1))
