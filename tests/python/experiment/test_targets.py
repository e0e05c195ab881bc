"""What candidates are transferred to."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Experiment, InputError
from swarmwright.experiment.ranges import E_PUCKS, Range, ranges_of, require_e_pucks
from swarmwright.experiment.targets import OtherSimulation, PseudoReality, is_same, targets_of

EXPERIMENT = Experiment.from_mapping(
    {"simulation": "minisim", "parameters": {"speedDefenders": 0.5}, "servers": "local"}
)


@pytest.mark.parametrize(
    ("text", "path", "low", "high"),
    [
        ("parameters.a=0.4..0.8", ("parameters", "a"), 0.4, 0.8),
        ("parameters.a=1..3", ("parameters", "a"), 1, 3),
        ("parameters.a = -1e-3..2".replace(" ", ""), ("parameters", "a"), -1e-3, 2),
        ("parameters.a.0.b=.5...7", ("parameters", "a", "0", "b"), 0.5, 0.7),
        ("parameters.a=5. .. 7.5", ("parameters", "a"), 5.0, 7.5),
        ('parameters."a.b"=-2..-1', ("parameters", "a.b"), -2, -1),
    ],
)
def test_ranges_are_read(text: str, path: tuple[str, ...], low: float, high: float) -> None:
    found = Range.parse(text)
    assert (found.path, found.low, found.high) == (path, low, high)
    assert (type(found.low), type(found.high)) == (type(low), type(high))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("parameters.a=0.4", "write KEY=LOW..HIGH, such as parameters.speedDefenders=0.4..0.8"),
        ("parameters.a", "write KEY=VALUE"),
        ("parameters.a=low..high", "'low' is not a number"),
        ("parameters.a=0..nan", "'nan' is not a number"),
        ("parameters.a=0..inf", "'inf' is not a number"),
        ("parameters.a=2..1", "exceeds the highest"),
        ("method.severity=0..1", "only parameters of the simulation can be varied"),
        ("speedDefenders=0..1", "varied; did you mean parameters.speedDefenders?"),
        ("parameters.seed=0..1", "every episode has its own seed"),
    ],
)
def test_what_is_no_range_is_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match="^--vary .*" + said.replace(".", r"\.").replace("?", r"\?")):
        Range.parse(text)


@given(st.integers(-5, 5), st.integers(0, 9), st.floats(0, 1, exclude_max=True))
def test_values_are_within(low: int, width: int, share: float) -> None:
    whole = Range(("parameters", "a"), low, low + width).interpolate(share)
    assert isinstance(whole, int)
    assert low <= whole <= low + width
    assert low <= Range(("parameters", "a"), float(low), low + width).interpolate(share) <= low + width


def test_models_are_the_same_for_all_runs_and_each_differs() -> None:
    target = PseudoReality((Range(("parameters", "speedDefenders"), 0.2, 0.9),))
    models = [one.parameters["speedDefenders"] for one in target.make_experiments(EXPERIMENT, 40)]
    assert len(set(models)) == 40
    assert min(models) < 0.3
    assert max(models) > 0.8
    other = target.make_experiments(EXPERIMENT.replace(seed=9), 50)
    assert [one.parameters["speedDefenders"] for one in other[:40]] == models
    assert {one.seed for one in other} == {9}


def test_a_file_changes_the_keys_that_it_has(tmp_path: Path) -> None:
    path = tmp_path / "faster.yaml"
    path.write_text("parameters: {numDefenders: 2}\nservers: in-process\n")
    target = OtherSimulation(str(path))
    (changed,) = target.make_experiments(EXPERIMENT, 30)
    expected = EXPERIMENT.replace(parameters={"numDefenders": 2}, servers="in-process")
    assert changed == expected
    assert target.sets_servers
    path.write_text("simulation: minisim\n")
    assert not OtherSimulation(str(path)).sets_servers
    assert target.make_experiments(EXPERIMENT, 30) == [EXPERIMENT]


def test_another_simulation_has_its_own_parameters(tmp_path: Path) -> None:
    path = tmp_path / "stadium.yaml"
    path.write_text("simulation: emergency_exit\nparameters:\n  numAgents: 3\n")
    (changed,) = OtherSimulation(str(path)).make_experiments(EXPERIMENT, 30)
    assert changed.parameters == {"numAgents": 3}
    assert changed.sensors != EXPERIMENT.sensors


def test_a_simulation_on_a_broker_has_the_sensors_of_the_run() -> None:
    target = OtherSimulation("gazebo")
    (changed,) = target.make_experiments(EXPERIMENT.replace(servers=None, broker="mqtt://localhost"), 30)
    assert (changed.sensors, changed.actuators) == (EXPERIMENT.sensors, EXPERIMENT.actuators)
    assert (changed.simulation, changed.parameters) == ("gazebo", EXPERIMENT.parameters)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "validate:\n  to:\n    parameters:\n      speed: 1\n",
            "e.yaml:5: validate.to.parameters.speed: unknown",
        ),
        (
            "validate:\n  to:\n  - {name: a, parameters: {numDefenders: 2}}\n  - parameters: {speed: 1}\n",
            "e.yaml:5: validate.to[1].parameters.speed: unknown",
        ),
        (
            "ranking:\n  kind: transferability\n  threshold: 1\n  slow: {parameters: {speed: 1}}\n",
            "e.yaml:5: ranking.slow.parameters.speed: unknown",
        ),
        ("validate:\n  to: [{method: nnga}]\n", "e.yaml:3: validate.to[0].method: does not belong"),
        ("validate:\n  vary: {speed: [0, 1]}\n", "e.yaml:3: validate.vary: speed: only parameters"),
    ],
)
def test_mistakes_in_the_experiment_have_its_lines(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "e.yaml"
    path.write_text(f"simulation: minisim\n{text}")
    with pytest.raises(InputError) as error:
        Experiment.load(path)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_mistakes_in_a_file_have_its_lines(tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    target = OtherSimulation(str(path))
    path.write_text("parameters:\n  speedDefender: 1\n")
    with pytest.raises(InputError, match=r"wrong\.yaml:2: parameters\.speedDefender: .*did you mean"):
        target.make_experiments(EXPERIMENT, 30)
    path.write_text("simulation: minisim\nmethod: nnga\nseed: 3\n")
    with pytest.raises(InputError) as found:
        target.make_experiments(EXPERIMENT, 30)
    assert [line.split(":")[1:3] for line in str(found.value).splitlines()[:2]] == [
        ["2", " method"], ["3", " seed"],
    ]  # fmt: skip
    assert str(found.value).count("does not belong to a target") == 2
    assert str(found.value).count("a target may have only keys for the evaluation of candidates") == 1
    path.write_text("- 1\n")
    with pytest.raises(InputError, match="expected a mapping"):
        target.make_experiments(EXPERIMENT, 30)


def test_the_conditions_that_candidates_were_evolved_in_are_recognised(tmp_path: Path) -> None:
    path = tmp_path / "target.yaml"
    for words, same in (
        ("simulation: minisim\n", True),
        ("servers: 2\n", True),
        ("parameters: {speedDefenders: 0.5}\n", True),
        ("parameters: {speedDefenders: 0.6}\n", False),
        ("fitness: -steps\n", False),
        ("broker: mqtt://localhost\nservers: auto\n", False),
    ):
        path.write_text(words)
        (there,) = OtherSimulation(str(path)).make_experiments(EXPERIMENT, 1)
        assert is_same(there, EXPERIMENT) == same, words


def test_there_is_something_to_transfer_to_and_only_once() -> None:
    ranges = ranges_of({"parameters.x": (0, 1)})
    assert [one.name for one in targets_of(["a", "b"], ranges)] == ["a", "b", "pseudo-reality"]
    with pytest.raises(InputError, match="nothing to transfer to"):
        targets_of([], [])
    with pytest.raises(InputError, match="a is given twice"):
        targets_of(["a", "b", "a"], [])
    with pytest.raises(InputError, match=r"vary: parameters\.x: expected a key and the lowest and highest"):
        ranges_of({"parameters.x": (0, 1, 2)})


def test_e_pucks_get_other_noise() -> None:
    def swarm(robot: Any) -> Experiment:
        return Experiment.from_mapping({"simulation": "arena", "parameters": {"robot": robot}})

    require_e_pucks(swarm("e-puck-rm1.2"))
    models = PseudoReality(E_PUCKS).make_experiments(swarm("e-puck-rm1.2"), 20)
    robots = [one.parameters["robot"] for one in models]
    assert {robot["preset"] for robot in robots} == {"e-puck-rm1.2"}
    noise = [robot["sensors"]["light"]["noise"] for robot in robots]
    assert len(set(noise)) == 20
    assert 0 <= min(noise) < 0.3 < 0.6 < max(noise) <= 0.9
    other = swarm({"preset": "e-puck-rm1.1", "radius": 0.04})
    (robot,) = [one.parameters["robot"] for one in PseudoReality(E_PUCKS).make_experiments(other, 1)]
    assert (robot["radius"], robot["preset"]) == (0.04, "e-puck-rm1.1")
    for robot in ("kilobot", {"preset": "foot-bot"}):
        with pytest.raises(InputError, match="needs robots of one kind in the arena, e-puck"):
            require_e_pucks(swarm(robot))
    kinds = [{"robot": "e-puck-rm1.1", "count": 3}, {"robot": {"preset": "e-puck-rm1.1"}, "count": 2}]
    mission = {"walls": {"rectangle": [2, 2]}, "start": {"disc": {"radius": 0.5}}, "fitness": "order"}
    for parameters in ({"robots": kinds}, {"mission": {**mission, "robot": "kilobot"}}):
        with pytest.raises(InputError, match="of one kind"):
            require_e_pucks(Experiment.from_mapping({"simulation": "arena", "parameters": parameters}))
    of_mission = {"simulation": "arena", "parameters": {"mission": {**mission, "robot": "e-puck-rm1.2"}}}
    (sampled,) = PseudoReality(E_PUCKS).make_experiments(Experiment.from_mapping(of_mission), 1)
    assert sampled.parameters["robot"]["preset"] == "e-puck-rm1.2"
    with pytest.raises(InputError, match="needs robots of one kind"):
        require_e_pucks(EXPERIMENT)


def test_the_robot_of_a_mission_varies() -> None:
    retrieval = Experiment.from_mapping(
        {"simulation": "arena", "parameters": {"mission": "object_retrieval"}}
    )
    ranges = ranges_of({"parameters.robot.mass": (0.5, 0.9)})
    robots = [one.parameters["robot"] for one in PseudoReality(tuple(ranges)).make_experiments(retrieval, 5)]
    assert len({robot["mass"] for robot in robots}) == 5
    assert all(0.5 <= robot["mass"] <= 0.9 and robot["drive"]["wheel_base"] == 0.1 for robot in robots)
    with pytest.raises(InputError, match="needs robots of one kind in the arena, e-puck"):
        require_e_pucks(retrieval)
