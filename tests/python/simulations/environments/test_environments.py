"""Gymnasium's and PettingZoo's environments: one record in every mode, and mistakes that are explained."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from mpe2 import simple_spread_v3

from swarmwright import Controller, Experiment, InputError, RunError, evaluate, optimize, simulate
from swarmwright.simulations import attached, catalogue
from swarmwright.simulations.gymnasium import Gymnasium
from swarmwright.simulations.loading import load
from tests.python.records import same_record

SPREAD = "pettingzoo:mpe2.simple_spread_v3"
HERE = Path(__file__).parent


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules are looked for in the working folder."""
    monkeypatch.chdir(HERE)


def experiment(simulation: Any, **changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": simulation,
            "controller": {"kind": "layered", "hidden": []},
            "method": {"population": 6, "generations": 1},
            "ranking": {"episodes": 2},
            **changes,
        }
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["gymnasium:CartPole-v1", "gymnasium:Pendulum-v1?max_episode_steps=30", SPREAD]
)
def test_one_record_here_and_on_servers_in_every_mode(name: str, tmp_path: Path) -> None:
    here = optimize(experiment(name), servers="in-process", out=tmp_path / "here")
    assert here.history[0].best > here.history[0].mean
    for mode, servers in (("stepwise", 1), ("batched", 2), ("offloaded", 2)):
        run = optimize(experiment(name, mode=mode), servers=servers, out=tmp_path / mode)
        same_record(run, here)


def test_the_fitness_is_the_reward_of_the_environment() -> None:
    one = experiment("gymnasium:Pendulum-v1", ranking={"episodes": 1}, parameters={"seed": 7})
    genome = np.full(one.genome_size, 0.5, np.float32)
    controller = Controller(one.representation().specification(genome))
    env = gymnasium.make("Pendulum-v1")
    seen, _ = env.reset(seed=7)
    reward, over = 0.0, False
    while not over:
        (action,) = controller((seen / [1, 1, 8]).astype(np.float32))
        seen, gained, terminated, truncated, _ = env.step(np.array([2 * action], np.float32))
        reward += float(gained)
        over = terminated or truncated
    assert simulate(one, controller, servers="in-process") == pytest.approx(reward, rel=1e-6)


def test_a_swarm_gets_the_mean_of_its_rewards() -> None:
    one = experiment(SPREAD, parameters={"seed": 3, "max_cycles": 10})
    controller = Controller(one.representation().specification(np.zeros(one.genome_size, np.float32)))
    env = simple_spread_v3.parallel_env(max_cycles=10)
    env.reset(seed=3)
    rewards: list[float] = []
    while env.agents:
        _, gained, _, _, _ = env.step(dict.fromkeys(env.agents, 0))
        rewards += gained.values()
    assert simulate(one, controller, servers="in-process") == pytest.approx(sum(rewards) / 3)


def test_options_in_the_name_and_parameters() -> None:
    five = experiment(f"{SPREAD}?N=5&continuous_actions=True", parameters={"max_cycles": 3}, fitness="steps")
    assert (five.sensors, five.actuators) == (30, 5)
    assert simulate(five, servers="in-process") == 3
    assert five.to_mapping()["simulation"] == f"{SPREAD}?N=5&continuous_actions=True"


def test_a_class_and_its_name_are_the_same() -> None:
    assert experiment(attached.load_adapter(SPREAD)).simulation == SPREAD


class Pole(Gymnasium):
    """A shorter pole."""

    environment = "CartPole-v1"
    options = {"max_episode_steps": 20}  # noqa: RUF012


def test_a_class_of_ones_own() -> None:
    one = experiment(Pole, fitness="steps - 10 * terminated")
    assert simulate(one, servers="in-process") in {20.0, *(float(steps - 10) for steps in range(1, 20))}


def test_agents_drop_out_and_differ() -> None:
    one = experiment("pettingzoo:broken")
    assert (one.sensors, one.actuators) == (2, 3)
    # a: 5 + 4 + 3 + 2 + 1 + 0, b is gone after the fourth step: 5 + 4 + 3 + 2
    assert simulate(one, servers="in-process") == (15 + 14) / 2
    assert simulate(experiment("pettingzoo:broken", fitness="best - worst"), servers="in-process") == 1


TAG = "pettingzoo:mpe2.simple_tag_v3"
TEAM = {
    "kind": "team",
    "groups": {"adversary": {"hidden": [3]}, "agent": {"kind": "fully_meshed", "hidden": 1}},
}


