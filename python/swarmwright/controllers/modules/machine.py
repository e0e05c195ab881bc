"""Machines and trees with modules in Python, for all robots of many episodes at once.

Includes the engine's modules in Python, bit-identical, for machines that combine them with user modules.
"""

import traceback
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError, RunError
from swarmwright.common.tracebacks import is_installed, locate_definition, shorten_path
from swarmwright.controllers.modules import grammar
from swarmwright.controllers.modules._base import (
    Behaviour,
    Condition,
    Numbers,
    Parameter,
    Parameters,
    RandomNumbers,
    Senses,
    pcg4d,
)
from swarmwright.controllers.modules.registered import implementation

# ruff: noqa: ARG002 - modules share one signature


_SHORT = np.float32(0.1)
_BLACK, _WHITE = np.float32(0.1), np.float32(0.95)
_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
_TANH_LIMIT = np.float32(9.15)
_TANH_P = np.array([0.5, 0.015736774, 7.970824e-5, 4.2581547e-8], dtype=np.float32)
_TANH_Q = np.array([1.0, 0.11480684, 0.0013933508, 2.7218455e-6], dtype=np.float32)


def _parameters(*names: str) -> Mapping[str, Parameter]:
    return {name: Parameter(*grammar.RANGES[name]) for name in names}


def _length(vector: Numbers) -> Numbers:
    x, y = vector[:, 0], vector[:, 1]
    length: Numbers = np.sqrt(x * x + y * y)
    return length


def _sigmoid(x: Numbers) -> Numbers:
    y = np.clip(_HALF * x, -_TANH_LIMIT, _TANH_LIMIT)
    z = y * y
    p = ((_TANH_P[3] * z + _TANH_P[2]) * z + _TANH_P[1]) * z + _TANH_P[0]
    q = ((_TANH_Q[3] * z + _TANH_Q[2]) * z + _TANH_Q[1]) * z + _TANH_Q[0]
    t = (y * p) / q
    values: Numbers = _HALF + _HALF * np.clip((t + t) / (_ONE + t * t), -_ONE, _ONE)
    return values


def draw_below(
    first: NDArray[np.uint32], second: NDArray[np.uint32], count: NDArray[np.uint32]
) -> NDArray[np.uint32]:
    """Return numbers below counts, from 16 bits of two random words."""
    byte = np.uint32(255)
    return ((first & byte | (second & byte) << np.uint32(8)) * count) >> np.uint32(16)


class Exploration(Behaviour):
    """Move straight ahead; at an obstacle in front, turn on the spot for a random time."""

    parameters = _parameters("rwm")
    state = 1
    """Remaining steps of a turn: to the left if positive, to the right if negative."""

    def act(self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers) -> Numbers:
        """Return the speeds."""
        turn = state[:, 0].copy()
        to_left, to_right = turn > 0, turn < 0
        speeds = np.ones((len(turn), 2), dtype=np.float32)
        speeds[to_left, 0] = -1
        speeds[to_right, 1] = -1
        ahead = (_length(senses.proximity) >= _SHORT) & (senses.proximity[:, 0] >= 0)
        begins = ahead & ~(to_left | to_right)
        words = random.words
        steps = draw_below(words[0], words[1], parameters["rwm"].astype(np.uint32)).astype(np.float32)
        steps = np.maximum(steps, _ONE)
        state[:, 0] = turn - np.sign(turn)
        state[begins, 0] = np.where(senses.proximity[:, 1] < 0, steps, -steps)[begins]
        return speeds


class Stop(Behaviour):
    """Stand still."""

    def act(self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers) -> Numbers:
        """Return the speeds."""
        return np.zeros((len(senses.ground), 2), dtype=np.float32)


