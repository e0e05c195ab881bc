"""Built-in simulations as FMUs: FMPy gets the engine's bits, and attached back they give the same record."""

import io
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from swarmwright import Experiment, InputError, _engine, optimize
from swarmwright.cli._commands import program
from swarmwright.export import simulation_fmu as module
from swarmwright.export.exporting import export_controller
from swarmwright.export.fmu import name_variables
from swarmwright.export.simulation_fmu import LIBRARY, Model, build_simulation_fmu
from swarmwright.simulations import catalogue
from swarmwright.simulations.fmu.program import Coupled
from swarmwright.simulations.fmu.ssp import describe, read_system, write_system
from tests.fmus import Driven, driving

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not LIBRARY.exists(), reason="engine/bindings/fmi is not built: make fmi"),
]

CASES: dict[str, dict[str, Any]] = {
    "minisim": {"numAgents": 3, "placement": "random", "speedDefenders": 0.4},
    "emergency_exit": {"numAgents": 4, "width": 9, "height": 8, "numBlockades": 5, "steps": 6},
    "arena": {"robots": 3, "duration": 3},
}
MISSION = {
    "walls": {"rectangle": [4, 3]},
    "start": {"disc": {"radius": 1}},
    "fitness": "order",
}
GROUPS = {**CASES["minisim"], "numDefenders": 2, "defenderSteering": "controller"}
"""Two kinds of agents, whose sensors have names of their own."""


@contextmanager
def driven(folder: Path, title: str, parameters: dict[str, Any], fmi: str) -> Iterator[Driven]:
    file = folder / "world.fmu"
    file.write_bytes(build_simulation_fmu(title, parameters, fmi=fmi, name="world"))
    assert validate_fmu(str(file)) == []
    with driving(file) as world:
        yield world


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize(("title", "parameters"), [*CASES.items(), ("minisim", GROUPS)])
def test_every_step_is_that_of_the_engine(
    title: str, parameters: dict[str, Any], fmi: str, tmp_path: Path
) -> None:
    """Sensors, who acts, fitness and metrics to the bit, in two episodes; a state takes back to it."""
    about = catalogue.description(title, parameters)
    kinds = [
        (group.agents, group.sensor_names, group.actuator_names)
        for group in catalogue.groups(title, parameters)
    ] or [(100, about["sensor_names"], about["actuator_names"])]
    channels = [
        (name_variables("sensors", sensors), name_variables("actuators", actuators))
        for count, sensors, actuators in kinds
        for _ in range(count)
    ]
    with driven(tmp_path, title, parameters, fmi) as world:
        for seed in (5, 6):
            world.begin(seed)
            episode = _engine.Episodes(title, parameters, [seed])
            random, made, state = np.random.default_rng(seed), 0, b""
            while not episode.done:
                assert not world.flag("done")
                _, agents, sensed = episode.acting()
                for agent, row in zip(agents, sensed, strict=True):
                    assert world.flag(f"agent[{agent + 1}].acts")
                    found = world.singles([f"agent[{agent + 1}].{name}" for name in channels[agent][0]])
                    assert np.array_equal(np.array(found, np.float32), row)
                moves = random.uniform(-1, 1, (len(agents), about["actuators"])).astype(np.float32)
                for agent, row in zip(agents, moves, strict=True):
                    names = [f"agent[{agent + 1}].{name}" for name in channels[agent][1]]
                    world.put(names, [float(one) for one in row])
                if made == 2:
                    kept = world.fmu.getFMUState()
                    state = world.fmu.serializeFMUState(kept)
                    world.fmu.freeFMUState(kept)
                    then = episode.fitness()[0], world.double("fitness")
                episode.step(moves)
                world.step(made)
                made += 1
            assert world.flag("done")
            assert world.double("fitness") == episode.fitness()[0]
            metrics = [world.double(f"metrics.{name}") for name in episode.metric_names]
            assert np.array_equal(metrics, episode.metrics(list(episode.metric_names))[0], equal_nan=True)
            world.step(made)  # nothing changes
            assert world.double("fitness") == episode.fitness()[0]
            kept = world.fmu.deserializeFMUState(state)
            world.fmu.setFMUState(kept)
            assert world.double("fitness") == then[0] == then[1]
            assert not world.flag("done")
            world.fmu.freeFMUState(kept)
            world.fmu.reset()


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_attached_back_it_gives_the_same_record(fmi: str, tmp_path: Path) -> None:
    """Three agents that start at random; parameters are set at the export and by the experiment."""
    file = tmp_path / "server.fmu"
    file.write_bytes(build_simulation_fmu("minisim", CASES["minisim"], fmi=fmi, name="server"))
    records = []
    for simulation, parameters in (("minisim", CASES["minisim"]), (str(file), {})):
        experiment = Experiment.from_mapping(
            {
                "simulation": simulation,
                "parameters": {**parameters, "maxSteps": 9, "seed": 4},
                "method": {"kind": "nnga", "population": 4, "generations": 2},
                "controller": {"kind": "fully_meshed", "hidden": 2},
                "ranking": {"episodes": 2},
                "fitness": "fitness + arrived - 0.1 * distance - 0.01 * steps",
                "servers": "in-process",
            }
        )
        record = optimize(experiment, out=tmp_path / Path(simulation).stem).record
        records.append([np.array(one) for one in (record.fitness, record.metrics, record.genomes)])
    assert all(np.array_equal(one, other) for one, other in zip(*records, strict=True))
    assert records[0][1].shape[1:] == (2, 3)