@pytest.mark.slow
def test_agents_of_several_kinds_have_controllers_of_their_own(tmp_path: Path) -> None:
    one = experiment(
        TAG, parameters={"max_cycles": 8}, controller=TEAM, fitness="reward_adversary - reward_agent"
    )
    here = optimize(one, servers="in-process", out=tmp_path / "here")
    assert here.history[0].best > 0
    for mode, servers in (("stepwise", 1), ("batched", 2), ("offloaded", 2)):
        run = optimize(one.replace(mode=mode), servers=servers, out=tmp_path / mode)
        same_record(run, here)
    team = here.best.controller
    assert {name: (found.sensors, found.actuators) for name, found in team.groups.items()} == {
        "adversary": (16, 5),
        "agent": (14, 5),
    }


def test_rewards_of_groups_are_those_of_the_environment() -> None:
    controller = {"kind": "team", "groups": {"adversary": {"hidden": []}, "agent": {"hidden": []}}}
    rewards = [
        simulate(experiment(TAG, controller=controller, fitness=fitness), servers="in-process")
        for fitness in ("fitness", "(3 * reward_adversary + reward_agent) / 4")
    ]
    assert rewards[0] == pytest.approx(rewards[1])


def test_groups_that_the_environment_does_not_have() -> None:
    with pytest.raises(InputError, match="adversary, agent"):
        experiment(TAG, controller={"kind": "team", "groups": {"hunters": {}, "prey": {}}})
    with pytest.raises(InputError, match=r"adversary\.agents: missing"):
        experiment(SPREAD, controller=TEAM)


def test_a_parameter_that_changes_the_number_of_agents_of_a_group() -> None:
    # The agents' spaces stay as they are.
    assert simulate(experiment("pettingzoo:broken?extra=1"), servers="in-process") > 0
    one = experiment("pettingzoo:broken", parameters={"extra": 1})
    words = (
        r"extra: changes the agents to the groups a \(1\), b \(2\) instead of the groups a \(1\), b \(1\);"
    )
    with pytest.raises(InputError, match=words):
        simulate(one, servers="in-process")


def test_agents_that_are_flagged_are_gone() -> None:
    """Also where the environment goes on to name them: b ends after the fourth step, a after the sixth."""
    one = experiment("pettingzoo:broken?trouble=flags")
    assert simulate(one, servers="in-process") == (15 + 14) / 2
    assert simulate(one.replace(fitness="steps"), servers="in-process") == 6


def test_an_agent_that_drops_out_needs_no_reward_in_its_last_step() -> None:
    one = experiment("pettingzoo:broken?trouble=last")
    assert simulate(one, servers="in-process") == (15 + 12) / 2


def test_an_agent_that_is_listed_again_acts_again() -> None:
    """b is not listed after the fourth step, again after the fifth, and acts in the sixth."""
    kind: Any = load("pettingzoo:broken?trouble=back")
    zoo = kind()
    zoo.reset({}, 1)
    acted = []
    while not zoo.done():
        acted.append(len(zoo.acting()))
        zoo.step(np.zeros((2, 3), np.float32))
    assert acted == [2, 2, 2, 2, 1, 2]


def test_agents_that_are_dropped_get_and_sense_nothing_more() -> None:
    """Also where the environment goes on to give rewards and observations to all that are possible."""
    kind: Any = load("pettingzoo:broken?trouble=dropped")
    zoo = kind()
    zoo.reset({}, 1)
    felt = []
    while not zoo.done():
        felt.append(zoo.step(np.zeros((2, 3), np.float32)).any(axis=1).tolist())
    assert felt == [[True, True]] * 4 + [[True, False]] * 2
    assert zoo.fitness() == (15 + 14) / 2


