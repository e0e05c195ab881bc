"""What adapters of libraries of environments have in common."""

import inspect
import logging
import math
import os
import warnings
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from difflib import get_close_matches
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError, SimulationError
from swarmwright.common.tracebacks import located
from swarmwright.common.untrusted import paths_elsewhere
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.calls import short
from swarmwright.simulations.environments import NEW_EACH_EPISODE
from swarmwright.simulations.environments._restoring import (
    SECONDS,
    Actions,
    Restoring,
    close,
    found_by_trials,
)
from swarmwright.simulations.groups import Group
from swarmwright.simulations.isolation import Apart

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
        alike = get_close_matches("environment", vars(kind), 1)
        hint = f"; there is {alike[0]!r}, is it a typing error?" if alike else ""
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
    return "the groups " + (", ".join(f"{name} ({one.agents})" for name, one in groups.items()) or "(none)")


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