class _Follow(Behaviour):
    """Follow a sum of vectors."""

    light: ClassVar[float] = 0
    obstacles: ClassVar[float] = -5

    def neighbours(self, parameters: Parameters) -> Numbers | np.float32:
        """Return the factor of the vector towards neighbours."""
        return _ZERO

    def act(self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers) -> Numbers:
        """Return the speeds: the outer wheel at full speed."""
        factor = self.neighbours(parameters)
        x, y = (
            np.float32(self.light) * senses.light[:, axis]
            + factor * senses.attraction[:, axis]
            + np.float32(self.obstacles) * senses.proximity[:, axis]
            for axis in (0, 1)
        )
        length = np.sqrt(x * x + y * y)
        short = length < _SHORT
        inner = np.where(short, _ONE, x) / np.where(short, _ONE, length)
        inner = np.clip(np.where(np.isnan(inner), _ZERO, inner), -_ONE, _ONE)
        to_left = np.where(short, _ZERO, y) > 0
        return np.stack([np.where(to_left, inner, _ONE), np.where(to_left, _ONE, inner)], axis=1)


class Phototaxis(_Follow):
    """Move towards the light, around obstacles."""

    light = 1


class AntiPhototaxis(_Follow):
    """Move away from the light, around obstacles."""

    light = -1


class Attraction(_Follow):
    """Move towards neighbours, around obstacles."""

    parameters = _parameters("alpha")
    obstacles = -6

    def neighbours(self, parameters: Parameters) -> Numbers:
        """Return alpha."""
        return parameters["alpha"]


class Repulsion(_Follow):
    """Move away from neighbours, around obstacles."""

    parameters = _parameters("alpha")

    def neighbours(self, parameters: Parameters) -> Numbers:
        """Return -alpha^2."""
        return -parameters["alpha"] * parameters["alpha"]


