"""FMUs as simulations, made by pythonfmu and by this project: FMPy's steps, records, what fails, mistakes."""

import itertools
import math
import os
import re
import shutil
import zipfile
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from swarmwright import (
    Controller,
    Experiment,
    InputError,
    Run,
    RunError,
    evaluate,
    optimize,
    resume,
    simulate,
)
from swarmwright.common import warn_once
from swarmwright.common.errors import engine_errors
from swarmwright.common.random_numbers import Stream
from swarmwright.export import EXPORTERS
from swarmwright.export.exporting import write
from swarmwright.servers.evaluation.base import Servers
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.host import Host
from swarmwright.simulations.loading import load
from tests.python.export.specifications import ALL, subject
from tests.python.simulations.command.test_hostile_parameters import HOSTILE

SMALL = {"kind": "nnga", "population": 6, "generations": 3}


def vehicle(fmus: Path, **changes: Any) -> Experiment:
    values = {
        "simulation": {"fmu": str(fmus / "Vehicle.fmu"), "sensors": ["goal_x", "goal_y"]},
        "fitness": "-distance",
        "method": SMALL,
        **changes,
    }
    return Experiment.from_mapping(values)


def controller_of(experiment: Experiment) -> Controller:
    made = experiment.representation()
    return Controller(made.specification(made.initial(Stream(1, "fmu"))))


def score(experiment: Experiment, seed: int | None = None) -> float:
    """The fitness of an episode in this process, always with the same controller."""
    return simulate(experiment, controller_of(experiment), servers="in-process", seed=seed)


@pytest.mark.parametrize("text", HOSTILE)
def test_text_of_a_peer_is_no_number(fmus: Path, text: str) -> None:
    host = Host(cast(type[Simulation], load(vehicle(fmus).simulation)))
    with pytest.raises(InputError, match=r"^mass: .* found, expected"), engine_errors():
        host.reset({"mass": text})


