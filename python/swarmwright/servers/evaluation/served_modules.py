"""Python behaviours and conditions on a simulation server; the engine calls this interface."""

import json
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.errors import InputError, RunError, SimulationError, engine_errors
from swarmwright.common.processes import use_threads
from swarmwright.common.tracebacks import is_installed
from swarmwright.controllers.modules import grammar
from swarmwright.controllers.modules.grammar import Module
from swarmwright.controllers.modules.played import PlayedEpisode, Robots
from swarmwright.servers.evaluation.module_code import ROLES, import_modules, sha256_of

LANES = 256
"""Episodes stepped side by side; a Python simulation has one."""


class MachineEvaluations:
    """Evaluations of every candidate with every seed, stepped in groups side by side.

    Args:
        simulation: its title, or a host.
        parameters: parameters of the simulation.
        architecture: architecture of the controllers, of the kind `python_modules`.
        weights: (candidates, weights).
        seeds: seeds of the episodes.
        metrics: names of the metrics to return.
        together: episodes side by side.
        isolate: split a failing group until only the failing episode is lost, rather than raise.
    """

    def __init__(
        self,
        simulation: Any,  # noqa: ANN401 - as the engine takes it
        parameters: dict[str, Any],
        architecture: Mapping[str, Any],
        weights: NDArray[np.float32],
        seeds: Sequence[int],
        metrics: Sequence[str],
        *,
        together: int,
        isolate: bool = False,
    ) -> None:
        self._simulation, self._parameters = simulation, parameters
        self._architecture, self._weights = architecture, weights
        self._seeds, self._metrics, self._isolate = list(seeds), list(metrics), isolate
        count = len(weights)
        self.total = count * len(self._seeds)
        self.done = 0
        """Finished evaluations."""
        self.part: NDArray[np.int64] = np.zeros((0, 2), dtype=np.int64)
        """Candidate and episode of the current group, or of the last one."""
        self._fitness = np.full(self.total, np.nan)
        self._values = np.full((self.total, len(self._metrics)), np.nan)
        # Seed by seed, so that a group mixes candidates and the last group does not hold only one of them.
        work = np.array([(c, e) for e in range(len(self._seeds)) for c in range(count)], dtype=np.int64)
        self._queue = deque(work[first : first + together] for first in range(0, self.total, together))
        self._episodes: _engine.Episodes | None = None
        self._robots: Robots | None = None

    def step(self) -> bool:
        """Advance by one step; return whether work remains.

        Raises RunError if the code of a module or of the simulation fails (never with `isolate`): the current
        group is dropped, and the next call continues with the others. Raises InputError for wrong parameters
        and for missing modules.
        """
        if self._robots is None:
            if not self._queue:
                return False
            self.part = self._queue.popleft()
        try:
            with engine_errors(failure=lambda: getattr(self._simulation, "failure", None)):
                self._advance()
        except RunError:
            self._robots = self._episodes = None
            middle = len(self.part) // 2
            if self._isolate and middle:
                self._queue.extendleft([self.part[middle:], self.part[:middle]])
                return True
            self.done += len(self.part)
            if not self._isolate:
                raise
        return self._robots is not None or bool(self._queue)

    def _advance(self) -> None:
        """Begin, continue or end the current group."""
        if self._robots is None:
            seeds = [self._seeds[episode] for episode in self.part[:, 1].tolist()]
            use_threads()
            self._episodes = _engine.Episodes(self._simulation, self._parameters, seeds)
            self._robots = Robots(self._episodes, self._architecture, self._weights, self.part[:, 0])
        assert self._episodes is not None
        if not self._episodes.done:
            self._robots.step()
        if self._episodes.done:
            rows = self.part[:, 0] * len(self._seeds) + self.part[:, 1]
            self._fitness[rows] = self._episodes.fitness()
            self._values[rows] = self._episodes.metrics(self._metrics)
            self.done += len(self.part)
            self._robots = self._episodes = None

    def fitness(self) -> NDArray[np.float64]:
        """Return the fitness, (candidates, episodes), NaN where an episode failed."""
        return self._fitness.reshape(len(self._weights), len(self._seeds))

    def metrics(self) -> NDArray[np.float64]:
        """Return the metrics, (candidates, episodes, metrics), NaN where an episode failed."""
        return self._values.reshape(len(self._weights), len(self._seeds), -1)

    def results(self) -> NDArray[np.float64]:
        """Return fitness and metrics of every evaluation, (candidates * episodes, 1 + metrics)."""
        return np.concatenate([self._fitness[:, np.newaxis], self._values], axis=1)


_STACK = 8000
"""Characters of a traceback to keep, from its end."""
_MAX_REPORTED = 100
"""Upper limit of distinct failures to report."""

Report = Callable[[str, str], None]
"""Called with the reason and traceback of a failure."""


