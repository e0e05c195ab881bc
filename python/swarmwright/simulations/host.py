"""Runs the code of a user's simulation for the engine: checks what it returns, explains what it raises."""

import contextlib
import math
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.core.errors import EpisodeError, InputError, SimulationError
from swarmwright.core.tracebacks import is_installed, shown
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.batch_checks import BatchChecks, Many
from swarmwright.simulations.batches import BatchSimulation
from swarmwright.simulations.description import Description, describe
from swarmwright.simulations.parameters import filled_in
from swarmwright.simulations.visualization import defines

if TYPE_CHECKING:
    from swarmwright.core.engine_types import SceneFields

Seen = tuple[NDArray[np.uint32], NDArray[np.float32], bool]
"""The agents that act next, ascending, (agents, sensors), and whether the episode has ended."""

_STACK = 8000
"""Characters of a traceback that are kept, of its end, which has the exception."""

_REMEMBERED = 100
"""Different failures that are reported, so that each is reported once."""


class Host:
    """One object of a simulation's class, as the engine steps it.

    Args:
        kind: the class.
        report: gets (reason, traceback) of a failure, once for each reason.
        description: of the class; default: asked.

    Raises InputError when the class does not describe itself properly.

    """

    def __init__(
        self,
        kind: type[Simulation] | type[BatchSimulation],
        report: Callable[[str, str], None] | None = None,
        description: Description | None = None,
    ) -> None:
        self._kind = kind
        self._report = report or (lambda _reason, _traceback: None)
        self._reported: set[str] = set()
        self._simulation: Simulation | BatchSimulation | None = None
        if description is None:
            self._simulation = self._made()
            description = describe(self._simulation, kind.__name__)
        self.description = description
        self.title = description.title
        self.dimensions = description.dimensions
        self.max_agents = description.max_agents
        self.sensors = description.sensors
        self.actuators = description.actuators
        self.copies = description.copies
        self.lanes = description.lanes
        self.frame_seconds = description.frame_seconds
        self.metrics = list(description.metrics.items())
        self.determinism = description.determinism
        self.tolerance = description.tolerance
        self.takes_controller = description.takes_controller
        self.steers_itself = description.steers_itself
        self.has_scenes = defines(kind, "scene")
        self._agents = 0

    def another(self) -> "Host":
        """Return a host with another object, which is made when it is reset."""
        other = Host(self._kind, self._report, self.description)
        other._reported = self._reported
        return other

    def reset(self, parameters: dict[str, Any], controller: str | None = None) -> Seen:
        """Go to the start of an episode.

        parameters: values of JSON's kinds; `seed` is the episode's, default 0. controller: its specification,
        where the simulation runs controllers itself. Raises the engine's InputError for parameters that are
        refused, SimulationError when the code fails.
        """
        values, seed = self._parameters(parameters)
        if self.takes_controller:
            return self._seen("reset", self._call("reset", values, seed, controller), first=True)
        if isinstance(self._simulation, BatchSimulation):
            return self._only(self._started(values, np.array([seed], np.uint64)))
        return self._seen("reset", self._call("reset", values, seed), first=True)

    def step(self, actions: NDArray[np.float32]) -> Seen:
        """Go on by one step; actions: (agents, actuators). Raises SimulationError when the code fails."""
        if isinstance(self._simulation, BatchSimulation):
            return self._only(self.go(actions[None]))
        return self._seen("step", self._call("step", actions), first=False)

    def fitness(self) -> float:
        """Return the fitness. Raises SimulationError when the code fails."""
        batch = isinstance(self._simulation, BatchSimulation)
        returned = self.results(metrics=False)[0, 0] if batch else self._call("fitness")
        value = _number(returned)
        if not math.isfinite(value):
            self._fail(f"fitness: {_short(returned)} returned, expected a finite number")
        return value

    def measure(self) -> list[float]:
        """Return the metrics, in the order of `metrics`; they may be NaN or infinite.

        Raises SimulationError when the code fails.
        """
        if isinstance(self._simulation, BatchSimulation):
            return self._measured(dict(zip(self._names, self.results(metrics=True)[1:, 0], strict=True)))
        returned = self._call("measure")
        if not isinstance(returned, Mapping):
            self._fail(f"measure: {_short(returned)} returned, expected a mapping from names to numbers")
        return self._measured(returned)

    def _measured(self, returned: Mapping[str, Any]) -> list[float]:
        values = []
        for name, _ in self.metrics:
            if name not in returned:
                self._fail(f"measure: {_short(dict(returned))} returned, which lacks {name!r}")
            values.append(_number(returned[name]))
            if math.isnan(values[-1]) and not isinstance(returned[name], float | np.floating):
                self._fail(f"measure: {name!r} is {_short(returned[name])}, expected a finite number")
        return values

    def scene(self) -> "SceneFields | None":
        """Return what it looks like; None for nothing. Raises SimulationError when the code fails."""
        from swarmwright.display import Scene  # noqa: PLC0415 - only where scenes are drawn

        scene = self._call("scene")
        if scene is None:
            return None
        if not isinstance(scene, Scene):
            self._fail(f"scene: {_short(scene)} returned, expected a swarmwright.display.Scene or None")
        try:
            return scene.plain()
        except (TypeError, ValueError) as error:
            self._fail(f"scene: {_short(scene)} returned: {error}")

    def picture(self) -> NDArray[np.uint8]:
        """Return what it looks like, (height, width, 3). Raises SimulationError when the code fails."""
        picture = self._call("picture")
        try:
            drawn = np.asarray(picture)
        except (TypeError, ValueError):  # ragged
            drawn = np.empty(0)
        if drawn.ndim != 3 or drawn.shape[2] != 3 or drawn.dtype != np.uint8 or not drawn.size:
            found = f"{drawn.dtype} of the shape {drawn.shape}" if drawn.ndim else _short(picture)
            self._fail(f"picture: {found} returned, expected uint8 of the shape (height, width, 3)")
        return drawn

    def start(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> Many:
        """Go to the start of many episodes of a BatchSimulation; raises as `reset`.

        parameters: as for `reset`; the seed in them does not count. seeds: (episodes,).
        """
        values, _ = self._parameters(parameters)
        return self._started(values, seeds)

    def _started(self, values: dict[str, Any], seeds: NDArray[np.uint64]) -> Many:
        self._many = BatchChecks(self.sensors, len(seeds), self.max_agents, self._fail)
        return self._many.seen("reset", self._call("reset", values, seeds), self._call)

    def go(self, actions: NDArray[np.float32]) -> Many:
        """Go on by one step; actions: (episodes, agents, actuators). Raises SimulationError."""
        return self._many.seen("step", self._call("step", actions), self._call)

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
            values = filled_in(self.description.parameters, given)
            if self._simulation is None:
                self._simulation = self._made()
        except InputError as error:
            raise _engine.InputError(str(error)) from None
        return values, seed

    def _seen(self, method: str, returned: Any, *, first: bool) -> Seen:  # noqa: ANN401 - whatever it returns
        """Check observations; ask who acts."""
        done = self._call("done")
        if not isinstance(done, bool | np.bool_):
            self._fail(f"done: {_short(done)} returned, expected True or False")
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
        expected = f"({'agents' if first else self._agents}, {self.sensors})"
        try:
            given = np.asarray(returned)
        except (TypeError, ValueError):  # ragged
            given = np.empty(0, object)
        if given.dtype.kind not in "biuf":
            self._fail(f"{method}: {_short(returned)} returned, expected numbers of the shape {expected}")
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

    def _acting(self) -> NDArray[np.uint32]:
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
                f"acting: {_short(returned)} returned, "
                f"expected indices of agents, ({self._agents},) booleans or None"
            )
        if agents.min() < 0 or agents.max() >= self._agents:
            self._fail(
                f"acting: {_short(returned)} returned, "
                f"but there are {self._agents} agents, from 0 to {self._agents - 1}"
            )
        return np.unique(agents).astype(np.uint32)

    def _call(self, method: str, *arguments: Any) -> Any:  # noqa: ANN401 - whatever the code takes and returns
        """Call a method of the user's; what it raises becomes SimulationError."""
        try:
            return getattr(self._simulation, method)(*arguments)
        except (InputError, _engine.InputError) as error:
            if method == "reset":  # about the parameters
                raise _engine.InputError(str(error)) from None
            self._fail(self._cause(method, error), error)
        except EpisodeError as error:  # it says where and what
            self._tell(str(error), error.stack)
            raise
        # Also `sys.exit` ends only the episode.
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a user's code may fail in any way
            self._fail(self._cause(method, error), error)

    def _made(self) -> Simulation | BatchSimulation:
        missing = sorted(getattr(self._kind, "__abstractmethods__", ()))
        if missing:
            raise InputError(
                f"{self._kind.__name__}: has no method {', '.join(missing)}; "
                "a simulation needs reset, step, done and fitness"
            )
        try:
            return self._kind()
        except InputError:  # what it needs is not there
            raise
        except (Exception, SystemExit) as error:  # noqa: BLE001 - as in `_call`
            self._fail(self._cause("__init__", error), error)

    def _cause(self, method: str, error: BaseException) -> str:
        """What was raised, and the last line of the user's file that led there, or else the last of all.

        What came from an environment of another library is reported with the last line of user code.
        """
        frames = traceback.extract_tb(error.__traceback__)[1:]
        file = getattr(sys.modules.get(self._kind.__module__), "__file__", None)
        if self._kind.__module__.startswith("swarmwright.adapters."):
            mine = [frame for frame in frames if not is_installed(frame.filename)] or frames
        else:
            mine = [frame for frame in frames if frame.filename == file] or frames
        where = f" ({shown(mine[-1].filename)}:{mine[-1].lineno})" if mine else ""
        words = str(error)
        return f"{method}: {type(error).__name__}{': ' if words else ''}{words}{where}"

    def _fail(self, reason: str, error: BaseException | None = None) -> NoReturn:
        """Report and raise."""
        reason = f"{self._kind.__name__}.{reason}"
        stack = None if error is None else _traceback(error)
        self._tell(reason, stack)
        raise SimulationError(reason, stack) from error

    def _tell(self, reason: str, stack: str | None) -> None:
        """Report a failure, the first time."""
        if reason not in self._reported and len(self._reported) < _REMEMBERED:
            self._reported.add(reason)
            self._report(reason, stack or "")


def _number(value: Any) -> float:  # noqa: ANN401 - whatever the code returns
    """Return a number, NaN for anything else."""
    try:
        return math.nan if isinstance(value, str) else float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _seed(value: Any) -> int:  # noqa: ANN401 - any JSON value
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0 <= value < 2**64 or value != int(value):
        raise InputError(f"seed: {_short(value)} found, expected an integer from 0 to 2**64 - 1")
    return int(value)


def _short(value: Any) -> str:  # noqa: ANN401 - any object
    with contextlib.suppress(Exception):
        text = " ".join(repr(value).split())
        return text if len(text) <= 60 else f"{text[:57]}..."
    return f"a {type(value).__name__}"


def _traceback(error: BaseException) -> str:
    """The traceback from the user's code on, without the lines of this folder."""
    folder = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120 - as in frames
    trace = error.__traceback__
    while trace is not None and os.path.dirname(os.path.abspath(trace.tb_frame.f_code.co_filename)) == folder:  # noqa: PTH100, PTH120
        trace = trace.tb_next
    text = "".join(traceback.format_exception(type(error), error, trace)).rstrip()
    return text if len(text) <= _STACK else f"...{text[3 - _STACK :]}"
