"""Shared code of the adapters for Gymnasium, PettingZoo and VMAS.

Sensors are read from the observation space. Bounded numbers are scaled to -1..1, unbounded numbers are passed
on unchanged, and a choice among n values becomes n numbers (one-hot). The parts of dictionaries and tuples
are concatenated.

Actuators, -1..1, are converted to the action space. Bounded numbers are scaled to their range; a number with
a single bound to the interval of width 2 next to it; unbounded numbers are passed on unchanged. For integers,
-1..1 is divided into bins of equal width. With two choices the sign decides; with more, the largest of n
actuators, the first among equals. An action mask restricts the choice.

Action masks follow PettingZoo's convention: the observation is a dictionary whose `action_mask` is 1 for each
choice that is allowed and 0 for the others.

Trials find out whether `reset` restores an environment completely. Some environments keep contacts, lists or
running means across `reset`, so that an episode would depend on the previous ones, and thus on which server
evaluated which candidate.
"""

import contextlib
import hashlib
import inspect
import logging
import math
import os
import time
import warnings
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from enum import Enum, auto
from typing import Any, ClassVar, NamedTuple, NoReturn, Self, TypeVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarmwright.common.errors import InputError, SimulationError
from swarmwright.common.ranges import Range
from swarmwright.common.suggestions import similar
from swarmwright.common.tracebacks import locate_error
from swarmwright.common.untrusted import find_outside_paths
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.base import Group, Simulation
from swarmwright.simulations.calls import summarize
from swarmwright.simulations.environments import NEW_EACH_EPISODE
from swarmwright.simulations.isolation import IsolatedModules

MASK = "action_mask"
"""Key of the mask in an observation."""
Allowed = NDArray[np.bool_]
"""(choices,), concatenated over the parts of an action."""


def mask_width(observations: Any, actions: Any) -> int:  # noqa: ANN401 - spaces of an environment
    """Return the number of choices in the observations' mask; 0 without a mask that fits the actions."""
    if not isinstance(observations, spaces.Dict) or set(observations.spaces) <= {MASK}:
        return 0
    match actions:
        case spaces.Discrete():
            choices = int(actions.n)
        case spaces.MultiDiscrete():
            choices = int(actions.nvec.sum())
        case _:
            return 0
    mask = observations.spaces.get(MASK)
    parts: tuple[Any, ...] = mask.spaces if isinstance(mask, spaces.Tuple) else (mask,)
    if not all(isinstance(part, spaces.Box | spaces.MultiBinary | spaces.MultiDiscrete) for part in parts):
        return 0
    sizes = [int(np.prod(part.shape)) for part in parts]
    return choices if sum(sizes) == choices else 0


def mask_reader(
    observations: Any,  # noqa: ANN401 - as above
    actions: Any,  # noqa: ANN401
    refuse: Callable[[Any], NoReturn],
) -> Callable[[Any], Allowed | None]:
    """Return a function that reads the choices an observation allows; None stands for all.

    An empty mask, such as that of an agent whose turn it is not, allows all.

    Args:
        observations: observation space.
        actions: action space.
        refuse: raises an error for a mask of the wrong size, or for None if an observation has no mask.
    """
    width = mask_width(observations, actions)
    if not width:
        return lambda _: None

    def read(observation: Any) -> Allowed | None:  # noqa: ANN401 - an observation
        mask = observation.get(MASK) if isinstance(observation, Mapping) else None
        if mask is None:
            refuse(None)
        flat = (
            np.concatenate([np.ravel(part) for part in mask]) if isinstance(mask, tuple) else np.ravel(mask)
        )
        if flat.size != width:
            refuse(mask)
        allowed = flat > 0
        return allowed if allowed.any() else None

    return read


Numbers = NDArray[np.float64]
_Item = TypeVar("_Item")

_UNBOUNDED = 1e6
"""Larger bounds count as infinite: some environments write a large number instead of infinity."""


class Sensors(NamedTuple):
    """Conversion of observations to sensor values."""

    width: int
    read: Callable[[Any], Numbers]
    """Observation -> (width,)"""
    ranges: tuple[Range | None, ...]
    """The values that -1 and 1 stand for; None for numbers that are not scaled."""


