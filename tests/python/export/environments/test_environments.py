"""Simulations as environments, checked by the checks of PettingZoo and Gymnasium themselves."""

import copy
import pickle
import subprocess
import sys
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from swarmwright import Episodes, Experiment, InputError, RunError, Simulation, environments
from swarmwright.export.environments import _world
from swarmwright.simulations import catalogue

SWARM: dict[str, Any] = {"mission": "aggregation", "duration": 3, "robots": 4}
KINDS: dict[str, Any] = {
    "mission": "foraging",
    "duration": 2,
    "robots": [{"robot": "e-puck-rm1.1", "count": 2}, {"robot": "point", "count": 3, "name": "scouts"}],
}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    ("simulation", "parameters"),
    [("arena", SWARM), ("arena", KINDS), ("minisim", {"agents": [[0.5, 0.5], [0.5, 6.0]]})],
)
def test_pettingzoo_accepts_it(simulation: str, parameters: dict[str, Any]) -> None:
    from pettingzoo.test import (  # type: ignore[import-untyped]
        parallel_api_test,
        parallel_seed_test,
    )

    parallel_api_test(environments.parallel_env(simulation, parameters), num_cycles=200)
    parallel_seed_test(lambda: environments.parallel_env(simulation, parameters), num_cycles=20)


def test_gymnasium_accepts_it() -> None:
    environment = environments.gymnasium_env("minisim", render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # observations have no bounds
        check_env(environment)


def test_rewards_add_up_to_the_fitness_of_the_same_episode() -> None:
    swarm = environments.parallel_env("arena", SWARM | {"mission": "homing"})
    drawn = np.random.default_rng(7).integers(2**63, size=2).tolist()
    for seed in (7, *drawn):
        swarm.reset(seed=7) if seed == 7 else swarm.reset()
        episodes = Episodes("arena", SWARM | {"mission": "homing"}, seeds=[seed])
        total = 0.0
        generator = np.random.default_rng(seed)
        while swarm.agents:
            actions = generator.uniform(-1, 1, (4, 2)).astype(np.float32)
            sensed, rewards, ended, cut, infos = swarm.step(dict(zip(swarm.agents, actions, strict=True)))
            episodes.step(actions)
            total += rewards["agent_2"]
            assert len(set(rewards.values())) == 1
            assert not any(ended.values())
            assert all(cut.values()) is not bool(swarm.agents)
            if swarm.agents:
                np.testing.assert_array_equal(np.stack(list(sensed.values())), episodes.observe().sensors)
                assert infos == {name: {} for name in swarm.agents}
        assert total == pytest.approx(episodes.fitness[0])
        assert infos["agent_0"]["fitness"] == episodes.fitness[0]
        assert infos["agent_1"]["seed"] == seed
        assert infos["agent_3"]["metrics"]["order"] == episodes.metrics["order"][0]


def test_the_reward_is_that_of_the_experiment() -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "parameters": {"seed": 5}, "fitness": "-3 * steps"}
    )
    agent = environments.gymnasium_env(experiment, {"maxSteps": 6})
    agent.reset()
    total, ended, cut = 0.0, False, False
    while not (ended or cut):
        _, reward, ended, cut, info = agent.step(np.zeros(1, np.float32))
        total += reward
    assert total == info["fitness"] == -3 * info["metrics"]["steps"]
    with pytest.raises(InputError, match="call reset"):
        agent.step(np.zeros(1, np.float32))


def test_seeds_are_drawn_after_the_one_that_was_given_and_from_the_system_without_any() -> None:
    agent = environments.gymnasium_env("minisim", {"maxSteps": 1, "seed": 4})

    def seeds(*given: int | None) -> list[int]:
        found = []
        for seed in given:
            agent.reset(seed=seed)
            found.append(agent.step(np.zeros(1, np.float32))[4]["seed"])
        return found

    first = seeds(100, None, None)
    assert first[0] == 100
    assert first[1:] == np.random.default_rng(100).integers(2**63, size=2).tolist()
    assert seeds(100, None, None) == first
    assert not set(seeds(101, None, None)) & set(first)
    one, other = (environments.parallel_env("arena", SWARM).reset()[0]["agent_0"] for _ in range(2))
    assert not np.array_equal(one, other)


