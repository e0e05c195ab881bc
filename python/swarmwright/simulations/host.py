"""Host of a user's simulation: runs it for the engine, checks its results, explains its exceptions."""

import json
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common import metric_names
from swarmwright.common.errors import InputError
from swarmwright.common.groups import DeclaredGroup, DeclaredSide
from swarmwright.common.ranges import Range, ranges_of
from swarmwright.common.suggestions import did_you_mean, similar
from swarmwright.common.time_limit import check_time_limit
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.base import (
    BatchSimulation,
    Described,
    Group,
    Simulation,
    check_groups,
    check_sides,
    count_groups,
)
from swarmwright.simulations.calls import OBSERVATIONS_ALONE, Calls, is_gymnasium_result, summarize
from swarmwright.simulations.parameters import Parameter, fill_parameters, parse_parameters

if TYPE_CHECKING:
    from swarmwright.common.engine_types import SceneFields

_LARGEST_COUNT = 1_000_000
"""Largest number of agents, sensors or actuators."""
_MOST_STEPS = 10**15
"""Largest `most_steps`."""
_DETERMINISMS = ("bitwise", "statistical", "none")
_MISSPELT_LIKENESS = 0.85
"""Smallest similarity of names, up to 1, at which an attribute counts as a misspelling of another."""


@dataclass(frozen=True)
class Description:
    """The description of a simulation; see the attributes of `Simulation`."""

    title: str
    dimensions: int
    max_agents: int | None
    sensors: int
    actuators: int
    sensor_names: tuple[str, ...]
    actuator_names: tuple[str, ...]
    sensor_units: tuple[str, ...]
    actuator_units: tuple[str, ...]
    sensor_ranges: tuple[Range | None, ...]
    actuator_ranges: tuple[Range | None, ...]
    parameters: Mapping[str, Parameter]
    metrics: Mapping[str, str]
    copies: bool
    determinism: str | None
    tolerance: float
    lanes: int
    most_steps: int | None
    frame_seconds: float
    step_seconds: float | None
    """Simulated seconds of a step; None if unknown."""
    takes_controller: bool
    """Whether `reset` receives the controller, because the simulation runs it itself."""
    groups: Mapping[str, Group]
    """Kinds of agents, in the order of the agents; empty if all are alike."""
    sides: tuple[DeclaredSide, ...]
    """Sides of a match; empty unless there are several kinds of agents."""
    padded: bool
    """Whether the rows of all agents are padded to the same length in messages."""
    steers_itself: bool | None
    """Whether no agent is controlled from outside; None: it depends on the parameters."""

    def plain(self) -> dict[str, Any]:
        """Return the description as a dictionary with the keys of `_engine.describe`."""
        return {
            "title": self.title,
            "dimensions": self.dimensions,
            "max_agents": self.max_agents,
            "sensors": self.sensors,
            "actuators": self.actuators,
            "sensor_names": list(self.sensor_names),
            "actuator_names": list(self.actuator_names),
            "sensor_units": list(self.sensor_units),
            "actuator_units": list(self.actuator_units),
            "parameters": {
                name: {
                    "type": parameter.kind,
                    "default": parameter.default,
                    "description": parameter.description,
                }
                for name, parameter in self.parameters.items()
            },
            "metrics": {name: {"unit": "", "description": text} for name, text in self.metrics.items()},
            "determinism": self.determinism,
        }


