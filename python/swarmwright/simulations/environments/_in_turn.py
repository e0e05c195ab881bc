"""PettingZoo's environments whose agents act in turn, behind the interface of its parallel environments.

Source: https://pettingzoo.farama.org/api/aec/
"""

from collections.abc import Mapping
from typing import Any

from swarmwright.common.errors import SimulationError
from swarmwright.simulations.calls import summarize
from swarmwright.simulations.environments._environment import parse_reward

Flags = dict[str, bool]
StepResult = tuple[dict[str, Any], dict[str, float], Flags, Flags, dict[str, Any]]
"""Observations, rewards, terminations, truncations and infos, each by agent."""


def acts_in_turn(env: Any) -> bool:  # noqa: ANN401 - types of libraries
    """Return whether an environment has PettingZoo's interface for agents that act in turn (AEC)."""
    return callable(getattr(env, "last", None)) and callable(getattr(env, "observe", None))


class InTurn:
    """An environment whose agents act in turn, as a parallel one whose only agent is the one to act.

    A step is the action of one agent. It returns the observation of the next agent, and the rewards that any
    agent got for it. Agents that have ended are removed at once, as `agent_iter` does.

    Args:
        env: the environment, an AECEnv or what acts like one. Other attributes are taken from it.
        name: its name, for messages.
    """

    def __init__(self, env: Any, name: str) -> None:  # noqa: ANN401 - types of libraries
        self.env, self.name = env, name
        self.agents: list[str] = []
        """The agent whose turn it is; empty at the end."""
        self._collected: dict[str, float] = {}
        self._paid: dict[str, float] = {}

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any attribute of the environment
        if name == "env":  # when an object is copied
            raise AttributeError(name)
        return getattr(self.env, name)

    def reset(self, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Start an episode; return the observation of the first agent, and infos."""
        self.env.reset(seed=seed)
        names = list(self.env.possible_agents)
        self._collected, self._paid = dict.fromkeys(names, 0.0), dict.fromkeys(names, 0.0)
        return self._next_turn(), {}

    def step(self, actions: Mapping[str, Any]) -> StepResult:
        """Let the agent act whose turn it is. Raises SimulationError if the environment breaks its rules."""
        (agent,) = self.agents
        self._collect(agent, self._last()[1])
        self.env.step(actions[agent])
        terminations, truncations = dict(self.env.terminations), dict(self.env.truncations)
        observations = self._next_turn()
        return observations, self._pay(), terminations, truncations, {}

    def _next_turn(self) -> dict[str, Any]:
        """Remove agents that have ended; return the observation of the agent whose turn it is."""
        while self.env.agents:
            agent = self.env.agent_selection
            if agent not in self.env.agents:
                raise SimulationError(
                    f"{self.name}: agent_selection is {summarize(agent)}, which is not among its agents, "
                    f"{', '.join(map(str, self.env.agents))}"
                )
            observation, reward, terminated, truncated = self._last()
            if not (terminated or truncated):
                self.agents = [agent]
                return {agent: observation}
            self._collect(agent, reward)
            left = len(self.env.agents)
            self.env.step(None)
            if len(self.env.agents) >= left:
                raise SimulationError(
                    f"{self.name}: agent {agent!r} has ended, but stays among its agents after step(None)"
                )
        self.agents = []
        return {}

    def _last(self) -> tuple[Any, Any, Any, Any]:
        last = self.env.last()
        if not (isinstance(last, tuple) and len(last) == 5):
            raise SimulationError(
                f"{self.name}: last returned {summarize(last)}, expected (observation, reward, termination, "
                "truncation, info)"
            )
        return last[:4]

    def _collect(self, agent: str, reward: Any) -> None:  # noqa: ANN401 - whatever an environment returns
        """Count the rewards of an agent since it last acted, with which the environment begins anew."""
        self._collected[agent] = self._collected.get(agent, 0.0) + parse_reward(self.name, reward)

    def _pay(self) -> dict[str, float]:
        """Return the rewards since the last call, also of agents that have yet to collect them."""
        due = getattr(self.env, "_cumulative_rewards", {})
        rewards = {}
        for agent, collected in self._collected.items():
            pending = parse_reward(self.name, due.get(agent, 0.0)) if agent in self.env.agents else 0.0
            rewards[agent] = collected + pending - self._paid.get(agent, 0.0)
            self._paid[agent] = collected + pending
        return rewards