class Actuators(NamedTuple):
    """Conversion of actuator values to actions."""

    width: int
    act: Callable[..., Any]
    """(width,), -1 to 1, and optionally the choices that are allowed -> action"""
    ranges: tuple[Range | None, ...]
    """The values that correspond to -1 and 1; None for numbers that are not scaled, or are choices."""


def with_mask(observations: Any, actions: Any, where: str) -> tuple[Sensors, Callable[[Any], Allowed | None]]:  # noqa: ANN401 - spaces of an environment
    """Return the sensors for an observation space, and a function that reads which choices are allowed.

    A mask of these actions is not a sensor. See `sensors`.
    """
    if not mask_width(observations, actions):
        return sensors(observations, where), lambda _: None
    sensor_space = spaces.Dict({key: part for key, part in observations.spaces.items() if key != MASK})
    mask_label = f"{where}[{MASK!r}]"

    def refuse(mask: Any) -> NoReturn:  # noqa: ANN401 - whatever an environment returns
        if mask is None:
            raise SimulationError(f"{where}: an observation lacks {MASK!r}, which is in its space")
        _refuse(mask, observations.spaces[MASK], mask_label)

    return sensors(sensor_space, where), mask_reader(observations, actions, refuse)


def sensors(space: Any, where: str) -> Sensors:  # noqa: ANN401 - whatever an environment says
    """Return the sensors for an observation space. Raises InputError for a space without a fixed size.

    Reading raises SimulationError for an observation of the wrong size and for an invalid choice. Bounds are
    not checked, because many environments exceed them.
    """
    _check_not_none(space, where)
    match space:
        case spaces.Box():
            middle, half = _range(space)

            def numbers(observation: Any) -> Numbers:  # noqa: ANN401 - an array
                return (_flat(observation, half.size, space, where) - middle) / half

            return Sensors(half.size, numbers, ranges(middle, half))
        case spaces.Discrete():
            return _choice_of_one(space, where)
        case spaces.MultiBinary():
            size = int(np.prod(space.shape))

            def flags(observation: Any) -> Numbers:  # noqa: ANN401 - an array of 0 and 1
                row = _flat(observation, size, space, where)
                if not ((row == 0) | (row == 1)).all():
                    _refuse(observation, space, where)
                return row

            return Sensors(size, flags, (None,) * size)
        case spaces.MultiDiscrete():
            return _choices(space, where)
        case spaces.Dict() | spaces.Tuple():
            return _parts(space, where)
    raise InputError(
        f"{where}: a {type(space).__name__} space has no fixed number of values for sensors; "
        "wrap the environment so that its observations are a Box"
    )


def _choice_of_one(space: spaces.Discrete, where: str) -> Sensors:
    count, start = int(space.n), int(space.start)

    def read(observation: Any) -> Numbers:  # noqa: ANN401 - an integer
        try:
            index = int(observation) - start
        except (TypeError, ValueError, OverflowError):
            _refuse(observation, space, where)
        if not 0 <= index < count or index + start != observation:
            _refuse(observation, space, where)
        row = np.zeros(count)
        row[index] = 1
        return row

    return Sensors(count, read, (None,) * count)


def _choices(space: spaces.MultiDiscrete, where: str) -> Sensors:
    counts, starts = space.nvec.ravel(), space.start.ravel()
    ends = np.cumsum(counts)
    width = int(ends[-1])

    def read(observation: Any) -> Numbers:  # noqa: ANN401 - an array of integers
        picked = _flat(observation, counts.size, space, where) - starts
        if not ((picked >= 0) & (picked < counts) & (picked % 1 == 0)).all():
            _refuse(observation, space, where)
        row = np.zeros(width)
        row[ends - counts + picked.astype(np.int64)] = 1
        return row

    return Sensors(width, read, (None,) * width)


def _parts(space: Any, where: str) -> Sensors:  # noqa: ANN401 - a Dict or a Tuple
    keys, parts = _inner(space, where, sensors)
    limits = tuple(ends for part in parts for ends in part.ranges)

    def read(observation: Any) -> Numbers:  # noqa: ANN401 - a dictionary or tuple
        try:
            values = [observation[key] for key in keys]
        except (TypeError, LookupError):
            _refuse(observation, space, where)
        return np.concatenate([part.read(value) for part, value in zip(parts, values, strict=True)])

    return Sensors(len(limits), read, limits)