@pytest.mark.slow
def test_a_parameter_that_changes_the_number_of_agents_alone(tmp_path: Path) -> None:
    one = experiment("pettingzoo:broken?alike=true", parameters={"extra": 3}, fitness="best - worst")
    assert simulate(one, servers="in-process") == 0
    for mode in ("stepwise", "batched", "offloaded"):
        run = optimize(one.replace(mode=mode), servers=1, out=tmp_path / mode)
        assert run.best.fitness == 0


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "pettingzoo:broken?trouble=alone",
            r"reset: broken: reset returned {.*expected \(observations, infos\)",
        ),
        (
            "pettingzoo:broken?trouble=four",
            r"broken: step returned 4 values, expected \(observation, reward, ter",
        ),
        ("pettingzoo:broken?trouble=unseen", "step: broken: agent 'a' is among its agents, but has no obs"),
        (
            "pettingzoo:broken?trouble=unpaid",
            "step: broken: agent 'b' has acted, but has no reward in step 1; return a reward for it, which",
        ),
        (
            "pettingzoo:broken?trouble=nothing",
            "step: broken: step returned None as rewards, expected a dict by agent",
        ),
        ("pettingzoo:broken?trouble=all", "broken: agent '__all__' is not among its possible_agents, a, b"),
        ("pettingzoo:broken?reward=[1,2]", "step: broken: its reward has 2 numbers, but fitness is a single"),
        (
            "pettingzoo:broken?reward='2.5'",
            r"step: broken: its reward is array\('2.5'.*\), expected a number",
        ),
        (
            "gymnasium:broken:Odd-v0?reward=NaN&late=true",
            "step: broken:Odd-v0: its reward is nan in step 3, expected a finite number$",
        ),
        (
            "gymnasium:broken:Odd-v0?reward=None&late=true",
            "broken:Odd-v0: its reward is None, expected a number",
        ),
        ("gymnasium:broken:Odd-v0?reward='2.5'&late=true", "its reward is '2.5', expected a number"),
        ("gymnasium:broken:Odd-v0?seen=3", r"observation_space: the observation 3 is not in Discrete\(3\)$"),
        (
            "gymnasium:broken:Limited-v0?values=4",
            r"expected 5, got 4\): step: expected \(observation, reward",
        ),
    ],
)
def test_what_an_environment_returns_wrongly_is_said(name: str, words: str) -> None:
    with pytest.raises(RunError, match=words):
        simulate(experiment(name), servers="in-process")


@pytest.mark.slow
def test_a_reward_in_an_array() -> None:
    assert simulate(experiment("pettingzoo:broken?reward=[2.0]"), servers="in-process") == (6 * 2 + 4 * 2) / 2


REMEMBERING = "gymnasium:broken:Remembering-v0"


