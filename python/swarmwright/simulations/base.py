"""The classes that simulations in Python derive from.

Kinds of agents in one simulation, as its class declares them.

Simulations in Python that step many episodes at once, with numpy.
"""

import operator
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.groups import DeclaredGroup
from swarmwright.common.ranges import ranges_of
from swarmwright.simulations.parameters import Parameter

if TYPE_CHECKING:
    from swarmwright.display import Scene


_LARGEST_COUNT = 1_000_000
"""Agents, sensors or actuators of a group, at most."""


@dataclass(frozen=True)
class Group:
    """Agents of one kind, of a simulation with several: a value of its `groups`.

    groups = {"predators": Group(agents="numPredators", sensors=4, actuators=2),
              "prey": Group(agents=1, sensors=6, actuators=1)}
    """

    agents: int | str
    """How many there are, or the parameter that says it."""
    sensors: int
    """Sensor values of an agent, at least 1."""
    actuators: int
    """Actuator values of an agent, at least 1."""
    sensor_names: Sequence[str] = ()
    """Names of an agent's sensors, one for each, or none at all."""
    actuator_names: Sequence[str] = ()
    """Names of an agent's actuators, in the same way."""
    sensor_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = field(
        default=(), compare=False
    )
    """What -1 and 1 of an agent's sensors stand for, see `Simulation`."""
    actuator_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = field(
        default=(), compare=False
    )
    """What -1 and 1 of an agent's actuators stand for, in the same way."""

    def __post_init__(self) -> None:
        """Take NumPy's integers for Python's."""
        for name in ("agents", "sensors", "actuators"):
            given = getattr(self, name)
            if not isinstance(given, bool | str) and hasattr(given, "__index__"):
                object.__setattr__(self, name, operator.index(given))

    def count(self, parameters: Mapping[str, Any]) -> int:
        """Return how many there are with these parameters, in which none is missing.

        Raises InputError, `name: why`, for a parameter that is no number of agents.
        """
        if isinstance(self.agents, int):
            return self.agents
        value = parameters.get(self.agents)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _LARGEST_COUNT:
            raise InputError(
                f"{self.agents}: {value!r} found, expected a number of agents, 0 to {_LARGEST_COUNT}"
            )
        return value


def declared(groups: Any, parameters: Mapping[str, Parameter], where: str) -> dict[str, Group]:  # noqa: ANN401 - whatever the class says
    """Return the groups of a class, checked.

    Args:
        groups: name -> Group, in the order of the agents.
        parameters: those of the class.
        where: its name, for messages.

    Raises InputError, naming class and attribute.
    """
    if not isinstance(groups, Mapping):
        raise InputError(f"{where}.groups: {groups!r} found, expected names with Group(..) for each")
    for name, group in groups.items():
        if not isinstance(name, str) or not name:
            raise InputError(f"{where}.groups: the name {name!r} found, expected text")
        at = f"{where}.groups[{name!r}]"
        if not isinstance(group, Group):
            raise InputError(f"{at}: {group!r} found, expected Group(agents=.., sensors=.., actuators=..)")
        _check(group, parameters, at)
    return dict(groups)


def _check(group: Any, parameters: Mapping[str, Parameter], at: str) -> None:  # noqa: ANN401 - fields may be anything
    for key in ("sensors", "actuators"):
        number, names = getattr(group, key), getattr(group, f"{key[:-1]}_names")
        if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= _LARGEST_COUNT:
            raise InputError(f"{at}.{key}: {number!r} found, expected an integer from 1 to {_LARGEST_COUNT}")
        if names and len(names) != number:
            raise InputError(f"{at}.{key[:-1]}_names: {len(names)} found, expected {number}")
        try:
            ranges_of(getattr(group, f"{key[:-1]}_ranges"), number)
        except ValueError as error:
            raise InputError(f"{at}.{key[:-1]}_ranges: {error}") from None
    if isinstance(group.agents, str):
        if group.agents not in parameters:
            known = ", ".join(parameters) or "none"
            raise InputError(f"{at}.agents: there is no parameter {group.agents!r}; there are: {known}")
        if parameters[group.agents].kind != "integer":
            raise InputError(f"{at}.agents: the parameter {group.agents!r} is not an integer")
    elif (
        isinstance(group.agents, bool)
        or not isinstance(group.agents, int)
        or not 0 <= group.agents <= _LARGEST_COUNT
    ):
        raise InputError(
            f"{at}.agents: {group.agents!r} found, expected a number from 0 to {_LARGEST_COUNT}, or the name "
            "of a parameter"
        )


def counted(groups: Mapping[str, Group], parameters: Mapping[str, Any]) -> list[DeclaredGroup]:
    """Return the groups with numbers of agents. Raises InputError as `Group.count`."""
    return [
        DeclaredGroup(
            name,
            group.count(parameters),
            group.sensors,
            group.actuators,
            tuple(group.sensor_names),
            tuple(group.actuator_names),
        )
        for name, group in groups.items()
    ]