def test_coupled_with_controllers_it_gives_the_fitness_of_the_run(tmp_path: Path) -> None:
    """A system of the world and an exported controller for each agent needs no further program."""
    parameters = {"numAgents": 2, "speedDefenders": 0.4}
    experiment = Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": parameters,
            "method": {"kind": "nnga", "population": 4, "generations": 2},
        }
    )
    run = optimize(experiment, out=tmp_path / "run")
    export_controller(run.path, to="fmu", output=tmp_path, prefix="robot")
    (tmp_path / "world.fmu").write_bytes(build_simulation_fmu("minisim", parameters, fmi="3.0", name="world"))
    about = catalogue.description("minisim")
    names = [
        *name_variables("sensors", about["sensor_names"]),
        *name_variables("actuators", about["actuator_names"]),
    ]
    ends = [(f"world.agent[{n}].{name}", f"robot{n}.{name}") for n in (1, 2) for name in names]
    connections = [
        f"{robot}:{world}" if ".actuators." in world else f"{world}:{robot}" for world, robot in ends
    ]
    files = {name: tmp_path / f"{name.rstrip('12')}.fmu" for name in ("robot1", "robot2", "world")}
    file = tmp_path / "system.ssp"
    file.write_bytes(write_system("system", files, connections)[0])
    system = Coupled(str(file), read_system(file), tmp_path / "unpacked", "gauss_seidel")
    assert describe(file).stop_time is None  # the world says it by its output
    variables, step = describe(file).variables, 0
    system.begin({}, 0.0, 10.0)
    while not system.get(variables["world.done"]):
        system.step(step * 0.25, 0.25)
        step += 1
    assert system.get(variables["world.fitness"]) == run.best.fitness
    system.end()


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_steps_that_do_not_begin_where_the_last_one_ended_are_errors(fmi: str, tmp_path: Path) -> None:
    """A gap would end the episode in one call; a step that is repeated would do nothing."""
    with driven(tmp_path, "minisim", {}, fmi) as world:
        world.begin(1)

        def refused(time: float, said: str) -> None:
            with pytest.raises(FMICallException):
                world.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=0.25)
            assert world.said[-1] == f"the step begins at {said} s"

        refused(3600.0, "3600 s, but the start time that was set up is 0")
        kept = world.fmu.getFMUState()
        world.step(0)
        once = world.double("fitness")
        for time in (0.0, 0.5, 3600.0):
            refused(time, f"{time:g} s, but the last one ended at 0.25")
        assert world.double("fitness") == once
        assert not world.flag("done")
        world.fmu.setFMUState(kept)
        world.step(0)
        assert world.double("fitness") == once
        world.fmu.doStep(currentCommunicationPoint=0.25 + 1e-12, communicationStepSize=0.25)
        world.fmu.freeFMUState(kept)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_damaged_states_and_those_of_other_exports_are_refused(fmi: str, tmp_path: Path) -> None:
    with driven(tmp_path, "minisim", {}, fmi) as world:
        world.begin(1)
        for step in range(3):
            world.step(step)
        kept = world.fmu.getFMUState()
        data = world.fmu.serializeFMUState(kept)
        world.fmu.freeFMUState(kept)
        random = np.random.default_rng(0)
        for place in random.integers(len(data), size=50):
            damaged = bytearray(data)
            damaged[place] ^= 1 << int(random.integers(8))
            with pytest.raises(FMICallException):
                world.fmu.deserializeFMUState(bytes(damaged))
            assert "not a state of this FMU, or are damaged" in world.said[-1]
    (tmp_path / "other").mkdir()
    with driven(tmp_path / "other", "minisim", {"maxSteps": 16}, fmi) as world:
        with pytest.raises(FMICallException):
            world.fmu.deserializeFMUState(data)
        assert "not a state of this FMU" in world.said[-1]


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_parameters_have_units_and_limits(fmi: str, tmp_path: Path) -> None:
    """Of the numbers, those that the descriptions of the simulations state."""
    expected = {
        "minisim": {
            "avoidance": ("", "0.0", None),
            **{f"{name}Radius": ("m", "0.0", None) for name in ("avoidance", "capture", "goal")},
            **dict.fromkeys(("speedAgents", "speedDefenders"), ("m", "0.0", None)),
            **dict.fromkeys(("mapHeight", "mapWidth"), ("", "1", "1000000")),
            "maxSteps": ("", "1", "10000000"),
            "numAgents": ("", "1", str(CASES["minisim"]["numAgents"])),
            "numDefenders": ("", "0", "100000"),
            "stepSize": ("", "0", "3600000"),
        },
        "emergency_exit": {
            **dict.fromkeys(("height", "width"), ("", "1", "2000")),
            "numAgents": ("", "1", str(CASES["emergency_exit"]["numAgents"])),
            "numBlockades": ("", "0", "4000000"),
            "numExits": ("", "1", "4000000"),
            "stepSize": ("", "0", "3600000"),
            "steps": ("", "1", "10000000"),
        },
        "arena": {"duration": ("s", "0.1", "26214.3"), "stepSize": ("", "0", "3600000")},
    }
    for title, known in expected.items():
        file = tmp_path / f"{title}.fmu"
        file.write_bytes(build_simulation_fmu(title, CASES[title], fmi=fmi, name="world"))
        assert validate_fmu(str(file)) == []
        description = read_model_description(str(file))
        found = {
            one.name: (one.unit or "", one.min, one.max)
            for one in description.modelVariables
            if one.causality == "parameter" and one.type != "String" and one.name != "seed"
        }
        assert found == known
        defined = {one.name: one.baseUnit for one in description.unitDefinitions}
        assert all(defined[unit] is not None for unit, _, _ in known.values() if unit)