class Late(Simulation):
    """Its fitness is known at some step; `truncated` says that the time was over."""

    sensors, actuators = 1, 1
    parameters = {"known": 3, "before": "raise", "cut": True}  # noqa: RUF012
    metrics = ("steps_left",)
    step_seconds = frame_seconds = 0.05

    def reset(self, parameters: dict[str, Any], _seed: int) -> Any:
        self.given, self.steps = parameters, 0
        return [[0.0]]

    def step(self, _actions: Any) -> Any:
        self.steps += 1
        return [[0.0]]

    def done(self) -> bool:
        return self.steps == 3

    def fitness(self) -> Any:
        if self.steps >= self.given["known"]:
            return 10.0 * self.steps
        if self.given["before"] == "raise":
            raise ZeroDivisionError
        return None if self.given["before"] == "none" else float("nan")

    def measure(self) -> Any:
        return {"steps_left": 3 - self.steps}

    def truncated(self) -> bool:
        return bool(self.given["cut"])


def rewards_of(agent: Any) -> tuple[list[float], bool, bool]:
    agent.reset(seed=1)
    rewards, ended, cut = [], False, False
    while not (ended or cut):
        _, reward, ended, cut, _ = agent.step(np.zeros(agent.action_space.shape, np.float32))
        rewards.append(reward)
    return rewards, ended, cut


@pytest.mark.parametrize("before", ["raise", "none", "nan"])
def test_a_fitness_that_is_not_known_before_the_end_is_rewarded_later(before: str) -> None:
    for known, expected in ((2, [0, 20, 10]), (3, [0, 0, 30])):
        agent = environments.gymnasium_env(Late, {"known": known, "before": before})
        assert rewards_of(agent) == (expected, False, True)
    with pytest.raises(RunError, match=r"Late.fitness: "):
        rewards_of(environments.gymnasium_env(Late, {"known": 4, "before": before}))


def test_an_expression_without_a_value_is_rewarded_later() -> None:
    def agent(fitness: str) -> Any:
        return environments.gymnasium_env(
            Experiment.from_mapping({"simulation": Late, "parameters": {"known": 0}, "fitness": fitness})
        )

    assert rewards_of(agent("1 / (2 - steps_left)"))[0] == [0, 1, -0.5]
    with pytest.raises(RunError, match="the episode failed: fitness: "):
        rewards_of(agent("1 / steps_left"))


def test_simulations_say_that_their_time_was_over() -> None:
    for cut in (True, False):
        agent = environments.gymnasium_env(Late, {"cut": cut})
        assert rewards_of(agent)[1:] == (not cut, cut)
        assert agent.metadata["render_fps"] == 20
    assert rewards_of(environments.gymnasium_env("gymnasium:Pendulum-v1"))[1:] == (False, True)
    assert rewards_of(environments.gymnasium_env("gymnasium:CartPole-v1"))[1:] == (True, False)
    swarm = environments.parallel_env("pettingzoo:mpe2.simple_tag_v3?max_cycles=3")
    swarm.reset(seed=1)
    while swarm.agents:
        still = {name: np.zeros(swarm.action_space(name).shape, np.float32) for name in swarm.agents}
        _, _, ended, cuts, _ = swarm.step(still)
    assert all(cuts.values())
    assert not any(ended.values())
    assert swarm.step({}) == ({}, {}, {}, {}, {})


