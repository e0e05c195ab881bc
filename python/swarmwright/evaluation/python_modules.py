"""Evaluation of machines with modules in Python: the engine steps episodes, Python the machines."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from swarmwright import _engine
from swarmwright.core.errors import RunError, engine_errors
from swarmwright.core.modules import PYTHON_KIND
from swarmwright.core.simulation_names import is_python
from swarmwright.evaluation.base import Controllers, Progress, Results
from swarmwright.evaluation.in_process import InProcessBackend, PythonBackend
from swarmwright.experiment.experiment import Experiment
from swarmwright.modules._stepping import Robots
from swarmwright.simulations import catalogue
from swarmwright.store import Journal, WarningEntry

_TOGETHER = 256
"""Episodes that are stepped side by side; of a simulation in Python one."""
_REPORT_S = 0.1


class ModulesBackend(InProcessBackend):
    """Evaluates machines with modules in Python in this process, many episodes side by side.

    Controllers that the engine computes are evaluated as usual.
    """

    def __init__(self, experiment: Experiment, metrics: Sequence[str] = ()) -> None:
        super().__init__(experiment, metrics)
        python = is_python(experiment.simulation)
        self._others = (PythonBackend if python else InProcessBackend)(experiment, metrics)
        self._together = 1 if python else _TOGETHER
        self.description = "in this process, machines in Python"

    def evaluator(self, architecture: dict[str, Any]) -> _engine.Evaluator | None:
        """Return None for machines with modules in Python."""
        return None if architecture.get("kind") == PYTHON_KIND else self._others.evaluator(architecture)

    def compute(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None,
    ) -> Results:
        """Return the results; NaN where a simulation in Python failed.

        Raises the engine's errors, InputError for modules that are not installed, RunError where their code
        fails.
        """
        if controllers.architecture.get("kind") != PYTHON_KIND:
            return self._others.compute(controllers, seeds, on_progress, meanwhile)
        if meanwhile is not None:
            meanwhile()
        count, total = len(controllers.weights), len(controllers.weights) * len(seeds)
        fitness = np.full(total, np.nan)
        metrics = np.full((total, len(self.metrics)), np.nan)
        warnings: list[WarningEntry] = []
        report = _Report(on_progress, total)
        simulation = catalogue.playable(self._simulation)
        # All candidates with the first seed, then all with the next one: episodes beside each other are as
        # different as can be, and the last part is not made of one candidate.
        work = np.array([(c, e) for e in range(len(seeds)) for c in range(count)], dtype=np.int64)
        for first in range(0, total, self._together):
            part = work[first : first + self._together]
            places = part[:, 0] * len(seeds) + part[:, 1]
            episodes = _engine.Episodes(simulation, self.parameters, [seeds[e] for e in part[:, 1].tolist()])
            robots = Robots(episodes, controllers.architecture, controllers.weights, part[:, 0])
            try:
                with engine_errors():
                    while not episodes.done:
                        robots.step()
                        report(first)
                    fitness[places] = episodes.fitness()
                    metrics[places] = episodes.metrics(list(self.metrics))
            except RunError as error:
                if self._together > 1 or error.__cause__ is None or not _is_engines(error.__cause__):
                    raise
                candidate, episode = part[0].tolist()
                reason = str(error)
                warnings.append(WarningEntry(f"episode {episode} failed: {reason}", candidate, reason))
        report(total, last=True)
        shape = (count, len(seeds))
        return Results(fitness.reshape(shape), metrics.reshape(*shape, -1), Journal(warnings=warnings))


def _is_engines(error: BaseException) -> bool:
    return isinstance(error, _engine.EngineError)


class _Report:
    """Reports progress some ten times a second."""

    def __init__(self, on_progress: Progress, total: int) -> None:
        self._on_progress = on_progress
        self._total = total
        self._next = time.monotonic() + _REPORT_S

    def __call__(self, done: int, *, last: bool = False) -> None:
        now = time.monotonic()
        if last or now >= self._next:
            self._next = now + _REPORT_S
            self._on_progress(done, self._total, "")