def _inner(space: Any, where: str, convert: Callable[[Any, str], _Item]) -> tuple[list[Any], list[_Item]]:  # noqa: ANN401 - a Dict or a Tuple
    """Return the keys of a space's parts, and each part converted. Raises InputError for an empty space."""
    inner: list[tuple[Any, Any]] = list(
        space.spaces.items() if isinstance(space, spaces.Dict) else enumerate(space.spaces)
    )
    if not inner:
        raise InputError(f"{where}: a {type(space).__name__} space without parts")
    return [key for key, _ in inner], [convert(part, f"{where}[{key!r}]") for key, part in inner]


def _flat(observation: Any, size: int, space: Any, where: str) -> Numbers:  # noqa: ANN401 - whatever an environment returns
    """Return an observation as a row of `size` numbers. Raises SimulationError if it is anything else."""
    try:
        row = np.asarray(observation, float).ravel()
    except (TypeError, ValueError):
        _refuse(observation, space, where)
    if row.size != size:
        _refuse(observation, space, where)
    return row


def _refuse(observation: Any, space: Any, where: str) -> NoReturn:  # noqa: ANN401 - whatever an environment returns
    shape = getattr(observation, "shape", ())
    description = f"{summarize(observation)} of the shape {shape}" if shape else summarize(observation)
    if shape and shape != getattr(space, "shape", None):
        # Without the values, the message is the same in every episode.
        description = f"of the shape {shape}"
    expected = f"Box{space.shape}" if isinstance(space, spaces.Box) else summarize(space)
    raise SimulationError(f"{where}: the observation {description} is not in {expected}")


