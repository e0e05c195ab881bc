"""What is wrong with an experiment whose simulation is a command is said with the line and a cure."""

from pathlib import Path
from typing import Any

import jsonschema
import pytest

from swarmwright import Experiment, InputError
from swarmwright.simulations.catalogue import title

YAML = """
simulation:
  command: cat {parameters} {log}
  log: out.csv
  metrics: {distance: mean}
fitness: "-distance"
controller: {kind: parameter_set, parameters: {gain: {type: real, range: [0, 5]}}}
"""


def problem(folder: Path, old: str, new: str) -> str:
    (folder / "e.yaml").write_text(YAML.replace(old, new))
    with pytest.raises(InputError) as raised:
        Experiment.load(folder / "e.yaml")
    return str(raised.value).removeprefix(f"{folder}/")


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (
            "{log}",
            "{lgo}",
            "e.yaml:3: simulation.command: {lgo} is neither a placeholder nor a parameter",
        ),
        (
            "{log}",
            "> {log}",
            'e.yaml:3: simulation.command: > needs a shell, but commands run without one; write [sh, -c, "ca',
        ),
        ("cat", 'cat "', "e.yaml:3: simulation.command: cannot be split into words: No closing quotation"),
        ("  log: out.csv\n", "", "e.yaml:3: simulation.command: {log} needs a log; write log: result.csv"),
        (
            "cat {parameters} {log}\n  log: out.csv",
            "cat",
            "e.yaml:2: simulation.log: is missing; name the result file",
        ),
        (
            "out.csv",
            "/tmp/out.csv",
            "e.yaml:4: simulation.log: '/tmp/out.csv' is outside the work folder",
        ),
        ("out.csv", "[a.csv, b.csv]", "e.yaml:3: simulation.command: {log} needs a single log;"),
        ("metrics", "metrcs", "e.yaml:5: simulation.metrcs: unknown key; did you mean 'metrics'?"),
        ("mean", "avg", "e.yaml:5: simulation.metrics.distance: 'avg' found, expected one of last, first,"),
        ("{distance", "{my-x: mean, distance", "write my_x: last(my-x)"),
        ('"-distance"', '"-distnace"', "e.yaml:6: fitness: 'distnace' is not a metric of cat@"),
        (
            'fitness: "-distance"',
            "",
            "fitness: is missing; write an expression over the metrics distance",
        ),
        (
            YAML.splitlines()[-1],
            "",
            "layered controls agents, but the command receives no controller. To",
        ),
        ("metrics:", "controller: json\n  metrics:", "parameter_set has no controller to write as a file"),
        ("metrics:", "timeout: 10s\n  metrics:", "e.yaml:5: simulation.timeout: must be a number, not '10s'"),
        ("metrics:", "files: [a.sdf]\n  metrics:", "files: "),
        ("metrics:", "files: {../a: b}\n  metrics:", "'../a' is outside the work folder"),
        ("metrics:", "parameters: a.yaml\n  metrics:", "a.yaml: there is no such file"),
        (
            "metrics:",
            "environment: {A: '{prt}'}\n  metrics:",
            "simulation.environment.A: {prt} is neither a placeholder nor a parameter",
        ),
        ("metrics:", 'fitness: "a +"\n  metrics:', "simulation.fitness: "),
        (
            "command: cat {parameters} {log}",
            "comand: x",
            "simulation.comand: unknown key; did you mean 'command'?",
        ),
        (
            "  log: out.csv",
            "  controller: stepwise",
            "{parameters} differs between episodes, but a stepwise",
        ),
    ],
)
def test_mistakes(tmp_path: Path, old: str, new: str, reason: str) -> None:
    assert reason in problem(tmp_path, old, new)


