"""PettingZoo's parallel environments as simulations.

Source: https://pettingzoo.farama.org/api/parallel/
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from importlib import import_module
from itertools import groupby
from pkgutil import iter_modules
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError, SimulationError
from swarmwright.common.ranges import common
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.tracebacks import located
from swarmwright.simulations.base import Group
from swarmwright.simulations.calls import short
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
    single,
    with_mask,
)

_BY_AGENT = ("observations", "rewards", "terminations", "truncations")


class PettingZoo(Environment):
    """A parallel environment; the fitness is the mean over agents of each one's sum of rewards.

        class Spread(PettingZoo):
            environment = "mpe2.simple_spread_v3"

    `environment` is the module that has `parallel_env`. Agents whose names differ in more than a number at
    the end, as adversary_0, adversary_1 and agent_0, are groups, `adversary` and `agent`, if those of a group
    follow each other and have the same spaces; `controller: {kind: team}` gives each a controller, and the
    metrics `reward_adversary`, .. are their mean sums of rewards. With any other controller all are steered
    by the same one, and each has as many sensors and actuators as the one with the most: sensors that one
    lacks are 0, and actuators that it lacks do nothing. An agent that the environment drops, or flags as
    terminated or truncated, acts no more, and gets no more rewards. A parameter may change how many agents
    there are, as long as all of them have the same spaces; `max_agents` is therefore not declared.
    """

    padded = True

    metrics = {  # noqa: RUF012 - as in the base class
        "steps": "Steps of the episode.",
        "worst": "Sum of rewards of the agent with the least.",
        "best": "Sum of rewards of the agent with the most.",
    }

    def make(self, options: dict[str, Any]) -> Any:  # noqa: ANN401 - parallel environments, or what acts like one
        """Return a new environment; override it to add wrappers."""
        name = self._named()
        try:
            module = import_module(name)
        except ModuleNotFoundError as error:
            hint = _alike(name) if error.name == name else ""
            if not hint:
                raise
            raise InputError(f"PettingZoo {name}: {located(error)}{hint}") from error
        if not hasattr(module, "parallel_env"):
            if hasattr(module, "env"):
                raise InputError(
                    f"{name}: has no parallel_env: its agents act in turn (AEC), those of a swarm at once; "
                    "where it can be converted, derive a class whose make() returns "
                    "pettingzoo.utils.conversions.aec_to_parallel(MODULE.env(**options))"
                )
            raise InputError(
                f"{name}: has no parallel_env; another module of this package may be meant{_alike(name)}"
            )
        return module.parallel_env(**options)

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        """Go to the start of an episode."""
        self._prepare_episode(parameters)
        begun = self.env.reset(seed=environment_seed(seed))
        # A dictionary of two agents would be unpacked as well.
        if not (isinstance(begun, tuple) and len(begun) == 2 and isinstance(begun[0], Mapping)):
            raise SimulationError(
                f"{self.environment}: reset returned {short(begun)}, expected (observations, infos), both "
                "dicts by agent; early versions of PettingZoo return the observations alone: "
                "return (observations, {})"
            )
        seen, _ = begun
        self._rewards = np.zeros(len(self._agents))
        self._steps = 0
        self._ended: set[str] = set()
        self._truncated = False
        self._check_seen(seen)
        return self._rows(seen)

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Advance by one step."""
        given = {}
        for name in self.env.agents:
            act = self._spaces[name][1]
            row = actions[self._agents[name]][: act.width].astype(float)
            given[name] = act.act(row, self._masks.get(name))
        # Some environments go on to give rewards and observations to those that they dropped.
        alive = {name for name in self.env.agents if name not in self._ended}
        returned = self.env.step(given)
        check_step(self.environment, returned, "PettingZoo in its first versions")
        self._check_dicts(returned)
        seen, rewards, *flags, _ = returned
        self._steps += 1
        self._check_known((*rewards, *seen))
        for name, reward in rewards.items():
            if name in alive:
                self._rewards[self._agents[name]] += single(self.environment, reward, self._steps)
        flagged = {name for ends in flags for name, ended in ends.items() if ended}
        # One that leaves the environment is gone, and comes back if the environment has it again.
        self._ended = {name for name in self.env.agents if name in self._ended or name in flagged}
        self._check_rewards(rewards, alive - self._ended)
        terminations, truncations = ({name for name in alive if ends.get(name)} for ends in flags)
        self._truncated = bool(truncations) and not terminations
        self._check_seen(seen)
        read = alive.union(name for name in self.env.agents if name not in self._ended)
        return self._rows({name: observation for name, observation in seen.items() if name in read})

    def acting(self) -> list[int]:
        """Return the agents that are in the environment, and not flagged as terminated or truncated."""
        return [self._agents[name] for name in self.env.agents if name not in self._ended]

    def done(self) -> bool:
        """Return whether no agent is left, or the episode has had all its steps."""
        return len(self._ended) == len(self.env.agents) or self._steps >= self.most_steps

    def truncated(self) -> bool:
        """Return whether agents were left, or the last ones were truncated and none was terminated."""
        return self._truncated or len(self._ended) < len(self.env.agents)

    def fitness(self) -> float:
        """Return the mean over agents of the sum of rewards."""
        return mean_reward(self._rewards)

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        found = {"steps": self._steps, "worst": self._rewards.min(), "best": self._rewards.max()}
        names = list(self._agents)
        for group in self.groups:
            own = [reward for name, reward in zip(names, self._rewards, strict=True) if _kind(name) == group]
            found[_metric(group)] = mean_reward(np.array(own))
        return found

    def _trial(self, env: Any, seed: int, actions: Actions) -> Iterator[bytes]:  # noqa: ANN401 - an environment
        def read(name: str, seen: Any) -> bytes:  # noqa: ANN401 - an observation
            return str(name).encode() + self._spaces[name][0].read(seen).tobytes()

        def action(name: str, seen: Mapping[str, Any]) -> Any:  # noqa: ANN401 - of the space's type
            act = self._spaces[name][1]
            return act.act(actions(act.width), self._allowed[name](seen[name]) if name in seen else None)

        seen, _ = env.reset(seed=seed)
        yield b"".join(read(*item) for item in seen.items())
        while env.agents:
            seen, rewards, *_ = env.step({name: action(name, seen) for name in env.agents})
            gained = np.array([float(reward) for reward in rewards.values()])
            yield b"".join(read(*item) for item in seen.items()) + gained.tobytes()

    def _rows(self, seen: dict[str, Any]) -> NDArray[np.float64]:
        """Return what agents sense, (agents, sensors), 0 for those that are gone."""
        self._check_known((*seen, *self.env.agents))
        rows = np.zeros((len(self._agents), self.sensors))
        for name, observation in seen.items():
            read = self._spaces[name][0]
            rows[self._agents[name], : read.width] = read.read(observation)
        self._masks = {name: self._allowed[name](observation) for name, observation in seen.items()}
        return rows

    def _check_seen(self, seen: Mapping[str, Any]) -> None:
        """Raise SimulationError for an agent that acts next without an observation."""
        for name in self.env.agents:
            if name not in seen and name not in self._ended:
                raise SimulationError(
                    f"{self.environment}: agent {name!r} is among its agents, but has no observation"
                )

    def _check_dicts(self, returned: tuple[Any, ...]) -> None:
        """Raise SimulationError where `step` returned something else by agent than dictionaries."""
        for what, mapping in zip(_BY_AGENT, returned, strict=False):
            if not isinstance(mapping, Mapping):
                raise SimulationError(
                    f"{self.environment}: step returned {short(mapping)} as {what}, expected a dict by agent"
                )

    def _check_rewards(self, rewards: Mapping[str, Any], alive: Collection[str]) -> None:
        """Raise SimulationError for an agent that has acted and goes on without a reward."""
        for name in self.env.agents:
            if name in alive and name not in rewards:
                raise SimulationError(
                    f"{self.environment}: agent {name!r} has acted, but has no reward in step {self._steps}; "
                    "give it one, which may be 0"
                )

    def _check_known(self, names: Iterable[str]) -> None:
        """Raise SimulationError for an agent that is not among the possible ones."""
        for name in names:
            if name not in self._agents:
                raise SimulationError(
                    f"{self.environment}: agent {name!r} is not among its possible_agents, "
                    f"{', '.join(self._agents)}; a swarm has the same agents all the time"
                )

    def _space(self, kind: str, agent: str) -> tuple[Any, str]:
        """Return a space of an agent, and where it is. Raises InputError where the environment cannot."""
        where = f"{self.environment}: {kind}({agent!r})"
        try:
            return getattr(self.env, kind)(agent), where
        except Exception as error:  # whatever the environment raises
            raise InputError(f"{where}: {located(error)}") from error

    def _sizes(self) -> tuple[int, int]:
        names = getattr(self.env, "possible_agents", None)
        if not names:
            raise InputError(
                f"{self.environment}: has no possible_agents, so it is not known how many there are"
            )
        self._agents = {name: index for index, name in enumerate(names)}
        self._spaces: dict[str, tuple[Sensors, Actuators]] = {}
        self._allowed: dict[str, Callable[[Any], Allowed | None]] = {}
        for name in names:
            observations, where = self._space("observation_space", name)
            actions, of_actions = self._space("action_space", name)
            seen, self._allowed[name] = with_mask(observations, actions, where)
            self._spaces[name] = seen, actuators(actions, of_actions)
        self.groups = type(self).groups or self._kinds()  # a class may say what it means
        if type(self).metrics is PettingZoo.metrics:
            self.metrics = PettingZoo.metrics | {
                _metric(group): f"Sum of rewards of an agent of the group {group}, mean."
                for group in self.groups
            }
        both = self._spaces.values()
        self.sensor_ranges = common([seen.ranges for seen, _ in both])
        self.actuator_ranges = common([act.ranges for _, act in both])
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
            made[kind] = Group(
                agents=len(spaces),
                sensors=sensors_,
                actuators=actuators_,
                sensor_ranges=common([seen.ranges for seen, _ in spaces]),
                actuator_ranges=common([act.ranges for _, act in spaces]),
            )
        return made if len(made) > 1 else {}


def _alike(module: str) -> str:
    """Return a hint at a module of the same package with a similar name; empty without one."""
    package, _, name = module.rpartition(".")
    if not package:
        return ""
    names = [submodule.name for submodule in iter_modules(getattr(import_module(package), "__path__", ()))]
    return did_you_mean(name, [module_name for module_name in names if module_name != name])


def _kind(agent: str) -> str:
    """Return the name of an agent without the number at its end."""
    return re.sub(r"_?\d+$", "", str(agent))


def _metric(group: str) -> str:
    return "reward_" + re.sub(r"\W", "_", group)
