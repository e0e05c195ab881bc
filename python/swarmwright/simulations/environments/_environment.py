"""What adapters of libraries of environments have in common.

Whether `reset` brings an environment back to where it was, which one object for all episodes needs.

Some environments keep contacts, lists or running means over `reset`. What happens in an episode would then
depend on the episodes before, and so on which server has evaluated which candidate.

Gymnasium's spaces as sensors and actuators.

Sensors: numbers with bounds are scaled to -1..1, others stay as they are; a choice of n is n numbers, 1 for
what is chosen and 0 for the rest; dictionaries and tuples follow one part after the other.

Actuators, -1..1: numbers with bounds are scaled to these; with one bound, to the 2 next to it; others stay as
they are. For integers the range -1..1 has a bin for each, all of the same width. Of two choices the sign
decides, of more the largest of as many actuators, the first one among equals; where an action mask allows
some only, among these. Dictionaries and tuples follow one part after the other.

Action masks: which choices an environment allows, as it says in its observations.

The form of PettingZoo and others: the observation is a dictionary with `action_mask`, 1 for each choice that
is allowed and 0 for others, beside what is observed.
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
from swarmwright.common.tracebacks import located
from swarmwright.common.untrusted import paths_elsewhere
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.base import Group, Simulation
from swarmwright.simulations.calls import short
from swarmwright.simulations.environments import NEW_EACH_EPISODE
from swarmwright.simulations.isolation import Apart

MASK = "action_mask"
"""Key of the mask in an observation."""
Allowed = NDArray[np.bool_]
"""(choices,), those of one part of an action after those of the other."""


def mask_width(observations: Any, actions: Any) -> int:  # noqa: ANN401 - spaces of an environment
    """Return how many choices the mask in observations is of; 0 where none fits the actions."""
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
    """Return what reads the choices that an observation allows; None stands for all.

    All are allowed where the mask has none, as that of an agent whose turn it is not.

    Args:
        observations: their space.
        actions: their space.
        refuse: raises for a mask of another size, and for None where an observation has none.
    """
    width = mask_width(observations, actions)
    if not width:
        return lambda _: None

    def read(seen: Any) -> Allowed | None:  # noqa: ANN401 - an observation
        mask = seen.get(MASK) if isinstance(seen, Mapping) else None
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
_Made = TypeVar("_Made")

_UNBOUNDED = 1e6
"""Bounds from here on are none: some environments write a large number for infinity."""


class Sensors(NamedTuple):
    """How an observation becomes numbers."""

    width: int
    read: Callable[[Any], Numbers]
    """Observation -> (width,)"""
    ranges: tuple[Range | None, ...]
    """What -1 and 1 of each stand for; None where numbers stay as they are."""


class Actuators(NamedTuple):
    """How numbers become an action."""

    width: int
    act: Callable[..., Any]
    """(width,), -1 to 1, and optionally the choices that are allowed -> action"""
    ranges: tuple[Range | None, ...]
    """What -1 and 1 of each stand for; None where they stand for themselves, or choose."""


def with_mask(observations: Any, actions: Any, where: str) -> tuple[Sensors, Callable[[Any], Allowed | None]]:  # noqa: ANN401 - spaces of an environment
    """Return the sensors for an observation space, and what reads which choices an observation allows.

    See `sensors`; an action mask is no sensor, where it is one of these actions.
    """
    if not mask_width(observations, actions):
        return sensors(observations, where), lambda _: None
    seen = spaces.Dict({key: part for key, part in observations.spaces.items() if key != MASK})
    place = f"{where}[{MASK!r}]"

    def refuse(mask: Any) -> NoReturn:  # noqa: ANN401 - whatever an environment returns
        if mask is None:
            raise SimulationError(f"{where}: an observation without {MASK!r}, which its space has")
        _refuse(mask, observations.spaces[MASK], place)

    return sensors(seen, where), mask_reader(observations, actions, refuse)


def sensors(space: Any, where: str) -> Sensors:  # noqa: ANN401 - whatever an environment says
    """Return the sensors for an observation space. Raises InputError for one whose size changes.

    Reading raises SimulationError for an observation of another size, or a choice that there is not. Whether
    numbers are within their bounds is not checked: many environments exceed them.
    """
    _check_there(space, where)
    match space:
        case spaces.Box():
            middle, half = _range(space)

            def numbers(seen: Any) -> Numbers:  # noqa: ANN401 - an array
                return (_flat(seen, half.size, space, where) - middle) / half

            return Sensors(half.size, numbers, ranges(middle, half))
        case spaces.Discrete():
            return _choice_of_one(space, where)
        case spaces.MultiBinary():
            size = int(np.prod(space.shape))

            def flags(seen: Any) -> Numbers:  # noqa: ANN401 - an array of 0 and 1
                row = _flat(seen, size, space, where)
                if not ((row == 0) | (row == 1)).all():
                    _refuse(seen, space, where)
                return row

            return Sensors(size, flags, (None,) * size)
        case spaces.MultiDiscrete():
            return _choices(space, where)
        case spaces.Dict() | spaces.Tuple():
            return _parts(space, where)
    raise InputError(
        f"{where}: a {type(space).__name__} space cannot be read by sensors, whose number is fixed; "
        "wrap the environment so that it gives a Box"
    )


def _choice_of_one(space: spaces.Discrete, where: str) -> Sensors:
    count, start = int(space.n), int(space.start)

    def read(seen: Any) -> Numbers:  # noqa: ANN401 - an integer
        try:
            index = int(seen) - start
        except (TypeError, ValueError, OverflowError):
            _refuse(seen, space, where)
        if not 0 <= index < count or index + start != seen:
            _refuse(seen, space, where)
        row = np.zeros(count)
        row[index] = 1
        return row

    return Sensors(count, read, (None,) * count)


def _choices(space: spaces.MultiDiscrete, where: str) -> Sensors:
    counts, starts = space.nvec.ravel(), space.start.ravel()
    ends = np.cumsum(counts)
    width = int(ends[-1])

    def read(seen: Any) -> Numbers:  # noqa: ANN401 - an array of integers
        picked = _flat(seen, counts.size, space, where) - starts
        if not ((picked >= 0) & (picked < counts) & (picked % 1 == 0)).all():
            _refuse(seen, space, where)
        row = np.zeros(width)
        row[ends - counts + picked.astype(np.int64)] = 1
        return row

    return Sensors(width, read, (None,) * width)


def _parts(space: Any, where: str) -> Sensors:  # noqa: ANN401 - a Dict or a Tuple
    keys, parts = _inner(space, where, sensors)
    found = tuple(ends for part in parts for ends in part.ranges)

    def read(seen: Any) -> Numbers:  # noqa: ANN401 - a dictionary or tuple
        try:
            values = [seen[key] for key in keys]
        except (TypeError, LookupError):
            _refuse(seen, space, where)
        return np.concatenate([part.read(value) for part, value in zip(parts, values, strict=True)])

    return Sensors(len(found), read, found)


def _inner(space: Any, where: str, made: Callable[[Any, str], _Made]) -> tuple[list[Any], list[_Made]]:  # noqa: ANN401 - a Dict or a Tuple
    """Return the keys of a space's parts, and what is made of each. Raises InputError where it has none."""
    inner: list[tuple[Any, Any]] = list(
        space.spaces.items() if isinstance(space, spaces.Dict) else enumerate(space.spaces)
    )
    if not inner:
        raise InputError(f"{where}: a {type(space).__name__} space without parts")
    return [key for key, _ in inner], [made(part, f"{where}[{key!r}]") for key, part in inner]