def test_there_are_no_more_agents_than_variables() -> None:
    ranges = {one.name: one.range for one in Model.from_simulation("minisim", GROUPS).parameters}
    assert (ranges["numAgents"], ranges["numDefenders"]) == ((1, 3), (0, 2))
    assert Model.from_simulation("minisim", GROUPS).agents == 5


@pytest.mark.parametrize(
    ("title", "parameters", "stop"),
    [
        ("minisim", CASES["minisim"], 3.75),
        ("emergency_exit", CASES["emergency_exit"], 6 * 4 * 0.2),
        ("emergency_exit", {**CASES["emergency_exit"], "update": "simultaneous"}, 6 * 0.2),
        ("arena", CASES["arena"], 3.0),
        ("arena", {"robots": 2, "mission": "aggregation"}, 120.0),
        ("arena", {"robots": 2, "mission": {**MISSION, "duration": 2.5}}, 2.5),
        ("arena", {"robots": 2, "mission": MISSION}, None),
    ],
)
def test_the_stop_time_is_when_every_episode_has_ended(
    title: str, parameters: dict[str, Any], stop: float | None, tmp_path: Path
) -> None:
    file = tmp_path / "world.fmu"
    file.write_bytes(build_simulation_fmu(title, parameters, fmi="2.0", name="world"))
    found = read_model_description(str(file)).defaultExperiment.stopTime
    assert (None if found is None else float(found)) == (None if stop is None else pytest.approx(stop))
    if stop is not None and stop < 10:
        result = simulate_fmu(str(file), output=["done"])
        assert result["done"][-1]


def test_attached_back_an_episode_may_be_longer_than_at_the_export(tmp_path: Path) -> None:
    file = tmp_path / "world.fmu"
    file.write_bytes(build_simulation_fmu("minisim", {}, fmi="2.0", name="world"))
    evaluated = [
        optimize(
            Experiment.from_mapping(
                {
                    "simulation": simulation,
                    "parameters": {"maxSteps": 25, "speedAgents": 0.1},
                    "method": {"kind": "nnga", "population": 4, "generations": 1},
                    "servers": "in-process",
                    "fitness": "steps + distance",
                }
            ),
            out=tmp_path / name,
        ).record.metrics
        for name, simulation in (("inside", "minisim"), ("attached", str(file)))
    ]
    inside, attached = evaluated
    assert np.array_equal(inside, attached)
    assert inside.max() >= 16