@pytest.mark.parametrize("arrived", [True, False])
def test_an_agent_that_reaches_its_goal_is_not_truncated(arrived: bool) -> None:
    goal = [6.5 if arrived else 1.0, 3.5]
    agent = environments.gymnasium_env("minisim", {"agents": [[6.0, 3.5]], "goal": goal, "maxSteps": 1})
    agent.reset(seed=1)
    _, _, ended, cut, info = agent.step(np.zeros(1, np.float32))
    assert info["metrics"]["arrived"] == arrived
    assert (ended, cut) == (arrived, not arrived)


class InTurn(Simulation):
    sensors, actuators = 1, 1

    def reset(self, *_: Any) -> Any:
        self.acted = 0
        return [[0.0], [0.0]]

    def step(self, *_: Any) -> Any:
        self.acted += 1
        return [[0.0], [0.0]]

    def acting(self) -> Any:
        return [self.acted % 2]

    def done(self) -> bool:
        return self.acted == 4

    def fitness(self) -> float:
        return 0.0


def test_agents_that_act_in_turn_are_refused() -> None:
    for title in catalogue.titles():
        episodes = Episodes(title)
        if episodes.actuators:
            episodes.step(np.zeros((len(episodes.observe().agents), episodes.actuators), np.float32))
            assert episodes.acts_in_turn == (title == "emergency_exit"), title
    for simulation in ("emergency_exit", InTurn):
        with pytest.raises(InputError, match="act in turn"):
            environments.parallel_env(simulation)


class Made(Simulation):
    """Counts its objects; a step is worth 1."""

    title, sensors, actuators = "made", 1, 1
    objects = 0

    def __init__(self) -> None:
        type(self).objects += 1

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:  # noqa: ARG002 - of the base class
        self.seed, self.steps = seed, 0
        return [[seed]]

    def step(self, actions: Any) -> Any:  # noqa: ARG002 - of the base class
        self.steps += 1
        return [[self.seed]]

    def done(self) -> bool:
        return self.steps == 3

    def fitness(self) -> float:
        return float(self.steps)


def test_one_object_has_all_episodes() -> None:
    env = environments.gymnasium_env(Made)
    before = Made.objects
    for seed in range(5):
        seen, _ = env.reset(seed=seed)
        assert seen.tolist() == [seed]
        for _ in range(1 + seed % 3):  # some end early
            seen, reward, *_ = env.step(np.zeros(1, np.float32))
        assert (seen.tolist(), reward) == ([seed], 1.0)
    assert Made.objects == before


def test_copies_begin_anew() -> None:
    swarm = environments.parallel_env("arena", SWARM)
    expected, _ = swarm.reset(seed=5)
    agent = environments.gymnasium_env("minisim")
    agent.reset()
    for copied in (copy.deepcopy(swarm), pickle.loads(pickle.dumps(swarm))):
        assert copied.agents == []
        sensed, _ = copied.reset(seed=5)
        np.testing.assert_array_equal(sensed["agent_1"], expected["agent_1"])
    with pytest.raises(InputError, match="no episode is running"):
        copy.deepcopy(agent).step(np.zeros(1, np.float32))


ASYNCHRONOUS = """
import gymnasium, sys, warnings
from swarmwright import Episodes, environments

warnings.simplefilter("ignore")
parameters = {"numAgents": 1} if sys.argv[1] == "emergency_exit" else {}
make = lambda: environments.gymnasium_env(sys.argv[1], parameters)
before = environments.gymnasium_env("minisim")
before.reset(seed=1)
before.step(before.action_space.sample())
Episodes("minisim", seeds=[1, 2]).run(lambda seen: seen.sensors[:, :1] * 0)  # by threads
together = gymnasium.vector.AsyncVectorEnv([make, make])
together.reset(seed=1)
_, rewards, *_ = together.step(together.action_space.sample())
together.close()
print(len(rewards))
"""


