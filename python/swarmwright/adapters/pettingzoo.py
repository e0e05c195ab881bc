"""PettingZoo's parallel environments as simulations.

Source: https://pettingzoo.farama.org/api/parallel/
"""

import re
from importlib import import_module
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.adapters._environment import Environment, environment_seed, total
from swarmwright.adapters._spaces import actuators, sensors
from swarmwright.core.errors import InputError, SimulationError
from swarmwright.simulations.groups import Group


class PettingZoo(Environment):
    """A parallel environment; the fitness is the mean over agents of each one's sum of rewards.

        class Spread(PettingZoo):
            environment = "mpe2.simple_spread_v3"

    `environment` is the module that has `parallel_env`. Agents whose names differ in more than a number at
    the end, as adversary_0, adversary_1 and agent_0, are groups, `adversary` and `agent`, if those of a group
    follow each other and have the same spaces; `controller: {kind: team}` gives each a controller, and the
    metrics `reward_adversary`, .. are their mean sums of rewards. With any other controller all are steered
    by the same one, and each has as many sensors and actuators as the one with the most: sensors that one
    lacks are 0, and actuators that it lacks do nothing. An agent that the environment drops acts no more.
    """

    padded = True

    metrics = {  # noqa: RUF012 - as in the base class
        "steps": "Steps of the episode.",
        "worst": "Sum of rewards of the agent with the least.",
        "best": "Sum of rewards of the agent with the most.",
    }

    def make(self, options: dict[str, Any]) -> Any:  # noqa: ANN401 - parallel environments, or what acts like one
        """Return a new environment; override it to add wrappers."""
        module = import_module(self.environment)
        if not hasattr(module, "parallel_env"):
            raise InputError(
                f"{self.environment}: has no parallel_env; agents that act in turn are not a swarm, "
                "or another module of this package is meant"
            )
        return module.parallel_env(**options)

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        """Go to the start of an episode."""
        self._start(parameters)
        seen, _ = self.env.reset(seed=environment_seed(seed))
        self._rewards = np.zeros(len(self._agents))
        self._steps = 0
        return self._rows(seen)

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Go on by one step."""
        given = {}
        for name in self.env.agents:
            act = self._spaces[name][1]
            given[name] = act.act(actions[self._agents[name]][: act.width].astype(float))
        seen, rewards, _, _, _ = self.env.step(given)
        for name, reward in rewards.items():
            self._rewards[self._agents[name]] += reward
        self._steps += 1
        return self._rows(seen)

    def acting(self) -> list[int]:
        """Return the agents that are in the environment."""
        return [self._agents[name] for name in self.env.agents]

    def done(self) -> bool:
        """Return whether no agent is left, or the episode has had all its steps."""
        return not self.env.agents or self._steps >= self.most_steps

    def fitness(self) -> float:
        """Return the mean over agents of the sum of rewards."""
        return total(self._rewards)

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        found = {"steps": self._steps, "worst": self._rewards.min(), "best": self._rewards.max()}
        names = list(self._agents)
        for group in self.groups:
            own = [reward for name, reward in zip(names, self._rewards, strict=True) if _kind(name) == group]
            found[_metric(group)] = total(np.array(own))
        return found

    def _rows(self, seen: dict[str, Any]) -> NDArray[np.float64]:
        """Return what agents sense, (agents, sensors), 0 for those that are gone."""
        strangers = [name for name in (*seen, *self.env.agents) if name not in self._agents]
        if strangers:
            raise SimulationError(
                f"{self.environment}: agent {strangers[0]!r} is not among its possible_agents, "
                f"{', '.join(self._agents)}; a swarm has the same agents all the time"
            )
        rows = np.zeros((len(self._agents), self.sensors))
        for name, observation in seen.items():
            read = self._spaces[name][0]
            rows[self._agents[name], : read.width] = read.read(observation)
        return rows

    def _sizes(self) -> tuple[int, int]:
        names = getattr(self.env, "possible_agents", None)
        if not names:
            raise InputError(
                f"{self.environment}: has no possible_agents, so it is not known how many there are"
            )
        self._agents = {name: index for index, name in enumerate(names)}
        self._spaces = {
            name: (
                sensors(self.env.observation_space(name), f"{self.environment}: observation_space({name!r})"),
                actuators(self.env.action_space(name), f"{self.environment}: action_space({name!r})"),
            )
            for name in names
        }
        self.max_agents = len(names)
        self.groups = type(self).groups or self._kinds()  # a class may say what it means
        if type(self).metrics is PettingZoo.metrics:
            self.metrics = PettingZoo.metrics | {
                _metric(group): f"Sum of rewards of an agent of the group {group}, mean."
                for group in self.groups
            }
        both = self._spaces.values()
        return max(seen.width for seen, _ in both), max(act.width for _, act in both)

    def _kinds(self) -> dict[str, Group]:
        """Return the groups of agents, in their order; none where all are of one kind, or kinds mix."""
        made: dict[str, Group] = {}
        for kind, names in groupby(self._agents, _kind):
            spaces = [self._spaces[name] for name in names]
            widths = {(seen.width, act.width) for seen, act in spaces}
            if not kind or kind in made or len(widths) != 1:
                return {}
            ((sensors_, actuators_),) = widths
            made[kind] = Group(agents=len(spaces), sensors=sensors_, actuators=actuators_)
        return made if len(made) > 1 else {}


def _kind(agent: str) -> str:
    """Return the name of an agent without the number at its end."""
    return re.sub(r"_?\d+$", "", str(agent))


def _metric(group: str) -> str:
    return "reward_" + re.sub(r"\W", "_", group)
