"""An existing program is attached with a YAML file alone."""

import dataclasses
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import (
    Experiment,
    InputError,
    Run,
    RunError,
    evaluate,
    optimize,
    repeat,
    resume,
    simulate,
)
from swarmwright.common import warn_once
from swarmwright.servers.evaluation.evaluate import run_episode
from swarmwright.simulations import catalogue
from tests.python.cli.test_services import events
from tests.python.records import same_record
from tests.python.simulations.command.processes import WELL, Traced

SIMULATOR = """
import csv, random, sys
import helper

values = dict(line.strip().split(": ") for line in open(sys.argv[1]))
random.seed(int(values["seed"]))
goal = random.uniform(0, 1)
with open(sys.argv[2], "w") as log:
    table = csv.writer(log)
    table.writerow(["step", "distance"])
    for step in range(3):
        table.writerow([step, helper.distance(float(values["speed"]), goal) / (1 + step)])
print("simulated", flush=True)
"""
HELPER = "def distance(speed, goal):\n    return abs(speed - goal)\n"
YAML = f"""
simulation:
  command: {sys.executable} sim.py {{parameters}} {{log}}
  log: out.csv
  metrics: {{distance: mean}}
fitness: "-distance"
controller: {{kind: parameter_set, parameters: {{speed: {{type: real, range: [0, 1]}}}}}}
method: {{kind: nnga, population: 4, generations: 2}}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Has a simulator in it that knows nothing of Swarmwright."""
    place = tmp_path / "my robots"  # with a space
    place.mkdir()
    (place / "sim.py").write_text(SIMULATOR)
    (place / "helper.py").write_text(HELPER)
    (place / "experiment.yaml").write_text(YAML)
    return place


def load(folder: Path, *settings: str) -> Experiment:
    return Experiment.load(folder / "experiment.yaml", settings)


@pytest.mark.slow
def test_one_record_wherever_it_runs(folder: Path, tmp_path: Path) -> None:
    experiment = load(folder)
    runs = [
        optimize(experiment, out=tmp_path / str(servers), servers=servers) for servers in ("in-process", 2)
    ]
    same_record(*runs)
    assert runs[0].best.fitness > -0.6
    assert "simulated" in (tmp_path / "2" / "servers.log").read_text()


@pytest.mark.slow
def test_a_broker_with_servers_of_the_same_file(
    folder: Path, tmp_path: Path, start: Any, embedded_broker: str
) -> None:
    serving = start(
        "serve", folder / "experiment.yaml", "--broker", embedded_broker, "--count", "2", "--json"
    )
    events(serving, "ready", 2)
    experiment = load(folder)
    alone = optimize(experiment, out=tmp_path / "alone", servers="in-process")
    same_record(optimize(experiment, out=tmp_path / "served", broker=embedded_broker), alone)
    # Servers of another script have another title, and are not asked.
    (folder / "helper.py").write_text(HELPER.replace("abs", "2 * abs"))
    edited = load(folder, "timeouts.discovery=0.3")
    with pytest.raises(RunError, match=r"offers sim@.*, not sim@"):
        simulate(edited, broker=embedded_broker)


def test_the_identity_is_that_of_definition_and_files(folder: Path, tmp_path: Path) -> None:
    def title(*settings: str) -> str:
        return catalogue.title(load(folder, *settings).simulation)

    first = title()
    assert first.startswith("sim@")
    moved = tmp_path / "moved"
    folder.rename(moved)
    moved.rename(folder)
    assert title() == first
    assert title("simulation.title=swarm") == "swarm"
    others = {title("simulation.timeout=7"), title("simulation.metrics.distance=last")}
    (folder / "helper.py").write_text(HELPER + "\n")
    others.add(title())
    assert len(others - {first}) == 3


@pytest.mark.parametrize("name", ["command.json", "data.json"])
def test_any_file_that_is_named_belongs_to_the_identity(folder: Path, name: str) -> None:
    titles = set()
    for text in ("{}", "[]"):
        (folder / name).write_text(text)
        titles.add(catalogue.title(load(folder, f"simulation.sources=[{name}]").simulation))
    assert len(titles) == 2


