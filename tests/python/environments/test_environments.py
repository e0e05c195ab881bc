"""Simulations as environments, checked by the checks of PettingZoo and Gymnasium themselves."""

import copy
import pickle
import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from swarmwright import Episodes, Experiment, InputError, Simulation, environments
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
    for seed in (7, 8, 9):
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


def test_copies_begin_anew() -> None:
    swarm = environments.parallel_env("arena", SWARM)
    expected, _ = swarm.reset(seed=5)
    agent = environments.gymnasium_env("minisim")
    agent.reset()
    for copied in (copy.deepcopy(swarm), pickle.loads(pickle.dumps(swarm))):
        assert copied.agents == []
        sensed, _ = copied.reset(seed=5)
        np.testing.assert_array_equal(sensed["agent_1"], expected["agent_1"])
    with pytest.raises(InputError, match="none has begun"):
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
    with pytest.raises(InputError, match="there is none for agent_0, agent_1"):
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
    with pytest.raises(InputError, match="has ended before its first step"):
        environments.parallel_env("arena", {**SWARM, "duration": 0.1})
