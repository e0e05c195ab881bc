"""PettingZoo's environments as simulations, both parallel ones and those whose agents act in turn.

Sources: https://pettingzoo.farama.org/api/parallel/, https://pettingzoo.farama.org/api/aec/
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from importlib import import_module
from itertools import groupby
from pkgutil import iter_modules
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from swarmwright.common import metric_names
from swarmwright.common.errors import InputError, SimulationError
from swarmwright.common.ranges import intersect_ranges
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.tracebacks import locate_error
from swarmwright.simulations.base import MOST_SIDES, Group, Side, is_side_name
from swarmwright.simulations.calls import summarize
from swarmwright.simulations.environments import GROUP_BY
from swarmwright.simulations.environments._environment import (
    Actions,
    Actuators,
    Allowed,
    Environment,
    Sensors,
    actuators,
    check_step,
    environment_seed,
    mean_reward,
    parse_reward,
    single,
    with_mask,
)

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


_PLAYER = "player"
"""Kind of the agents of a game, by convention of PettingZoo: they are opponents, not a swarm."""
_STEP_RESULTS = ("observations", "rewards", "terminations", "truncations")


class PettingZoo(Environment):
    """An environment of PettingZoo; the fitness is the mean over agents of each one's sum of rewards.

        class Spread(PettingZoo):
            environment = "mpe2.simple_spread_v3"

    `environment` is the module that has `parallel_env` or, if agents act in turn, `env` alone. Agents form
    groups by their names without the number at the end: adversary_0, adversary_1 and agent_0 are the groups
    `adversary` and `agent`, if the agents of a group follow each other and have the same spaces. The players
    of a game, player_0 and player_1, are a group each. `controller: {kind: team}` gives each group a
    controller, and the metrics `reward_adversary`, .. are the mean sums of rewards of a group. Each group is
    a side of a match, whose fitness is this metric. Any other controller controls all agents, with as many
    sensors and actuators as the agent with the most: missing sensors are 0, and surplus actuators have no
    effect. An agent that the environment drops, or flags as terminated or truncated, stops acting and gets no
    further rewards. A parameter may change the number of agents if all have the same spaces; `max_agents` is
    therefore not declared. If agents act in turn, a step is the action of one agent.
    """

    group_by: ClassVar[Literal["agent", "kind"] | None] = None
    """Which agents form a group: `kind`, those whose names differ only in the number at the end; `agent`,
    each agent alone. None: `agent` if all are called player, else `kind`."""
    padded = True

    metrics = {  # noqa: RUF012 - as in the base class
        "steps": "Steps of the episode.",
        "worst": "Sum of rewards of the agent with the least.",
        "best": "Sum of rewards of the agent with the most.",
    }

    def make(self, options: dict[str, Any]) -> Any:  # noqa: ANN401 - parallel environments, or what acts like one
        """Return a new environment, parallel or with agents in turn; override it to add wrappers."""
        name = self._environment_name()
        try:
            module = import_module(name)
        except ModuleNotFoundError as error:
            hint = _suggest_module(name) if error.name == name else ""
            if not hint:
                raise
            raise InputError(f"PettingZoo {name}: {locate_error(error)}{hint}") from error
        for function in ("parallel_env", "env"):
            if callable(getattr(module, function, None)):
                return getattr(module, function)(**options)
        raise InputError(
            f"{name}: has no parallel_env and no env; name a module of this package that has one"
            f"{_suggest_module(name)}"
        )

    def _new_environment(self, parameters: dict[str, Any], *, rendering: bool) -> Any:  # noqa: ANN401 - types of libraries
        """Return a new environment, parallel or as one. Raises InputError like the base class."""
        env = super()._new_environment(parameters, rendering=rendering)
        return InTurn(env, self.environment) if acts_in_turn(env) else env

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        """Start an episode."""
        self._prepare_episode(parameters)
        result = self.env.reset(seed=environment_seed(seed))
        # A dictionary of two agents would be unpacked as well.
        if not (isinstance(result, tuple) and len(result) == 2 and isinstance(result[0], Mapping)):
            raise SimulationError(
                f"{self.environment}: reset returned {summarize(result)}, expected (observations, infos), "
                "both dicts by agent; early versions of PettingZoo return the observations alone: "
                "return (observations, {})"
            )
        observations, _ = result
        self._rewards = np.zeros(len(self._agents))
        self._steps = 0
        self._ended: set[str] = set()
        self._truncated = False
        self._check_observations(observations)
        return self._rows(observations)

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Advance by one step."""
        actions_by_name = {}
        for name in self.env.agents:
            act = self._spaces[name][1]
            row = actions[self._agents[name]][: act.width].astype(float)
            actions_by_name[name] = act.act(row, self._masks.get(name))
        # Some environments still return rewards and observations of agents that they dropped.
        alive = {name for name in self.env.agents if name not in self._ended}
        earning = self._agents.keys() if isinstance(self.env, InTurn) else alive
        returned = self.env.step(actions_by_name)
        check_step(self.environment, returned, "PettingZoo in its first versions")
        self._check_dicts(returned)
        observations, rewards, *flags, _ = returned
        self._steps += 1
        self._check_possible_agents((*rewards, *observations))
        for name, reward in rewards.items():
            if name in earning:
                self._rewards[self._agents[name]] += single(self.environment, reward, self._steps)
        flagged = {name for ends in flags for name, ended in ends.items() if ended}
        # An agent that leaves the environment may come back later.
        self._ended = {name for name in self.env.agents if name in self._ended or name in flagged}
        self._check_rewards(rewards, alive - self._ended)
        terminations, truncations = ({name for name in alive if ends.get(name)} for ends in flags)
        self._truncated = bool(truncations) and not terminations
        self._check_observations(observations)
        reporting = alive.union(name for name in self.env.agents if name not in self._ended)
        return self._rows(
            {name: observation for name, observation in observations.items() if name in reporting}
        )

    def acting(self) -> list[int]:
        """Return the agents in the environment that are neither terminated nor truncated."""
        return [self._agents[name] for name in self.env.agents if name not in self._ended]

    def done(self) -> bool:
        """Return whether no agent is left, or the step limit is reached."""
        return len(self._ended) == len(self.env.agents) or self._steps >= self.most_steps

    def truncated(self) -> bool:
        """Return whether agents were left, or the last ones were truncated and none was terminated."""
        return self._truncated or len(self._ended) < len(self.env.agents)

    def fitness(self) -> float:
        """Return the mean over agents of the sum of rewards."""
        return mean_reward(self._rewards)

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        metrics = {"steps": self._steps, "worst": self._rewards.min(), "best": self._rewards.max()}
        first = 0
        for group, metric in self._reward_metrics.items():
            count = self.groups[group].count({**self.options, **(self._env_parameters or {})})
            rewards = self._rewards[first : first + count]
            metrics[metric] = mean_reward(rewards) if len(rewards) else np.nan
            first += count
        return metrics

    def _trial(self, env: Any, seed: int, actions: Actions) -> Iterator[bytes]:  # noqa: ANN401 - an environment
        def read(name: str, observation: Any) -> bytes:  # noqa: ANN401 - an observation
            return str(name).encode() + self._spaces[name][0].read(observation).tobytes()

        def action(name: str, observations: Mapping[str, Any]) -> Any:  # noqa: ANN401 - of the space's type
            act = self._spaces[name][1]
            return act.act(
                actions(act.width), self._allowed[name](observations[name]) if name in observations else None
            )

        observations, _ = env.reset(seed=seed)
        yield b"".join(read(*item) for item in observations.items())
        while env.agents:
            observations, rewards, *_ = env.step({name: action(name, observations) for name in env.agents})
            gained = np.array([float(reward) for reward in rewards.values()])
            yield b"".join(read(*item) for item in observations.items()) + gained.tobytes()

    def _rows(self, observations: dict[str, Any]) -> NDArray[np.float64]:
        """Return the sensor values, (agents, sensors), 0 for agents that have left."""
        self._check_possible_agents((*observations, *self.env.agents))
        rows = np.zeros((len(self._agents), self.sensors))
        for name, observation in observations.items():
            read = self._spaces[name][0]
            rows[self._agents[name], : read.width] = read.read(observation)
        self._masks = {name: self._allowed[name](observation) for name, observation in observations.items()}
        return rows

    def _check_observations(self, observations: Mapping[str, Any]) -> None:
        """Raise SimulationError if an agent that acts next has no observation."""
        for name in self.env.agents:
            if name not in observations and name not in self._ended:
                raise SimulationError(
                    f"{self.environment}: agent {name!r} is among its agents, but has no observation"
                )

    def _check_dicts(self, returned: tuple[Any, ...]) -> None:
        """Raise SimulationError unless `step` returned dictionaries by agent."""
        for name, mapping in zip(_STEP_RESULTS, returned, strict=False):
            if not isinstance(mapping, Mapping):
                raise SimulationError(
                    f"{self.environment}: step returned {summarize(mapping)} as {name}, expected a dict by "
                    "agent"
                )

    def _check_rewards(self, rewards: Mapping[str, Any], alive: Collection[str]) -> None:
        """Raise SimulationError if an agent that has acted, and continues, has no reward."""
        for name in self.env.agents:
            if name in alive and name not in rewards:
                raise SimulationError(
                    f"{self.environment}: agent {name!r} has acted, but has no reward in step {self._steps}; "
                    "return a reward for it, which may be 0"
                )

    def _check_possible_agents(self, names: Iterable[str]) -> None:
        """Raise SimulationError for an agent that is not among `possible_agents`."""
        for name in names:
            if name not in self._agents:
                raise SimulationError(
                    f"{self.environment}: agent {name!r} is not among its possible_agents, "
                    f"{', '.join(self._agents)}; a swarm has the same agents throughout"
                )

    def _space(self, kind: str, agent: str) -> tuple[Any, str]:
        """Return a space of an agent and its label for messages. Raises InputError if the call fails."""
        where = f"{self.environment}: {kind}({agent!r})"
        try:
            return getattr(self.env, kind)(agent), where
        except Exception as error:  # whatever the environment raises
            raise InputError(f"{where}: {locate_error(error)}") from error

    def _sizes(self) -> tuple[int, int]:
        if self.group_by not in {None, *GROUP_BY}:
            raise InputError(
                f"{type(self).__name__}.group_by: {self.group_by!r} found, expected agent, kind or None"
            )
        names = getattr(self.env, "possible_agents", None)
        if not names:
            raise InputError(
                f"{self.environment}: has no possible_agents, so the number of agents is unknown"
            )
        self._agents = {name: index for index, name in enumerate(names)}
        self._spaces: dict[str, tuple[Sensors, Actuators]] = {}
        self._allowed: dict[str, Callable[[Any], Allowed | None]] = {}
        for name in names:
            observations, observations_label = self._space("observation_space", name)
            actions, actions_label = self._space("action_space", name)
            inputs, self._allowed[name] = with_mask(observations, actions, observations_label)
            self._spaces[name] = inputs, actuators(actions, actions_label)
        self.groups = type(self).groups or self._kinds()  # a class may declare its own
        self._reward_metrics = _name_metrics(self.groups)
        if type(self).metrics is PettingZoo.metrics:
            self.metrics = PettingZoo.metrics | {
                metric: f"Sum of rewards of an agent of the group {group}, mean."
                for group, metric in self._reward_metrics.items()
            }
        self.sides = type(self).sides or self._make_sides()
        both = self._spaces.values()
        self.sensor_ranges = intersect_ranges([inputs.ranges for inputs, _ in both])
        self.actuator_ranges = intersect_ranges([outputs.ranges for _, outputs in both])
        return max(inputs.width for inputs, _ in both), max(outputs.width for _, outputs in both)

    def _make_sides(self) -> dict[str, Side]:
        """Return a side for each of several groups, whose fitness is the mean reward of an agent."""
        if not 2 <= len(self.groups) <= MOST_SIDES or not all(map(is_side_name, self.groups)):
            return {}
        return {
            group: Side(fitness=metric if metric in self.metrics and is_side_name(metric) else None)
            for group, metric in self._reward_metrics.items()
        }

    def _group_of(self, agent: str) -> str:
        """Return the name of the group that an agent belongs to, if it is one."""
        by_agent = all(_kind(name) == _PLAYER for name in self._agents)
        if self.group_by is not None:
            by_agent = self.group_by == "agent"
        return str(agent) if by_agent else _kind(agent)

    def _kinds(self) -> dict[str, Group]:
        """Return the groups of agents in order; empty if there is a single kind, or if kinds are mixed."""
        groups: dict[str, Group] = {}
        for kind, names in groupby(self._agents, self._group_of):
            spaces = [self._spaces[name] for name in names]
            widths = {(inputs.width, outputs.width) for inputs, outputs in spaces}
            if not kind or kind in groups or len(widths) != 1:
                return {}
            ((sensors_, actuators_),) = widths
            groups[kind] = Group(
                agents=len(spaces),
                sensors=sensors_,
                actuators=actuators_,
                sensor_ranges=intersect_ranges([inputs.ranges for inputs, _ in spaces]),
                actuator_ranges=intersect_ranges([outputs.ranges for _, outputs in spaces]),
            )
        return groups if len(groups) > 1 else {}


def _suggest_module(module: str) -> str:
    """Return a hint at a similarly named module of the same package; empty if there is none."""
    package, _, name = module.rpartition(".")
    if not package:
        return ""
    names = [submodule.name for submodule in iter_modules(getattr(import_module(package), "__path__", ()))]
    return did_you_mean(name, [module_name for module_name in names if module_name != name])


def _kind(agent: str) -> str:
    """Return the name of an agent without the number at its end."""
    return re.sub(r"_?\d+$", "", str(agent))


def _name_metrics(groups: Iterable[str]) -> dict[str, str]:
    """Return the name of the metric that has the rewards of each group; names are valid, and differ."""
    names: dict[str, str] = {}
    for group in groups:
        name = plain = metric_names.suggest_name(f"reward_{group}")
        number = 1
        while name in names.values():
            number += 1
            name = f"{plain}_{number}"
        names[group] = name
    return names