@pytest.mark.slow
def test_a_run_keeps_the_files_and_is_resumed(folder: Path, tmp_path: Path) -> None:
    experiment = load(folder)
    run = optimize(experiment, out=tmp_path / "run", servers="in-process")
    longer = optimize(
        experiment.replace(method={"generations": 3}), out=tmp_path / "long", servers="in-process"
    )
    kept = run.path / "code" / "1" / "simulation"
    assert {path.name for path in kept.iterdir()} == {"sim.py", "helper.py", "swarmwright-command.json"}
    resumed = resume(run.path, generations=3)
    assert resumed.digest == longer.digest
    best = run.best
    # An edited script is not used, and a missing one is not needed.
    (folder / "helper.py").write_text(HELPER.replace("abs", "2 * abs"))
    assert repeat(Run.open(run.path), best.candidate, best.generation).same
    with pytest.raises(InputError, match=r"helper\.py was edited"):
        resume(run.path, generations=4)
    for name in ("sim.py", "helper.py"):
        (folder / name).unlink()
    assert repeat(Run.open(run.path), best.candidate, best.generation).same
    # Also in another place.
    (tmp_path / "elsewhere").mkdir()
    there = run.path.rename(tmp_path / "elsewhere" / "run")
    assert resume(there, generations=4).generations == 4


@pytest.mark.slow
def test_parameters_with_defaults_from_the_programs_own_file(traced: Traced) -> None:
    (traced.folder / "own.yaml").write_text("speed: 0.5\npid: {kp: 1.5, ki: 0}\nname: two words\nseed: 9\n")
    script = "cat parameters.yaml; sed -n 's/^  kp: /fitness\\n/p' parameters.yaml > log.csv"
    experiment = traced.shell(script, parameters="own.yaml", log=["log.csv"])
    assert simulate(experiment, seed=4) == 1.5
    assert simulate(experiment.replace(parameters={"pid.kp": 3})) == 3
    with pytest.raises(InputError, match=r"unknown parameter of .*; did you mean 'pid\.kp'"):
        experiment.replace(parameters={"pid.kq": 3})
    with pytest.raises(InputError, match="'fast' found, expected a number"):
        experiment.replace(parameters={"pid.kp": "fast"})


