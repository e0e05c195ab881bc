"""Base classes of simulations in Python, and the groups of agents and sides of a match that they declare."""

import operator
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.groups import DeclaredGroup, DeclaredSide
from swarmwright.common.ranges import ranges_of
from swarmwright.common.suggestions import suggest_or_list
from swarmwright.simulations.parameters import Parameter

if TYPE_CHECKING:
    from swarmwright.display import Scene


_LARGEST_COUNT = 1_000_000
"""Largest number of agents, sensors or actuators of a group."""
MOST_SIDES = 256
"""Largest number of sides, which servers announce: `protocol/schemas/server.schema.json`."""
_LONGEST_NAME = 100
"""Largest number of characters of the names of a side, its groups and its fitness, likewise."""


@dataclass(frozen=True)
class Group:
    """A kind of agent in a simulation with several kinds: a value of its `groups`.

    groups = {"predators": Group(agents="numPredators", sensors=4, actuators=2),
              "prey": Group(agents=1, sensors=6, actuators=1)}
    """

    agents: int | str
    """Number of agents, or the name of the parameter that sets it."""
    sensors: int
    """Number of sensor values of an agent, at least 1."""
    actuators: int
    """Number of actuator values of an agent, at least 1."""
    sensor_names: Sequence[str] = ()
    """Names of all sensors of an agent; empty for no names."""
    actuator_names: Sequence[str] = ()
    """Names of all actuators of an agent; empty for no names."""
    sensor_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = field(
        default=(), compare=False
    )
    """The values that -1 and 1 of an agent's sensors stand for, see `Simulation`."""
    actuator_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = field(
        default=(), compare=False
    )
    """The values that -1 and 1 of an agent's actuators stand for."""

    def __post_init__(self) -> None:
        """Convert NumPy's integers to Python's."""
        for name in ("agents", "sensors", "actuators"):
            value = getattr(self, name)
            if not isinstance(value, bool | str) and hasattr(value, "__index__"):
                object.__setattr__(self, name, operator.index(value))

    def count(self, parameters: Mapping[str, Any]) -> int:
        """Return the number of agents; parameters must include defaults.

        Raises InputError, "name: reason", for a parameter that is not a number of agents.
        """
        if isinstance(self.agents, int):
            return self.agents
        value = parameters.get(self.agents)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _LARGEST_COUNT:
            raise InputError(
                f"{self.agents}: {value!r} found, expected a number of agents, 0 to {_LARGEST_COUNT}"
            )
        return value


@dataclass(frozen=True)
class Side:
    """A side of a match in a simulation whose groups compete: a value of its `sides`.

    sides = {"predators": Side(fitness="caught"), "prey": Side(fitness="survived")}
    """

    groups: Sequence[str] = ()
    """Names of its groups of agents; empty for the group of the same name."""
    fitness: str | None = None
    """The metric that is its fitness, larger is better; None if experiments define it."""


def check_groups(groups: Any, parameters: Mapping[str, Parameter], where: str) -> dict[str, Group]:  # noqa: ANN401 - whatever the class says
    """Check the groups of a class and return them.

    Args:
        groups: name -> Group, in the order of the agents.
        parameters: the parameters of the class.
        where: the class's name, for messages.

    Raises InputError, with class and attribute.
    """
    if not isinstance(groups, Mapping):
        raise InputError(f"{where}.groups: {groups!r} found, expected a mapping from names to Group(..)")
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
            available = ", ".join(parameters) or "none"
            raise InputError(f"{at}.agents: there is no parameter {group.agents!r}; available: {available}")
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