def describe(simulation: Described | Any, where: str = "") -> Description:  # noqa: ANN401 - or what acts like one
    """Read and check a simulation's attributes. Raises InputError, with class (`where`) and attribute."""
    where = where or type(simulation).__name__
    title: Any = simulation.title or where.lower()
    if not isinstance(title, str) or len(title) > 1000:
        raise InputError(f"{where}.title: {title!r} found, expected text of at most 1000 characters")
    parameters = parse_parameters(simulation.parameters, where)
    for name, parameter in parameters.items():
        try:
            json.dumps(parameter.default, allow_nan=False)
        except (TypeError, ValueError):
            raise InputError(
                f"{where}.parameters[{name!r}]: default: {parameter.default!r} found, expected a JSON value"
            ) from None
    max_agents, steps = simulation.max_agents, getattr(simulation, "most_steps", Described.most_steps)
    groups = check_groups(getattr(simulation, "groups", {}), parameters, where)
    metrics = _metrics(where, simulation.metrics)
    sensors, actuators = (
        _count_channels(where, simulation, groups, name) for name in ("sensors", "actuators")
    )
    if (sensors == 0) != (actuators == 0):
        name, counterpart = ("sensors", "actuators") if sensors == 0 else ("actuators", "sensors")
        raise InputError(
            f"{where}.{name}: 0 found, expected at least 1; if the simulation controls its agents itself, "
            f"set {counterpart} to 0, too"
        )

    def channels(name: str, count: int) -> tuple[str, ...]:
        return _channels(where, name, getattr(simulation, name, ()), count)

    def ranges(name: str, count: int) -> tuple[Range | None, ...]:
        try:
            return ranges_of(getattr(simulation, name, ()), count)
        except ValueError as error:
            raise InputError(f"{where}.{name}: {error}") from None

    return Description(
        title=title,
        dimensions=_count(where, "dimensions", simulation.dimensions, least=0),
        max_agents=None if max_agents is None else _count(where, "max_agents", max_agents),
        sensors=sensors,
        actuators=actuators,
        sensor_names=channels("sensor_names", sensors),
        actuator_names=channels("actuator_names", actuators),
        sensor_units=channels("sensor_units", sensors),
        actuator_units=channels("actuator_units", actuators),
        sensor_ranges=ranges("sensor_ranges", sensors),
        actuator_ranges=ranges("actuator_ranges", actuators),
        parameters=parameters,
        metrics=metrics,
        copies=bool(simulation.copies),
        determinism=_determinism(where, simulation.determinism),
        tolerance=_tolerance(where, simulation.tolerance),
        lanes=_count(where, "lanes", getattr(simulation, "lanes", 1)),
        most_steps=None if steps is None else _count(where, "most_steps", steps, most=_MOST_STEPS),
        frame_seconds=_tolerance(where, simulation.frame_seconds, "frame_seconds"),
        step_seconds=_step_seconds(where, simulation),
        takes_controller=bool(getattr(simulation, "takes_controller", False)),
        groups=groups,
        sides=check_sides(getattr(simulation, "sides", {}), groups, metrics, where),
        padded=bool(getattr(simulation, "padded", False)),
        steers_itself=True if sensors == 0 else getattr(simulation, "steers_itself", None),
    )


def find_misspelt_attributes(kind: type[Described]) -> list[str]:
    """Return messages about attributes that are probably misspelt names of a simulation's attributes.

    The values must be of the same type: `sensor_range = 0.5` is not a misspelling of `sensor_ranges`.
    """
    base = BatchSimulation if issubclass(kind, BatchSimulation) else Simulation
    users = [
        base_class
        for base_class in kind.__mro__
        if not f"{base_class.__module__}.".startswith(("swarmwright.", "abc."))
    ]
    attributes = {name: value for user in reversed(users) for name, value in vars(user).items()}
    base_attributes = {
        name: getattr(base, name, 0)  # sensors and actuators have no default
        for name in (*dir(base), "sensors", "actuators")
        if not name.startswith("_") and name not in attributes
    }
    messages = []
    for name, value in attributes.items():
        if name.startswith("_") or hasattr(base, name):
            continue
        suggestion = similar(name, base_attributes, _MISSPELT_LIKENESS)
        if suggestion is not None and _classify_value(value) == _classify_value(base_attributes[suggestion]):
            messages.append(
                f"{kind.__name__}.{name}: is not an attribute of {base.__name__} and has no effect; "
                f"did you mean {suggestion!r}?"
            )
    return messages


def _classify_value(value: object) -> str:
    """Return the type of an attribute's value: method, values, text or value."""
    if callable(value) or isinstance(value, classmethod | staticmethod):
        return "method"
    if isinstance(value, Iterable) and not isinstance(value, str):
        return "values"
    return "text" if isinstance(value, str) else "value"


def _count_channels(where: str, simulation: Any, groups: Mapping[str, Group], name: str) -> int:  # noqa: ANN401 - as above
    """Return the number of sensors or actuators, with groups the largest."""
    declared = getattr(simulation, name, None)
    if not groups:
        return _count(where, name, declared, least=int(isinstance(simulation, BatchSimulation)))
    most = max(getattr(group, name) for group in groups.values())
    if declared is not None and declared != most:
        raise InputError(f"{where}.{name}: {declared!r} found, but groups have up to {most}; leave it out")
    return int(most)