ROS2 = """\
"/**":
  ros__parameters:
    list: [1, 2.5]
    pid:
      kp: 2
    speed: 0.25
    word: two words
    seed: 3
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "text"),
    [
        ("yaml", "list: [1, 2.5]\npid:\n  kp: 2\nspeed: 0.25\nword: two words\nseed: 3\n"),
        ("ros2", ROS2),
        ("json", '{"list": [1, 2.5], "pid": {"kp": 2}, "speed": 0.25, "word": "two words", "seed": 3}'),
    ],
)
def test_formats_of_the_parameter_file(traced: Traced, form: str, text: str) -> None:
    script = f"cp {{parameters}} {traced.folder}/seen; printf 'fitness\\n1\\n' > log.csv"
    experiment = traced.shell(script, parameters_format=form)
    given = {"pid.kp": 2, "list": [1, 2.5], "word": "two words", "seed": 3}
    evaluate(experiment.replace(parameters=given), [[0.25]])
    written = (traced.folder / "seen").read_text()
    if form == "json":
        assert json.loads(written) == json.loads(text)
    else:
        assert written == text


@pytest.mark.slow
def test_placeholders_in_commands_files_and_the_environment(traced: Traced) -> None:
    (traced.folder / "world.sdf").write_text("<world {speed} {kept}>{{x}} {seed}</world>")
    script = (
        "cat world.sdf; test -d {folder} && test -f {here}/world.sdf && echo $ROS_MASTER_URI {instance} "
        "{port} {episode} {{port}} ${HOME} {x,y}; printf 'fitness\\n{speed}\\n' > {log}"
    )
    experiment = traced.shell(
        script,
        files=["world.sdf"],
        log="log.csv",
        keep="all",
        environment={"ROS_MASTER_URI": "http://localhost:{port}", "DISPLAY": ":1{instance}"},
    )
    assert evaluate(experiment, [[0.25]]).tolist() == [0.25]
    (world,) = (traced.folder / "work").rglob("world.sdf")
    assert world.read_text() == "<world 0.25 {kept}>{{x}} 0</world>"


@pytest.mark.slow
def test_a_parameter_with_the_name_of_a_placeholder_is_in_the_file_alone(traced: Traced) -> None:
    (traced.folder / "own.yaml").write_text("port: 7\nspeed: 0.5\n")
    script = "test {port} -ge 1024 && sed -n 's/^port: /fitness\\n/p' parameters.yaml > log.csv"
    assert simulate(traced.shell(script, parameters="own.yaml")) == 7


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "definition"),
    [
        ("echo {port};", {}),
        ("", {"environment": {"ROS_MASTER_URI": "http://localhost:{port}"}}),
        ("", {"files": ["world.sdf"]}),
    ],
)
def test_a_parameter_with_the_name_of_a_placeholder_is_refused_in_episodes(
    traced: Traced, script: str, definition: dict[str, Any]
) -> None:
    """As other tools may send it: experiments with one are refused."""
    (traced.folder / "world.sdf").write_text("<world {port}/>")
    (traced.folder / "own.yaml").write_text("port: 7\nspeed: 0.5\n")
    words = r"the parameter port has the name of \{port\}, a free TCP port, .*; rename the parameter"
    for own in ({}, {"parameters": "own.yaml"}):
        made = traced.shell(f"{script} {WELL}", **definition, **own)
        stored = dataclasses.replace(made, parameters={"port": 5000})
        with pytest.raises(RunError, match=words):
            simulate(stored)
    unused = dataclasses.replace(traced.shell(WELL), parameters={"port": 5000})
    assert simulate(unused) == simulate(traced.shell(WELL))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "definition", "told"),
    [
        (
            "",
            {},
            r"neither \{weight\}, \{speed\}, \{seed\} nor \{parameters\} \(the path of parameters",
        ),
        (": {speed};", {}, r"neither \{seed\} nor .* receives it only if .*; for a program without random"),
        (": {speed};", {"determinism": "bitwise"}, None),
        (": {speed};", {"environment": {"SEED": "{seed}"}}, None),
        (":;", {"files": ["world.sdf"]}, r"^simulation: command: contains neither \{speed\} nor"),
        (": {parameters};", {}, None),
        ("cat parameters.yaml;", {}, None),
        ("", {"parameters_format": "json"}, "only if it opens parameters.json"),
        ("sh script;", {"sources": ["script"]}, None),
    ],
)
def test_parameters_that_do_not_reach_the_program_are_told_once(
    traced: Traced,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    script: str,
    definition: dict[str, Any],
    told: str | None,
) -> None:
    monkeypatch.setattr(warn_once, "_given", set())
    (traced.folder / "world.sdf").write_text("<world {seed}/>")
    (traced.folder / "script").write_text("cat parameters.yaml")
    parameters = {} if script else {"weight": 2}
    experiment = traced.shell(f"{script} {WELL}", **definition).replace(parameters=parameters)
    for _ in range(2):
        simulate(experiment)
    lines = [record.getMessage() for record in caplog.records if "contains neither" in record.getMessage()]
    assert len(lines) == (told is not None)
    assert told is None or re.search(told, lines[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("log", "content"),
    [
        ("log.csv", "a,b\n1,4\n4,x\n2,y\n"),
        ("log.csv", "# a ; b\r\n1;4\r\n4;x\r\n2;y"),
        ("log.tsv", "a\tb\n1\t4\n4\tx\n2\ty\n"),
        ("log.txt", "a,b\ntrue,\n\n4e0,\n 2,\n"),
        ("log.jsonl", '{"a": 1}\n{"b": "text"}\n\n{"a": 4}\n{"a": 2}'),
        ("log.json", '[{"a": true}, {"a": 4, "b": {"c": 1}}, {"a": 2}]'),
    ],
)
def test_formats_of_logs(traced: Traced, log: str, content: str) -> None:
    (traced.folder / "content").write_text(content)
    metrics = {
        "mean_a": "mean(a)",
        "most": "max(a)",
        "least": "min(a)",
        "a": "last",
        "begin": "first(a)",
        "n": "count(a)",
        "total": "sum(a)",
        "spread": "std( a )",
    }
    experiment = traced.shell(
        f"cp {{here}}/content {log}", log=log, metrics=metrics, fitness=" + ".join(metrics)
    )
    found = run_episode(experiment, None, broker=None).metrics
    assert found == {
        "mean_a": 7 / 3,
        "most": 4,
        "least": 1,
        "a": 2,
        "begin": 1,
        "n": 3,
        "total": 7,
        "spread": pytest.approx(np.std([1, 4, 2])),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "content",
    [
        "# Simulator 3, release\n# seed 7\ntime,a\n1,2\n",
        "# Simulator 3\n\n# time,a\n1,2\n",
        "# time;a\n# in s;in m\n1;2\n",
        '# He said, "here",\ntime,a\n\n1,2\n',
        "time,a,time\n1,2,x\n",
    ],
)
def test_comments_before_the_names_of_columns(traced: Traced, content: str) -> None:
    (traced.folder / "content").write_text(content)
    experiment = traced.shell(f"cp {traced.folder}/content log.csv", fitness="a")
    assert simulate(experiment) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "metric", "result"),
    [
        ("a,b\n1,nan\n2,3\n", "mean(b)", None),
        ("a,b\n1,nan\n2,3\n", "min(b)", None),
        ("a,b\n1,2\n2,nan\n", "max(b)", None),
        ("a,b\n1,inf\n2,-inf\n", "sum(b)", None),
        ("a,b\n1,nan\n2,3\n", "last(b)", 3),
        ("a,b\n1,starting\n2,3\n", "last(b)", 3),
        ("a,b\n1,3\n2,ended\n", "first(b)", 3),
        ("a,b\n1,starting\n2,nan\n", "count(b)", 2),
    ],
)
def test_a_metric_without_a_value_counts_where_the_fitness_uses_it(
    traced: Traced, content: str, metric: str, result: float | None
) -> None:
    (traced.folder / "content").write_text(content)

    def run(fitness: str) -> float:
        metrics = {"a": "last", "b": metric}
        return simulate(traced.shell(f"cp {traced.folder}/content log.csv", fitness=fitness, metrics=metrics))

    assert run("a") == 2
    if result is not None:
        assert run("b") == result
    else:
        with pytest.raises(RunError, match=r"log\.csv:\d: b is -?(nan|inf), expected a finite number"):
            run("b")


@pytest.mark.slow
def test_a_value_that_is_no_number_is_never_a_metric(traced: Traced) -> None:
    (traced.folder / "content").write_text("a,b\n1,2\n2,lost\n3,4\n")
    metrics = {"a": "last", "b": "mean"}
    with pytest.raises(RunError, match=r"log\.csv:3: b is 'lost', expected a number"):
        simulate(traced.shell(f"cp {traced.folder}/content log.csv", fitness="a", metrics=metrics))


@pytest.mark.slow
def test_nested_values_in_a_log(traced: Traced) -> None:
    experiment = traced.shell(
        'echo \'{"pose": {"x": 3}}\' > log.json', log="log.json", metrics={"x": "last(pose.x)"}, fitness="-x"
    )
    assert simulate(experiment) == -3


@pytest.mark.slow
def test_many_logs_and_standard_output(traced: Traced) -> None:
    script = "for i in 1 2 3; do printf 'distance\\n%s\\n' $i > agent_$i.csv; done"
    experiment = traced.shell(script, log="agent_*.csv", metrics={"far": "sum(distance)"}, fitness="-far")
    assert simulate(experiment) == -6.0
    experiment = traced.shell("echo '{\"fitness\": 2.5}'", log="stdout", log_format="jsonl")
    assert simulate(experiment) == 2.5


@pytest.mark.slow
def test_an_episode_that_is_shown(traced: Traced) -> None:
    script = f"printf 'fitness\\n%s\\n' {{seed}} > log.csv; echo $0 >> {traced.folder}/seen"
    experiment = traced.experiment(["sh", "-c", script, "hidden"], visual=["sh", "-c", script, "window"])
    assert simulate(experiment, seed=3) == 3
    assert simulate(experiment, visual=True, seed=4) == 4
    assert (traced.folder / "seen").read_text().split() == ["hidden", "window"]