def check_sides(
    sides: Any,  # noqa: ANN401 - whatever the class says
    groups: Mapping[str, Group],
    metrics: Collection[str],
    where: str,
) -> tuple[DeclaredSide, ...]:
    """Check the sides of a class and return them.

    Args:
        sides: name -> Side.
        groups: the groups of the class. Without `sides`, each of several groups is a side.
        metrics: names of the metrics of the class.
        where: the class's name, for messages.

    Raises InputError, with class and attribute.
    """
    if not isinstance(sides, Mapping):
        raise InputError(f"{where}.sides: {_cut(sides)} found, expected a mapping from names to Side(..)")
    if not sides:
        return _imply_sides(groups)
    if not 2 <= len(sides) <= MOST_SIDES:
        raise InputError(f"{where}.sides: {len(sides)} found, expected 2 to {MOST_SIDES} sides")
    declared: list[DeclaredSide] = []
    side_of: dict[str, str] = {}
    for name, side in sides.items():
        side_declared = _check_side(name, side, groups, metrics, where)
        for group in side_declared.groups:
            other = side_of.setdefault(group, name)
            if other != name:
                raise InputError(
                    f"{where}.sides[{name!r}].groups: {group!r} belongs to the side {other!r}, too; a group "
                    "belongs to one side"
                )
        declared.append(side_declared)
    rest = [group for group in groups if group not in side_of]
    if rest:
        raise InputError(f"{where}.sides: {', '.join(rest)} missing; each group belongs to a side")
    return tuple(declared)


def _imply_sides(groups: Mapping[str, Group]) -> tuple[DeclaredSide, ...]:
    """Return a side for each group; none for a single group, and if they could not be announced."""
    if not 2 <= len(groups) <= MOST_SIDES or not all(map(is_side_name, groups)):
        return ()
    return tuple(DeclaredSide(name, (name,)) for name in groups)


def _check_side(
    name: Any,  # noqa: ANN401 - as above
    side: Any,  # noqa: ANN401
    groups: Mapping[str, Group],
    metrics: Collection[str],
    where: str,
) -> DeclaredSide:
    _check_name(name, f"{where}.sides: the name")
    at = f"{where}.sides[{name!r}]"
    if not isinstance(side, Side):
        raise InputError(f"{at}: {_cut(side)} found, expected Side(groups=.., fitness=..)")
    if isinstance(side.groups, str) or not isinstance(side.groups, Sequence):
        raise InputError(f"{at}.groups: {_cut(side.groups)} found, expected names of groups")
    names = tuple(side.groups) or (name,)
    for index, group in enumerate(names):
        _check_name(group, f"{at}.groups")
        if group not in groups:
            raise InputError(f"{at}.groups: there is no group {group!r}{suggest_or_list(group, groups)}")
        if group in names[:index]:
            raise InputError(f"{at}.groups: {group!r} found twice")
    if side.fitness is not None:
        _check_name(side.fitness, f"{at}.fitness")
        if side.fitness not in metrics:
            raise InputError(
                f"{at}.fitness: there is no metric {side.fitness!r}{suggest_or_list(side.fitness, metrics)}"
            )
    return DeclaredSide(name, names, side.fitness)


def _check_name(name: object, at: str) -> None:
    if not is_side_name(name):
        raise InputError(
            f"{at}: {_cut(name)} found, expected text of 1 to {_LONGEST_NAME} printable characters"
        )


