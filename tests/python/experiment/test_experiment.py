"""Experiment files: what they mean, and what is said when they are wrong."""

# ruff: noqa: E501 - a table of messages, a line each

import copy
import dataclasses
import json
import operator
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmwright import Experiment, InputError, evaluate, optimize, templates
from swarmwright.common.yaml import Source, dump, parse
from swarmwright.experiment.validation import check


def problems(text: str, tmp_path: Path) -> list[str]:
    file = tmp_path / "my.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        Experiment.load(file)
    assert caught.value.exit_status == 2
    return [line.replace(str(file), "my.yaml") for line in str(caught.value).splitlines()]


def test_only_the_simulation_is_required() -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim"})
    assert (experiment.sensors, experiment.actuators, experiment.requirements.dimensions) == (4, 1, 2)
    assert experiment.genome_size == 49
    assert experiment.controller.kind == "layered"
    assert experiment.to_mapping()["method"]["kind"] == "nnga"
    assert (experiment.mode, experiment.servers, experiment.seed, experiment.broker) == (
        "auto",
        "auto",
        1,
        None,
    )
    assert (experiment.timeouts.discovery, experiment.timeouts.step) == (10, 60)
    assert experiment.first_seed == 0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "method:\n  populaton: 50\n",
            "my.yaml:3: method.populaton: unknown key; did you mean 'population'?",
        ),
        ("controler: {}\n", "my.yaml:2: controler: unknown key; did you mean 'controller'?"),
        ("method: {kind: ngna}\n", "my.yaml:2: method.kind: unknown method 'ngna'; did you mean 'nnga'?"),
        (
            "controller:\n  kind: xyz\n",
            "my.yaml:3: controller.kind: unknown controller 'xyz'; available: evostick, fully_meshed, hebbian",
        ),
        ("controller: {kind: [1]}\n", "my.yaml:2: controller.kind: must be text, not [1]"),
        (
            "ranking: {aggregate: meen}\n",
            "my.yaml:2: ranking.aggregate: must be one of mean, sum, median, worst, quantile, cvar, not 'meen'; did you mean 'mean'?",
        ),
        ("method: {population: '50'}\n", "my.yaml:2: method.population: must be an integer, not '50'"),
        ("method: {population: 50.5}\n", "my.yaml:2: method.population: must be an integer, not 50.5"),
        ("method: {generations: 0}\n", "my.yaml:2: method.generations: must be at least 1, not 0"),
        ("method: {severity: .nan}\n", "my.yaml:2: method.severity: must be a finite number, not nan"),
        ("method: {severity: much}\n", "my.yaml:2: method.severity: must be a number, not 'much'"),
        (
            "method: {elite: 0.5}\n",
            "my.yaml:2: method: elite, random, mutate, crossover and renew must add up to 1, not 1.35",
        ),
        ("method: [nnga]\n", "my.yaml:2: method: must be a mapping (key: value), not ['nnga']"),
        (
            "method: nnga\n",
            "my.yaml:2: method: must be a mapping (key: value), not 'nnga'; write {kind: nnga}",
        ),
        (
            "method: cmaes\n",
            "my.yaml:2: method: must be a mapping (key: value), not 'cmaes'; write {kind: cma_es}",
        ),
        (
            "files: [map.json]\n",
            "my.yaml:2: files: unknown key; list files that the simulation reads in the section servers",
        ),
        (
            "method: {kind: cma_es, momentum: 1}\n",
            "my.yaml:2: method.momentum: unknown key; known keys: kind, generations, ",
        ),
        (
            "controller:\n  hidden:\n    - 8\n    - eight\n",
            "my.yaml:5: controller.hidden[1]: must be an integer, not 'eight'",
        ),
        ("controller: {hidden: 8}\n", "my.yaml:2: controller.hidden: must be a list, not 8; write [8]"),
        (
            "controller: {hidden: '8, 4'}\n",
            "my.yaml:2: controller.hidden: must be a list, not '8, 4'; write [8, 4]",
        ),
        ("controller: {hidden: x}\n", "my.yaml:2: controller.hidden: must be a list, not 'x'"),
        (
            "controller: {output_range: 2}\n",
            "my.yaml:2: controller.output_range: must be a list of 2 items, not 2",
        ),
        (
            "method: {kind: nsga2, objectives: [steps]}\n",
            "my.yaml:2: method.objectives: must map each metric to a direction, ",
        ),
        (
            "method: {kind: nsga2, objectives: {fitness: maximize, steps: minimize}}\n",
            "my.yaml:2: method.objectives.fitness: fitness is always the first objective and is maximized; leave it out",
        ),
        (
            "method: {kind: map_elites, measures: {steps: [0, 15, 5]}}\n",
            "my.yaml:2: method.measures.steps: must have the form {range: [0, 15], bins: 5}",
        ),
        (
            "method: {kind: map_elites, measures: [steps]}\n",
            "my.yaml:2: method.measures: must map each metric to a range, such as {steps: {range: [0, 1], ",
        ),
        ("seed: -1\n", "my.yaml:2: seed: must be at least 0, not -1"),
        ("seed: true\n", "my.yaml:2: seed: must be an integer, not true"),
        ("seed:\n", "my.yaml:2: seed: must be an integer, not nothing"),
        ("seed: 1\nseed: 2\n", "my.yaml:3: seed: duplicate key in one mapping (first in line 2)"),
        (
            "mode: offload\n",
            "my.yaml:2: mode: must be one of auto, stepwise, batched, offloaded, not 'offload'; did you mean 'offloaded'?",
        ),
        ("servers: 0\n", "my.yaml:2: servers: must be at least 1 and at most 1024, not 0"),
        (
            "servers: locl\n",
            "my.yaml:2: servers: must be auto, local, in-process, a number of servers or a launcher such as slurm:4, not 'locl'; did you mean 'local'?",
        ),
        (
            "servers: true\n",
            "my.yaml:2: servers: must be auto, local, in-process, a number of servers or a launcher such as slurm:4, not true",
        ),
        ("requirements: {max_agents: 3}\n", "my.yaml:2: requirements.dimensions: is missing"),
        (
            "requirements: {dimension: 3, dimensions: 2}\n",
            "my.yaml:2: requirements.dimension: unknown key; did you mean 'dimensions'?",
        ),
        ("timeouts: {step: 0}\n", "my.yaml:2: timeouts.step: must be greater than 0, not 0"),
        (
            "prefix: a/#\n",
            "my.yaml:2: prefix: must not contain '#', '+' or NUL, which have a special meaning in MQTT",
        ),
        ("prefix: /a\n", "my.yaml:2: prefix: must begin with neither '/' nor '$'"),
        ("broker: localhost\n", "my.yaml:2: broker: must begin with one of mqtt://, mqtts://, ws://, wss://"),
        ("broker: mqtt://\n", "my.yaml:2: broker: has no host; write it like mqtt://host:1883"),
        ("broker: mqtt://h:99999\n", "my.yaml:2: broker: has an invalid port, which must be from 1 to 65535"),
        ("sensors: 3\n", "my.yaml:2: sensors: minisim has 4, not 3; leave the key out"),
        (
            "parameters: {maxStep: 3}\n",
            "my.yaml:2: parameters.maxStep: unknown parameter of minisim; did you mean 'maxSteps'?",
        ),
        ("parameters:\n  mapWidth: 13\n  maxSteps: 0\n", "my.yaml:4: parameters.maxSteps: "),
        ("parameters:\n  maxSteps: '15'\n", "my.yaml:3: parameters.maxSteps: "),
        (
            "parameters: {mapWidth: .inf}\n",
            "my.yaml:2: parameters.mapWidth: must be a finite number, not inf",
        ),
    ],
)
def test_each_mistake_is_named_with_file_line_and_key(text: str, expected: str, tmp_path: Path) -> None:
    found = problems(f"simulation: minisim\n{text}", tmp_path)
    assert len(found) == 1
    assert found[0].startswith(expected)
    assert len(found[0]) > len("my.yaml:4: parameters.maxSteps: ")