class ServedModules:
    """The modules that a simulation server offers.

    Machines received through the broker name modules and the SHA-256 of their code; only the modules offered
    here are used, and no other code is imported.

    Args:
        names: names of the modules, see `module_code.offered`.
        simulation: its title, or a host.
        report: called with failures of their code, once per reason.

    Raises InputError for missing or invalid modules.
    """

    def __init__(self, names: Sequence[str], simulation: Any, report: Report) -> None:  # noqa: ANN401 - as the engine takes it
        self._simulation = simulation
        self._report = report
        self._reported: set[str] = set()
        self._offered = {
            (role, module.name, sha256_of(role, module)): module
            for (role, _), many in import_modules(names).items()
            for module in many
        }
        self.together = LANES if isinstance(simulation, str) else 1
        """Episodes that take about as long as a single one."""

    @property
    def announced(self) -> list[dict[str, str]]:
        """Announcement of each module, see docs/reference/protocol.md."""
        entries = []
        for (role, name, sha256), module in self._offered.items():
            values = {"role": role, "name": name, "file": module.file or None, "sha256": sha256}
            entries.append({key: value for key, value in values.items() if value is not None})
        return entries

    def begin(
        self,
        architecture: dict[str, Any],
        weights: NDArray[np.float32],
        seeds: Sequence[int],
        parameters: dict[str, Any],
        metrics: Sequence[str],
    ) -> MachineEvaluations:
        """Begin to evaluate candidates. Raises the engine's InputError for machines with other modules."""
        with _refusals():
            return MachineEvaluations(
                self._simulation,
                parameters,
                self._resolve_modules(architecture),
                weights,
                seeds,
                metrics,
                together=self.together,
                isolate=True,
            )

    def play(self, specification: str, parameters: dict[str, Any]) -> "ServedEpisode":
        """Begin one episode. Raises as `begin`."""
        values = json.loads(specification)
        with _refusals():
            machine = {**values, **self._resolve_modules(values)}
            seed = int(parameters.get("seed", 0))
            return ServedEpisode(PlayedEpisode(self._simulation, parameters, seed, machine), self._tell)

    def _resolve_modules(self, architecture: Mapping[str, Any]) -> dict[str, Any]:
        """Replace the modules of a specification by those offered, with parameters in their class's order."""
        specification = dict(architecture)
        for role, key in ROLES.items():
            specification[key] = [
                self._find_module(role, grammar.parse_module(module_name)).as_mapping()
                for module_name in architecture[key]
            ]
        return specification

    def _find_module(self, role: str, definition: Module) -> Module:
        if definition.built_in:
            return definition
        same = (
            module
            for (offered_role, name, sha256), module in self._offered.items()
            if (offered_role, name) == (role, definition.name) and definition.sha256 in ("", sha256)
        )
        offered_module = next(same, None)
        if offered_module is None:
            raise InputError(
                f"controller: this server lacks {role} {definition.name!r}, or has different code for it"
            )
        if dict(offered_module.parameters) != dict(definition.parameters):
            raise InputError(
                f"controller: {role} {definition.name!r} has different parameters on this server"
            )
        return offered_module

    def _tell(self, reason: str, stack: str) -> None:
        if reason not in self._reported and len(self._reported) < _MAX_REPORTED:
            self._reported.add(reason)
            self._report(reason, stack)


class ServedEpisode:
    """An episode that reports failures with their traceback."""

    def __init__(self, episode: PlayedEpisode, tell: Report) -> None:
        self._episode = episode
        self._tell = tell

    @property
    def done(self) -> bool:
        """Whether the episode has ended."""
        return self._episode.done

    @property
    def fitness(self) -> float:
        """Fitness so far."""
        return self._episode.fitness

    @property
    def metric_names(self) -> list[str]:
        """Names of all metrics."""
        return self._episode.metric_names

    def metrics(self, names: list[str]) -> list[float]:
        """Return the named metrics so far."""
        return self._episode.metrics(names)

    def step(self) -> None:
        """Advance by one step. Raises SimulationError when the code of a module fails."""
        try:
            self._episode.step()
        except RunError as error:
            stack = _stack(error.__cause__)
            self._tell(str(error), stack)
            raise SimulationError(str(error), stack or None) from error


@contextmanager
def _refusals() -> Iterator[None]:
    """Convert errors in a request to the engine's InputError."""
    try:
        yield
    except InputError as error:
        raise _engine.InputError(str(error)) from None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise _engine.InputError(f"controller: is not a valid machine of modules: {error!r}") from None


def _stack(error: BaseException | None) -> str:
    """Return the traceback from the module's code on; empty without an exception."""
    if error is None:
        return ""
    first = trace = error.__traceback__
    while trace is not None and is_installed(trace.tb_frame.f_code.co_filename):
        trace = trace.tb_next
    text = "".join(traceback.format_exception(type(error), error, trace or first)).rstrip()
    return text if len(text) <= _STACK else f"...{text[3 - _STACK :]}"