class _Floor(Condition):
    """Hold on ground of a colour."""

    parameters = _parameters("probability")

    @abstractmethod
    def holds(self, ground: Numbers) -> NDArray[np.bool_]:
        """Return which robots' ground has the colour."""

    def probability(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> Numbers:
        """Return the probability on ground of the colour, 0 elsewhere."""
        return np.where(self.holds(senses.ground), parameters["probability"], _ZERO)


class BlackFloor(_Floor):
    """Hold on black ground."""

    def holds(self, ground: Numbers) -> NDArray[np.bool_]:
        """Return which robots' ground is black."""
        return ground <= _BLACK


class WhiteFloor(_Floor):
    """Hold on white ground."""

    def holds(self, ground: Numbers) -> NDArray[np.bool_]:
        """Return which robots' ground is white."""
        return (ground >= _WHITE) & (ground > _BLACK)


class GreyFloor(_Floor):
    """Hold on grey ground."""

    def holds(self, ground: Numbers) -> NDArray[np.bool_]:
        """Return which robots' ground is neither black nor white."""
        return (ground > _BLACK) & (ground < _WHITE)


class Neighbours(Condition):
    """More likely the more neighbours there are."""

    parameters = _parameters("xi", "eta")
    sign: ClassVar[np.float32] = _ONE

    def probability(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> Numbers:
        """Return the logistic function of eta times (number of neighbours - xi)."""
        return _sigmoid(parameters["eta"] * (self.sign * (senses.neighbours - parameters["xi"])))


class FewNeighbours(Neighbours):
    """More likely the fewer neighbours there are."""

    sign = -_ONE


class FixedProbability(Condition):
    """Hold with a constant probability."""

    parameters = _parameters("probability")

    def probability(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> Numbers:
        """Return the parameter `probability`."""
        return parameters["probability"]


PAGE = "docs/how-to/plug-ins.md"
"""The guide to user modules."""

Instance = TypeVar("Instance")
_UNIT = np.float32(2.0**-24)
Rows = NDArray[np.int64]


class Swarm:
    """Robots, each with its own machine and state; all machines share one architecture.

    Args:
        architecture: architecture of the kind `python_modules`.
        weights: (machines, weights).

    Raises InputError when a module is missing, its parameters have changed since the controller was designed,
    or its class cannot be constructed without arguments.
    """

    def __init__(self, architecture: Mapping[str, Any], weights: Numbers) -> None:
        catalogue = grammar.Catalogue.from_specification(architecture)
        self._behaviours: list[Behaviour] = [
            _instantiate(implementation("behaviour", behaviour)) for behaviour in catalogue.behaviours
        ]
        self._conditions: list[Condition] = [
            _instantiate(implementation("condition", condition)) for condition in catalogue.conditions
        ]
        self._behaviour_places = list(catalogue.behaviour_columns.items())
        self._condition_places = list(catalogue.condition_columns.items())
        self._tree = grammar.is_tree(architecture)
        self._first, self._each = catalogue.state_weights, catalogue.transition_weights
        self._states, self._most = int(architecture["states"]), int(architecture["transitions"])
        self._counts, self._table = self._read(catalogue, np.asarray(weights, dtype=np.float32))
        self.restart(np.zeros(0, dtype=np.int64))

    def _read(self, catalogue: grammar.Catalogue, weights: Numbers) -> tuple[Rows, Numbers]:
        """Return the number of states and the weights, (machines, states, weights of a state), limited."""
        counts = np.trunc(np.clip(weights[:, 0], 1, self._states)).astype(np.int64)
        table = (
            weights[:, 1:].reshape(len(weights), self._states, self._first + self._most * self._each).copy()
        )
        _limit(table, 0, (0, len(self._behaviours) - 1, True))
        _limit(table, 3, (0, self._most, True))
        for module in catalogue.behaviours:
            for name, column in catalogue.behaviour_columns[module.name].items():
                _limit(table, column, module.parameters[name])
        for k in range(self._most):
            at = self._first + k * self._each
            table[..., at] = np.trunc(np.clip(table[..., at], 0, counts[:, np.newaxis] - 1))
            _limit(table, at + 1, (0, len(self._conditions) - 1, True))
            for module in catalogue.conditions:
                for name, column in catalogue.condition_columns[module.name].items():
                    _limit(table, at + column, module.parameters[name])
        return counts, table

    def restart(self, owners: Rows) -> None:
        """Begin new episodes. owners: the machine of each robot, (robots,)."""
        count = len(owners)
        self._owners = owners
        self.current = np.zeros(count, dtype=np.int64)
        """Current state of each robot's machine."""
        self._settled = np.zeros(count, dtype=np.bool_)
        widest = max(behaviour.state for behaviour in self._behaviours)
        self._behaviour_state = np.zeros((count, widest), dtype=np.float32)
        widest = max(condition.state for condition in self._conditions)
        self._condition_state = np.zeros((count, self._most, widest), dtype=np.float32)

    def extend(self, owners: Rows, before: int, after: int) -> None:
        """Grow each episode from `before` to `after` robots."""
        old_arrays: list[NDArray[Any]] = [
            self.current,
            self._settled,
            self._behaviour_state,
            self._condition_state,
        ]
        self.restart(owners)
        new_arrays: list[NDArray[Any]] = [
            self.current,
            self._settled,
            self._behaviour_state,
            self._condition_state,
        ]
        for old, new in zip(old_arrays, new_arrays, strict=True):
            new.reshape(-1, after, *new.shape[1:])[:, :before] = old.reshape(-1, before, *old.shape[1:])

    def step(self, robots: Rows, sensors: Numbers) -> Numbers:
        """Return the actuators of a subset of robots, (n, 2).

        Args:
            robots: indices, (n,), without repetition.
            sensors: (n, 9), finite.

        Raises RunError when the code of a module fails.
        """
        random_sensor = np.clip(sensors[:, 8], np.float32(0), 1 - _UNIT)
        bits = (random_sensor * np.float32(16777216)).astype(np.uint32)
        words = random_words(bits)
        if self._tree:
            return self._step_trees(robots, sensors, bits, words)
        part = self._table[self._owners[robots], self.current[robots]]
        actuators = self._act(robots, part, sensors, bits, words)
        self._make_transitions(robots, part, sensors, bits, words)
        return actuators

    def _act(
        self, robots: Rows, part: Numbers, sensors: Numbers, bits: NDArray[np.uint32], words: list[Any]
    ) -> Numbers:
        """Return the actuators of the behaviours in rows of the table."""
        actuators = np.zeros((len(robots), 2), dtype=np.float32)
        numbers = part[:, 0].astype(np.int64)
        for number, behaviour in enumerate(self._behaviours):
            rows = np.flatnonzero(numbers == number)
            if not len(rows):
                continue
            name, columns = self._behaviour_places[number]
            state = self._behaviour_state[robots[rows], : behaviour.state]
            parameters = {key: part[rows, column] for key, column in columns.items()}
            random = RandomNumbers(bits[rows], 0, [word[rows] for word in words])
            speeds = call_module(
                behaviour.act,
                name,
                Senses.from_rows(sensors[rows]),
                parameters,
                state,
                random,
                shape=(len(rows), 2),
            )
            actuators[rows] = np.clip(speeds, -1, 1)
            self._behaviour_state[robots[rows], : behaviour.state] = state
        return actuators

    def _holds(
        self,
        robots: Rows,
        part: Numbers,
        sensors: Numbers,
        bits: NDArray[np.uint32],
        unit: Numbers,
        *,
        k: int,
        position: int,
    ) -> NDArray[np.bool_]:
        """Return where the condition of transition k, with weights `part`, holds. unit: random numbers."""
        holds = np.zeros(len(robots), dtype=np.float32)
        numbers = part[:, 1].astype(np.int64)
        for number, condition in enumerate(self._conditions):
            rows = np.flatnonzero(numbers == number)
            if not len(rows):
                continue
            name, columns = self._condition_places[number]
            state = self._condition_state[robots[rows], k, : condition.state]
            parameters = {key: part[rows, column] for key, column in columns.items()}
            random = RandomNumbers(bits[rows], 1 + position)
            holds[rows] = call_module(
                condition.probability,
                name,
                Senses.from_rows(sensors[rows]),
                parameters,
                state,
                random,
                shape=(len(rows),),
            )
            self._condition_state[robots[rows], k, : condition.state] = state
        return unit < holds

    def _make_transitions(
        self, robots: Rows, part: Numbers, sensors: Numbers, bits: NDArray[np.uint32], words: list[Any]
    ) -> None:
        """Make transitions."""
        held = np.zeros((len(robots), self._most), dtype=np.bool_)
        settled = self._settled[robots]
        for k in range(self._most):
            rows = np.flatnonzero(settled & (k < part[:, 3]))
            if len(rows):
                at = self._first + k * self._each
                transition = part[rows, at : at + self._each]
                unit = _unit(words[k][rows])
                held[rows, k] = self._holds(
                    robots[rows], transition, sensors[rows], bits[rows], unit, k=k, position=k
                )
        self._settled[robots] = True
        number = held.sum(axis=1)
        rows = np.flatnonzero(number)
        if not len(rows):
            return
        choice = draw_below(words[2][rows], words[3][rows], number[rows].astype(np.uint32)).astype(np.int64)
        order = np.cumsum(held[rows], axis=1)
        chosen = np.argmax(held[rows] & (order == choice[:, np.newaxis] + 1), axis=1)
        self.current[robots[rows]] = part[rows, self._first + chosen * self._each].astype(np.int64)
        self._settled[robots[rows]] = False
        self._clear_state(robots[rows])

    def _step_trees(
        self, robots: Rows, sensors: Numbers, bits: NDArray[np.uint32], words: list[Any]
    ) -> Numbers:
        """Return the actuators of trees: each advances to the first subtree whose condition does not hold."""
        owners = self._owners[robots]
        counts = self._counts[owners]
        active = np.ones(len(robots), dtype=np.bool_)
        for index in range(self._states):
            rows = np.flatnonzero(active & (self.current[robots] == index) & (index < counts))
            if not len(rows):
                continue
            transition = self._table[owners[rows], index, self._first :]
            unit = _unit(words[index][rows])
            holds = self._holds(
                robots[rows], transition, sensors[rows], bits[rows], unit, k=0, position=index
            )
            active[rows] = holds
            done = robots[rows[holds]]
            self.current[done] += 1
            self._clear_state(done)
        actuators = np.zeros((len(robots), 2), dtype=np.float32)
        ended = self.current[robots] >= counts
        rows = np.flatnonzero(~ended)
        part = self._table[owners[rows], self.current[robots[rows]]]
        tick_words = [word[rows] for word in words]
        actuators[rows] = self._act(robots[rows], part, sensors[rows], bits[rows], tick_words)
        self.current[robots[ended]] = 0
        return actuators

    def _clear_state(self, robots: Rows) -> None:
        self._behaviour_state[robots] = 0
        self._condition_state[robots] = 0


def _limit(table: Numbers, column: int, limits: grammar.Range) -> None:
    low, high, whole = limits
    values = np.clip(table[..., column], low, high)
    table[..., column] = np.trunc(values) if whole else values


def _unit(word: NDArray[np.uint32]) -> Numbers:
    unit: Numbers = (word >> np.uint32(8)).astype(np.float32) * _UNIT
    return unit


def call_module(
    method: Callable[..., Any],
    name: str,
    senses: Senses,
    parameters: Parameters,
    state: Numbers,
    random: RandomNumbers,
    *,
    shape: tuple[int, ...],
) -> Numbers:
    """Call a module and return its result.

    Raises RunError, with file and line, when the call fails, the result is invalid, or the module has
    replaced an attribute of its object.
    """
    label = f"{name}: {method.__name__}"
    module = method.__self__  # type: ignore[attr-defined] # of an object
    kind, before = type(module), dict(vars(module))
    try:
        # The result is checked below.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            returned = method(senses, parameters, state, random)
    # `sys.exit` in a module is an error, too.
    except (Exception, SystemExit) as error:
        raise RunError(f"{_line(kind, error)}: {label}: {type(error).__name__}: {error}") from error
    result = np.empty(0, np.float32)
    problem = _attribute_problem(before, vars(module))
    if problem is None:
        try:
            result = np.asarray(returned, dtype=np.float32)
        except (TypeError, ValueError):
            problem = f"returns {type(returned).__name__}, expected an array"
        else:
            problem = _array_problem(result, shape)
    if problem is None:
        return result
    raise RunError(f"{locate_definition(kind)}: {label}: {problem}")


def _attribute_problem(before: Mapping[str, Any], after: Mapping[str, Any]) -> str | None:
    """Return a message if a module has replaced an attribute of its object.

    One object acts for the robots of all episodes, so attributes that change make episodes depend on each
    other. A new attribute may be a constant that is set in the first call, as in stored runs; changes of it
    are detected in the next call.
    """
    for name, value in after.items():
        if name in before and before[name] is not value:
            return (
                f"changes self.{name}, which is shared by all robots of all episodes; keep the memory of a "
                f"robot in `state`, and set constants in __init__ ({PAGE})"
            )
    return None


def _array_problem(result: Numbers, shape: tuple[int, ...]) -> str | None:
    """Return a message if the result of a module is invalid."""
    if result.shape != shape:
        return f"returns an array of the shape {result.shape}, expected {shape}"
    if not np.isfinite(result).all():
        return "returns a number that is not finite"
    return None


def _instantiate(kind: type[Instance]) -> Instance:
    try:
        return kind()
    except (Exception, SystemExit) as error:
        words = f"{kind.__name__}: __init__: {type(error).__name__}: {error}"
        raise InputError(
            f"{_line(kind, error)}: {words}; modules are constructed without arguments"
        ) from error


def _line(kind: type[Any], error: BaseException) -> str:
    """Return the last line of user code that led to an error, or the location of the class."""
    frames = [
        frame for frame in traceback.extract_tb(error.__traceback__) if not is_installed(frame.filename)
    ]
    if frames:
        return f"{shorten_path(frames[-1].filename)}:{frames[-1].lineno}"
    return locate_definition(kind)


def random_words(bits: NDArray[np.uint32]) -> list[NDArray[np.uint32]]:
    """Return the random words that the behaviours and conditions of a step share.

    bits: (n,), the 24 bits of each robot's random sensor.
    """
    return pcg4d(bits, 1, 2, 3)