def test_all_wrong_parameters_come_at_once(tmp_path: Path) -> None:
    text = (
        "simulation: minisim\nparameters:\n  maxSteps: -1\n  mapWidth: x\n  agents: 5\n  speedAgents: fast\n"
    )
    assert [line.split(": ")[0:2] for line in problems(text, tmp_path)] == [
        ["my.yaml:3", "parameters.maxSteps"],
        ["my.yaml:4", "parameters.mapWidth"],
        ["my.yaml:5", "parameters.agents"],
        ["my.yaml:6", "parameters.speedAgents"],
    ]


def test_what_follows_from_a_wrong_parameter_is_not_told(tmp_path: Path) -> None:
    # Two agents are right for two agents, and (20, 3) is inside a map that is wide enough.
    text = "simulation: minisim\nparameters: {numAgents: x, agents: [[1, 1], [2, 2]], goal: [12, 3]}\n"
    assert len(problems(text, tmp_path)) == 1


def test_an_unknown_title_is_told_with_file_and_line(tmp_path: Path) -> None:
    file = tmp_path / "my.yaml"
    file.write_text("seed: 1\nsimulation: minsim\nservers: local\nsensors: 4\nactuators: 1\n")
    with pytest.raises(InputError) as caught:
        optimize(file, out=tmp_path / "run")
    assert str(caught.value).startswith(
        f"{file}:2: simulation: unknown simulation 'minsim'; did you mean 'minisim'?"
    )
    with pytest.raises(InputError, match=r"^simulation: unknown simulation 'minsm'"):
        optimize(Experiment.load(file, ["simulation=minsm"]), out=tmp_path / "run")