def _channels(where: str, name: str, value: Any, count: int) -> tuple[str, ...]:  # noqa: ANN401 - whatever it says
    """Return names or units of sensors or actuators: all of them, or none."""
    noun = name.partition("_")[2]
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InputError(f"{where}.{name}: {value!r} found, expected a list of {count} {noun}")
    names = tuple(value)
    if not all(isinstance(name_, str) for name_ in names):
        raise InputError(f"{where}.{name}: {list(names)!r} found, expected text only")
    if names and len(names) != count:
        raise InputError(f"{where}.{name}: {len(names)} {noun} found, expected {count}")
    return names


def check_determinism(where: str, name: Any, tolerance: Any) -> tuple[str | None, float]:  # noqa: ANN401 - whatever the class says
    """Check `determinism` and `tolerance`. Raises InputError, with class (`where`) and attribute."""
    return _determinism(where, name), _tolerance(where, tolerance)


def _determinism(where: str, value: Any) -> str | None:  # noqa: ANN401 - whatever the class says
    if value is not None and value not in _DETERMINISMS:
        expected = ", ".join(_DETERMINISMS)
        raise InputError(f"{where}.determinism: {value!r} found, expected one of {expected}, or None")
    return None if value is None else str(value)


def _tolerance(where: str, value: Any, name: str = "tolerance") -> float:  # noqa: ANN401 - whatever it says
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise InputError(f"{where}.{name}: {value!r} found, expected a number, 0 or more")
    return float(value)


def _step_seconds(where: str, simulation: Any) -> float | None:  # noqa: ANN401 - as above
    """Return the class's `step_seconds`, or else its `frame_seconds` if it sets that."""
    declared = getattr(simulation, "step_seconds", None)
    if declared is not None:
        seconds = _tolerance(where, declared, "step_seconds")
        if seconds == 0:
            raise InputError(f"{where}.step_seconds: {declared!r} found, expected seconds above 0, or None")
        return seconds
    owners = [vars(simulation), *(vars(kind) for kind in type(simulation).__mro__ if kind is not Described)]
    if any("frame_seconds" in owner for owner in owners):
        return _tolerance(where, simulation.frame_seconds, "frame_seconds") or None
    return None


def _metrics(where: str, metrics: Any) -> dict[str, str]:  # noqa: ANN401 - whatever the class says
    """Return name -> description."""
    if isinstance(metrics, str) or not isinstance(metrics, Iterable):
        raise InputError(f"{where}.metrics: {metrics!r} found, expected names, or names with descriptions")
    named = dict(metrics) if isinstance(metrics, Mapping) else dict.fromkeys(metrics, "")
    for name, text in named.items():
        if name == "fitness":
            raise InputError(f"{where}.metrics: {name!r} is the name of the fitness; choose another name")
        if metric_names.problem_of(name):
            raise InputError(
                f"{where}.metrics: {name!r} found, expected a letter (A-Z, a-z) or _, then letters, digits "
                "and _"
            )
        if not isinstance(text, str):
            raise InputError(f"{where}.metrics[{name!r}]: {text!r} found, expected a description")
    return named


def _count(where: str, name: str, value: Any, *, least: int = 1, most: int = _LARGEST_COUNT) -> int:  # noqa: ANN401 - whatever it says
    with suppress(TypeError):
        if not isinstance(value, bool) and least <= operator.index(value) <= most:
            return operator.index(value)
    raise InputError(f"{where}.{name}: {value!r} found, expected an integer from {least} to {most}")


@cache
def choose_display(kind: type[Simulation] | type[BatchSimulation]) -> Literal["scene", "picture"]:
    """Return what a class can display: scenes, or else pictures that it draws itself.

    Raises InputError with the reason if it has nothing to display.
    """
    if overrides(kind, "scene"):
        return "scene"
    if issubclass(kind, Simulation) and overrides(kind, "picture"):
        explain = getattr(kind, "explain_missing_display", None)  # of environments of libraries
        reason = None if explain is None else explain()
        if reason is not None:
            raise InputError(reason)
        return "picture"
    if hasattr(kind, "runVisual"):
        raise InputError(f"{kind.__name__} is a command, whose episodes Swarmwright cannot draw")
    raise InputError(
        f"{kind.__name__} has nothing to display; add a method scene() that returns a "
        "swarmwright.display.Scene, or picture() that returns an image"
    )