@pytest.mark.slow
def test_every_step_is_that_of_fmpy(fmus: Path, tmp_path: Path) -> None:
    """The distance after all steps, with the same controller in a loop of FMPy's own."""
    experiment = vehicle(fmus)
    found = [score(experiment, seed) for seed in (5, 6)]
    file = str(fmus / "Vehicle.fmu")
    known = {one.name: one.valueReference for one in read_model_description(file).modelVariables}
    extract(file, str(tmp_path))
    for seed, fitness in zip((5, 6), found, strict=True):
        controller = controller_of(experiment)
        controller.reset()
        fmu = FMU2Slave(
            guid=read_model_description(file).guid,
            unzipDirectory=str(tmp_path),
            modelIdentifier="Vehicle",
            instanceName="v",
        )
        fmu.instantiate()
        fmu.setInteger([known["seed"]], [seed])
        fmu.setupExperiment(startTime=0.0, stopTime=2.0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        for step in range(20):
            sensed = np.array(fmu.getReal([known["goal_x"], known["goal_y"]]), np.float32)
            actuators = controller(sensed)
            fmu.setReal([known["steer"], known["thrust"]], [float(one) for one in actuators])
            fmu.doStep(currentCommunicationPoint=step * 0.1, communicationStepSize=0.1)
        assert -fmu.getReal([known["distance"]])[0] == fitness
        fmu.terminate()


@pytest.mark.slow
@pytest.mark.parametrize("form", ["fmu", "fmu3"])
def test_fmus_of_this_project_in_both_versions(form: str, tmp_path: Path) -> None:
    """An exported controller as the world: its actuators are sensors, and three instances are agents."""
    write(EXPORTERS.get(form)().files(subject(ALL["fully_meshed-tanh-6"]), "robot"), tmp_path)
    file = str(tmp_path / "robot.fmu")
    known = read_model_description(file)
    inputs = [one for one in known.modelVariables if one.causality == "input"]
    outputs = [one for one in known.modelVariables if one.causality == "output"]
    experiment = Experiment.from_mapping(
        {
            "simulation": {
                "fmu": file,
                "agents": 3,
                "steps": 7,
                "actuators": [{"variable": one.name, "range": [-0.5, 2]} for one in inputs],
                "metrics": {"level": f"mean({outputs[0].name})"},
            },
            "fitness": "level",
        }
    )
    assert (experiment.sensors, experiment.actuators) == (2, 3)
    found = score(experiment)
    extract(file, str(tmp_path / "x"))
    make = FMU2Slave if form == "fmu" else FMU3Slave
    fmu = make(guid=known.guid, unzipDirectory=str(tmp_path / "x"), modelIdentifier="robot", instanceName="r")
    fmu.instantiate()
    if form == "fmu":
        fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    get, put = (fmu.getReal, fmu.setReal) if form == "fmu" else (fmu.getFloat32, fmu.setFloat32)
    controller, levels = controller_of(experiment), []
    controller.reset()
    for step in range(7):
        actuators = controller(np.array(get([one.valueReference for one in outputs]), np.float32))
        values = [-0.5 + (float(one) + 1.0) * 0.5 * 2.5 for one in actuators]
        put([one.valueReference for one in inputs], values)
        fmu.doStep(currentCommunicationPoint=step * 1.0, communicationStepSize=1.0)
        levels.append(get([outputs[0].valueReference])[0])
    assert found == math.fsum(levels) / 7
    fmu.freeInstance()


@pytest.mark.journey
def test_one_record_here_and_on_servers_in_every_mode(fmus: Path, tmp_path: Path) -> None:
    places: tuple[tuple[str, Servers], ...] = (("auto", "local"), ("auto", 2), ("stepwise", 1))
    digests = {
        optimize(vehicle(fmus, mode=mode), servers=servers, out=tmp_path / f"{mode}{servers}").digest
        for mode, servers in places
    }
    assert len(digests) == 1


@pytest.mark.slow
def test_agents_in_one_instance(fmus: Path) -> None:
    numbered = {"sensors": ["x{agent}"], "actuators": ["v{agent}"], "agents": 2}
    experiment = Experiment.from_mapping(
        {
            "simulation": {"fmu": str(fmus / "Pair.fmu"), **numbered, "metrics": {"gap": "last"}},
            "fitness": "-gap",
        }
    )
    assert (experiment.sensors, experiment.actuators) == (1, 1)
    found = score(experiment)
    places = [-1.0, 1.0]
    agents = [controller_of(experiment), controller_of(experiment)]
    for one in agents:
        one.reset()
    for _ in range(10):
        speeds = [
            float(agent(np.array([place], np.float32))[0])
            for agent, place in zip(agents, places, strict=True)
        ]
        places = [place + speed * 0.1 for place, speed in zip(places, speeds, strict=True)]
    assert -found == places[1] - places[0]


@pytest.mark.slow
def test_parameters_seeds_and_ends(fmus: Path) -> None:
    one = vehicle(fmus)
    assert score(one, 1) == score(one, 1) != score(one, 2)
    assert score(vehicle(fmus, parameters={"mass": 3})) != score(one)
    simulation = {
        "fmu": str(fmus / "Vehicle.fmu"),
        "sensors": ["goal_x"],
        "metrics": {"steps": "count(distance)"},
    }
    assert score(vehicle(fmus, simulation={**simulation, "steps": 7}, fitness="steps")) == 7.0
    # pythonfmu says with a step that is not done that the simulation ends.
    ends = vehicle(fmus, simulation=simulation, fitness="steps", parameters={"trouble": "refuse"})
    assert score(ends) == 1.0
    early = {**simulation, "done": "steps >= 4"}
    assert score(vehicle(fmus, simulation=early, fitness="steps")) == 4.0
    fast = {**simulation, "sensors": ["goal_x", "fast", "process"], "seed": "seed", "step": 0.05}
    assert vehicle(fmus, simulation=fast, fitness="steps").sensors == 3
    assert score(vehicle(fmus, simulation=fast, fitness="steps")) == 40.0


@pytest.mark.slow
def test_steps_that_do_not_end_at_the_stop_time(
    fmus: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(warn_once, "_given", set())  # each is said once by a process
    simulation = {"fmu": str(fmus / "Vehicle.fmu"), "metrics": {"steps": "count(distance)"}}
    for step, words in ((0.1, ""), (0.3, "step: 0.3 s does not divide the 2 s from start to stop of")):
        caplog.clear()
        with caplog.at_level("WARNING", "swarmwright"):
            fitness = score(vehicle(fmus, simulation={**simulation, "step": step}, fitness="steps"))
        assert fitness == round(2 / step)
        assert words in caplog.text
        assert bool(words) == ("does not divide" in caplog.text)


@pytest.mark.slow
def test_parameters_are_evolved_without_a_controller(fmus: Path, tmp_path: Path) -> None:
    parameters = {"mass": {"type": "real", "range": [0.5, 3]}}
    experiment = Experiment.from_mapping(
        {
            "simulation": {"fmu": str(fmus / "Vehicle.fmu"), "start": {"thrust": 1.0, "seed": 3}},
            "fitness": "-distance",
            "controller": {"kind": "parameter_set", "parameters": parameters},
            "method": SMALL,
        }
    )
    run = optimize(experiment, servers="local", out=tmp_path / "run")
    assert len({run.evaluation(index, 0).fitness for index in range(6)}) > 3


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_what_fails_is_said_and_the_next_episode_works(fmus: Path) -> None:
    for trouble, said in (
        ("crash", "SIGSEGV"),
        ("hang", "has not ended after 2 s"),
        ("print", "printed more than"),
        ("raise", r"the step from 0.5 s: [^;]*RuntimeError\('the motor is broken'\)"),
        ("nan", "goal_x is nan at 0.1 s"),
    ):
        simulation = {
            "fmu": str(fmus / "Vehicle.fmu"), "sensors": ["goal_x"], "timeout": 2.0, "output": 1.0,
        }  # fmt: skip
        experiment = vehicle(fmus, simulation=simulation, parameters={"trouble": trouble})
        with pytest.raises(RunError, match=said):
            score(experiment)
        assert np.isfinite(score(vehicle(fmus, simulation=simulation)))


@pytest.mark.slow
def test_the_process_is_recycled(fmus: Path) -> None:
    simulation = {
        "fmu": str(fmus / "Vehicle.fmu"), "sensors": ["goal_x"], "steps": 1, "metrics": {"process": "last"},
    }  # fmt: skip
    counts = []
    for recycle in (0, 2):
        experiment = vehicle(fmus, simulation={**simulation, "recycle": recycle}, fitness="process")
        genomes = np.zeros((6, experiment.genome_size), np.float32)
        found = evaluate(experiment, genomes, servers="in-process")
        counts.append(len(set(found.tolist())))
        assert os.getpid() not in found
    assert counts == [1, 3]


@pytest.mark.slow
def test_the_run_keeps_the_fmu(fmus: Path, tmp_path: Path) -> None:
    folder = tmp_path / "moved"
    folder.mkdir()
    shutil.copy(fmus / "Vehicle.fmu", folder / "v.fmu")
    (folder / "e.yaml").write_text(
        "simulation: v.fmu\nfitness: -distance\nmethod: {kind: nnga, population: 6, generations: 2}\n"
    )
    run = optimize(folder / "e.yaml", servers="local", out=tmp_path / "run")
    assert (run.path / "code" / "1" / "simulation" / "v.fmu").is_file()
    longer = optimize(
        Experiment.load(folder / "e.yaml").with_settings(["method.generations=4"]),
        servers="local",
        out=tmp_path / "longer",
    )
    shutil.copytree(run.path, tmp_path / "changed")
    shutil.rmtree(folder)
    assert resume(run, generations=4, servers="local").digest == longer.digest
    copy = tmp_path / "changed" / "code" / "1" / "simulation" / "v.fmu"
    shutil.copy(fmus / "Pair.fmu", copy)
    with pytest.raises(InputError, match=r"v\.fmu"):
        resume(Run.open(tmp_path / "changed"), generations=4, servers="local")


MISTAKES: tuple[tuple[str, str], ...] = (
    ("simulation: none.fmu", "simulation.fmu: none.fmu: there is no such file"),
    ("simulation: broken.fmu", "simulation.fmu: broken.fmu: is not an FMU, or is damaged: "),
    ("simulation: empty.fmu", "simulation.fmu: empty.fmu: is not an FMU, or is damaged: "),
    ("simulation: {fmu: Vehicle.fmu}", "fitness: is missing; write an expression over the metrics "),
    ("simulation: Vehicle.fmu\nfitness: -distanc", "did you mean 'distance'?"),
    ("simulation: {fmu: Vehicle.fmu, sensors: [goal_z]}", "has no variable 'goal_z'; did you mean 'goal_"),
    ("simulation: {fmu: Vehicle.fmu, sensors: [trouble]}", "trouble of Vehicle.fmu is of the type String"),
    (
        "simulation: {fmu: Vehicle.fmu, actuators: [mass]}",
        "mass of Vehicle.fmu is not an input, but has the caus",
    ),
    ("simulation: {fmu: Vehicle.fmu, start: {masss: 1}}", "simulation.start.masss: Vehicle.fmu has no vari"),
    ("simulation: {fmu: Vehicle.fmu, seed: sead}", "simulation.seed: Vehicle.fmu has no variable 'sead'"),
    ("simulation: {fmu: Vehicle.fmu, metrics: {d: last(dist)}}", "simulation.metrics.d: Vehicle.fmu has no"),
    ("simulation: {fmu: Vehicle.fmu, agents: 0}", "simulation.agents: "),
    ("simulation: {fmu: Vehicle.fmu, step: -1}", "simulation.step: "),
    ("simulation: {fmu: Vehicle.fmu, sensor: [goal_x]}", "simulation.sensor: "),
    (
        "simulation: {fmu: Vehicle.fmu, actuators: [{variable: steer, range: [1, -1]}]}",
        "the lowest value must be below the highest, not 1 and -1",
    ),
    (
        "simulation: {fmu: Pair.fmu, agents: 2, sensors: ['x{agent}', gap], actuators: ['v{agent}']}",
        "simulation.sensors: gap lacks {agent}, which other names have",
    ),
    (
        "simulation: {fmu: Pair.fmu, agents: 3, sensors: ['x{agent}'], actuators: ['v{agent}']}",
        "Pair.fmu has no variable 'x3'",
    ),
    (
        "simulation: Vehicle.fmu\nfitness: -distance\nparameters: {mas: 2}",
        "parameters.mas: unknown parameter",
    ),
    (
        "simulation: Vehicle.fmu\nfitness: -distance\nparameters: {mass: heavy}",
        "parameters.mass: 'heavy' found",
    ),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "said"),
    [
        ('<!ENTITY x SYSTEM "file:///etc/hostname">', "uses the entity x of a DTD, which is not supported"),
        (
            '<!ENTITY a "aaaaaaaaaa">'
            + "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in itertools.pairwise("abcdefghijx")),
            "uses the entity a of a DTD, which is not supported",
        ),
    ],
    ids=["external", "amplified"],
)
def test_entities_are_not_expanded(tmp_path: Path, what: str, said: str) -> None:
    write(EXPORTERS.get("fmu")().files(subject(ALL["mealy_fsm"]), "robot"), tmp_path)
    with zipfile.ZipFile(tmp_path / "robot.fmu") as one, zipfile.ZipFile(tmp_path / "bad.fmu", "w") as bad:
        for name in one.namelist():
            text = one.read(name)
            if name == "modelDescription.xml":
                begin, rest = text.decode().split("?>", 1)
                rest = rest.replace('generationTool="', 'generationTool="&x;')
                text = f"{begin}?><!DOCTYPE fmiModelDescription [{what}]>{rest}".encode()
            bad.writestr(name, text)
    with pytest.raises(InputError, match=rf"bad\.fmu: modelDescription\.xml:1: {said}"):
        Experiment.from_mapping({"simulation": str(tmp_path / "bad.fmu"), "fitness": "0"})


@pytest.mark.parametrize(("text", "said"), MISTAKES, ids=[said[:40] for _, said in MISTAKES])
def test_mistakes(fmus: Path, tmp_path: Path, text: str, said: str) -> None:
    for name in ("Vehicle.fmu", "Pair.fmu"):
        (tmp_path / name).symlink_to(fmus / name)
    (tmp_path / "broken.fmu").write_bytes((fmus / "Vehicle.fmu").read_bytes()[:3000])
    (tmp_path / "empty.fmu").write_bytes(b"")
    (tmp_path / "e.yaml").write_text(f"{text}\n")
    with pytest.raises(InputError) as caught:
        Experiment.load(tmp_path / "e.yaml")
    told = str(caught.value).replace(f"{tmp_path}/", "")
    assert said in told, told
    assert "e.yaml:" in told


@pytest.mark.slow
def test_no_library_for_this_machine(tmp_path: Path) -> None:
    write(EXPORTERS.get("fmu")().files(subject(ALL["mealy_fsm"]), "robot"), tmp_path)
    with (
        zipfile.ZipFile(tmp_path / "robot.fmu") as whole,
        zipfile.ZipFile(tmp_path / "other.fmu", "w") as other,
    ):
        for name in whole.namelist():
            other.writestr(name.replace("linux64", "win64"), whole.read(name))
    with pytest.raises(
        InputError, match=r"has no library for this machine, .*; available: win64\. If .* `fmpy compile"
    ):
        Experiment.from_mapping({"simulation": str(tmp_path / "other.fmu"), "fitness": "0"})


@pytest.mark.slow
def test_thousands_of_variables(tmp_path: Path) -> None:
    """They are read; those that matter have to be named."""
    write(EXPORTERS.get("fmu")().files(subject(ALL["mealy_fsm"]), "robot"), tmp_path)
    known = read_model_description(str(tmp_path / "robot.fmu"))
    output = next(one.name for one in known.modelVariables if one.causality == "output")
    more = "".join(
        f'<ScalarVariable name="v{index}" valueReference="{index + 100}" causality="output" '
        'variability="discrete" initial="exact"><Real start="0"/></ScalarVariable>'
        for index in range(10_000)
    )
    with zipfile.ZipFile(tmp_path / "robot.fmu") as one, zipfile.ZipFile(tmp_path / "m.fmu", "w") as many:
        for name in one.namelist():
            text = one.read(name).replace(b"</ModelVariables>", more.encode() + b"</ModelVariables>")
            many.writestr(name, text if name.endswith(".xml") else one.read(name))
    simulation = {"fmu": str(tmp_path / "m.fmu"), "metrics": {"level": f"mean({output})"}, "steps": 3}
    with pytest.raises(InputError, match=r"sensors: is missing: .* has 10,002 outputs; name the sensors"):
        Experiment.from_mapping({"simulation": simulation, "fitness": "level"})
    assert np.isfinite(
        score(
            Experiment.from_mapping({"simulation": {**simulation, "sensors": [output]}, "fitness": "level"})
        )
    )


def test_fmpy_is_missing(fmus: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmwright.simulations.fmu.description.is_installed", lambda: False)
    shutil.copy(fmus / "Vehicle.fmu", fmus / "Unread.fmu")
    with pytest.raises(InputError, match=r"FMUs need FMPy, which is not installed; pip install"):
        Experiment.from_mapping({"simulation": str(fmus / "Unread.fmu"), "fitness": "0"})


@pytest.mark.slow
def test_the_best_are_transferred_to_an_fmu_beside_the_experiment(fmus: Path, tmp_path: Path) -> None:
    for name in ("own.fmu", "other.fmu"):
        shutil.copy(fmus / "Vehicle.fmu", tmp_path / name)
    path, other = (
        tmp_path / "x.yaml",
        "{simulation: {fmu: other.fmu, sensors: [goal_x, goal_y]}, name: other}",
    )
    text = (
        "simulation: {fmu: own.fmu, sensors: [goal_x, goal_y]}\n"
        "fitness: -distance\nservers: in-process\n"
        "method: {kind: nnga, population: 4, generations: 2}\n"
    )
    ranking = f"ranking: {{kind: multi_fidelity, slow: {other}}}\n"
    path.write_text(f"{text}{ranking}validate: {{episodes: 0, candidates: 1, seeds: 2, to: [{other}]}}\n")
    run = optimize(Experiment.load(path), out=tmp_path / "run")
    (one,) = run.transferred
    assert one.target_episodes.tolist() == one.source_episodes.tolist(), "it is the same model"
    assert run.slow_evaluations == 2
    path.write_text(f"{text}validate: {{to: [other.fmu]}}\n")
    with pytest.raises(
        InputError, match=r"x\.yaml:5: validate\.to\[0\]: other\.fmu: .*agents of other have 4 sensors"
    ):
        Experiment.load(path)


@pytest.mark.parametrize(
    ("definition", "changes", "key"),
    [
        ({"done": "distanze < 1"}, {}, r"simulation\.done"),
        ({"fitness": "-distanze"}, {}, r"simulation\.fitness"),
        ({}, {"fitness": "-distanze"}, "fitness"),
    ],
)
def test_an_expression_over_unknown_metrics_is_named_by_its_key(
    definition: dict[str, Any], changes: dict[str, Any], key: str, fmus: Path
) -> None:
    simulation = {"fmu": str(fmus / "Vehicle.fmu"), "sensors": ["goal_x", "goal_y"], **definition}
    with pytest.raises(InputError) as caught:
        vehicle(fmus, simulation=simulation, **changes)
    assert re.search(rf"(^|\s){key}: 'distanze' is not a metric; did you mean 'distance'", str(caught.value))