@pytest.mark.parametrize("servers", ["local", "2"])
def test_requirements_that_the_simulation_cannot_fulfil_are_told_at_once(
    servers: str, tmp_path: Path
) -> None:
    file = tmp_path / "my.yaml"
    file.write_text(f"simulation: minisim\nservers: {servers}\nrequirements: {{dimensions: 3}}\n")
    with pytest.raises(InputError) as caught:
        optimize(file, out=tmp_path / "run")
    assert str(caught.value) == f"{file}:3: requirements: minisim has 2 dimensions, not 3; leave the key out"
    file.write_text("simulation: minisim\nrequirements: {dimensions: 2, max_agents: 1000000}\n")
    with pytest.raises(InputError, match="minisim has at most 100000 agents, not 1000000"):
        optimize(file, out=tmp_path / "run")


def test_all_mistakes_come_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = "simulation: minisim\nseed: x\nmethod:\n  kind: nnga\n  generatons: 3\nranking: {episodes: 0}\nfoo: 1\nfoo: 2\n"
    assert [line.split(": ")[0:2] for line in problems(text, tmp_path)] == [
        ["my.yaml:2", "seed"],
        ["my.yaml:5", "method.generatons"],
        ["my.yaml:6", "ranking.episodes"],
        ["my.yaml:8", "foo"],
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("- 1\n", "holds [1]"),
        ("minisim\n", "holds 'minisim'"),
        ("seed: 1\n", "simulation: is missing"),
        (
            "simulation: {gymnasium: Acrobot-v1}\n",
            "environments are written without a space; write gymnasium:Acrobot-v1",
        ),
        ("simulation: {pettingzoo: }\n", "environments are written without a space; write pettingzoo:NAME"),
    ],
)
def test_what_is_no_experiment(text: str, words: str, tmp_path: Path) -> None:
    assert any(words in line for line in problems(text, tmp_path))


def test_a_password_in_the_address_is_refused_and_not_repeated(tmp_path: Path) -> None:
    found = problems("simulation: minisim\nbroker: mqtt://me:s3cret@host\n", tmp_path)
    assert "SWARMWRIGHT_PASSWORD" in found[0]
    assert "s3cret" not in found[0]


def test_sections_left_empty_mean_their_defaults(tmp_path: Path) -> None:
    file = tmp_path / "my.yaml"
    file.write_text("simulation: minisim\nmethod:\nparameters:\ncontroller:\n")
    assert Experiment.load(file) == Experiment.from_mapping({"simulation": "minisim"})


def test_a_foreign_simulation_is_fine_until_it_is_run() -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "gazebo", "parameters": {"anything": [1, {"x": None}]}}
    )
    assert experiment.requirements.dimensions == 2
    with pytest.raises(InputError, match="sensors: unknown, as 'gazebo' is not built in"):
        _ = experiment.genome_size
    assert experiment.replace(sensors=3, actuators=2, controller={"hidden": []}).genome_size == 8


def test_numpy_values_are_plain_values() -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "seed": np.int64(5), "parameters": {"goal": np.array([12.0, 3.0])}}
    )
    assert experiment.seed == 5
    assert experiment.to_mapping()["parameters"] == {"goal": [12.0, 3.0]}