def _cut(value: object) -> str:
    """Return the representation of a value, which may be long, in at most 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def is_side_name(name: object) -> bool:
    """Return whether a name can be that of a side, of one of its groups, or of its fitness."""
    return isinstance(name, str) and 0 < len(name) <= _LONGEST_NAME and name.isprintable()


def count_groups(groups: Mapping[str, Group], parameters: Mapping[str, Any]) -> list[DeclaredGroup]:
    """Return the groups with their numbers of agents. Raises InputError like `Group.count`."""
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
    """The attributes that describe a simulation."""

    title: str = ""
    """The name in discovery and in experiments; default: the class's name in lower case."""
    dimensions: int = 2
    """Spatial dimensions, which experiments may require."""
    max_agents: int | None = None
    """Largest number of agents; None: no limit."""
    sensors: int
    """Number of sensor values of an agent. 0, like `actuators`, if the simulation controls its agents itself
    and only its parameters are optimized (`controller: {kind: parameter_set}`); `reset` and `step` then
    return nothing."""
    actuators: int
    """Number of actuator values of an agent; 0 if `sensors` is 0."""
    groups: Mapping[str, "Group"] = {}
    """Kinds of agents that differ in sensors, actuators or controllers: name -> Group(agents, sensors,
    actuators). The agents of the first group come first. `sensors` and `actuators` are then the maxima over
    the groups. Experiments use `controller: {kind: team, groups: {..}}`."""
    sides: Mapping[str, "Side"] = {}
    """Sides of a match, if groups compete: name -> Side(groups, fitness), which experiments name in
    `ranking: {kind: tournament, sides: [..]}` or in `populations`. Each group belongs to a side. Default:
    each group is a side, without a fitness."""
    sensor_names: Sequence[str] = ()
    """Names of all sensors of an agent, for drawings of controllers; empty: they are numbered."""
    actuator_names: Sequence[str] = ()
    """Names of all actuators of an agent; empty: they are numbered."""
    sensor_units: Sequence[str] = ()
    """Units of all sensors of an agent, such as m or rad, for exported controllers."""
    actuator_units: Sequence[str] = ()
    """Units of all actuators of an agent."""
    sensor_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = ()
    """For exported controllers: the values that -1 and 1 of each sensor stand for, if it is scaled: (low,
    high) in its unit, or (low, high, unit); None for a sensor that is not scaled."""
    actuator_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = ()
    """The values that -1 and 1 of each actuator stand for."""
    parameters: Mapping[str, Any] = {}
    """Parameters that an experiment can set: name -> default, or name -> Parameter(default, description, ..).

    If a class declares any, an experiment that names the class cannot set others."""
    metrics: Sequence[str] | Mapping[str, str] = ()
    """The metrics that `measure` returns: names, or name -> description. Experiments can define fitness from
    them."""
    determinism: Literal["bitwise", "statistical", "none"] | None = None
    """How far two evaluations of the same episode and controller agree on any server: bit-identical, within
    `tolerance`, or not at all. None: unknown. If it is bitwise or statistical, experiments can have results
    audited on another server (`faults: {audit: 0.01}`)."""
    tolerance: float = 0.0
    """If `determinism` is statistical: the largest difference of fitness and metrics, relative to the larger
    value, absolute for values below 1."""
    copies: bool = True
    """Whether a process can have several objects of this class, whose episodes are then stepped side by side
    in the mode `batched`. False if objects hold a unique resource: a window, a robot, a port."""
    most_steps: int | None = 1_000_000
    """Largest number of steps of an episode; an episode that is not done after them fails. None: no limit."""
    frame_seconds: float = 0.1
    """Seconds between two frames when displayed."""
    step_seconds: float | None = None
    """Simulated seconds of a step, above 0, which is the step time of exported controllers. None:
    `frame_seconds` if the class sets it, else unknown."""

    @classmethod
    def notice_before_run(cls, parameters: Mapping[str, Any]) -> str | None:  # noqa: ARG003 - for those that override it
        """Return a notice for the user before a run; None, the default, for no notice.

        parameters: the experiment's parameters, unchecked.
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

    `swarmwright serve file.py:Gather` starts simulation servers for it. An experiment names it by its title,
    or as `simulation: file.py:Gather`, which starts the servers automatically.

    The constructor takes no arguments. An object runs one episode after the other: `reset`, then `step` until
    `done`, then `fitness`. An exception ends the episode and fails its evaluation; the next episode begins
    with `reset`. For reproducible runs, episodes must depend only on the parameters and the seed;
    `swarmwright.testing.check_simulation` tests this.
    """

    @abstractmethod
    def reset(self, parameters: dict[str, Any], seed: int) -> ArrayLike | None:
        """Start an episode and return the first observations.

        Args:
            parameters: the experiment's parameters. Declared parameters have been checked, and defaults
                added.
            seed: seed of the episode, 0 to 2**64 - 1; the only source of randomness.

        Returns:
            Observations, (agents, sensors), finite: a row for each agent. Numbers are rounded to binary32.
            With `groups`, a row may be as long as its agent's group declares, and is padded with 0.
            None if `sensors` is 0.

        Raises:
            swarmwright.InputError: the parameters are not valid, "name: reason"; no further episodes are run
                with them.
        """

    @abstractmethod
    def step(self, actions: NDArray[np.float32]) -> ArrayLike | None:
        """Advance the episode by one step.

        Args:
            actions: (agents, actuators), float32, -1 to 1. Rows of agents that did not act are 0, and with
                `groups` also the columns beyond the actuators of an agent's group.

        Returns:
            Observations as from `reset`, with the same number of rows. Rows of agents that do not act next
            are ignored, and all rows when the episode is done.
        """

    @abstractmethod
    def done(self) -> bool:
        """Return whether the episode has ended. Called after `reset` and after every step."""

    @abstractmethod
    def fitness(self) -> float:
        """Return the fitness of the episode: finite, higher is better. Called when it has ended.

        `swarmwright.environments` calls it after every step, because rewards are its changes. If it fails
        before the end, or is not finite, the reward comes later, at the latest at the end.
        """

    def measure(self) -> Mapping[str, float]:
        """Return the metrics of the episode: all names in `metrics`.

        Called when the episode has ended, if an experiment uses them. A metric may be NaN or infinite if
        there is nothing to measure; the episode fails only if its fitness is computed from it.
        """
        return {}

    def truncated(self) -> bool:
        """Return whether the episode ended only because its time was over, which agents do not sense.

        Called at the end by `swarmwright.environments`, so that learning does not take the last state for a
        terminal state. The default is False.
        """
        return False

    def acting(self) -> ArrayLike | None:
        """Return the agents that act next: indices, or (agents,) booleans; None, the default, for all.

        Leave out agents that have dropped out. If agents take turns, return a single agent each time. While
        no agent acts, the simulation is stepped without actions until it is done.
        """
        return None

    def scene(self) -> "Scene | None":
        """Return the scene to display; None, the default, for nothing.

        `swarmwright replay` draws it, and `simulate --visual` on a server.
        """
        return None

    def picture(self) -> NDArray[np.uint8] | None:
        """Return the picture to display, (height, width, 3), red, green, blue from 0 to 255.

        None, the default, for nothing. `swarmwright replay` uses it for videos and pages if the class has no
        `scene`.
        """
        return None