def _flat(seen: Any, size: int, space: Any, where: str) -> Numbers:  # noqa: ANN401 - whatever an environment returns
    """Return an observation as a row of so many numbers. Raises SimulationError for others."""
    try:
        row = np.asarray(seen, float).ravel()
    except (TypeError, ValueError):
        _refuse(seen, space, where)
    if row.size != size:
        _refuse(seen, space, where)
    return row


def _refuse(seen: Any, space: Any, where: str) -> NoReturn:  # noqa: ANN401 - whatever an environment returns
    shape = getattr(seen, "shape", ())
    found = f"{short(seen)} of the shape {shape}" if shape else short(seen)
    if shape and shape != getattr(space, "shape", None):
        # The numbers differ from episode to episode, what is wrong does not.
        found = f"of the shape {shape}"
    expected = f"Box{space.shape}" if isinstance(space, spaces.Box) else short(space)
    raise SimulationError(f"{where}: the observation {found} is not in {expected}")


def actuators(space: Any, where: str) -> Actuators:  # noqa: ANN401 - whatever an environment says
    """Return the actuators for an action space. Raises InputError for one that cannot be steered."""
    _check_there(space, where)
    match space:
        case spaces.Box():
            if np.issubdtype(space.dtype, np.integer):
                return _integers(space)
            middle, half = _reach(space)
            shape, kind = space.shape, space.dtype

            def scaled(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
                action = (middle + half * row).reshape(shape).astype(kind)
                return np.clip(action, space.low, space.high)

            return Actuators(half.size, scaled, ranges(middle, half))
        case spaces.Discrete():
            width, choose = _choice(int(space.n))
            start = int(space.start)

            def one(row: Numbers, allowed: Allowed | None = None) -> int:
                return start + choose(row, allowed)

            return Actuators(width, one, (None,) * width)
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
        f"{where}: a {type(space).__name__} space cannot be steered by actuators; "
        "wrap the environment so that it takes a Box or a Discrete"
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
        actions = [part.act(own) for part, own in zip(parts, rows, strict=True)]
        return dict(zip(keys, actions, strict=True)) if isinstance(space, spaces.Dict) else tuple(actions)

    return Actuators(int(ends[-1]), act, tuple(limits for part in parts for limits in part.ranges))


def ranges(middle: NDArray[Any], half: NDArray[Any]) -> tuple[Range | None, ...]:
    """Return what -1 and 1 of scaled numbers stand for: middle and half the width of the range of each."""
    parts = zip(np.ravel(half).tolist(), np.ravel(middle).tolist(), strict=True)
    return tuple(Range.scaled(*part) for part in parts)


def _range(space: spaces.Box) -> tuple[Numbers, Numbers]:
    """Return the middle of each number's range and half its width, flat; 0 and 1 where it has no bounds."""
    low, high = space.low.astype(float).ravel(), space.high.astype(float).ravel()
    bounded = (low > -_UNBOUNDED) & (high < _UNBOUNDED) & (low < high)
    low, high = np.where(bounded, low, -1.0), np.where(bounded, high, 1.0)
    return (low + high) / 2, (high - low) / 2


def _reach(space: spaces.Box) -> tuple[Numbers, Numbers]:
    """Return the middle of what each actuator reaches and half its width, flat.

    The bounds; the 2 next to the only bound; -1 to 1 without any.
    """
    low, high = space.low.astype(float).ravel(), space.high.astype(float).ravel()
    above, below = low > -_UNBOUNDED, high < _UNBOUNDED
    least = np.where(above, low, np.where(below, high - 2, -1.0))
    most = np.where(below, high, np.where(above, low + 2, 1.0))
    return (least + most) / 2, (most - least) / 2


def _integers(space: spaces.Box) -> Actuators:
    """Return the actuators for integers: -1 to 1 is divided into as many bins as there are integers.

    With one bound there are the 3 next to it, without any -1, 0 and 1.
    """
    firsts, counts = [], []
    # Python's integers: differences of 64-bit bounds do not fit into 64 bits.
    for low, high in zip(space.low.ravel().tolist(), space.high.ravel().tolist(), strict=True):
        above, below = low > -_UNBOUNDED, high < _UNBOUNDED
        count = high - low + 1 if above and below else min(3, high - low + 1)
        firsts.append(low if above else high - count + 1 if below else -1)
        counts.append(count)
    shape, kind = space.shape, space.dtype
    # Wider than the type, in which a sum with the number of a bin may not fit.
    wide = np.uint64 if kind == np.uint64 else np.int64
    first, bins = np.array(firsts, wide), np.array(counts, float)

    def picked(row: Numbers, _: Allowed | None = None) -> Any:  # noqa: ANN401 - of the space's type
        index = np.clip(np.floor(bins * (row + 1) / 2), 0, bins - 1)
        return (first + index.astype(wide)).astype(kind).reshape(shape)

    # The number of a bin is that of a value of this range, rounded.
    return Actuators(bins.size, picked, ranges(first + (bins - 1) / 2, bins / 2))


def _check_there(space: Any, where: str) -> None:  # noqa: ANN401 - whatever an environment says
    if space is None:
        raise InputError(f"{where}: is missing; an environment has to say what is observed and done in it")


def _choice(count: int) -> tuple[int, Callable[[Numbers, Allowed | None], int]]:
    """Return how many actuators choose one of `count`, and how; of those that are allowed, if any is."""
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
"""Steps of a trial, at most. Those of BipedalWalker-v3 differ once it has fallen, those of
knights_archers_zombies once a zombie has got through, after 141."""
SECONDS = 5.0
"""Time of all trials together, after which they end with what is known: servers have to begin their work."""
_SEEDS = (1, 2)
"""Seeds of the episode that is repeated, and of the one between: some environments take 0 for no seed."""

Actions = Callable[[int], NDArray[np.float64]]
"""Number of actuators -> what they do in a step, -1 to 1."""
Trial = Callable[[Any, int, Actions], Iterator[bytes]]
"""(environment, seed, actions) -> what an episode returns, step after step."""


class Restoring(Enum):
    """What trials have shown."""

    RESTORED = auto()
    """An episode with the same seed and actions is the same again."""
    NEW_ONLY = auto()
    """It is the same in a new object only."""
    NEVER = auto()
    """It differs even in a new object: not all randomness comes from the seed."""
    UNKNOWN = auto()
    """There was not enough time to find out."""


class _OutOfTimeError(Exception):
    """The time of the trials is over."""


def found_by_trials(make: Callable[[], Any], trial: Trial) -> Restoring:
    """Compare an episode with its repetition after another one, to the bit.

    Only new objects are used, so that the ones that evaluate are what they are without the comparison.

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
        return Restoring.NEW_ONLY  # it is known that `reset` is not enough
    finally:
        close(env)


def _record(env: Any, trial: Trial, seed: int, end: float) -> list[bytes]:  # noqa: ANN401 - of libraries
    """Return digests of what an episode returns, step after step.

    One that fails ends with the exception, which episodes report.

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
    """Close an environment; what it has computed counts also where it has no `close`, or that fails."""
    with contextlib.suppress(Exception):
        env.close()


_log = logging.getLogger("swarmwright")

_ARRAY = "rgb_array"
"""The render mode that gives pictures as arrays."""
_MOST_FRAMES = 1000
"""Frames a second, at most, that an environment can ask for."""
_MANY_SENSORS = 10_000
"""With more of them there is a warning."""
_FLAG_WORDS = frozenset({"true", "false", "yes", "no", "on", "off"})
"""Texts that are meant as a flag, in lower case."""


class Environment(Simulation):
    """An environment of another library as a simulation.

    Its parameters are what the environment's constructor takes; in an experiment they are set as any others,
    as long as they leave alone what agents sense and how they act. Those that do not belong to the name:
    `pettingzoo:mpe2.simple_spread_v3?N=5`.
    """

    environment: ClassVar[str] = ""
    """The environment, as its library names it."""
    options: ClassVar[Mapping[str, Any]] = {}
    """What its constructor gets; parameters of an experiment are added."""
    adapted: ClassVar[str] = ""
    """The name from which the class was made; empty for a user-written class."""
    apart: ClassVar[Apart | None] = None
    """The modules of a run's copy, of which the environment is."""
    most_steps: int = 10_000
    """An episode that the environment does not end is ended after so many."""
    new_each_episode: ClassVar[bool | None] = None
    """Whether each episode gets a new object of the environment, rather than `reset` of one for all.

    None: where a trial before the first episode of a process shows that `reset` does not restore the
    environment. It has 200 steps and 5 seconds at most; no trial is made where `copies` is false, or of
    `render_mode` human."""
    rendering: ClassVar[bool] = False
    """Whether environments are made with `render_mode="rgb_array"`, see `rendered`."""

    def __init__(self) -> None:
        self.env: Any = None
        self._given: dict[str, Any] | None = None
        self._replace_environment({})
        self.sensors, self.actuators = self._sizes()
        if self.sensors > _MANY_SENSORS:
            warn_once(
                f"{self.adapted or type(self).__name__}: an agent has {self.sensors} sensors, such as a "
                "picture's, so that controllers are large and slow; a class whose make() adds a wrapper can "
                "reduce them"
            )

    @abstractmethod
    def make(self, options: dict[str, Any]) -> Any:  # noqa: ANN401 - types of libraries
        """Return a new environment. Raises any exception when there is none with these options."""

    def _named(self) -> str:
        """Return the environment's name. Raises InputError for a class that has none."""
        if self.environment:
            return self.environment
        kind = type(self)
        near = similar("environment", vars(kind))
        hint = "" if near is None else f"; there is {near!r}, is it a typing error?"
        raise InputError(f"{kind.__name__}: has no attribute 'environment', the environment's name{hint}")

    def described_with(self, parameters: dict[str, Any]) -> Self:
        """Return this object with what it announces with these parameters: ranges may depend on them.

        Raises InputError where they do not fit.
        """
        self._ensure_environment(parameters, anew=False)
        return self

    @contextmanager
    def _modules(self) -> Iterator[None]:
        """Let modules that `make` imports be the copies of a run, where the environment is of one."""
        with nullcontext() if self.apart is None else self.apart.entered():
            yield

    @classmethod
    def unshown(cls) -> str | None:
        """Return why the environment has nothing to show, as it declares; None where it renders."""
        modes = _render_modes(cls().env)
        if _ARRAY in modes:
            return None
        return (
            f"{cls.__name__} {cls.environment}: has nothing to show: its metadata has the render_modes "
            f"{', '.join(modes) or 'none'}, and pictures need {_ARRAY}"
        )

    @classmethod
    def rendered(cls) -> type[Self]:
        """Return a class like this one whose objects draw pictures, which costs time.

        Raises InputError when the environment cannot render to an array, or what it renders with is not
        installed.
        """
        reason = cls.unshown()
        if reason is not None:
            raise InputError(reason)
        # Many draw with pygame, which prints a greeting and looks for a screen; arrays need neither.
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
        attributes = {"rendering": True, "__module__": cls.__module__, "__doc__": cls.__doc__}
        made: type[Self] = type(cls.__name__, (cls,), attributes)
        label = f"{cls.__name__} {cls.environment}"
        try:
            trial = made()
            if getattr(trial.env, "render_mode", _ARRAY) == _ARRAY:
                trial.env.reset(seed=0)
                drawn = trial.picture()
            else:
                drawn = None
        except Exception as error:  # libraries raise various exceptions
            raise InputError(f"{label}: cannot be rendered: {type(error).__name__}: {error}") from error
        frames = getattr(trial.env, "metadata", {}).get("render_fps")
        if isinstance(frames, int | float) and 0 < frames <= _MOST_FRAMES:
            made.frame_seconds = 1 / frames
        close(trial.env)
        if drawn is None:
            raise InputError(
                f"{label}: cannot be rendered: it was made without render_mode={_ARRAY!r}; an "
                "overridden make() must pass its options to the environment"
            )
        return made

    def picture(self) -> NDArray[np.uint8] | None:
        """Return what the environment renders, (height, width, 3)."""
        if not self.rendering:
            return None
        drawn = self.env.render()
        return None if drawn is None else np.asarray(drawn, dtype=np.uint8)[:, :, :3]

    @abstractmethod
    def _sizes(self) -> tuple[int, int]:
        """Read the spaces of the environment; return how many sensors and actuators an agent has."""

    @abstractmethod
    def _trial(self, env: Any, seed: int, actions: Actions) -> Iterator[bytes]:  # noqa: ANN401 - types of libraries
        """Run an episode; yield what `reset` and each step return."""

    def _new_environment(self, parameters: dict[str, Any], *, rendering: bool) -> Any:  # noqa: ANN401 - types of libraries
        """Return a new environment. Raises InputError where there is none with these parameters."""
        label = f"{type(self).__name__} {self.environment}"
        check_paths(label, self.environment, parameters)
        try:
            shown = {"render_mode": _ARRAY} if rendering else {}
            with self._modules():
                made = self.make({**self.options, **parameters, **shown})
            try:
                _check_flags(made, {**self.options, **parameters}, label)
            except InputError:
                close(made)
                raise
            return made
        except InputError:
            raise
        except Exception as error:  # libraries raise various exceptions
            where = f"{', '.join(parameters)}: {label}" if parameters else label
            raise InputError(f"{where}: {located(error)}") from error

    def _replace_environment(self, parameters: dict[str, Any]) -> None:
        """Have a new environment with these parameters. Raises InputError where there is none."""
        made = self._new_environment(parameters, rendering=self.rendering)
        self._close()
        self.env, self._given = made, dict(parameters)

    def _close(self) -> None:
        if self.env is not None:
            close(self.env)
        self.env = self._given = None

    def _is_new_each_episode(self) -> bool:
        """Return what `new_each_episode` says, or else a trial, which a class has once in a process.

        It has the parameters of the name alone, so that all servers find the same.
        """
        kind = type(self)
        if kind.new_each_episode is not None:
            return kind.new_each_episode
        found = vars(kind).get("_restoring")
        if found is None:
            if not self.copies or getattr(self.env, "render_mode", None) == "human":
                return False
            # Closing an environment may end what others draw with, so there is none beside those of trials.
            self._close()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # those of the episodes are enough
                found = found_by_trials(lambda: self._new_environment({}, rendering=False), self._trial)
            kind._restoring = found  # type: ignore[attr-defined]
            _tell(found, self.adapted or kind.__name__)
        return bool(found is Restoring.NEW_ONLY)

    def _prepare_episode(self, parameters: dict[str, Any]) -> None:
        """Be ready for an episode with these parameters. Raises InputError where they do not fit."""
        self._ensure_environment(parameters, anew=self._is_new_each_episode())

    def _ensure_environment(self, parameters: dict[str, Any], *, anew: bool) -> None:
        """Have an environment with these parameters, a new one where they are others or `anew`.

        Raises InputError where they do not fit.
        """
        is_known = parameters == self._given
        if is_known and not anew:
            return
        if anew:
            self._close()
        self._replace_environment(parameters)
        if is_known:
            return
        groups = self.groups
        sizes = self._sizes()
        if (sizes, self.groups) == ((self.sensors, self.actuators), groups):
            return
        found, before = f"{sizes[0]} sensors and {sizes[1]} actuators", f"{self.sensors} and {self.actuators}"
        if sizes == (self.sensors, self.actuators):
            found, before = _listed(self.groups), _listed(groups)
        self._given, self.groups = None, groups
        raise InputError(
            f"{', '.join(parameters)}: with it agents have {found} instead of {before}; put it into the "
            f"simulation's name, as {self.environment}?{'&'.join(f'{name}=..' for name in parameters)}"
        )


def check_paths(label: str, environment: str, parameters: Mapping[str, Any]) -> None:
    """Raise InputError for paths that lead elsewhere: parameters may come from a peer, a name does not."""
    for name, value in parameters.items():
        for path in paths_elsewhere(value):
            raise InputError(
                f"{name}: {label}: {path!r} found, but parameters name files below the server's folder only; "
                f"put it into the simulation's name, as {environment}?{name}=.."
            )


def _check_flags(env: Any, given: Mapping[str, Any], label: str) -> None:  # noqa: ANN401 - types of libraries
    """Raise InputError for words such as `no` where the environment has a flag: any text counts as true."""
    try:
        expected = inspect.signature(type(getattr(env, "unwrapped", env))).parameters
    except (TypeError, ValueError):  # it does not say what it takes
        return
    for name, value in given.items():
        is_word = isinstance(value, str) and value.lower() in _FLAG_WORDS
        if is_word and name in expected and isinstance(expected[name].default, bool):
            raise InputError(f"{name}: {label}: {value!r} found, expected true or false")


def _tell(found: Restoring, name: str) -> None:
    """Say what trials have found, where it is not what is expected of environments."""
    if found is Restoring.NEW_ONLY:
        _log.warning(
            "%s: reset() does not restore all of its state, so that an episode would depend on those before; "
            "each episode gets a new environment, which takes longer (%s=true says so without this message)",
            name,
            NEW_EACH_EPISODE,
        )
    elif found is Restoring.NEVER:
        _log.warning(
            "%s: episodes with the same seed differ, even in new environments, so that runs cannot be "
            "repeated; reset(seed=..) has to seed all random numbers",
            name,
        )
    elif found is Restoring.UNKNOWN:
        _log.warning(
            "%s: is too slow to find out within %g s whether reset() restores all of its state; one object "
            "is used for all episodes (%s=false says so without this message, true takes a new one for each)",
            name,
            SECONDS,
            NEW_EACH_EPISODE,
        )


def _listed(groups: Mapping[str, Group]) -> str:
    """Return groups with their numbers of agents."""
    return "the groups " + (
        ", ".join(f"{name} ({group.agents})" for name, group in groups.items()) or "(none)"
    )


def _render_modes(env: Any) -> list[str]:  # noqa: ANN401 - types of libraries
    """Return the ways in which an environment says that it renders."""
    modes = (getattr(env, "metadata", None) or {}).get("render_modes") or []
    return [str(mode) for mode in modes]


def environment_seed(seed: int) -> int:
    """Return 32 bits of a seed, as many as all environments take; smaller ones stay as they are."""
    return (seed ^ seed >> 32) & 0xFFFF_FFFF


def check_step(environment: str, returned: Any, old: str) -> None:  # noqa: ANN401 - whatever it returns
    """Raise SimulationError where `step` did not return five values; old: which interface has four."""
    if isinstance(returned, tuple) and len(returned) == 5:
        return
    found = f"{len(returned)} values" if isinstance(returned, tuple) else short(returned)
    raise SimulationError(f"{environment}: step returned {found}, {expected_of_step(old)}")


def expected_of_step(old: str) -> str:
    """Return in words what `step` has to return; old: which interface has four values."""
    return f"expected (observation, reward, terminated, truncated, info); {old} has four, with done alone"


def one_number(environment: str, reward: Any) -> float:  # noqa: ANN401 - whatever an environment returns
    """Return a reward as one number. Raises SimulationError for several, as in multi-objective tasks."""
    if isinstance(reward, int | float | np.integer | np.floating):
        return float(reward)
    try:
        given = np.asarray(reward)
    except (TypeError, ValueError):  # ragged
        given = np.empty((), object)
    if given.dtype.kind not in "biuf":
        raise SimulationError(f"{environment}: its reward is {short(reward)}, expected a number")
    if given.size != 1:
        raise SimulationError(
            f"{environment}: its reward has {given.size} numbers, a fitness is one. If they are objectives, "
            "weigh them in a custom class whose make() adds a wrapper such as "
            "mo_gymnasium.wrappers.LinearReward; if they are the rewards of several agents, attach the "
            "environment's interface of PettingZoo"
        )
    return float(given.item())


def single(environment: str, reward: Any, step: int) -> float:  # noqa: ANN401 - as above
    """Return the reward of a step, from 1 on. Raises SimulationError as above, or where it is not finite."""
    value = one_number(environment, reward)
    if not math.isfinite(value):
        raise SimulationError(
            f"{environment}: its reward is {value} in step {step}, expected a finite number"
        )
    return value


def mean_reward(rewards: NDArray[np.float64]) -> float:
    """Return the mean of rewards, in a fixed order."""
    return float(sum(rewards.tolist()) / len(rewards))
