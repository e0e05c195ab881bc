"""Runs the code of a user's simulation for the engine: checks what it returns, explains what it raises.

Checks what the code of a BatchSimulation returns, for many episodes at once.

What the class of a simulation can show: scenes, which are drawn here, or pictures that it draws itself.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.common.groups import DeclaredGroup
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.base import BatchSimulation, Described, Simulation, counted
from swarmwright.simulations.calls import OBSERVATIONS_ALONE, Calls, is_of_gymnasium, short
from swarmwright.simulations.description import Description, describe
from swarmwright.simulations.parameters import filled_in

if TYPE_CHECKING:
    from swarmwright.common.engine_types import SceneFields


@cache
def shown_as(kind: type[Simulation] | type[BatchSimulation]) -> Literal["scene", "picture"]:
    """Return what a class can show, scenes where it has both.

    Raises InputError with the reason where there is nothing to show.
    """
    if defines(kind, "scene"):
        return "scene"
    if issubclass(kind, Simulation) and defines(kind, "picture"):
        unshown = getattr(kind, "unshown", None)  # of environments of libraries
        reason = None if unshown is None else unshown()
        if reason is not None:
            raise InputError(reason)
        return "picture"
    if hasattr(kind, "runVisual"):
        raise InputError(f"{kind.__name__} is a command, whose episodes cannot be drawn here")
    raise InputError(
        f"{kind.__name__} has nothing to show: give it a method scene() that returns a "
        "swarmwright.display.Scene, or picture() that returns an image"
    )


@cache
def drawing(kind: type[Simulation]) -> type[Simulation]:
    """Return the class whose objects draw pictures: environments of libraries render only when asked to.

    Raises InputError where the environment cannot.
    """
    rendered = getattr(kind, "rendered", None)
    made: type[Simulation] = kind if rendered is None else rendered()
    return made


def defines(kind: type[Described], method: str) -> bool:
    """Return whether a class overrides a method."""
    found = getattr(kind, method, None)
    return found is not None and all(
        found is not getattr(base, method, None) for base in (Simulation, BatchSimulation)
    )


Many = tuple[NDArray[np.bool_], NDArray[np.float32], NDArray[np.bool_]]
"""Who acts next, (episodes, agents); (episodes, agents, sensors); which episodes have ended, (episodes,)."""
Call = Callable[..., Any]


class BatchChecks:
    """Episodes that are stepped together.

    Args:
        sensors: of an agent.
        episodes: how many.
        most: agents of an episode, None for no limit.
        fail: raises SimulationError with a reason, "method: why".
    """

    def __init__(
        self, sensors: int, episodes: int, most: int | None, fail: Callable[[str], NoReturn]
    ) -> None:
        self._sensors, self._episodes, self._most, self._fail = sensors, episodes, most, fail
        self._agents: int | None = None
        self._over = np.zeros(episodes, bool)

    def seen(self, method: str, returned: Any, call: Call) -> Many:  # noqa: ANN401 - whatever it returns
        """Check observations; ask which episodes have ended, and who acts."""
        rows = self._rows(method, returned)
        self._over = self._over | self._flags("done", call("done"), (self._episodes,))
        acting = call("acting")
        shape = rows.shape[:2]
        acts = np.ones(shape, bool) if acting is None else self._flags("acting", acting, shape)
        acts = acts & ~self._over[:, None]
        finite = np.isfinite(rows)
        if not finite.all():
            wrong = np.argwhere(~finite & acts[:, :, None])
            if len(wrong):
                episode, agent, sensor = wrong[0]
                self._fail(
                    f"{method}: sensor {sensor} of agent {agent} in episode {episode} is "
                    f"{rows[episode, agent, sensor]}, expected a finite number (binary32)"
                )
        return acts, rows, self._over

    def results(self, metrics: Sequence[str], call: Call) -> NDArray[np.float64]:
        """Ask for fitness and metrics, (1 + metrics, episodes)."""
        found = np.empty((1 + len(metrics), self._episodes))
        found[0] = self._numbers("fitness", call("fitness"))
        if metrics:
            measured = call("measure")
            if not isinstance(measured, Mapping) or not set(metrics) <= set(measured):
                self._fail(f"measure: expected a mapping with {', '.join(metrics)}")
            for index, name in enumerate(metrics, 1):
                found[index] = self._numbers(f"measure: {name!r}", measured[name])
        return found

    def _rows(self, method: str, returned: Any) -> NDArray[np.float32]:  # noqa: ANN401
        agents = "agents" if self._agents is None else self._agents
        expected = f"({self._episodes}, {agents}, {self._sensors})"
        if is_of_gymnasium(returned):
            self._fail(f"{method}: {short(returned)} returned, {OBSERVATIONS_ALONE}")
        given = _array(returned)
        fits = given.ndim == 3 and (given.shape[0], given.shape[2]) == (self._episodes, self._sensors)
        if given.dtype.kind not in "biuf" or not fits or given.shape[1] != (self._agents or given.shape[1]):
            self._fail(f"{method}: observations of the shape {given.shape} returned, expected {expected}")
        if self._agents is None:
            self._agents = given.shape[1]
            if not self._agents or (self._most is not None and self._agents > self._most):
                limit = (
                    "" if self._most is None else f" and at most {self._most}, the simulation's max_agents"
                )
                self._fail(f"{method}: {self._agents} agents returned, expected at least 1{limit}")
        with np.errstate(over="ignore"):
            return np.ascontiguousarray(given, dtype=np.float32)

    def _flags(self, method: str, returned: Any, shape: tuple[int, ...]) -> NDArray[np.bool_]:  # noqa: ANN401
        flags = _array(returned)
        if flags.dtype != np.bool_ or flags.shape != shape:
            self._fail(
                f"{method}: {flags.dtype} of the shape {flags.shape} returned, expected {shape} booleans"
            )
        return flags

    def _numbers(self, what: str, returned: Any) -> NDArray[np.float64]:  # noqa: ANN401
        numbers = _array(returned)
        if numbers.dtype.kind not in "biuf" or numbers.shape != (self._episodes,):
            self._fail(f"{what}: the shape {numbers.shape} returned, expected ({self._episodes},) numbers")
        return numbers.astype(np.float64)


def _array(returned: Any) -> NDArray[Any]:  # noqa: ANN401 - whatever the code returns
    try:
        return np.asarray(returned)
    except (TypeError, ValueError):  # ragged
        return np.empty(0, object)


Seen = tuple[NDArray[np.uint32], NDArray[np.float32], bool]
"""The agents that act next, ascending, (agents, sensors), and whether the episode has ended."""


_MANY_STEPS = 10_000
"""Steps of an episode after which a user is asked whether it has an end."""


class Host(Calls[Simulation | BatchSimulation]):
    """One object of a simulation's class, as the engine steps it.

    Args:
        kind: the class.
        report: gets (reason, traceback) of a failure, once for each reason.
        description: of the class; default: asked.

    Raises InputError when the class does not describe itself properly.

    """

    _beginning = "reset"
    _needs: ClassVar[str] = "a simulation needs reset, step, done and fitness"
    moves_robots = False
    """Whether the arena's missions are run; see `PhysicsHost`."""

    def __init__(
        self,
        kind: type[Simulation] | type[BatchSimulation],
        report: Callable[[str, str], None] | None = None,
        description: Description | None = None,
    ) -> None:
        super().__init__(kind, report)
        if description is None:
            self._object = self._made()
            description = describe(self._object, kind.__name__)
        self.description = description
        self.title = description.title
        self.dimensions = description.dimensions
        self.max_agents = description.max_agents
        # The engine's agents have sensors and actuators. One that is never asked for actions stands for none.
        self._steered = description.sensors > 0
        self.sensors = description.sensors or 1
        self.actuators = description.actuators or 1
        self.copies = description.copies
        self.lanes = description.lanes
        self.frame_seconds = description.frame_seconds
        self.metrics = list(description.metrics.items())
        self.determinism = description.determinism
        self.tolerance = description.tolerance
        self.takes_controller = description.takes_controller
        self.has_groups = bool(description.groups)
        self.steers_itself = description.steers_itself
        self.has_scenes = defines(kind, "scene")
        is_declared = any("most_steps" in vars(base) for base in kind.__mro__ if base is not Described)
        self._declares_most_steps = is_declared or description.most_steps != Described.most_steps
        self._agents = 0
        self._steps = 0  # of the episode
        self._groups: list[DeclaredGroup] = []  # of the episode

    def groups(self) -> list[tuple[str, int, int, int, bool]]:
        """Return the kinds of agents of the episode.

        Name, agents, sensors, actuators, and whether rows of all agents have the same length.
        """
        padded = self.description.padded
        return [(group.name, group.agents, group.sensors, group.actuators, padded) for group in self._groups]

    def another(self) -> "Host":
        """Return a host with another object, which is made when it is reset."""
        other = Host(self._kind, self._report, self.description)
        other._reports_with(self)
        return other

    def reset(self, parameters: dict[str, Any], controller: str | None = None) -> Seen:
        """Start an episode.

        parameters: values of JSON's kinds; `seed` is the episode's, default 0. controller: its specification,
        where the simulation runs controllers itself. Raises the engine's InputError for parameters that are
        refused, SimulationError when the code fails.
        """
        values, seed = self._parameters(parameters)
        self._steps = 0
        if self.takes_controller:
            return self._seen("reset", self._call("reset", values, seed, controller), first=True)
        if isinstance(self._object, BatchSimulation):
            return self._only(self._started(values, np.array([seed], np.uint64)))
        return self._seen("reset", self._call("reset", values, seed), first=True)

    def step(self, actions: NDArray[np.float32]) -> Seen:
        """Advance by one step; actions: (agents, actuators). Raises SimulationError when the code fails."""
        if isinstance(self._object, BatchSimulation):
            return self._only(self.go(actions[None]))
        given = actions if self._steered else actions[:, :0]
        seen = self._seen("step", self._call("step", given), first=False)
        self._count_step(ended=seen[2])
        return seen

    def _count_step(self, *, ended: bool) -> None:
        """Fail an episode that seems to have no end; warn before that, as it may take hours until then."""
        self._steps += 1
        if self._steps == _MANY_STEPS and not ended and not self._declares_most_steps:
            name = self._kind.__name__
            warn_once(
                f"{name}: an episode has not ended after {_MANY_STEPS:,} steps; does done() become true? "
                f"Declare {name}.most_steps, the steps of the longest episode, where this many are meant"
            )
        most = self.description.most_steps
        if most is not None and self._steps >= most and not ended:
            self._fail(
                f"done: not true after {self._steps} steps; does it become true? An episode may have "
                f"{self._kind.__name__}.most_steps steps, or any number where that is None"
            )

    def fitness(self) -> float:
        """Return the fitness. Raises SimulationError when the code fails."""
        batch = isinstance(self._object, BatchSimulation)
        returned = self.results(metrics=False)[0, 0] if batch else self._call("fitness")
        value = _number(returned)
        if not math.isfinite(value):
            self._fail(f"fitness: {short(returned)} returned, expected a finite number")
        return value

    def truncated(self) -> bool:
        """Return whether the episode has ended since its time was over, see `Simulation.truncated`.

        Raises SimulationError when the code fails.
        """
        if not isinstance(self._object, Simulation):
            return False
        # Classes that were written before there was the method may have a flag of this name.
        given: Any = self._object.truncated
        returned = self._call("truncated") if callable(given) else given
        if not isinstance(returned, bool | np.bool_):
            self._fail(f"truncated: {short(returned)} returned, expected True or False")
        return bool(returned)

    def measure(self) -> list[float]:
        """Return the metrics, in the order of `metrics`; they may be NaN or infinite.

        Raises SimulationError when the code fails.
        """
        if isinstance(self._object, BatchSimulation):
            return self._measured(dict(zip(self._names, self.results(metrics=True)[1:, 0], strict=True)))
        returned = self._call("measure")
        if not isinstance(returned, Mapping):
            self._fail(f"measure: {short(returned)} returned, expected a mapping from names to numbers")
        return self._measured(returned)

    def _measured(self, returned: Mapping[str, Any]) -> list[float]:
        values = []
        for name, _ in self.metrics:
            if name not in returned:
                self._fail(f"measure: {short(dict(returned))} returned, which lacks {name!r}")
            values.append(_number(returned[name]))
            if math.isnan(values[-1]) and not isinstance(returned[name], float | np.floating):
                self._fail(f"measure: {name!r} is {short(returned[name])}, expected a number")
        return values

    def scene(self) -> "SceneFields | None":
        """Return what it looks like; None for nothing. Raises SimulationError when the code fails."""
        from swarmwright.display import Scene  # noqa: PLC0415 - only where scenes are drawn

        scene = self._call("scene")
        if scene is None:
            return None
        if not isinstance(scene, Scene):
            self._fail(f"scene: {short(scene)} returned, expected a swarmwright.display.Scene or None")
        try:
            return scene.plain()
        except (TypeError, ValueError) as error:
            self._fail(f"scene: {short(scene)} returned: {error}")

    def picture(self) -> NDArray[np.uint8]:
        """Return what it looks like, (height, width, 3). Raises SimulationError when the code fails."""
        picture = self._call("picture")
        try:
            drawn = np.asarray(picture)
        except (TypeError, ValueError):  # ragged
            drawn = np.empty(0)
        if drawn.ndim != 3 or drawn.shape[2] != 3 or drawn.dtype != np.uint8 or not drawn.size:
            found = f"{drawn.dtype} of the shape {drawn.shape}" if drawn.ndim else short(picture)
            self._fail(f"picture: {found} returned, expected uint8 of the shape (height, width, 3)")
        return drawn

    def start(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> Many:
        """Start many episodes of a BatchSimulation; raises as `reset`.

        parameters: as for `reset`; the seed in them does not count. seeds: (episodes,).
        """
        values, _ = self._parameters(parameters)
        return self._started(values, seeds)

    def _started(self, values: dict[str, Any], seeds: NDArray[np.uint64]) -> Many:
        self._steps = 0
        self._many = BatchChecks(self.sensors, len(seeds), self.max_agents, self._fail)
        return self._many.seen("reset", self._call("reset", values, seeds), self._call)

    def go(self, actions: NDArray[np.float32]) -> Many:
        """Advance by one step; actions: (episodes, agents, actuators). Raises SimulationError."""
        many = self._many.seen("step", self._call("step", actions), self._call)
        self._count_step(ended=bool(many[2].all()))
        return many

    def _only(self, many: Many) -> Seen:
        """What is seen of the only episode of a BatchSimulation."""
        acts, rows, over = many
        return np.flatnonzero(acts[0]).astype(np.uint32), rows[0], bool(over[0])

    def results(self, metrics: bool) -> NDArray[np.float64]:
        """Return fitness and, where wanted, all metrics of all episodes, (1 + metrics, episodes).

        Those of episodes that have not ended may be anything. Raises SimulationError when the code fails.
        """
        return self._many.results(self._names if metrics else [], self._call)

    @property
    def _names(self) -> list[str]:
        return [name for name, _ in self.metrics]

    def _parameters(self, parameters: dict[str, Any]) -> tuple[dict[str, Any], int]:
        """Make the object where there is none; return what it is reset with, and the seed."""
        given = dict(parameters)
        try:
            seed = _seed(given.pop("seed", 0))
            self._notice_unknown(given)
            known = self.description.parameters
            values = filled_in(
                known,
                {name: given_value for name, given_value in given.items() if not known or name in known},
                sent=True,
            )
            if self.has_groups:
                self._groups = counted(self.description.groups, values)
            if self._object is None:
                self._object = self._made()
        except InputError as error:
            raise _engine.InputError(str(error)) from None
        return values, seed

    def _notice_unknown(self, given: Mapping[str, Any]) -> None:
        """Warn of parameters that the class does not declare, once for each; they do not reach it.

        Tools that have the class refuse them; those that know its title alone cannot. By the protocol servers
        ignore what they do not know, so that they are no reason to refuse the work.
        """
        known = self.description.parameters
        if not known:  # any are possible
            return
        for name in sorted(given.keys() - known.keys()):
            warn_once(
                f"{self.description.title}: a tool has set the parameter {name!r}, which "
                f"{self._kind.__name__} does not declare{did_you_mean(name, known)}"
            )

    def _seen(self, method: str, returned: Any, *, first: bool) -> Seen:  # noqa: ANN401 - whatever it returns
        """Check observations; ask who acts."""
        done = self._call("done")
        if not isinstance(done, bool | np.bool_):
            self._fail(f"done: {short(done)} returned, expected True or False")
        if done and not first:
            return np.empty(0, np.uint32), np.empty((self._agents, self.sensors), np.float32), True
        rows = self._rows(method, returned, first=first)
        acting = np.empty(0, np.uint32) if done else self._acting()
        # Fast path: all values are finite.
        if not np.isfinite(rows).all():
            for agent in acting:
                wrong = np.flatnonzero(~np.isfinite(rows[agent]))
                if len(wrong):
                    self._fail(
                        f"{method}: sensor {wrong[0]} of agent {agent} is {rows[agent, wrong[0]]}, "
                        "expected a finite number (binary32)"
                    )
        return acting, rows, bool(done)

    def _rows(self, method: str, returned: Any, *, first: bool) -> NDArray[np.float32]:  # noqa: ANN401
        if not self._steered:
            self._agents = 1
            return np.zeros((1, 1), np.float32)
        if is_of_gymnasium(returned):
            self._fail(f"{method}: {short(returned)} returned, {OBSERVATIONS_ALONE}")
        if self.has_groups:
            returned = self._filled_up(method, returned)
        expected = f"({'agents' if first else self._agents}, {self.sensors})"
        try:
            given = np.asarray(returned)
        except (TypeError, ValueError):  # ragged
            given = np.empty(0, object)
        if given.dtype.kind not in "biuf":
            self._fail(f"{method}: {short(returned)} returned, expected numbers of the shape {expected}")
        if given.ndim != 2 or given.shape[1] != self.sensors or not (first or len(given) == self._agents):
            self._fail(
                f"{method}: observations of the shape {given.shape} returned, expected {expected}: "
                f"a row of {self.sensors} for each agent"
            )
        with np.errstate(over="ignore"):
            rows = np.ascontiguousarray(given, dtype=np.float32)
        if first:
            self._agents = len(rows)
            most = self.max_agents
            if not self._agents or (most is not None and self._agents > most):
                limit = "" if most is None else f" and at most {most}, the simulation's max_agents"
                self._fail(f"{method}: {self._agents} agents returned, expected at least 1{limit}")
        return rows

    def _filled_up(self, method: str, returned: Any) -> Any:  # noqa: ANN401 - whatever it returns
        """Return rows of the same length where each is as long as the agent's group says."""
        wanted = [group.sensors for group in self._groups for _ in range(group.agents)]
        try:
            rows = [np.asarray(row) for row in returned]
        except (TypeError, ValueError):
            return returned
        if len(rows) != len(wanted):
            groups = ", ".join(f"{group.agents} {group.name}" for group in self._groups)
            self._fail(f"{method}: {len(rows)} rows returned, expected {len(wanted)}: {groups}")
        filled = np.zeros((len(rows), self.sensors), np.float64)
        for agent, (row, own) in enumerate(zip(rows, wanted, strict=True)):
            if row.dtype.kind not in "biuf" or row.shape not in {(own,), (self.sensors,)}:
                self._fail(
                    f"{method}: agent {agent} senses {short(row.tolist())}, expected {own} numbers, as its "
                    "group says"
                )
            filled[agent, :own] = row[:own]
        return filled

    def _acting(self) -> NDArray[np.uint32]:
        if not self._steered:
            return np.empty(0, np.uint32)
        returned = self._call("acting")
        if returned is None:
            return np.arange(self._agents, dtype=np.uint32)
        try:
            agents = np.asarray(returned)
        except (TypeError, ValueError):  # ragged
            agents = np.empty(1, object)
        if agents.dtype == np.bool_ and agents.shape == (self._agents,):
            return np.flatnonzero(agents).astype(np.uint32)
        if not agents.size:
            return np.empty(0, np.uint32)
        if agents.dtype.kind not in "iu" or agents.ndim != 1:
            self._fail(
                f"acting: {short(returned)} returned, "
                f"expected indices of agents, ({self._agents},) booleans or None"
            )
        if agents.min() < 0 or agents.max() >= self._agents:
            self._fail(
                f"acting: {short(returned)} returned, "
                f"but there are {self._agents} agents, from 0 to {self._agents - 1}"
            )
        indices = np.unique(agents)
        if agents.size == self._agents > indices.size and indices[-1] <= 1:
            self._fail(
                f"acting: {short(returned)} returned, which names agents twice: "
                "indices of agents are expected, and flags are booleans"
            )
        return indices.astype(np.uint32)


def _number(value: Any) -> float:  # noqa: ANN401 - whatever the code returns
    """Return a number, NaN for anything else."""
    try:
        return math.nan if isinstance(value, str | bytes | bytearray | memoryview) else float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _seed(value: Any) -> int:  # noqa: ANN401 - any JSON value
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0 <= value < 2**64 or value != int(value):
        raise InputError(f"seed: {short(value)} found, expected an integer from 0 to 2**64 - 1")
    return int(value)