class BatchSimulation(Described):
    """A simulation whose methods take and return arrays for many episodes, stepped together with NumPy.

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

    It can be used wherever a `Simulation` can. All episodes have the same parameters and number of agents,
    and each has its own seed and controllers. Up to `lanes` offloaded controllers are evaluated at once, and
    a batch has up to `lanes` or 256 episodes; in the mode stepwise, and for offloaded parameter sets, the
    arrays hold a single episode. For the same result in every mode, an episode must not depend on the others:
    `swarmwright.testing.check_batch_simulation` tests this. If a method raises, the episodes are repeated one
    by one, so that only those fail that cause the error.
    """

    lanes: int = 1024
    """Largest number of episodes in a call."""

    @abstractmethod
    def reset(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> ArrayLike:
        """Start an episode for each seed and return the first observations.

        Args:
            parameters: as in `Simulation.reset`.
            seeds: (episodes,), the only source of randomness.

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
            Observations as from `reset`. Those of episodes that have ended, and of agents that do not act
            next, are ignored.
        """

    @abstractmethod
    def done(self) -> ArrayLike:
        """Return which episodes have ended, (episodes,) booleans.

        Called after `reset` and after every step.
        """

    @abstractmethod
    def fitness(self) -> ArrayLike:
        """Return the fitness of each episode, (episodes,), higher is better.

        Called after each step in which episodes have ended; only the values of these are used.
        """

    def measure(self) -> Mapping[str, ArrayLike]:
        """Return the metrics, name -> (episodes,); called like `fitness`."""
        return {}

    def acting(self) -> ArrayLike | None:
        """Return the agents that act next, (episodes, agents) booleans; None, the default, for all."""
        return None

    def scene(self) -> Any:  # noqa: ANN401 - a swarmwright.Scene
        """Return the scene of the first episode, a `swarmwright.display.Scene`; None for nothing."""
        return None