@pytest.mark.journey
@pytest.mark.parametrize("simulation", ["minisim", "emergency_exit"])
def test_environments_of_gymnasium_run_in_forked_processes(simulation: str) -> None:
    """Also where this process has stepped one before: the engine steps one episode without its threads."""
    done = subprocess.run(
        [sys.executable, "-c", ASYNCHRONOUS, simulation],
        capture_output=True,
        text=True,
        timeout=55,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "2\n"), done.stderr


def test_kinds_have_spaces_of_their_own_names() -> None:
    swarm = environments.parallel_env("arena", KINDS)
    assert swarm.possible_agents == ["e-puck-rm1.1_0", "e-puck-rm1.1_1", "scouts_0", "scouts_1", "scouts_2"]
    sensed, _ = swarm.reset(seed=1)
    for name in swarm.possible_agents:
        assert swarm.observation_space(name) is swarm.observation_space(name)
        assert swarm.observation_space(name).contains(sensed[name])


def test_it_is_drawn() -> None:
    swarm = environments.parallel_env("arena", SWARM, render_mode="rgb_array")
    swarm.reset(seed=1)
    picture = swarm.render()
    assert picture is not None
    assert picture.dtype == np.uint8
    assert picture.shape[1:] == (560, 3)
    assert environments.parallel_env("arena", SWARM).render() is None


def test_nothing_is_drawn_before_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment is made faster than its first picture."""
    monkeypatch.setattr(_world, "Picture", None)
    swarm = environments.parallel_env("arena", SWARM, render_mode="rgb_array")
    swarm.reset(seed=1)


def test_environments_of_libraries_draw_themselves() -> None:
    agent = environments.gymnasium_env("gymnasium:CartPole-v1", render_mode="rgb_array")
    library = gymnasium.make("CartPole-v1", render_mode="rgb_array")
    agent.reset(seed=3)
    library.reset(seed=3)
    assert np.array_equal(agent.render(), library.render())  # type: ignore[arg-type] # both draw
    assert agent.metadata["render_fps"] == library.metadata["render_fps"]
    library.close()
    with pytest.raises(InputError, match="Late has nothing to display"):
        environments.gymnasium_env(Late, render_mode="rgb_array")


def test_mistakes() -> None:
    with pytest.raises(InputError, match="has 4 agents; use parallel_env"):
        environments.gymnasium_env("arena", SWARM)
    with pytest.raises(InputError, match="act in turn"):
        environments.parallel_env("emergency_exit")
    with pytest.raises(InputError, match="render_mode: 'human' found"):
        environments.parallel_env("arena", render_mode="human")  # type: ignore[arg-type]
    swarm = environments.parallel_env("arena", SWARM)
    with pytest.raises(InputError, match=r"call reset\(\) first"):
        swarm.step({})
    swarm.reset()
    with pytest.raises(InputError, match="actions: missing for agent_0, agent_1"):
        swarm.step(dict.fromkeys(["agent_2", "agent_3"], np.zeros(2, np.float32)))
    with pytest.raises(InputError, match=r"agent_1: an action of the shape \(3,\) found, expected \(2,\)"):
        swarm.step({name: np.zeros(2 + (name == "agent_1"), np.float32) for name in swarm.agents})
    for strange, words in [
        ("left", "must be an array of numbers"),
        (None, "must be an array of numbers"),
        ([np.nan, 0.0], r"the action \[nan, 0.0\] found, expected finite numbers"),
    ]:
        actions: dict[str, Any] = {name: np.zeros(2, np.float32) for name in swarm.agents}
        actions["agent_2"] = strange
        with pytest.raises(InputError, match=f"agent_2: {words}"):
            swarm.step(actions)
    with pytest.raises(InputError, match=r"^seed: must be from 0"):
        swarm.reset(seed=-1)
    with pytest.raises(InputError, match=r"^seed: must be from 0"):
        environments.gymnasium_env("minisim").reset(seed=-1)
    with pytest.raises(InputError, match="ends before its first step"):
        environments.parallel_env("arena", {**SWARM, "duration": 0.1})