@pytest.mark.slow
def test_an_environment_that_reset_does_not_restore_is_new_in_each_episode(
    caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    here = optimize(experiment(REMEMBERING), servers="in-process", out=tmp_path / "here")
    assert here.history[0].best == here.history[0].mean == 1 + 2 + 3
    said = [one.message for one in caplog.records if "restore" in one.message]
    assert len(said) == 1
    assert said[0].startswith(f"{REMEMBERING}: reset() does not restore all of its state")
    assert "new_each_episode=true" in said[0]
    same_record(optimize(experiment(REMEMBERING), servers=2, out=tmp_path / "servers"), here)


def test_the_name_says_whether_each_episode_has_a_new_environment(caplog: pytest.LogCaptureFixture) -> None:
    genomes = np.zeros((2, 6), np.float32)
    for value, difference in (("true", 0), ("false", 3 * 3)):
        one = experiment(f"{REMEMBERING}?new_each_episode={value}", ranking={"episodes": 1})
        first, second = evaluate(one, genomes, servers="in-process")
        assert second - first == difference
    assert not caplog.records
    with pytest.raises(InputError, match="new_each_episode=no found, expected true or false"):
        experiment(f"{REMEMBERING}?new_each_episode=no")


@pytest.mark.parametrize("closing", ["missing", "fails"])
def test_environments_need_not_close(closing: str) -> None:
    one = experiment(f"{REMEMBERING}?closing={closing}", ranking={"episodes": 1})
    first, second = evaluate(one, np.zeros((2, 6), np.float32), servers="in-process")
    assert first == second == 1 + 2 + 3


def test_a_slow_environment_ends_the_trial(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmwright.simulations.environments._environment.SECONDS", 0.0)
    one = experiment(f"{REMEMBERING}?video=true", ranking={"episodes": 1})
    first, second = evaluate(one, np.zeros((2, 6), np.float32), servers="in-process")
    assert second - first == 3 * 3
    (said,) = [each.message for each in caplog.records]
    assert "too slow to test" in said
    assert "new_each_episode=false" in said


def test_no_trial_has_the_seed_0(caplog: pytest.LogCaptureFixture) -> None:
    simulate(experiment(f"{REMEMBERING}?zero_is_none=true"), servers="in-process")
    assert "reset() does not restore all of its state" in caplog.text


def test_an_environment_whose_seed_determines_nothing(caplog: pytest.LogCaptureFixture) -> None:
    simulate(experiment(f"{REMEMBERING}?random=true"), servers="in-process")
    assert "episodes with the same seed differ, even in new environments" in caplog.text


def test_trials_leave_an_environment_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    kind: Any = attached.load_adapter(f"{SPREAD}?N=2")
    records = []
    for new in (None, False, True):
        monkeypatch.setattr(kind, "new_each_episode", new)
        one = kind()
        records.append([one.reset({}, 5), *(one.step(np.ones((2, 5), np.float32)) for _ in range(4))])
    np.testing.assert_array_equal(records[0], records[1])
    np.testing.assert_array_equal(records[0], records[2])


def test_an_endless_episode_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Gymnasium, "most_steps", 50)
    assert simulate(experiment("gymnasium:broken:Failing-v0?endless=true"), servers="in-process") == 50


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("gymnasium:CartPol-v1", "Gymnasium CartPol-v1: NameNotFound: .* Did you mean: `CartPole`"),
        ("gymnasium:CartPole-v1?gravi=1", "unexpected keyword argument 'gravi'"),
        (
            "gymnasium:CartPole-v1?sutton_barto_reward=no",
            "sutton_barto_reward: Gymnasium CartPole-v1: 'no' found, expected true or false",
        ),
        (f"{SPREAD}?continuous_actions=off", "continuous_actions: .*: 'off' found, expected true or false"),
        (f"{SPREAD}?N=2&max_cycles=9&N=3", "the option N is given twice; leave one"),
        ("gymnasium:CartPole-v1?fast", "'fast' found after the question mark, expected option=value"),
        (
            "gymnasium:broken:Failing-v0?text=true",
            "observation_space: a Text space has no fixed number of values for sensors",
        ),
        (
            "pettingzoo:mpe2.simple_spread_v1",
            "ModuleNotFoundError: No module named 'mpe2.simple_spread_v1'; did you mean 'simple_spread_v3'",
        ),
        ("pettingzoo:mpe2.simple_spread", "has no parallel_env.*; did you mean 'simple_spread_v3'"),
        (
            "pettingzoo:os.path",
            "os.path: has no parallel_env and no env; name a module of this package that has one$",
        ),
        (
            f"{__file__}:SeveralPoles",
            "SeveralPoles CartPole-v1: is a vector of 4 environments, but an episode runs .*BatchSim",
        ),
        (
            "gymnasium:broken:Vector-v0",
            "broken:Vector-v0: is registered only as a vector of environments, .*swarmwright.BatchSimulation",
        ),
        ("pettingzoo:os.nothing", "No module named 'os.nothing'"),
        (
            "pettingzoo:",
            "^simulation: pettingzoo: names no environment; expected pettingzoo:ENVIRONMENT, a mod",
        ),
        (
            f"{__file__}:Misspelt",
            "Misspelt: missing the attribute 'environment', .* misspell it as 'enviroment'",
        ),
        ("pettingzoo:mpe2", "mpe2: has no parallel_env"),
        pytest.param(
            "vmas:navigation",
            r"torch is not installed; pip install 'swarmwright\[vmas\]'",
            marks=pytest.mark.skipif(find_spec("vmas") is not None, reason="VMAS is there"),
        ),
        ("pettingzoo:broken?agents=false", "broken: has no possible_agents"),
        (
            "pettingzoo:broken?trouble=assert",
            r"PettingZoo broken: AssertionError \(.*broken.py:\d+: assert trouble != \"assert\"\)",
        ),
        ("pettingzoo:broken?size=x", r"broken: observation_space\('a'\): TypeError: .* \(.*broken.py:\d+\)"),
        (
            "gymnasium:ALF/Pong-v5",
            "NamespaceNotFound: .* gymnasium:MODULE:ALF/Pong-v5, as in gymnasium:ale_py:ALE/Pong-v5",
        ),
        (
            "gymnasium:my/broken.py:Odd-v0",
            "broken.py is a file, expected a module .* gymnasium:broken:Odd-v0$",
        ),
        ("pettingzoo:broken.py", "broken.py is a file, expected a module .* pettingzoo:broken$"),
        (
            "gymnasium:broken:Several-v0",
            r"Gymnasium broken:Several-v0: its reward has 3 numbers, .* mo_gymnasium.wrappers.LinearReward",
        ),
        (
            "gymnasium:broken:Odd-v0?values=4",
            r"Odd-v0: step returned 4 values, expected .* Gym before 0.26 returns",
        ),
        ("gymnasium:broken:Odd-v0?reward=None", "Odd-v0: its reward is None, expected a number"),
        ("gymnasium:broken:Nowhere-v0", "Nowhere-v0: observation_space: missing"),
    ],
)
def test_what_does_not_exist_is_said_before_the_run(name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        experiment(name)


def test_parameters_that_change_the_agents() -> None:
    one = experiment(SPREAD, parameters={"N": 4})
    words = "N: changes the agents to 24 sensors and 5 actuators instead of 18 and 5; put it into the"
    with pytest.raises(InputError, match=words):
        simulate(one, servers="in-process")
    wrong = experiment("gymnasium:CartPole-v1", parameters={"gravi": 3})
    with pytest.raises(InputError, match=r"gravi: .*unexpected keyword argument"):
        simulate(wrong, servers="in-process")
    # YAML 1.2 has true and false alone.
    flag = experiment("gymnasium:CartPole-v1", parameters={"sutton_barto_reward": "no"})
    with pytest.raises(InputError, match=r"sutton_barto_reward: .*'no' found, expected true or false"):
        simulate(flag, servers="in-process")


def test_a_flag_can_also_take_text() -> None:
    path = experiment("gymnasium:broken:Remembering-v0", parameters={"video": "films"})
    assert simulate(path, servers="in-process") == 1 + 2 + 3
    word = experiment("gymnasium:broken:Remembering-v0", parameters={"video": "OFF"})
    with pytest.raises(InputError, match=r"video: .*'OFF' found, expected true or false"):
        simulate(word, servers="in-process")


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["local", 1])
@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "pettingzoo:broken?trouble=raise",
            r"PettingZoo.step: ValueError: the wheels came off \(.*broken.py:\d+\)",
        ),
        (
            "pettingzoo:broken?trouble=refused",
            r"PettingZoo.step: SimulationError: the wheels came off \(.*broken.py:\d+\)",
        ),
        (
            "pettingzoo:broken?trouble=more",
            "PettingZoo.step: broken: agent 'c' is not among its possible_agents, a, b",
        ),
        (
            "pettingzoo:broken?trouble=shape",
            r"PettingZoo.step: broken: observation_space\('a'\): .* of the shape \(3,\) is not in Box\(2,\)",
        ),
        ("gymnasium:broken:Failing-v0", r"LinAlgError: Singular matrix \(.*broken.py:\d+\)"),
        ("gymnasium:broken:Several-v0?first=3", "Gymnasium.step: .* reward has 3 numbers"),
        ("gymnasium:broken:Several-v0?start=1", r"Gymnasium.reset: AssertionError \(.*broken.py:\d+\)"),
    ],
)
def test_exceptions_in_an_environment_arrive_with_message_and_place(
    name: str, words: str, servers: Any
) -> None:
    with pytest.raises(RunError, match=words):
        simulate(experiment(name, mode="offloaded"), servers=servers)