def actuators(space: Any, where: str) -> Actuators:  # noqa: ANN401 - whatever an environment says
    """Return the actuators for an action space. Raises InputError for an unsupported space."""
    _check_not_none(space, where)
    match space:
        case spaces.Box():
            if np.issubdtype(space.dtype, np.integer):
                return _integers(space)
            middle, half = _reach(space)
            shape, kind = space.shape, space.dtype

            def scale_to_space(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
                action = (middle + half * row).reshape(shape).astype(kind)
                return np.clip(action, space.low, space.high)

            return Actuators(half.size, scale_to_space, ranges(middle, half))
        case spaces.Discrete():
            width, choose = _choice(int(space.n))
            start = int(space.start)

            def choose_value(row: Numbers, allowed: Allowed | None = None) -> int:
                return start + choose(row, allowed)

            return Actuators(width, choose_value, (None,) * width)
        case spaces.MultiDiscrete():
            return _several(space)
        case spaces.MultiBinary():
            shape, bits = space.shape, int(np.prod(space.shape))

            def flags(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
                return (row > 0).astype(np.int8).reshape(shape)

            return Actuators(bits, flags, (None,) * bits)
        case spaces.Dict() | spaces.Tuple():
            return _action_parts(space, where)
    raise InputError(
        f"{where}: actuators cannot control a {type(space).__name__} space; "
        "wrap the environment so that its actions are a Box or a Discrete"
    )


def _several(space: spaces.MultiDiscrete) -> Actuators:
    counts = space.nvec.ravel().tolist()
    choices = [_choice(int(count)) for count in counts]
    ends = np.cumsum([width for width, _ in choices])
    firsts, shape, choice_ends = space.start, space.nvec.shape, np.cumsum(counts)

    def several(row: Numbers, allowed: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
        parts = np.split(row, ends[:-1])
        masks = [None] * len(parts) if allowed is None else np.split(allowed, choice_ends[:-1])
        each = zip(choices, parts, masks, strict=True)
        picked = [choose(part, mask) for (_, choose), part, mask in each]
        return (firsts + np.reshape(picked, shape)).astype(space.dtype)

    return Actuators(int(ends[-1]), several, (None,) * int(ends[-1]))


def _action_parts(space: Any, where: str) -> Actuators:  # noqa: ANN401 - a Dict or a Tuple
    keys, parts = _inner(space, where, actuators)
    ends = np.cumsum([part.width for part in parts])

    def act(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
        rows = np.split(row, ends[:-1])
        actions = [part.act(values) for part, values in zip(parts, rows, strict=True)]
        return dict(zip(keys, actions, strict=True)) if isinstance(space, spaces.Dict) else tuple(actions)

    return Actuators(int(ends[-1]), act, tuple(limits for part in parts for limits in part.ranges))


def ranges(middle: NDArray[Any], half: NDArray[Any]) -> tuple[Range | None, ...]:
    """Return the values that -1 and 1 stand for, given the middle and half the width of each range."""
    parts = zip(np.ravel(half).tolist(), np.ravel(middle).tolist(), strict=True)
    return tuple(Range.from_scale(*part) for part in parts)


def _range(space: spaces.Box) -> tuple[Numbers, Numbers]:
    """Return the middle and half the width of each number's range, flat; 0 and 1 without bounds."""
    low, high = space.low.astype(float).ravel(), space.high.astype(float).ravel()
    bounded = (low > -_UNBOUNDED) & (high < _UNBOUNDED) & (low < high)
    low, high = np.where(bounded, low, -1.0), np.where(bounded, high, 1.0)
    return (low + high) / 2, (high - low) / 2


def _reach(space: spaces.Box) -> tuple[Numbers, Numbers]:
    """Return the middle and half the width of each actuator's range, flat.

    With a single bound the range is 2 wide and begins or ends there; without bounds it is -1 to 1.
    """
    low, high = space.low.astype(float).ravel(), space.high.astype(float).ravel()
    above, below = low > -_UNBOUNDED, high < _UNBOUNDED
    least = np.where(above, low, np.where(below, high - 2, -1.0))
    most = np.where(below, high, np.where(above, low + 2, 1.0))
    return (least + most) / 2, (most - least) / 2


def _integers(space: spaces.Box) -> Actuators:
    """Return the actuators for integers: -1 to 1 is divided into a bin for each integer.

    With a single bound these are the 3 integers next to it, without bounds -1, 0 and 1.
    """
    firsts, counts = [], []
    # Python's integers: differences of 64-bit bounds do not fit into 64 bits.
    for low, high in zip(space.low.ravel().tolist(), space.high.ravel().tolist(), strict=True):
        above, below = low > -_UNBOUNDED, high < _UNBOUNDED
        count = high - low + 1 if above and below else min(3, high - low + 1)
        firsts.append(low if above else high - count + 1 if below else -1)
        counts.append(count)
    shape, kind = space.shape, space.dtype
    # Wider than the space's type, in which the sum with the bin's index may overflow.
    wide = np.uint64 if kind == np.uint64 else np.int64
    first, bins = np.array(firsts, wide), np.array(counts, float)

    def choose_integers(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
        index = np.clip(np.floor(bins * (row + 1) / 2), 0, bins - 1)
        return (first + index.astype(wide)).astype(kind).reshape(shape)

    # A bin's integer is the value in this range, rounded.
    return Actuators(bins.size, choose_integers, ranges(first + (bins - 1) / 2, bins / 2))


def _check_not_none(space: Any, where: str) -> None:  # noqa: ANN401 - whatever an environment says
    if space is None:
        raise InputError(f"{where}: missing; an environment must define its observation and action spaces")


def _choice(count: int) -> tuple[int, Callable[[Numbers, Allowed | None], int]]:
    """Return the number of actuators that choose among `count` values, and the function that chooses.

    If a mask allows any values, only those are chosen.
    """
    if count > 2:

        def largest(row: Numbers, allowed: Allowed | None) -> int:
            if allowed is not None and allowed.any():
                row = np.where(allowed, row, -np.inf)
            return int(row.argmax())

        return count, largest

    def sign(row: Numbers, allowed: Allowed | None) -> int:
        picked = int(row[0] > 0 and count == 2)
        if allowed is not None and allowed.any() and not allowed[picked]:
            picked = 1 - picked
        return picked

    return 1, sign


STEPS = 200
"""Largest number of steps of a trial. Differences appear in BipedalWalker-v3 once it has fallen, and in
knights_archers_zombies once a zombie has got through, after 141 steps."""
SECONDS = 5.0
"""Time limit of all trials together, so that servers start their work soon."""
_SEEDS = (1, 2)
"""Seeds of the repeated episode and of the episode between. Not 0, which some environments ignore."""

Actions = Callable[[int], NDArray[np.float64]]
"""Number of actuators -> their values in a step, -1 to 1."""
Trial = Callable[[Any, int, Actions], Iterator[bytes]]
"""(environment, seed, actions) -> the results of an episode, step by step."""


class Restoring(Enum):
    """Result of the trials: whether an episode can be repeated."""

    RESTORED = auto()
    """The same seed and actions give the same episode."""
    NEW_ONLY = auto()
    """They do so only in a new object."""
    NEVER = auto()
    """They do not even in a new object: not all randomness comes from the seed."""
    UNKNOWN = auto()
    """The trials took too long."""


class _OutOfTimeError(Exception):
    """The trials exceeded their time limit."""


def test_restoring(make: Callable[[], Any], trial: Trial) -> Restoring:
    """Run an episode, another one, and the first one again; compare the repetition bit by bit.

    The trials use objects of their own, so that they do not affect evaluations.

    Args:
        make: returns a new environment.
        trial: runs an episode.
    """
    end = time.monotonic() + SECONDS
    repeated, between = _SEEDS
    env = make()
    try:
        first = _record(env, trial, repeated, end)
        _record(env, trial, between, end)
        if _record(env, trial, repeated, end) == first:
            return Restoring.RESTORED
    except _OutOfTimeError:
        return Restoring.UNKNOWN
    finally:
        close(env)
    env = make()
    try:
        return Restoring.NEW_ONLY if _record(env, trial, repeated, end) == first else Restoring.NEVER
    except _OutOfTimeError:
        return Restoring.NEW_ONLY  # the first object has shown that `reset` is not enough
    finally:
        close(env)


def _record(env: Any, trial: Trial, seed: int, end: float) -> list[bytes]:  # noqa: ANN401 - of libraries
    """Return digests of an episode's results, step by step.

    If the episode fails, the last item names the exception; evaluations report it.

    Raises _OutOfTimeError after `end`, a time of `time.monotonic`.
    """
    generator = np.random.default_rng(seed)

    def actions(width: int) -> NDArray[np.float64]:
        return np.zeros(width) if seed == _SEEDS[0] else generator.uniform(-1, 1, width)

    returned = []
    try:
        for _, answer in zip(range(STEPS + 1), trial(env, seed, actions), strict=False):
            returned.append(hashlib.sha256(answer).digest())  # observations can be pictures
            if time.monotonic() > end:
                raise _OutOfTimeError
    except _OutOfTimeError:
        raise
    except Exception as error:  # noqa: BLE001 - libraries raise various exceptions
        returned.append(type(error).__name__.encode())
    return returned


def close(env: Any) -> None:  # noqa: ANN401 - types of libraries
    """Close an environment. Ignores a missing or failing `close`, as results are valid without it."""
    with contextlib.suppress(Exception):
        env.close()


_log = logging.getLogger("swarmwright")

_ARRAY = "rgb_array"
"""The render mode that returns pictures as arrays."""
_MOST_FRAMES = 1000
"""Highest frame rate, in frames a second, that is taken from an environment's metadata."""
_MANY_SENSORS = 10_000
"""Number of sensors above which a warning is logged."""
_FLAG_WORDS = frozenset({"true", "false", "yes", "no", "on", "off"})
"""Strings, in lower case, that users write for booleans."""


class Environment(Simulation):
    """An environment of another library as a simulation.

    Its parameters are the arguments of the environment's constructor. An experiment sets them like any
    others, unless they change the number of sensors or actuators; those belong in the simulation's name, as
    in `pettingzoo:mpe2.simple_spread_v3?N=5`.
    """

    environment: ClassVar[str] = ""
    """The environment's name in its library."""
    options: ClassVar[Mapping[str, Any]] = {}
    """Arguments of its constructor; parameters of an experiment are added."""
    adapted: ClassVar[str] = ""
    """The name from which the class was made; empty for a user-written class."""
    isolated_modules: ClassVar[IsolatedModules | None] = None
    """Modules of the run's copy that defines the environment, if any."""
    most_steps: int = 10_000
    """Step after which an episode ends if the environment has not ended it."""
    new_each_episode: ClassVar[bool | None] = None
    """Whether each episode gets a new environment object instead of a `reset` of the same one.

    None: decided by a trial before the first episode of a process, which tests whether `reset` restores the
    environment. The trial takes at most 200 steps and 5 seconds, and is skipped if `copies` is false or
    `render_mode` is human."""
    rendering: ClassVar[bool] = False
    """Whether environments are made with `render_mode="rgb_array"`, see `make_rendering_class`."""

    def __init__(self) -> None:
        self.env: Any = None
        self._env_parameters: dict[str, Any] | None = None
        self._replace_environment({})
        self.sensors, self.actuators = self._sizes()
        if self.sensors > _MANY_SENSORS:
            warn_once(
                f"{self.adapted or type(self).__name__}: an agent has {self.sensors} sensors, such as the "
                "pixels of a picture, which makes controllers large and slow; reduce them with a class whose "
                "make() adds a wrapper"
            )

    @abstractmethod
    def make(self, options: dict[str, Any]) -> Any:  # noqa: ANN401 - types of libraries
        """Return a new environment. May raise any exception if the options are not accepted."""

    def _environment_name(self) -> str:
        """Return the environment's name. Raises InputError for a class that has none."""
        if self.environment:
            return self.environment
        kind = type(self)
        suggestion = similar("environment", vars(kind))
        hint = "" if suggestion is None else f"; did you misspell it as {suggestion!r}?"
        raise InputError(
            f"{kind.__name__}: missing the attribute 'environment', the environment's name{hint}"
        )

    def configure(self, parameters: dict[str, Any]) -> Self:
        """Apply parameters, on which ranges and sizes may depend, and return this object.

        Raises InputError if the environment does not accept them.
        """
        self._ensure_environment(parameters, anew=False)
        return self

    @contextmanager
    def _modules(self) -> Iterator[None]:
        """Let `make` import the run's copies of modules, if the environment belongs to a run."""
        with nullcontext() if self.isolated_modules is None else self.isolated_modules.activate():
            yield

    @classmethod
    def explain_missing_display(cls) -> str | None:
        """Return why the environment cannot be displayed, according to its metadata; None if it can."""
        modes = _render_modes(cls().env)
        if _ARRAY in modes:
            return None
        return (
            f"{cls.__name__} {cls.environment}: has nothing to display: pictures need the render mode "
            f"{_ARRAY}, but its metadata lists the render_modes {', '.join(modes) or 'none'}"
        )

    @classmethod
    def make_rendering_class(cls) -> type[Self]:
        """Return a subclass whose objects draw pictures, which costs time.

        Raises InputError if the environment cannot render to an array, or a library for rendering is missing.
        """
        reason = cls.explain_missing_display()
        if reason is not None:
            raise InputError(reason)
        # Many environments draw with pygame, which prints a banner and looks for a screen.
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
        attributes = {"rendering": True, "__module__": cls.__module__, "__doc__": cls.__doc__}
        rendering_class: type[Self] = type(cls.__name__, (cls,), attributes)
        label = f"{cls.__name__} {cls.environment}"
        try:
            trial = rendering_class()
            if getattr(trial.env, "render_mode", _ARRAY) == _ARRAY:
                trial.env.reset(seed=0)
                drawn = trial.picture()
            else:
                drawn = None
        except Exception as error:  # libraries raise various exceptions
            raise InputError(f"{label}: cannot be rendered: {type(error).__name__}: {error}") from error
        frames = getattr(trial.env, "metadata", {}).get("render_fps")
        if isinstance(frames, int | float) and 0 < frames <= _MOST_FRAMES:
            rendering_class.frame_seconds = 1 / frames
        close(trial.env)
        if drawn is None:
            raise InputError(
                f"{label}: cannot be rendered, because it was created without render_mode={_ARRAY!r}; an "
                "overridden make() must pass its options to the environment"
            )
        return rendering_class

    def picture(self) -> NDArray[np.uint8] | None:
        """Return the rendered picture, (height, width, 3)."""
        if not self.rendering:
            return None
        drawn = self.env.render()
        return None if drawn is None else np.asarray(drawn, dtype=np.uint8)[:, :, :3]

    @abstractmethod
    def _sizes(self) -> tuple[int, int]:
        """Read the environment's spaces; return the numbers of sensors and actuators of an agent."""

    @abstractmethod
    def _trial(self, env: Any, seed: int, actions: Actions) -> Iterator[bytes]:  # noqa: ANN401 - types of libraries
        """Run an episode; yield the results of `reset` and of each step as bytes."""

    def _new_environment(self, parameters: dict[str, Any], *, rendering: bool) -> Any:  # noqa: ANN401 - types of libraries
        """Return a new environment. Raises InputError if it does not accept the parameters."""
        label = f"{type(self).__name__} {self.environment}"
        check_paths(label, self.environment, parameters)
        try:
            shown = {"render_mode": _ARRAY} if rendering else {}
            with self._modules():
                env = self.make({**self.options, **parameters, **shown})
            try:
                _check_flags(env, {**self.options, **parameters}, label)
            except InputError:
                close(env)
                raise
            return env
        except InputError:
            raise
        except Exception as error:  # libraries raise various exceptions
            where = f"{', '.join(parameters)}: {label}" if parameters else label
            raise InputError(f"{where}: {locate_error(error)}") from error

    def _replace_environment(self, parameters: dict[str, Any]) -> None:
        """Create an environment with these parameters and close the old one. Raises InputError."""
        env = self._new_environment(parameters, rendering=self.rendering)
        self._close()
        self.env, self._env_parameters = env, dict(parameters)

    def _close(self) -> None:
        if self.env is not None:
            close(self.env)
        self.env = self._env_parameters = None

    def _is_new_each_episode(self) -> bool:
        """Return `new_each_episode`, or else the result of a trial, made once for a class in a process.

        The trial uses only the parameters in the name, so that all servers get the same result.
        """
        kind = type(self)
        if kind.new_each_episode is not None:
            return kind.new_each_episode
        restoring = vars(kind).get("_restoring")
        if restoring is None:
            if not self.copies or getattr(self.env, "render_mode", None) == "human":
                return False
            # Closing a trial's environment may end a library that other environments draw with.
            self._close()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the episodes raise them again
                restoring = test_restoring(lambda: self._new_environment({}, rendering=False), self._trial)
            kind._restoring = restoring  # type: ignore[attr-defined]
            _log_restoring(restoring, self.adapted or kind.__name__)
        return bool(restoring is Restoring.NEW_ONLY)

    def _prepare_episode(self, parameters: dict[str, Any]) -> None:
        """Prepare an episode with these parameters. Raises InputError if they are not accepted."""
        self._ensure_environment(parameters, anew=self._is_new_each_episode())

    def _ensure_environment(self, parameters: dict[str, Any], *, anew: bool) -> None:
        """Create an environment if the parameters have changed, or if `anew`.

        Raises InputError if the parameters are not accepted, or change the sensors or actuators.
        """
        is_same = parameters == self._env_parameters
        if is_same and not anew:
            return
        if anew:
            self._close()
        self._replace_environment(parameters)
        if is_same:
            return
        groups = self.groups
        sizes = self._sizes()
        if (sizes, self.groups) == ((self.sensors, self.actuators), groups):
            return
        actual, expected = (
            f"{sizes[0]} sensors and {sizes[1]} actuators",
            f"{self.sensors} and {self.actuators}",
        )
        if sizes == (self.sensors, self.actuators):
            actual, expected = _format_groups(self.groups), _format_groups(groups)
        self._env_parameters, self.groups = None, groups
        raise InputError(
            f"{', '.join(parameters)}: changes the agents to {actual} instead of {expected}; put it into the "
            f"simulation's name, as in {self.environment}?{'&'.join(f'{name}=..' for name in parameters)}"
        )


def check_paths(label: str, environment: str, parameters: Mapping[str, Any]) -> None:
    """Raise InputError for paths outside the working folder in parameters, which may come from a peer."""
    for name, value in parameters.items():
        for path in find_outside_paths(value):
            raise InputError(
                f"{name}: {label}: {path!r} is outside the server's folder, where parameters may not point; "
                f"put it into the simulation's name, as in {environment}?{name}=.."
            )


def _check_flags(env: Any, options: Mapping[str, Any], label: str) -> None:  # noqa: ANN401 - types of libraries
    """Raise InputError for words such as `no` if the environment expects a boolean: any text is true."""
    try:
        expected = inspect.signature(type(getattr(env, "unwrapped", env))).parameters
    except (TypeError, ValueError):  # no signature
        return
    for name, value in options.items():
        is_word = isinstance(value, str) and value.lower() in _FLAG_WORDS
        if is_word and name in expected and isinstance(expected[name].default, bool):
            raise InputError(f"{name}: {label}: {value!r} found, expected true or false")


def _log_restoring(restoring: Restoring, name: str) -> None:
    """Log a warning unless the trials have shown that `reset` restores the environment."""
    if restoring is Restoring.NEW_ONLY:
        _log.warning(
            "%s: reset() does not restore all of its state, so each episode gets a new environment, which is "
            "slower; set %s=true to silence this message",
            name,
            NEW_EACH_EPISODE,
        )
    elif restoring is Restoring.NEVER:
        _log.warning(
            "%s: episodes with the same seed differ, even in new environments, so runs cannot be repeated; "
            "reset(seed=..) must seed all random numbers",
            name,
        )
    elif restoring is Restoring.UNKNOWN:
        _log.warning(
            "%s: too slow to test within %g s whether reset() restores all of its state; all episodes use "
            "the same object. Set %s=false to silence this message, or true for a new object in each episode",
            name,
            SECONDS,
            NEW_EACH_EPISODE,
        )


def _format_groups(groups: Mapping[str, Group]) -> str:
    """Return a list of groups with their numbers of agents."""
    return "the groups " + (
        ", ".join(f"{name} ({group.agents})" for name, group in groups.items()) or "(none)"
    )


def _render_modes(env: Any) -> list[str]:  # noqa: ANN401 - types of libraries
    """Return the render modes in an environment's metadata."""
    modes = (getattr(env, "metadata", None) or {}).get("render_modes") or []
    return [str(mode) for mode in modes]


def environment_seed(seed: int) -> int:
    """Fold a seed to 32 bits, which all environments accept; seeds below 2**32 stay unchanged."""
    return (seed ^ seed >> 32) & 0xFFFF_FFFF


def check_step(environment: str, returned: Any, old: str) -> None:  # noqa: ANN401 - whatever it returns
    """Raise SimulationError unless `step` returned five values; old: the interface that returns four."""
    if isinstance(returned, tuple) and len(returned) == 5:
        return
    description = f"{len(returned)} values" if isinstance(returned, tuple) else summarize(returned)
    raise SimulationError(f"{environment}: step returned {description}, {describe_step_result(old)}")


def describe_step_result(old: str) -> str:
    """Return the expected result of `step` in words; old: the interface that returns four values."""
    return (
        f"expected (observation, reward, terminated, truncated, info); {old} returns four, with a single done"
    )


def parse_reward(environment: str, reward: Any) -> float:  # noqa: ANN401 - whatever an environment returns
    """Return a reward as a float. Raises SimulationError for anything but a single number."""
    if isinstance(reward, int | float | np.integer | np.floating):
        return float(reward)
    try:
        values = np.asarray(reward)
    except (TypeError, ValueError):  # ragged
        values = np.empty((), object)
    if values.dtype.kind not in "biuf":
        raise SimulationError(f"{environment}: its reward is {summarize(reward)}, expected a number")
    if values.size != 1:
        raise SimulationError(
            f"{environment}: its reward has {values.size} numbers, but fitness is a single number. Weight "
            "several objectives with a custom class whose make() adds a wrapper such as "
            "mo_gymnasium.wrappers.LinearReward; for rewards of several agents, use the environment's "
            "PettingZoo interface"
        )
    return float(values.item())


def single(environment: str, reward: Any, step: int) -> float:  # noqa: ANN401 - as above
    """Return the reward of a step, counted from 1. Raises SimulationError unless it is a finite number."""
    value = parse_reward(environment, reward)
    if not math.isfinite(value):
        raise SimulationError(
            f"{environment}: its reward is {value} in step {step}, expected a finite number"
        )
    return value


def mean_reward(rewards: NDArray[np.float64]) -> float:
    """Return the mean of rewards, in a fixed order."""
    return float(sum(rewards.tolist()) / len(rewards))