@cache
def make_drawing_class(kind: type[Simulation]) -> type[Simulation]:
    """Return the class whose objects draw pictures, which environments of libraries do only on request.

    Raises InputError if the environment cannot draw.
    """
    make = getattr(kind, "make_rendering_class", None)
    drawing_class: type[Simulation] = kind if make is None else make()
    return drawing_class


def overrides(kind: type[Described], method: str) -> bool:
    """Return whether a class overrides a method."""
    attribute = getattr(kind, method, None)
    return attribute is not None and all(
        attribute is not getattr(base, method, None) for base in (Simulation, BatchSimulation)
    )


BatchStepResult = tuple[NDArray[np.bool_], NDArray[np.float32], NDArray[np.bool_]]
"""Agents that act next, (episodes, agents); observations, (episodes, agents, sensors); ended, (episodes,)."""
Call = Callable[..., Any]


class BatchChecks:
    """Checks of the results of a BatchSimulation.

    Args:
        sensors: number of sensors of an agent.
        episodes: number of episodes.
        most: most agents of an episode; None for no limit.
        fail: raises SimulationError with a message, "method: reason".
    """

    def __init__(
        self, sensors: int, episodes: int, most: int | None, fail: Callable[[str], NoReturn]
    ) -> None:
        self._sensors, self._episodes, self._most, self._fail = sensors, episodes, most, fail
        self._agents: int | None = None
        self._over = np.zeros(episodes, bool)

    def check_step(self, method: str, returned: Any, call: Call) -> BatchStepResult:  # noqa: ANN401 - whatever it returns
        """Check observations; call `done` and `acting`."""
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
        """Return fitness and metrics, (1 + metrics, episodes)."""
        results = np.empty((1 + len(metrics), self._episodes))
        results[0] = self._numbers("fitness", call("fitness"))
        if metrics:
            measured = call("measure")
            if not isinstance(measured, Mapping) or not set(metrics) <= set(measured):
                self._fail(f"measure: expected a mapping with {', '.join(metrics)}")
            for index, name in enumerate(metrics, 1):
                results[index] = self._numbers(f"measure: {name!r}", measured[name])
        return results

    def _rows(self, method: str, returned: Any) -> NDArray[np.float32]:  # noqa: ANN401
        agents = "agents" if self._agents is None else self._agents
        expected = f"({self._episodes}, {agents}, {self._sensors})"
        if is_gymnasium_result(returned):
            self._fail(f"{method}: {summarize(returned)} returned, {OBSERVATIONS_ALONE}")
        array = _array(returned)
        fits = array.ndim == 3 and (array.shape[0], array.shape[2]) == (self._episodes, self._sensors)
        if array.dtype.kind not in "biuf" or not fits or array.shape[1] != (self._agents or array.shape[1]):
            self._fail(f"{method}: observations of the shape {array.shape} returned, expected {expected}")
        if self._agents is None:
            self._agents = array.shape[1]
            if not self._agents or (self._most is not None and self._agents > self._most):
                limit = (
                    "" if self._most is None else f" and at most {self._most}, the simulation's max_agents"
                )
                self._fail(f"{method}: {self._agents} agents returned, expected at least 1{limit}")
        with np.errstate(over="ignore"):
            return np.ascontiguousarray(array, dtype=np.float32)

    def _flags(self, method: str, returned: Any, shape: tuple[int, ...]) -> NDArray[np.bool_]:  # noqa: ANN401
        flags = _array(returned)
        if flags.dtype != np.bool_ or flags.shape != shape:
            self._fail(
                f"{method}: {flags.dtype} of the shape {flags.shape} returned, expected {shape} booleans"
            )
        return flags

    def _numbers(self, label: str, returned: Any) -> NDArray[np.float64]:  # noqa: ANN401
        numbers = _array(returned)
        if numbers.dtype.kind not in "biuf" or numbers.shape != (self._episodes,):
            self._fail(f"{label}: the shape {numbers.shape} returned, expected ({self._episodes},) numbers")
        return numbers.astype(np.float64)


def _array(returned: Any) -> NDArray[Any]:  # noqa: ANN401 - whatever the code returns
    try:
        return np.asarray(returned)
    except (TypeError, ValueError):  # ragged
        return np.empty(0, object)


StepResult = tuple[NDArray[np.uint32], NDArray[np.float32], bool]
"""The agents that act next, ascending; observations, (agents, sensors); whether the episode has ended."""