def test_parameters_set_by_the_master(tmp_path: Path) -> None:
    """Numbers, text, JSON in text; what the simulation refuses is in the log."""
    said: list[str] = []
    file = tmp_path / "world.fmu"
    file.write_bytes(build_simulation_fmu("minisim", {}, fmi="3.0", name="world"))
    known = read_model_description(str(file))
    references = {one.name: one.valueReference for one in known.modelVariables}
    folder = extract(str(file), str(tmp_path / "world"))
    fmu = FMU3Slave(guid=known.guid, unzipDirectory=folder, modelIdentifier="world", instanceName="w")
    fmu.instantiate(logMessage=lambda _environment, _status, _category, text: said.append(text.decode()))
    fmu.setFloat64([references["speedAgents"]], [2.5])
    fmu.setString([references["goal"]], ["[9, 4]"])
    fmu.setString([references["placement"]], ["fixed"])
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    engine = _engine.Episodes("minisim", {"speedAgents": 2.5, "goal": [9, 4]}, [0])
    engine.step(np.zeros((1, 1), np.float32))
    fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.25)
    assert fmu.getFloat64([references["fitness"]])[0] == engine.fitness()[0]

    fmu.setFloat32([references["agent[1].actuators.heading"]], [float("nan")])
    refused: list[tuple[Callable[[], Any], str]] = [
        (lambda: fmu.doStep(0.25, 0.25), "actuator 1 of agent 1 is NaN"),
        (lambda: fmu.setInt64([references["mapWidth"]], [3]), "mapWidth is a parameter: it can be set until"),
        (lambda: fmu.setFloat64([references["fitness"]], [3.0]), "fitness is an output"),
        (lambda: fmu.getFloat64([references["done"]]), "done (value reference 2) is not of the type Float64"),
        (lambda: fmu.getFloat64([99]), "no variable has the value reference 99"),
    ]
    for call, expected in refused:
        with pytest.raises(FMICallException):
            call()
        assert expected in said[-1]
    for name, value, expected in (
        ("numAgents", 4, "the parameters make 4 agents, but the FMU has variables for 1; export it again"),
        ("mapWidth", -1, "parameter mapWidth: -1 found"),
    ):
        fmu.reset()
        fmu.setInt64([references[name]], [value])
        fmu.enterInitializationMode()
        with pytest.raises(FMICallException):
            fmu.exitInitializationMode()
        assert expected in said[-1]
    fmu.freeInstance()


def test_event_mode_that_is_not_announced_is_refused(tmp_path: Path) -> None:
    said: list[str] = []
    file = tmp_path / "world.fmu"
    file.write_bytes(build_simulation_fmu("minisim", {}, fmi="3.0", name="world"))
    folder = extract(str(file), str(tmp_path / "world"))
    token = read_model_description(str(file)).guid
    fmu = FMU3Slave(guid=token, unzipDirectory=folder, modelIdentifier="world", instanceName="w")
    with pytest.raises(Exception, match="Failed to instantiate"):
        fmu.instantiate(
            eventModeUsed=True,
            logMessage=lambda _environment, _status, _category, text: said.append(text.decode()),
        )
    assert said == ["this FMU has no event mode; instantiate it without"]


def test_mistakes_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.fmu").write_text("of another program")
    for words, expected in (
        (["minisin"], "is neither a built-in simulation (arena, emergency_exit, minisim)"),
        (["minisim", "--set", "parameters.numAgent=3"], "did you mean 'numAgents'?"),
        (["minisim", "--set", "parameters.numAgents=-3"], "numAgents"),
        (["minisim", "--set", "numAgents=3"], "write --set parameters.numAgents=3"),
        (["minisim", "--output", "mine.fmu"], "was not exported by Swarmwright"),
        (["minisim", "--fmi", "1"], "'1' is not one of '2', '3'"),
        (["minisim", "--set", "parameters.numAgents=90000"], "the limit of an FMU is 200,000"),
    ):
        done = CliRunner().invoke(program, ["export-fmu", *words])
        said = done.output + str(done.exception)
        assert expected in said, said
        assert done.exit_code == 2 or isinstance(done.exception, InputError)
    assert {file.name for file in tmp_path.iterdir()} == {"mine.fmu"}


def test_licences_of_the_library_are_in_it() -> None:
    with zipfile.ZipFile(io.BytesIO(build_simulation_fmu("minisim", {}, fmi="3.0", name="world"))) as archive:
        text = archive.read("documentation/licenses/license.txt").decode()
    assert "swarmwright-fmi" in text
    assert "Permission is hereby granted, free of charge" in text  # of crates under MIT


def test_a_parameter_by_which_there_are_other_sensors(tmp_path: Path) -> None:
    file = tmp_path / "foot_bots.fmu"
    words = ["export-fmu", "arena", "--set", "parameters.robot=foot-bot", "--output", str(file)]
    done = CliRunner().invoke(program, words)
    assert done.exit_code == 0, done.output + str(done.exception)
    assert file.is_file()


def test_missing_licences_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LICENSES", tmp_path / "missing")
    with pytest.raises(InputError, match=r"are missing; run `make \.venv/\.engine`"):
        build_simulation_fmu("minisim", {}, fmi="2.0", name="world")