def test_a_reset_that_returns_the_observation_alone() -> None:
    class Old(Gymnasium):
        environment = "old"

        def make(self, options: dict[str, Any]) -> Any:  # noqa: ARG002
            env: Any = gymnasium.make("MountainCarContinuous-v0").unwrapped
            begin = env.reset
            env.reset = lambda **options: begin(**options)[0]
            return env

    with pytest.raises(
        RunError, match=r"old: reset returned array\(.*expected \(observation, info\) with a dict as"
    ):
        Old().reset({}, 1)


def test_a_reset_of_the_time_before_seeds() -> None:
    class Old(Gymnasium):
        environment = "old"

        def make(self, options: dict[str, Any]) -> Any:  # noqa: ARG002
            env: Any = gymnasium.make("MountainCarContinuous-v0").unwrapped
            begin = env.reset
            env.reset = lambda: begin()[0]
            return env

    with pytest.raises(RunError, match=r"old: .*argument 'seed'; expected reset\(self, \*, seed=None"):
        Old().reset({}, 1)


@pytest.mark.slow
def test_masked_actions_are_not_taken(tmp_path: Path) -> None:
    one = experiment("gymnasium:broken:Masked-v0", controller={"kind": "layered", "hidden": []})
    assert (one.sensors, one.actuators) == (2, 4)
    here = optimize(one, servers="in-process", out=tmp_path / "here")
    # Without sensors an action has the same preference in all steps: 0 or 1, 1 or 2, 2 or 3, 3 or 0, 0 or 1.
    assert 0 + 1 + 2 + 0 + 0 <= here.history[0].mean <= here.history[0].best <= 1 + 2 + 3 + 3 + 1
    same_record(optimize(one, servers=1, out=tmp_path / "servers"), here)
    swarm = evaluate(experiment("pettingzoo:masked"), np.zeros((1, 12), np.float32), servers="in-process")
    assert swarm.tolist() == [0 + 1 + 2 + 0 + 0]