_MANY_STEPS = 10_000
"""Steps of an episode after which the user is warned that it may not end."""


class Host(Calls[Simulation | BatchSimulation]):
    """An object of a simulation's class, for use by the engine.

    Args:
        kind: the class.
        report: called with (reason, traceback) of a failure, once for each reason.
        description: the class's description; default: read from an object.

    Raises InputError if the class's attributes are not valid.
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
            self._object = self._make_object()
            description = describe(self._object, kind.__name__)
        self.description = description
        self.title = description.title
        self.dimensions = description.dimensions
        self.max_agents = description.max_agents
        # The engine's agents always have sensors and actuators; an agent that never acts stands for none.
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
        self.sides = [(side.name, list(side.groups), side.fitness) for side in description.sides]
        self.steers_itself = description.steers_itself
        self.has_scenes = overrides(kind, "scene")
        is_declared = any("most_steps" in vars(base) for base in kind.__mro__ if base is not Described)
        self._declares_most_steps = is_declared or description.most_steps != Described.most_steps
        self._agents = 0
        self._steps = 0  # of the episode
        self._groups: list[DeclaredGroup] = []  # of the episode

    def groups(self) -> list[tuple[str, int, int, int, bool]]:
        """Return the groups of the episode: name, agents, sensors, actuators, and whether rows are padded."""
        padded = self.description.padded
        return [(group.name, group.agents, group.sensors, group.actuators, padded) for group in self._groups]

    def another(self) -> "Host":
        """Return a host with another object, which is created at its first reset."""
        other = Host(self._kind, self._report, self.description)
        other._share_reports(self)
        return other

    def reset(self, parameters: dict[str, Any], controller: str | None = None) -> StepResult:
        """Start an episode.

        parameters: JSON values; `seed` is the episode's seed, default 0. controller: the specification, if
        the simulation runs controllers itself. Raises the engine's InputError for parameters that are
        refused, and SimulationError if the code fails.
        """
        values, seed = self._parameters(parameters)
        self._steps = 0
        if self.takes_controller:
            return self._check_step("reset", self._call("reset", values, seed, controller), first=True)
        if isinstance(self._object, BatchSimulation):
            return self._select_single(self._start_batch(values, np.array([seed], np.uint64)))
        return self._check_step("reset", self._call("reset", values, seed), first=True)

    def step(self, actions: NDArray[np.float32]) -> StepResult:
        """Advance by one step; actions: (agents, actuators). Raises SimulationError if the code fails."""
        if isinstance(self._object, BatchSimulation):
            return self._select_single(self.go(actions[None]))
        used_actions = actions if self._steered else actions[:, :0]
        result = self._check_step("step", self._call("step", used_actions), first=False)
        self._count_step(ended=result[2])
        return result

    def _count_step(self, *, ended: bool) -> None:
        """Fail an episode with too many steps, and warn much earlier, as reaching them may take hours."""
        check_time_limit()
        self._steps += 1
        if self._steps == _MANY_STEPS and not ended and not self._declares_most_steps:
            name = self._kind.__name__
            warn_once(
                f"{name}: an episode has not ended after {_MANY_STEPS:,} steps; does done() become true? "
                f"If episodes are this long, declare {name}.most_steps, the steps of the longest"
            )
        most = self.description.most_steps
        if most is not None and self._steps >= most and not ended:
            self._fail(
                f"done: not true after {self._steps} steps; does it become true? The limit is "
                f"{self._kind.__name__}.most_steps; None removes it"
            )

    def fitness(self) -> float:
        """Return the fitness. Raises SimulationError if the code fails."""
        batch = isinstance(self._object, BatchSimulation)
        returned = self.results(metrics=False)[0, 0] if batch else self._call("fitness")
        value = _to_float(returned)
        if not math.isfinite(value):
            self._fail(f"fitness: {summarize(returned)} returned, expected a finite number")
        return value

    def truncated(self) -> bool:
        """Return whether the episode ended because its time was over, see `Simulation.truncated`.

        Raises SimulationError if the code fails.
        """
        if not isinstance(self._object, Simulation):
            return False
        # A class may have a flag of this name instead of the method.
        attribute: Any = self._object.truncated
        returned = self._call("truncated") if callable(attribute) else attribute
        if not isinstance(returned, bool | np.bool_):
            self._fail(f"truncated: {summarize(returned)} returned, expected True or False")
        return bool(returned)

    def measure(self) -> list[float]:
        """Return the metrics, in the order of `metrics`; they may be NaN or infinite.

        Raises SimulationError if the code fails.
        """
        if isinstance(self._object, BatchSimulation):
            return self._check_metrics(dict(zip(self._names, self.results(metrics=True)[1:, 0], strict=True)))
        returned = self._call("measure")
        if not isinstance(returned, Mapping):
            self._fail(f"measure: {summarize(returned)} returned, expected a mapping from names to numbers")
        return self._check_metrics(returned)

    def _check_metrics(self, returned: Mapping[str, Any]) -> list[float]:
        values = []
        for name, _ in self.metrics:
            if name not in returned:
                self._fail(f"measure: {summarize(dict(returned))} returned, which lacks {name!r}")
            values.append(_to_float(returned[name]))
            if math.isnan(values[-1]) and not isinstance(returned[name], float | np.floating):
                self._fail(f"measure: {name!r} is {summarize(returned[name])}, expected a number")
        return values

    def scene(self) -> "SceneFields | None":
        """Return the scene; None for nothing. Raises SimulationError if the code fails."""
        from swarmwright.display import Scene  # noqa: PLC0415 - only where scenes are drawn

        scene = self._call("scene")
        if scene is None:
            return None
        if not isinstance(scene, Scene):
            self._fail(f"scene: {summarize(scene)} returned, expected a swarmwright.display.Scene or None")
        try:
            return scene.plain()
        except (TypeError, ValueError) as error:
            self._fail(f"scene: {summarize(scene)} returned: {error}")

    def picture(self) -> NDArray[np.uint8]:
        """Return the picture, (height, width, 3). Raises SimulationError if the code fails."""
        picture = self._call("picture")
        try:
            drawn = np.asarray(picture)
        except (TypeError, ValueError):  # ragged
            drawn = np.empty(0)
        if drawn.ndim != 3 or drawn.shape[2] != 3 or drawn.dtype != np.uint8 or not drawn.size:
            description = f"{drawn.dtype} of the shape {drawn.shape}" if drawn.ndim else summarize(picture)
            self._fail(f"picture: {description} returned, expected uint8 of the shape (height, width, 3)")
        return drawn

    def start(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> BatchStepResult:
        """Start many episodes of a BatchSimulation; raises like `reset`.

        parameters: as for `reset`, but their seed is ignored. seeds: (episodes,).
        """
        values, _ = self._parameters(parameters)
        return self._start_batch(values, seeds)

    def _start_batch(self, values: dict[str, Any], seeds: NDArray[np.uint64]) -> BatchStepResult:
        self._steps = 0
        self._many = BatchChecks(self.sensors, len(seeds), self.max_agents, self._fail)
        return self._many.check_step("reset", self._call("reset", values, seeds), self._call)

    def go(self, actions: NDArray[np.float32]) -> BatchStepResult:
        """Advance by one step; actions: (episodes, agents, actuators). Raises SimulationError."""
        many = self._many.check_step("step", self._call("step", actions), self._call)
        self._count_step(ended=bool(many[2].all()))
        return many

    def _select_single(self, many: BatchStepResult) -> StepResult:
        """Return the result of the only episode of a BatchSimulation."""
        acts, rows, over = many
        return np.flatnonzero(acts[0]).astype(np.uint32), rows[0], bool(over[0])

    def results(self, metrics: bool) -> NDArray[np.float64]:
        """Return fitness and, if `metrics`, all metrics of all episodes, (1 + metrics, episodes).

        Values of episodes that have not ended are arbitrary. Raises SimulationError if the code fails.
        """
        return self._many.results(self._names if metrics else [], self._call)

    @property
    def _names(self) -> list[str]:
        return [name for name, _ in self.metrics]

    def _parameters(self, parameters: dict[str, Any]) -> tuple[dict[str, Any], int]:
        """Create the object if necessary; return the parameters for `reset`, and the seed."""
        received = dict(parameters)
        try:
            seed = _check_seed(received.pop("seed", 0))
            self._warn_of_unknown(received)
            declarations = self.description.parameters
            values = fill_parameters(
                declarations,
                {name: value for name, value in received.items() if not declarations or name in declarations},
                sent=True,
            )
            if self.has_groups:
                self._groups = count_groups(self.description.groups, values)
            if self._object is None:
                self._object = self._make_object()
        except InputError as error:
            raise _engine.InputError(str(error)) from None
        return values, seed

    def _warn_of_unknown(self, received: Mapping[str, Any]) -> None:
        """Warn once of each parameter that the class does not declare, and that is therefore ignored.

        Tools that have the class refuse such parameters, but tools that only know its title cannot. The
        protocol requires servers to ignore unknown parameters.
        """
        declarations = self.description.parameters
        if not declarations:  # the class takes any parameters
            return
        for name in sorted(received.keys() - declarations.keys()):
            warn_once(
                f"{self.description.title}: a tool has set the parameter {name!r}, which "
                f"{self._kind.__name__} does not declare{did_you_mean(name, declarations)}"
            )

    def _check_step(self, method: str, returned: Any, *, first: bool) -> StepResult:  # noqa: ANN401 - whatever it returns
        """Check observations; call `done` and `acting`."""
        done = self._call("done")
        if not isinstance(done, bool | np.bool_):
            self._fail(f"done: {summarize(done)} returned, expected True or False")
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
        if is_gymnasium_result(returned):
            self._fail(f"{method}: {summarize(returned)} returned, {OBSERVATIONS_ALONE}")
        if self.has_groups:
            returned = self._pad_rows(method, returned)
        expected = f"({'agents' if first else self._agents}, {self.sensors})"
        try:
            array = np.asarray(returned)
        except (TypeError, ValueError):  # ragged
            array = np.empty(0, object)
        if array.dtype.kind not in "biuf":
            self._fail(f"{method}: {summarize(returned)} returned, expected numbers of the shape {expected}")
        if array.ndim != 2 or array.shape[1] != self.sensors or not (first or len(array) == self._agents):
            self._fail(
                f"{method}: observations of the shape {array.shape} returned, expected {expected}: "
                f"a row of {self.sensors} for each agent"
            )
        with np.errstate(over="ignore"):
            rows = np.ascontiguousarray(array, dtype=np.float32)
        if first:
            self._agents = len(rows)
            most = self.max_agents
            if not self._agents or (most is not None and self._agents > most):
                limit = "" if most is None else f" and at most {most}, the simulation's max_agents"
                self._fail(f"{method}: {self._agents} agents returned, expected at least 1{limit}")
        return rows

    def _pad_rows(self, method: str, returned: Any) -> Any:  # noqa: ANN401 - whatever it returns
        """Pad rows that are as long as their agents' groups declare to the same length."""
        widths = [group.sensors for group in self._groups for _ in range(group.agents)]
        try:
            rows = [np.asarray(row) for row in returned]
        except (TypeError, ValueError):
            return returned
        if len(rows) != len(widths):
            groups = ", ".join(f"{group.agents} {group.name}" for group in self._groups)
            self._fail(f"{method}: {len(rows)} rows returned, expected {len(widths)}: {groups}")
        filled = np.zeros((len(rows), self.sensors), np.float64)
        for agent, (row, width) in enumerate(zip(rows, widths, strict=True)):
            if row.dtype.kind not in "biuf" or row.shape not in {(width,), (self.sensors,)}:
                self._fail(
                    f"{method}: agent {agent} senses {summarize(row.tolist())}, expected {width} numbers, as "
                    "its group declares"
                )
            filled[agent, :width] = row[:width]
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
                f"acting: {summarize(returned)} returned, "
                f"expected indices of agents, ({self._agents},) booleans or None"
            )
        if agents.min() < 0 or agents.max() >= self._agents:
            self._fail(
                f"acting: {summarize(returned)} returned, "
                f"but there are {self._agents} agents, from 0 to {self._agents - 1}"
            )
        indices = np.unique(agents)
        if agents.size == self._agents > indices.size and indices[-1] <= 1:
            self._fail(
                f"acting: {summarize(returned)} returned, which names agents twice: "
                "indices of agents are expected, and flags are booleans"
            )
        return indices.astype(np.uint32)


def _to_float(value: Any) -> float:  # noqa: ANN401 - whatever the code returns
    """Return a number as a float, NaN for anything else."""
    try:
        return math.nan if isinstance(value, str | bytes | bytearray | memoryview) else float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _check_seed(value: Any) -> int:  # noqa: ANN401 - any JSON value
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0 <= value < 2**64 or value != int(value):
        raise InputError(f"seed: {summarize(value)} found, expected an integer from 0 to 2**64 - 1")
    return int(value)
