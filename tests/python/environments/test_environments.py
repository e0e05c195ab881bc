"""Simulations as environments, checked by the checks of PettingZoo and Gymnasium themselves."""

import warnings
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from swarmwright import Episodes, Experiment, InputError, environments

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
            assert not any(cut.values())
            if swarm.agents:
                np.testing.assert_array_equal(np.stack(list(sensed.values())), episodes.observe().sensors)
                assert infos == {name: {} for name in swarm.agents}
        assert all(ended.values())
        assert total == pytest.approx(episodes.fitness[0])
        assert infos["agent_0"]["fitness"] == episodes.fitness[0]
        assert infos["agent_3"]["metrics"]["order"] == episodes.metrics["order"][0]


def test_the_reward_is_that_of_the_experiment() -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "parameters": {"seed": 5}, "fitness": "-3 * steps"}
    )
    agent = environments.gymnasium_env(experiment, {"maxSteps": 6})
    agent.reset()
    total, ended = 0.0, False
    while not ended:
        _, reward, ended, _, info = agent.step(np.zeros(1, np.float32))
        total += reward
    assert total == info["fitness"] == -3 * info["metrics"]["steps"]
    with pytest.raises(InputError, match="call reset"):
        agent.step(np.zeros(1, np.float32))


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