class Described(ABC):
    """The description of a simulation."""

    title: str = ""
    """The name in discovery, which experiments may give; default: the name of the class in small letters."""
    dimensions: int = 2
    """Spatial dimensions, which experiments may require."""
    max_agents: int | None = None
    """Most agents that are possible; None: no limit."""
    sensors: int
    """Sensor values of an agent. 0, as `actuators`, if the simulation controls its agents itself and only
    its parameters are optimized (`controller: {kind: parameter_set}`): `reset` and `step` return nothing."""
    actuators: int
    """Actuator values of an agent; 0 if `sensors` is 0."""
    groups: Mapping[str, "Group"] = {}
    """Kinds of agents that differ in sensors, actuators or controllers: name -> Group(agents, sensors,
    actuators), the first one having the agents from 0 on. `sensors` and `actuators` then follow from them:
    the most of any. Experiments have `controller: {kind: team, groups: {..}}`."""
    sensor_names: Sequence[str] = ()
    """Names of an agent's sensors, one for each, for drawings of controllers; empty: they are numbered."""
    actuator_names: Sequence[str] = ()
    """Names of an agent's actuators, in the same way."""
    sensor_units: Sequence[str] = ()
    """Units of an agent's sensors, one for each, such as m or rad, for exported controllers."""
    actuator_units: Sequence[str] = ()
    """Units of an agent's actuators, in the same way."""
    sensor_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = ()
    """For exported controllers: what -1 and 1 of an agent's sensors stand for, where values are scaled, one
    for each: (low, high) in its unit, or (low, high, unit); None for values that are what they are."""
    actuator_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = ()
    """What -1 and 1 of an agent's actuators stand for, in the same way."""
    parameters: Mapping[str, Any] = {}
    """What can be set in an experiment: name -> default, or name -> Parameter(default, description, ..).

    Where any are declared, an experiment that names the class cannot set others."""
    metrics: Sequence[str] | Mapping[str, str] = ()
    """What `measure` returns: names, or name -> description. Experiments can define fitness from them."""
    determinism: Literal["bitwise", "statistical", "none"] | None = None
    """How far two evaluations of one episode with one controller agree on any server: bit-identical, within
    `tolerance`, or not at all. None: not known. Where it is bitwise or statistical, experiments can have
    results audited on another server (`faults: {audit: 0.01}`)."""
    tolerance: float = 0.0
    """Where `determinism` is statistical: how far fitness and metrics may differ, as a part of the larger
    one, absolute below 1."""
    copies: bool = True
    """Whether one process can have several objects of this class, whose episodes are then stepped side by
    side in the mode `batched`. False for those that hold something there is only one of: a window, a robot, a
    port."""
    most_steps: int | None = 1_000_000
    """Steps of an episode at most: one that is not done after them has failed. None: no limit."""
    frame_seconds: float = 0.1
    """Seconds between two frames when shown."""
    step_seconds: float | None = None
    """Seconds of a step in the world that is simulated, above 0: how often exported controllers are to be
    stepped. None: `frame_seconds` where the class sets it, else not known."""

    @classmethod
    def notice_before_run(cls, parameters: Mapping[str, Any]) -> str | None:  # noqa: ARG003 - for those that override it
        """Return what a user is told before a run with these parameters; None, the default, for nothing.

        parameters: those that the experiment gives, which have not been checked.
        """
        return None