def test_numpy_values_replace_others() -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim", "parameters": {"goal": [12.0, 3.0]}})
    moved = experiment.replace(parameters={"goal": np.array([11.0, 2.0])}, seed=np.int64(5))
    assert moved.to_mapping()["parameters"] == {"goal": [11.0, 2.0]}
    assert moved.seed == 5
    same = experiment.replace(parameters={"goal": np.array([12.0, 3.0])})
    assert same == experiment


def test_what_an_experiment_holds_cannot_be_changed() -> None:
    experiment = Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": {"goal": [12.0, 3.0]},
            "controller": {"hidden": [4]},
            "ranking": {"kind": "absolute"},
        }
    )
    before, values = hash(experiment), experiment.to_mapping()
    for change in (
        lambda: experiment.parameters.update(maxSteps=3),
        lambda: operator.setitem(experiment.parameters, "maxSteps", 3),
        lambda: operator.delitem(experiment.parameters, "goal"),
        lambda: operator.setitem(experiment.parameters["goal"], 0, 1.0),
        lambda: experiment.parameters["goal"].append(1.0),
        lambda: vars(experiment.controller)["hidden"].append(2),
    ):
        with pytest.raises(TypeError, match=r"experiment.replace\(parameters="):
            change()
    assert (hash(experiment), experiment.to_mapping()) == (before, values)
    values["parameters"]["goal"][0] = 1.0  # plain values are a copy
    assert experiment.parameters == {"goal": [12.0, 3.0]}


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_copies_are_equal_and_cannot_be_changed_either(copied: Callable[[Experiment], Experiment]) -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "parameters": {"goal": [12.0, 3.0]}, "controller": {"hidden": [4]}}
    )
    other = copied(experiment)
    assert (other, hash(other)) == (experiment, hash(experiment))
    assert json.loads(json.dumps(other.parameters)) == {"goal": [12.0, 3.0]}
    assert other.parameters | {"seed": 3} == {"goal": [12.0, 3.0], "seed": 3}
    with pytest.raises(TypeError, match="read-only"):
        other.parameters["goal"][0] = 1.0
    with pytest.raises(TypeError, match="read-only"):
        vars(other.controller)["hidden"].clear()


def test_an_experiment_is_checked_before_a_run(tmp_path: Path) -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim", "servers": "in-process"})
    wrong = dataclasses.replace(experiment, parameters={"typo": 3})
    with pytest.raises(InputError, match=r"parameters\.typo: unknown parameter of minisim"):
        optimize(wrong, out=tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("given", [(), ({"simulation": "minisim"},), ("my.yaml",)])
def test_the_class_leads_to_what_makes_experiments(given: tuple[Any, ...]) -> None:
    with pytest.raises(InputError, match=r"Experiment.load\(path\), or by Experiment.from_mapping\(\{"):
        Experiment(*given)


def test_methods_are_asked_and_told() -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "servers": "in-process", "method": {"kind": "cma_es", "population": 15}}
    )
    method, other = experiment.new_method(), experiment.new_method(experiment.representation())
    genomes = method.ask()
    assert genomes.shape == (15, experiment.genome_size)
    assert genomes.tobytes() == other.ask().tobytes()
    wrong: Any
    for wrong in (["a"] * 15, [{}] * 15, "a", [[1.0], [1.0, 2.0]]):
        with pytest.raises(InputError, match="fitness: must be an array of numbers"):
            method.tell(wrong)
    with pytest.raises(InputError, match=r"fitness: shape is \(14,\); expected \(15,\)"):
        method.tell(np.zeros(14))
    method.tell(evaluate(experiment, genomes, generation=method.generation))
    assert method.generation == 1