def test_many_sensors_are_warned_of(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmwright.simulations.environments._environment._MANY_SENSORS", 3)
    simulate(experiment(Pole), servers="in-process")
    (said,) = [one.message for one in caplog.records if "sensors" in one.message]
    assert said.startswith("Pole: an agent has 4 sensors, such as the pixels of a picture")


class SeveralPoles(Gymnasium):
    """A vector of environments."""

    environment = "CartPole-v1"

    def make(self, options: dict[str, Any]) -> Any:
        return gymnasium.make_vec(self.environment, num_envs=4, vectorization_mode="sync", **options)


class Misspelt(Gymnasium):
    """The name of its attribute is wrong."""

    enviroment = "CartPole-v1"


class Reach(gymnasium.Env[Any, Any]):
    """One whose bounds depend on a parameter."""

    open = 0
    """How many there are that are not closed."""

    def __init__(self, reach: float = 3.0, far: bool = False) -> None:  # noqa: ARG002
        Reach.open += 1
        self.observation_space = gymnasium.spaces.Box(-reach, reach, (1,), np.float64)
        self.action_space = gymnasium.spaces.Box(0.0, 2 * reach, (1,), np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:  # noqa: ARG002
        return np.zeros(1), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return np.asarray(action), 1.0, True, False, {}

    def close(self) -> None:
        Reach.open -= 1


class OfReach(Gymnasium):
    """The environment above."""

    environment = "reach"
    aggregation = Reach

    def make(self, options: dict[str, Any]) -> Any:
        return Reach(**options)


def test_ranges_are_those_of_the_parameters() -> None:
    name = f"{__file__}:OfReach"
    for parameters, reach in (({}, 3.0), ({"seed": 5}, 3.0), ({"reach": 8.0, "seed": 5}, 8.0)):
        assert catalogue.ranges(name, parameters) == {
            "sensor_ranges": [[-reach, reach, ""]],
            "actuator_ranges": [[0.0, 2 * reach, ""]],
        }
    found = catalogue.ranges("gymnasium:Pendulum-v1", {})
    assert found == {"sensor_ranges": [None, None, [-8, 8, ""]], "actuator_ranges": [[-2, 2, ""]]}
    assert catalogue.ranges("minisim", {}) == {}


def test_environments_of_ranges_are_closed() -> None:
    name = f"{__file__}:OfReach"
    catalogue.ranges(name, {})
    kind: Any = load(name)
    reach = kind.aggregation
    before = reach.open
    catalogue.ranges(name, {"reach": 8.0})
    with pytest.raises(InputError, match="unexpected keyword argument"):
        catalogue.ranges(name, {"wide": 8.0})
    with pytest.raises(InputError, match="'no' found, expected true or false"):
        catalogue.ranges(name, {"far": "no"})
    assert reach.open == before


def test_ranges_of_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "pettingzoo:mpe2.simple_tag_v3?continuous_actions=true"
    found = catalogue.ranges(name, {}, "adversary")
    assert found == {"actuator_ranges": [[0, 1, ""]] * 5}
    assert catalogue.ranges(name, {}) == found
    # For channels, too, the environment is made once, not once for each group.
    made: list[Any] = []
    parameters = {"max_cycles": 10}
    kind: Any = load(name)
    describe = kind.configure

    def configure(self: Any, given: Any) -> Any:
        made.append(given)
        return describe(self, given)

    monkeypatch.setattr(kind, "configure", configure)
    groups = catalogue.channels(name, parameters)["groups"]
    assert len(groups) > 1
    assert all(one["actuator_ranges"] == found["actuator_ranges"] for one in groups.values())
    assert made == [parameters]
