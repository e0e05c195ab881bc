"""What `--set KEY.PATH=VALUE` makes of an experiment, and what is said when it is wrong."""

# ruff: noqa: E501 - a table of messages, a line each

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, evaluate, templates
from swarmwright.analysis.sweep import Sweep
from swarmwright.common.yaml import parse
from swarmwright.experiment.budget import Budget

FILE = """\
simulation: minisim
method: {kind: nnga, population: 12, generations: 4}
parameters: {agents: [[0.5, 3.5]], maxSteps: 9}
mode: stepwise
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my.yaml"
    path.write_text(FILE)
    return path


def test_values_are_yaml_and_the_last_one_wins(file: Path) -> None:
    experiment = Experiment.load(
        file,
        ["seed=3", "controller.hidden=[8, 4]", "seed=4", "mode=auto", "timeouts.step=2.5", "fitness=arrived"],
    )
    assert (experiment.seed, experiment.mode, experiment.timeouts.step) == (4, "auto", 2.5)
    assert (vars(experiment.controller)["hidden"], experiment.fitness) == ([8, 4], "arrived")
    assert experiment.method == Experiment.load(file).method


def test_items_of_lists_are_named_by_their_number(file: Path) -> None:
    one = Experiment.load(file, ["parameters.agents.0=[1, 2]"])
    other = Experiment.load(file, ["parameters.agents[0][0]=1", "parameters.agents.0.1=2"])
    assert one.parameters["agents"] == other.parameters["agents"] == [[1, 2]]


def test_null_takes_a_key_back_to_its_default(file: Path) -> None:
    experiment = Experiment.load(file, ["method.population=null", "parameters=null", "mode="])
    assert (vars(experiment.method)["population"], experiment.parameters, experiment.mode) == (50, {}, "auto")


def test_another_kind_starts_from_its_own_defaults(file: Path) -> None:
    for settings in (["method.step=0.2", "method.kind=cma_es"], ["method.kind=cma_es", "method.step=0.2"]):
        method = Experiment.load(file, settings).to_mapping()["method"]
        assert (method["kind"], method["step"], method["generations"]) == ("cma_es", 0.2, 4)
        assert "population" not in method
    assert Experiment.load(file, ["method.kind=nnga"]) == Experiment.load(file)


@pytest.mark.parametrize(
    ("limits", "settings", "expected"),
    [
        ("generations: 4", [], Budget(4, None, None)),
        ("evaluations: 70, target: 3", [], Budget(None, 70, None)),
        ("generations: 4, seconds: 7", [], Budget(4, None, 7)),
        ("generations: 4", ["method.evaluations=90"], Budget(None, 90, None)),
        ("evaluations: 70, seconds: 7", ["method.generations=9"], Budget(9, None, None)),
        ("generations: 4, seconds: 7", ["method.generations=null"], Budget(None, None, 7)),
        ("population: 12", [], Budget(200, None, None)),
    ],
)
def test_a_method_of_another_kind_keeps_the_budget(
    file: Path, limits: str, settings: list[str], expected: Budget
) -> None:
    file.write_text(file.read_text().replace("population: 12, generations: 4", limits))
    for order in (["method.kind=de", *settings], [*settings, "method.kind=de"]):
        found = Experiment.load(file, order)
        assert (found.to_mapping()["method"]["kind"], found.budget) == ("de", expected)
        assert found.method.target == (3 if "target" in limits else None)
    if settings:
        assert Experiment.load(file, settings).budget == expected, "of the file's own kind"
    race = Experiment.load(file, ["method.kind=racing", *settings])
    assert race.budget.generations == (9 if "method.generations=9" in settings else None), (
        "instances of a race"
    )


def test_a_ranking_of_another_kind_keeps_its_episodes_and_seeds(file: Path) -> None:
    file.write_text(file.read_text() + "ranking: {episodes: 12, seeds: new, failed: stop, level: 0.3}\n")
    race = Experiment.load(file, ["ranking.kind=race"])
    found = race.to_mapping()["ranking"]
    assert (found["kind"], found["episodes"], found["seeds"], found["failed"]) == ("race", 12, "new", "stop")
    assert found["level"] == 0.05, "another level than that of an aggregate"
    for order in (["ranking.kind=race", "ranking.episodes=8"], ["ranking.episodes=8", "ranking.kind=race"]):
        assert Experiment.load(file, order).ranking.episodes == 8
    with pytest.raises(InputError, match=r"ranking\.episodes=3: 3 is too few for a race"):
        Experiment.load(file, ["ranking.kind=race", "ranking.episodes=3"])


def test_a_budget_that_is_kept_is_reported_where_it_stands(file: Path) -> None:
    file.write_text(file.read_text().replace("generations: 4", "generations: none"))
    with pytest.raises(InputError, match=r"my\.yaml:\d+: method\.generations: "):
        Experiment.load(file, ["method.kind=de"])


def test_a_whole_section_comes_before_what_is_set_in_it_afterwards(file: Path) -> None:
    def method(*settings: str) -> dict[str, Any]:
        found: dict[str, Any] = Experiment.load(file, settings).to_mapping()["method"]
        return found

    assert method("method={}", "method.kind=snes")["kind"] == "snes"
    assert method("method={population: 8}", "method.generations=3", "method.kind=de")["generations"] == 3
    assert method("method.population=8", "method={}", "method.kind=de") == method("method={kind: de}")
    assert method("method.kind=snes", "method={}") == method("method={}"), "the last one wins"
    found = Experiment.load(
        file, ["parameters={}", "parameters.field=3", "parameters=null", "simulation=other"]
    )
    assert (found.simulation, found.parameters) == ("other", {})


def test_another_simulation_brings_its_own_sensors(file: Path) -> None:
    written = Experiment.load(file, ["parameters=null"])
    written.save(file)  # with every default written out
    other = Experiment.load(file, ["simulation=emergency_exit"])
    assert (other.sensors, other.actuators) == (10, 2)
    assert written.with_settings(["simulation=emergency_exit"]) == other
    assert Experiment.load(file, ["simulation=emergency_exit", "seed=5"]).seed == 5


def test_names_with_dots_stand_in_quotes() -> None:
    experiment = Experiment.from_mapping({"simulation": "foreign"}).with_settings(['parameters."pid.k"=3'])
    assert experiment.parameters == {"pid.k": 3}


def test_all_problems_come_at_once_with_those_of_the_file(file: Path) -> None:
    file.write_text(FILE.replace("population", "populaton").replace("stepwise", "x"))
    settings = [
        "method.generatons=5",
        "controller.hidden=[8, x]",
        "parameters.agents.1=[1, 1]",
        "parameters.maxSteps.first=4",
        "faults={audti: 1}",
        "controler.kind=layered",
    ]
    with pytest.raises(InputError) as caught:
        Experiment.load(file, settings)
    assert str(caught.value).replace(str(file), "my.yaml").splitlines() == [
        "my.yaml:2: method.populaton: unknown key; did you mean 'population'?",
        "my.yaml:4: mode: must be one of auto, stepwise, batched, offloaded, not 'x'",
        "--set method.generatons=5: unknown key; did you mean 'generations'?",
        "--set controller.hidden=[8, x]: controller.hidden[1]: must be an integer, not 'x'",
        "--set parameters.agents.1=[1, 1]: parameters.agents is a list without an item '1'; its items are 0 to 0",
        "--set parameters.maxSteps.first=4: parameters.maxSteps is 9, which has no key 'first'",
        "--set faults={audti: 1}: faults.audti: unknown key; did you mean 'audit'?",
        "--set controler.kind=layered: controler: unknown key; did you mean 'controller'?",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("method.generations", "write KEY=VALUE"),
        ("=5", "write KEY=VALUE"),
        ("a..b=5", "write KEY=VALUE"),
        ("seed=[1", "the value is not valid YAML"),
        ("parameters={a: 1, a: 2}", "duplicate key"),
        ("seed=!!python/none 1", "has no meaning here"),
    ],
)
def test_what_is_no_setting(text: str, words: str, file: Path) -> None:
    with pytest.raises(InputError) as caught:
        Experiment.load(file, [text, "also wrong"])
    lines = str(caught.value).splitlines()
    assert lines[0].startswith(f"--set {text}: ")
    assert words in lines[0]
    assert lines[1].startswith("--set also wrong: write KEY=VALUE")


def test_files_in_settings_are_relative_to_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, here = tmp_path / "of_file", tmp_path / "here"
    folder.mkdir()
    here.mkdir()
    for place, steps in ((folder, 1), (here, 2)):
        field = {"width": 5, "height": 5, "agents": [[steps, 0]], "exits": [[4, 4]], "blockades": []}
        (place / "field.json").write_text(json.dumps(field))
    file = folder / "exit.yaml"
    file.write_text("simulation: emergency_exit\nparameters: {field: field.json, numAgents: 1}\n")
    monkeypatch.chdir(here)
    assert Experiment.load(file).parameters["field"]["agents"] == [[1, 0]]
    assert Experiment.load(file, ["seed=3"]).parameters["field"]["agents"] == [[1, 0]]
    assert Experiment.load(file, ["parameters.field=field.json"]).parameters["field"]["agents"] == [[2, 0]]


def test_settings_of_a_sweep_hold_for_all_variants(file: Path) -> None:
    sweep = file.with_name("sweep.yaml")
    sweep.write_text("experiment: my.yaml\ngrid: {method.population: [10, 20]}\n")
    loaded = Sweep.load(sweep, settings=["method.generations=7"])
    assert [one.experiment.generations for one in loaded.variants] == [7, 7]
    with pytest.raises(InputError, match=r"--set method\.generatons=7: unknown key"):
        Sweep.load(sweep, settings=["method.generatons=7"])


def test_only_what_makes_sense_can_be_set_of_a_run() -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim"})
    with pytest.raises(InputError, match="--set seed=3: seed: only parameters count"):
        experiment.with_settings(
            ["parameters.maxSteps=3", "seed=3"], only=["parameters"], reason="only parameters count"
        )


def test_controllers_that_do_not_fit_another_robot() -> None:
    experiment = Experiment.from_mapping({"simulation": "arena", "servers": "local"})
    with pytest.raises(InputError) as raised:
        experiment.with_settings(["parameters.robot=foot-bot"])
    found = str(raised.value)
    assert found.startswith(
        "controller: was evolved for 24 sensors and 2 actuators, but the robot foot-bot has "
    )
    assert "; matching robots: e-puck-rm1.1" in found
    assert "leave the key out" not in found
    assert experiment.with_settings(["parameters.robot=e-puck-rm1.1"]).sensors == 24


def test_parts_of_a_robot_that_the_mission_names(tmp_path: Path) -> None:
    def swarm(**parameters: Any) -> Experiment:
        return Experiment.from_mapping({"simulation": "arena", "parameters": parameters})

    changed = swarm(mission="object_retrieval").with_settings(["parameters.robot.drive.noise=0.1"])
    robot = changed.parameters["robot"]
    assert (robot["mass"], robot["drive"]["max_speed"], robot["drive"]["noise"]) == (0.8, 0.2, 0.1)
    assert (changed.sensors, changed.actuators) == (20, 3)
    noise = {"drive": {"noise": 0.1}}
    for parameters in ({}, {"mission": "aggregation"}, {"robot": "e-puck-rm1.1"}):
        changed = swarm(**parameters).with_settings(["parameters.robot.drive.noise=0.1"])
        assert changed.parameters["robot"] == {"preset": "e-puck-rm1.1", **noise}
    changed = swarm().with_settings(["parameters.robot.drive.noise=0.1", "parameters.robot=e-puck-rm1.1"])
    assert changed.parameters["robot"] == "e-puck-rm1.1"
    with pytest.raises(InputError, match="but the robot foot-bot has"):
        swarm().with_settings(["parameters.robot=foot-bot"])
    file = tmp_path / "swarm.yaml"
    file.write_text("simulation: arena\nparameters: {mission: object_retrieval}\n")
    changed = Experiment.load(file, ["parameters.robot.drive.noise=0.1"])
    assert changed.parameters["robot"]["mass"] == 0.8
    # What the file names may be anything.
    (tmp_path / "mine.yaml").write_text("place: {polygon: [[0, 0], [3, 0], [3, 3], [0, 3]]}\n")
    for mission in ("mine.yaml", "nowhere", "[1]"):
        file.write_text(f"simulation: arena\nparameters: {{mission: {mission}}}\n")
        with pytest.raises(InputError):
            Experiment.load(file, ["parameters.robot.drive.noise=0.1"])
    same = swarm(mission="object_retrieval").with_settings(["parameters.robot.drive.noise=0.05"])
    genomes = np.zeros((1, same.genome_size))
    before = evaluate(swarm(mission="object_retrieval"), genomes, servers="local")
    assert evaluate(same, genomes, servers="local").tobytes() == before.tobytes()


def test_parts_of_the_robots_of_kinds() -> None:
    own = {"preset": "e-puck-rm1.2", "drive": {"max_speed": 0.08}}
    kinds = [
        {"name": "scout", "robot": "e-puck-rm1.2", "count": 2},
        {"name": "heavy", "robot": own, "count": 1},
    ]
    mission = {**parse(templates.mission("aggregation"), "").values, "robots": kinds}

    def changed(key: str, **parameters: Any) -> Experiment:
        return Experiment.from_mapping({"simulation": "arena", "parameters": parameters}).with_settings([key])

    found = changed("parameters.mission.robots.0.robot.drive.noise=0.1", mission=mission)
    assert found.parameters["mission"]["robots"][0]["robot"] == {
        "preset": "e-puck-rm1.2", "drive": {"noise": 0.1},
    }  # fmt: skip
    found = changed("parameters.mission.robots.1.robot.drive.noise=0.1", mission=mission)
    assert found.parameters["mission"]["robots"][1]["robot"]["drive"] == {"max_speed": 0.08, "noise": 0.1}
    found = changed("parameters.robots.0.robot.drive.noise=0.1", robots=kinds)
    assert found.parameters["robots"][0]["robot"]["preset"] == "e-puck-rm1.2"
    for key, parameters in (("mission.robots", {"mission": mission}), ("robots", {"robots": kinds})):
        with pytest.raises(InputError) as caught:
            changed("parameters.robot.drive.noise=0.1", **parameters)
        assert str(caught.value) == (
            "--set parameters.robot.drive.noise=0.1: parameters.robot has no effect, as there are kinds of "
            f"robots; set a component of a kind, such as parameters.{key}.0.robot.drive.noise"
        )


def test_parts_of_a_mission_in_a_file_or_with_a_name(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(templates.mission("decision"))
    (tmp_path / "robot.yaml").write_text("preset: e-puck-rm1.2\n")
    file = tmp_path / "swarm.yaml"
    for mission in ("mine.yaml", "decision"):
        file.write_text(f"simulation: arena\nparameters: {{mission: {mission}, robot: robot.yaml}}\n")
        changed = Experiment.load(
            file, ["parameters.mission.robots=3", "parameters.robot.sensors.ground.noise=0.1"]
        )
        mission_of_it, robot = changed.parameters["mission"], changed.parameters["robot"]
        assert (mission_of_it["robots"], mission_of_it["title"]) == (3, "Decision")
        assert robot == {"preset": "e-puck-rm1.2", "sensors": {"ground": {"noise": 0.1}}}
    with pytest.raises(InputError, match="unknown field `robt`") as caught:
        Experiment.load(file, ["parameters.mission.robt=3"])
    assert str(caught.value).startswith("--set parameters.mission.robt=3: ")
    file.write_text("simulation: arena\nparameters: {mission: none.yaml}\n")
    with pytest.raises(InputError) as caught:
        Experiment.load(file, ["parameters.mission.robots=3"])
    assert "none.yaml: there is no such file" in str(caught.value)
    # A part of text that stands for nothing else.
    file.write_text("simulation: gazebo\nparameters: {mission: decision}\n")
    with pytest.raises(InputError, match=r"parameters\.mission is 'decision', which has no key 'robots'"):
        Experiment.load(file, ["parameters.mission.robots=3"])


def test_a_metric_called_like_that_of_the_ranking() -> None:
    values = {"simulation": "minisim", "fitness": "slow_fitness * 2"}
    ranking = {"kind": "multi_fidelity", "slow": {"parameters": {"maxSteps": 50}}}
    with pytest.raises(InputError, match="fitness: the ranking multi_fidelity uses the name slow_fitness"):
        Experiment.from_mapping({**values, "ranking": ranking})