def test_paths_are_text(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(templates.mission("decision"))
    experiment = Experiment.from_mapping({"simulation": "arena", "parameters": {"mission": mission}})
    assert experiment.parameters["mission"]["title"] == "Decision"


@pytest.mark.slow
@given(
    st.fixed_dictionaries(
        {"simulation": st.just("minisim")},
        optional={
            "seed": st.integers(0, 2**63 - 1),
            "servers": st.integers(1, 1024) | st.sampled_from(["auto", "local"]),
            "prefix": st.sampled_from(["", "lab/1", "a b", "é"]),
            "broker": st.sampled_from(["mqtt://h", "wss://[::1]:443/mqtt", "mqtts://h:8883"]),
            "method": st.fixed_dictionaries(
                {"kind": st.sampled_from(["nnga", "random_search"])},
                optional={
                    "generations": st.integers(1, 10**9),
                    "target": st.floats(allow_nan=False, allow_infinity=False),
                },
            ),
            "controller": st.sampled_from(
                [{"kind": "fully_meshed", "hidden": 0}, {"hidden": [3, 4]}, {"weight_range": 1e-3}]
            ),
            "timeouts": st.fixed_dictionaries({}, optional={"step": st.floats(1e-3, 1000)}),
        },
    )
)
def test_a_saved_experiment_loads_to_an_equal_one(values: dict[str, Any]) -> None:
    experiment = Experiment.from_mapping(values)
    text = dump(experiment.to_mapping())
    assert Experiment(**check(parse(text, "x.yaml"))) == experiment
    assert Experiment(**check(Source("", values=experiment.to_mapping()))) == experiment


def test_saving_writes_every_default(tmp_path: Path) -> None:
    Experiment.from_mapping({"simulation": "minisim"}).save(tmp_path / "full.yaml")
    text = (tmp_path / "full.yaml").read_text()
    for key in (
        "population: 50",
        "partners: 11",
        "discovery: 10.0",
        "sensors: 4",
        "hidden: [8]",
        "episodes: 1",
    ):
        assert key in text


def test_replacing_merges_sections_and_checks() -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "method": {"population": 20, "generations": 7}}
    )
    changed = experiment.replace(seed=9, method={"generations": 3})
    assert (changed.seed, changed.generations, changed.to_mapping()["method"]["population"]) == (9, 3, 20)
    assert experiment.seed == 1
    other = changed.replace(method={"kind": "random_search"})
    assert other.to_mapping()["method"] == {
        "kind": "random_search",
        "generations": 200,
        "operation": "generational",
        "in_flight": 16,
        "population": 50,
    }
    with pytest.raises(InputError, match=r"method\.generatons: unknown key; did you mean 'generations'"):
        experiment.replace(method={"generatons": 3})


def test_replacing_by_none_takes_a_key_back_to_its_default() -> None:
    experiment = Experiment.from_mapping(
        {
            "simulation": "minisim",
            "seed": 4,
            "broker": "mqtt://h",
            "parameters": {"agents": [[1, 1]], "maxSteps": 3},
            "method": {"target": 1.0, "generations": 5},
        }
    )
    changed = experiment.replace(
        seed=None, broker=None, parameters={"agents": None}, method={"target": None, "generations": None}
    )
    assert (changed.seed, changed.broker, changed.parameters) == (1, None, {"maxSteps": 3})
    assert (changed.method.target, changed.generations) == (None, 200)


def test_another_simulation_has_sensors_of_its_own() -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "x", "sensors": 7, "actuators": 3, "requirements": {"dimensions": 3}}
    )
    changed = experiment.replace(simulation="minisim")
    assert (changed.sensors, changed.actuators, changed.requirements.dimensions) == (4, 1, 2)


def test_another_robot_has_sensors_of_its_own(tmp_path: Path) -> None:
    file = tmp_path / "arena.yaml"
    file.write_text("simulation: arena\nrequirements: {dimensions: 2, max_agents: 30}\n")
    changed = Experiment.load(file).replace(parameters={"robot": "e-puck-rm1.2"})
    assert (changed.sensors, changed.actuators, changed.requirements.max_agents) == (9, 2, 30)
    assert changed == Experiment.load(file, ["parameters.robot=e-puck-rm1.2"])
    file.write_text("simulation: arena\nsensors: 24\n")
    with pytest.raises(InputError, match=r"sensors: arena has 9, not 24; leave the key out"):
        Experiment.load(file).replace(parameters={"robot": "e-puck-rm1.2"})


