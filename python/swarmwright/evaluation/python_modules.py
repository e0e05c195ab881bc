"""Evaluation of machines with modules in Python in this process."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from swarmwright import _engine
from swarmwright.core.errors import RunError
from swarmwright.core.modules import PYTHON_KIND
from swarmwright.core.simulation_names import is_python
from swarmwright.evaluation.base import Controllers, Progress, Results
from swarmwright.evaluation.in_process import InProcessBackend, PythonBackend
from swarmwright.evaluation.machines import TOGETHER, MachineEvaluations
from swarmwright.experiment.experiment import Experiment
from swarmwright.simulations import catalogue
from swarmwright.store import Journal, WarningEntry

_REPORT_S = 0.1


class ModulesBackend(InProcessBackend):
    """Evaluates machines with modules in Python in this process, many episodes side by side.

    Controllers that the engine computes are evaluated as usual.
    """

    def __init__(self, experiment: Experiment, metrics: Sequence[str] = ()) -> None:
        super().__init__(experiment, metrics)
        python = is_python(experiment.simulation)
        self._others = (PythonBackend if python else InProcessBackend)(experiment, metrics)
        self._together = 1 if python else TOGETHER
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
        work = MachineEvaluations(
            catalogue.playable(self._simulation),
            self.parameters,
            controllers.architecture,
            controllers.weights,
            seeds,
            self.metrics,
            together=self._together,
        )
        warnings: list[WarningEntry] = []
        report = _Report(on_progress, work.total)
        more = True
        while more:
            try:
                more = work.step()
            except RunError as error:
                if self._together > 1 or not isinstance(error.__cause__, _engine.EngineError):
                    raise
                candidate, episode = work.part[0].tolist()
                reason = str(error)
                warnings.append(WarningEntry.of_episode(episode, f" failed: {reason}", candidate, reason))
            report(work.done)
        report(work.total, last=True)
        return Results(work.fitness(), work.metrics(), Journal(warnings=warnings))


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