class Simulation(Described):
    """A simulation: agents sense, controllers compute, agents act, until the episode ends with a fitness.

        class Gather(Simulation):
            title, dimensions, sensors, actuators = "gather", 1, 1, 1

            def reset(self, parameters, seed):
                self.x = np.random.default_rng(seed).uniform(-1, 1, (5, 1))
                self.steps = 0
                return self.x

            def step(self, actions):
                self.x += 0.1 * actions
                self.steps += 1
                return self.x

            def done(self):
                return self.steps == 30

            def fitness(self):
                return -float(np.abs(self.x).mean())

    `swarmwright serve file.py:Gather` makes simulation servers of it; an experiment names it by its title, or
    as `simulation: file.py:Gather` and then starts the servers by itself.

    One object runs one episode at a time, any number in turn: `reset`, then `step` until `done`, then
    `fitness`. It is made without arguments. An exception ends the episode: its evaluation has failed, the
    next one begins with `reset`. For runs that can be repeated, whatever happens must follow from the
    parameters and the seed, which `swarmwright.testing.check_simulation` tries.
    """

    @abstractmethod
    def reset(self, parameters: dict[str, Any], seed: int) -> ArrayLike | None:
        """Start an episode and return the first observations.

        Args:
            parameters: those of the experiment; those that are declared have been checked, and have their
                defaults when they were left out.
            seed: of the episode, 0 to 2**64 - 1; the only source of chance.

        Returns:
            Observations, (agents, sensors), finite: a row for each agent. Numbers are rounded to binary32.
            With `groups`, rows may be as long as each agent's group says; they are filled up with 0.
            None if `sensors` is 0.

        Raises:
            swarmwright.InputError: the parameters cannot be used, "name: why"; no other episode is tried with
                them.
        """

    @abstractmethod
    def step(self, actions: NDArray[np.float32]) -> ArrayLike | None:
        """Advance the episode by one step.

        Args:
            actions: (agents, actuators), float32, -1 to 1; rows of agents that did not act are 0, and with
                `groups` what a row has beyond the actuators of the agent's group.

        Returns:
            Observations as from `reset`, with as many rows. Rows of agents that do not act next do not count,
            and none does when the episode is done.
        """

    @abstractmethod
    def done(self) -> bool:
        """Return whether the episode has ended. Called after `reset` and after every step."""

    @abstractmethod
    def fitness(self) -> float:
        """Return the fitness of the episode: finite, higher is better. Called when it has ended.

        `swarmwright.environments` asks after every step, since rewards are how it changes. Where it fails
        before the end, or is not a finite number, the reward comes later, at the end at the latest.
        """

    def measure(self) -> Mapping[str, float]:
        """Return the metrics of the episode: all that `metrics` names.

        Asked when the episode has ended, only where an experiment wants them. A metric may be NaN or
        infinite, where there is nothing to measure; the episode fails only where the fitness is computed from
        it.
        """
        return {}

    def truncated(self) -> bool:
        """Return whether the episode ended only because its time was over, which agents do not sense.

        Asked at the end by `swarmwright.environments`, so that learning does not take the last state for one
        after which nothing can be gained. The default is False.
        """
        return False

    def acting(self) -> ArrayLike | None:
        """Return which agents act next: indices, or (agents,) booleans; None, the default, for all.

        Leave out agents that have dropped out. Where agents act one after the other, return one at a time.
        While no agent acts the simulation is stepped without actions until it is done.
        """
        return None

    def scene(self) -> "Scene | None":
        """Return the scene to display now; None, the default, for nothing.

        `swarmwright replay` draws it, and so does a server that is asked to (`simulate --visual`).
        """
        return None

    def picture(self) -> NDArray[np.uint8] | None:
        """Return the picture to display now, (height, width, 3), red, green, blue from 0 to 255.

        None, the default, for nothing to show. `swarmwright replay` uses it for videos and pages when the
        class has no `scene`.
        """
        return None


class BatchSimulation(Described):
    """A simulation whose methods take and return arrays of many episodes: one numpy call steps them all.

        class Gather(BatchSimulation):
            title, dimensions, sensors, actuators = "gather", 1, 1, 1

            def reset(self, parameters, seeds):
                starts = [np.random.default_rng(int(seed)).uniform(-1, 1, (5, 1)) for seed in seeds]
                self.x = np.stack(starts)
                self.steps = 0
                return self.x

            def step(self, actions):
                self.x += 0.1 * actions
                self.steps += 1
                return self.x

            def done(self):
                return np.full(len(self.x), self.steps == 30)

            def fitness(self):
                return -np.abs(self.x).mean(axis=(1, 2))

    All episodes have the same parameters and as many agents; each has a seed and controllers.
    Wherever a `Simulation` can be used, this can be, too. Offloaded controllers are
    evaluated with up to `lanes` others at once, and a batch has up to `lanes` or 256 episodes; in the mode
    stepwise, and for offloaded parameter sets, there is one episode in the arrays. For the same result in
    every mode, no episode may depend on how many there are: `swarmwright.testing.check_batch_simulation`
    tries that. When a method raises, episodes are repeated one by one, so that only those fail that do alone.
    """

    lanes: int = 1024
    """Most episodes at once."""

    @abstractmethod
    def reset(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> ArrayLike:
        """Start an episode for each seed and return the first observations.

        Args:
            parameters: as in `Simulation.reset`.
            seeds: (episodes,), the only source of chance.

        Returns:
            Observations, (episodes, agents, sensors), finite.

        Raises:
            swarmwright.InputError: as in `Simulation.reset`.
        """

    @abstractmethod
    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        """Advance all episodes by one step.

        Args:
            actions: (episodes, agents, actuators), float32, -1 to 1; 0 for agents that did not act, and for
                episodes that have ended.

        Returns:
            Observations as from `reset`; those of episodes that have ended, and of agents that do not act
            next, do not count.
        """

    @abstractmethod
    def done(self) -> ArrayLike:
        """Return which episodes have ended, (episodes,) booleans.

        Asked after `reset` and after every step.
        """

    @abstractmethod
    def fitness(self) -> ArrayLike:
        """Return how well each went, (episodes,), more is better.

        Asked as often as an episode has ended, when only those that ended with this step count.
        """

    def measure(self) -> Mapping[str, ArrayLike]:
        """Return the metrics, name -> (episodes,), as `fitness`."""
        return {}

    def acting(self) -> ArrayLike | None:
        """Return who acts next, (episodes, agents) booleans; None, the default, for all."""
        return None

    def scene(self) -> Any:  # noqa: ANN401 - a swarmwright.Scene
        """Return what the first episode looks like now, a `swarmwright.display.Scene`; None for nothing."""
        return None