@pytest.mark.parametrize(
    ("where", "name"),
    [
        ({"command": ["cat", "--port", "{port}"]}, "port"),
        ({"environment": {"ROS_MASTER_URI": "http://localhost:{port}"}}, "port"),
        ({"command": ["cat", "{folder}"]}, "folder"),
        ({"files": ["world.sdf"]}, "instance"),
    ],
)
def test_a_parameter_takes_no_placeholder_s_place(tmp_path: Path, where: dict[str, Any], name: str) -> None:
    (tmp_path / "world.sdf").write_text("<world>{instance}</world>")
    definition = {"folder": str(tmp_path), **where}
    with pytest.raises(
        InputError, match=rf"^parameters\.{name}: {{{name}}} stands for .*; rename the parameter or"
    ):
        experiment(**definition).replace(parameters={name: 3})
    evolved = {"kind": "parameter_set", "parameters": {name: {"type": "real", "range": [0, 5]}}}
    with pytest.raises(InputError, match=rf"^controller\.parameters\.{name}: {{{name}}} stands for "):
        experiment(**definition).replace(controller=evolved)
    # Where the placeholder is not used, it is a name like any other.
    assert experiment(folder=str(tmp_path)).replace(parameters={name: 3}).parameters == {name: 3}


def test_sensors_and_actuators_are_needed_for_controllers(tmp_path: Path) -> None:
    said = problem(tmp_path, YAML[1:], "simulation: {command: x, controller: stepwise}\n")
    assert "simulation.sensors: is missing; give the number of sensors of an agent" in said
    assert "simulation.actuators: is missing" in said


def experiment(**simulation: Any) -> Experiment:
    parameters = {"gain": {"type": "real", "range": [0, 5]}}
    return Experiment.from_mapping(
        {
            "simulation": {"command": "cat", "log": "out.csv", **simulation},
            "fitness": "-distance",
            "controller": {"kind": "parameter_set", "parameters": parameters},
        }
    )


def test_it_is_written_as_it_was_read(tmp_path: Path) -> None:
    one = experiment(timeout=100, environment={"A": "{port}"})
    assert one.label == "cat"
    assert one.to_mapping()["simulation"] == {
        "command": ["cat"],
        "environment": {"A": "{port}"},
        "folder": str(Path.cwd()),
        "log": ["out.csv"],
        "timeout": 100,
    }
    one.save(tmp_path / "e.yaml")
    assert Experiment.load(tmp_path / "e.yaml") == one
    assert one.replace(seed=2).simulation == one.simulation
    # The fitness belongs to the simulation, too: also other optimization tools get it.
    assert '"fitness":"-other"' in one.replace(fitness="-other").simulation
    assert one.with_settings(["simulation.timeout=5"]).to_mapping()["simulation"]["timeout"] == 5


def test_results_are_waited_for_as_long_as_episodes_may_take() -> None:
    assert experiment(timeout=20).timeouts.step == 60
    assert experiment(timeout=600).timeouts.step == 630
    assert experiment(timeout=600).with_settings(["timeouts.step=700"]).timeouts.step == 700


def test_the_schema_has_commands() -> None:
    validator = jsonschema.Draft202012Validator(Experiment.json_schema())
    validator.validate(experiment().to_mapping())
    with pytest.raises(jsonschema.ValidationError):
        validator.validate({"simulation": {"command": "x", "tmeout": 5}})


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("command:{x", "simulation: command:{x: is not the JSON text of a command (Expecting property name"),
        ("command:{" + '"a": {' * 100_000, ": is not the JSON text of a command (maximum recursion"),
        ('command:{"command": "true"}', "simulation.log: is missing"),
        ('command:{"folder": 3}', "simulation.folder: must be text, not 3"),
        ("ros:{}", "simulation.command: is missing"),
    ],
)
def test_a_definition_as_text_is_checked_as_a_mapping_is(name: str, reason: str) -> None:
    with pytest.raises(InputError) as raised:
        Experiment.from_mapping({"simulation": name})
    assert reason in str(raised.value)


@pytest.mark.parametrize("name", ["command:{x", 'command:{"folder": 3}', 'fmu:{"fmu": 1}', "ros:{}"])
def test_servers_of_a_broken_definition_are_refused(name: str) -> None:
    with pytest.raises(InputError):
        title(name)