def test_parameters_that_do_not_change_the_sensors_are_replaced_without_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sweeps make thousands of such copies, perhaps of a file that is edited meanwhile."""
    file = tmp_path / "arena.yaml"
    file.write_text("simulation: arena\n")
    experiment = Experiment.load(file)
    monkeypatch.setattr("swarmwright.experiment.experiment.read", lambda _: pytest.fail("the file is read"))
    changed = experiment.replace(parameters={"duration": 7})
    assert (changed.sensors, changed.parameters["duration"]) == (experiment.sensors, 7)


def test_sensors_that_no_simulation_here_announces_stay() -> None:
    experiment = Experiment.from_mapping({"simulation": "x", "sensors": 7, "actuators": 3})
    changed = experiment.replace(parameters={"robot": "e-puck-rm1.2"})
    assert (changed.sensors, changed.actuators) == (7, 3)


def test_settings_of_a_mapping() -> None:
    changed = Experiment.from_mapping({"simulation": "arena"}, ["parameters.robot=foot-bot", "seed=3"])
    assert changed == Experiment.from_mapping(
        {"simulation": "arena", "parameters": {"robot": "foot-bot"}, "seed": 3}
    )
    with pytest.raises(InputError, match="--set sede=3: unknown key; did you mean 'seed'"):
        Experiment.from_mapping({"simulation": "arena"}, ["sede=3"])


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"parameters": {"speedAgents": 1}},
        {
            "controller": {"kind": "layered", "hidden": [8, 4]},
            "validate": {"vary": {"parameters.speedDefenders": [0, 1]}},
        },
        {"servers": {"launcher": "process", "count": 2}, "ranking": {"kind": "race"}},
        {"method": {"kind": "cma_es"}},
    ],
)
def test_equal_experiments_have_equal_hashes(changes: dict[str, Any], tmp_path: Path) -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim", **changes})
    experiment.save(tmp_path / "saved.yaml")
    loaded = Experiment.load(tmp_path / "saved.yaml")
    assert (loaded, hash(loaded)) == (experiment, hash(experiment))
    assert {experiment: "a"}[loaded] == "a"
    assert len({experiment, loaded, experiment.replace(seed=7)}) == 2
    whole, real = (experiment.replace(parameters={"speedAgents": value}) for value in (1, 1.0))
    assert (whole == real, hash(whole) == hash(real)) == (True, True)


def test_experiments_do_not_change() -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim"})
    with pytest.raises(dataclasses.FrozenInstanceError):
        experiment.seed = 3  # type: ignore[misc]


@pytest.mark.parametrize("seed", [-1, 1.5, "1", True, 2**63])
def test_simulation_seeds_that_are_none(seed: object) -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "elsewhere", "sensors": 1, "actuators": 1, "parameters": {"seed": seed}}
    )
    with pytest.raises(InputError, match=r"parameters\.seed: must be an integer"):
        _ = experiment.first_seed


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.binary(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["kind", "hidden", "population", "dimensions", "x", 3]), inner, max_size=3
        )
    ),
    max_leaves=6,
)
KEYS = sorted(Experiment.json_schema()["properties"])


@pytest.mark.slow
@given(st.dictionaries(st.sampled_from([*KEYS, "nonsense"]) | st.integers(), JUNK), st.booleans())
@settings(max_examples=400)
def test_junk_is_an_input_error_and_nothing_else(values: dict[Any, Any], named: bool) -> None:
    if named:
        values = values | {"simulation": "minisim"}
    try:
        experiment = Experiment.from_mapping(values)
    except InputError:
        return
    assert Experiment.from_mapping(experiment.to_mapping()) == experiment


def test_genomes_without_bounds_are_refused() -> None:
    with pytest.raises(InputError, match="controller: 100070006 genes exceed the limit of 1000000"):
        _ = Experiment.from_mapping(
            {"simulation": "minisim", "controller": {"kind": "fully_meshed", "hidden": 10_000}}
        ).genome_size


def test_files_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written: No such file or directory"):
        Experiment.from_mapping({"simulation": "minisim"}).save(tmp_path / "none" / "x.yaml")


@pytest.mark.parametrize("seed", [-1, 2**62 + 1, 2**63 - 1, True, 1.5])
def test_the_first_seed_leaves_room_for_those_of_other_episodes(seed: object) -> None:
    values = {"simulation": "foreign", "sensors": 1, "actuators": 1}
    assert Experiment.from_mapping({**values, "parameters": {"seed": 2**62}}).first_seed == 2**62
    with pytest.raises(InputError, match=r"parameters\.seed: must be an integer from 0 to 2\*\*62, not "):
        _ = Experiment.from_mapping({**values, "parameters": {"seed": seed}}).first_seed
