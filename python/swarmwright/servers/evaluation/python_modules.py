"""Evaluation of machines with Python modules in this process."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from swarmwright import _engine
from swarmwright.common.errors import RunError, SimulationError
from swarmwright.common.simulation_names import is_python
from swarmwright.controllers.modules.grammar import PYTHON_KIND
from swarmwright.experiment.experiment import Experiment
from swarmwright.servers.evaluation.base import CodeFailures, Controllers, Progress, Results
from swarmwright.servers.evaluation.in_process import (
    Failure,
    InProcessBackend,
    PythonBackend,
    Repetition,
    Value,
)
from swarmwright.servers.evaluation.served_modules import LANES, MachineEvaluations
from swarmwright.simulations import catalogue

_REPORT_S = 0.1


class ModulesBackend(InProcessBackend):
    """Backend for machines with Python modules in this process, many episodes side by side.

    Other controllers are evaluated by the backend of the simulation.
    """

    def __init__(self, experiment: Experiment, metrics: Sequence[str] = ()) -> None:
        super().__init__(experiment, metrics)
        python = is_python(experiment.simulation)
        self._fallback = (PythonBackend if python else InProcessBackend)(experiment, metrics)
        self._together = 1 if python else LANES
        # The simulation's declared determinism does not cover modules.
        self._repetition = Repetition(experiment.faults.attempts, bitwise=False)
        self._code_failures = CodeFailures()
        self.description = "in this process (behaviours in Python)"

    def evaluator(self, architecture: dict[str, Any]) -> _engine.Evaluator | None:
        """Return None for machines with Python modules."""
        return None if architecture.get("kind") == PYTHON_KIND else self._fallback.evaluator(architecture)

    def compute(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None,
    ) -> Results:
        """Return the results; NaN if a Python simulation failed in all attempts.

        Raises the engine's errors, InputError for modules that are not installed, RunError if their code
        fails.
        """
        if controllers.architecture.get("kind") != PYTHON_KIND:
            return self._fallback.compute(controllers, seeds, on_progress, meanwhile)
        if meanwhile is not None:
            meanwhile()
        work = self._work(controllers, seeds)
        failures: list[Failure] = []
        report = _Report(on_progress, work.total)
        started = time.time()
        more = True
        while more:
            try:
                more = work.step()
            except RunError as error:
                failures.append(self._failure_of(work, error))
            report(work.done)
        fitness, metrics = work.fitness(), work.metrics()

        def retry(candidate: int, episode: int) -> Value | Failure:
            report(work.done)
            part = self._work(
                Controllers(controllers.architecture, controllers.weights[candidate : candidate + 1]),
                seeds[episode : episode + 1],
            )
            try:
                while part.step():
                    report(work.done)
            except RunError as error:
                return self._failure_of(part, error)
            return Value(float(part.fitness()[0, 0]), part.metrics()[0, 0])

        journal = self._repetition(failures, fitness, metrics, retry, started)
        self._code_failures.note(journal)
        report(work.total, last=True)
        return Results(fitness, metrics, journal)

    def _work(self, controllers: Controllers, seeds: Sequence[int]) -> MachineEvaluations:
        return MachineEvaluations(
            catalogue.make_playable(self._simulation),
            self.parameters,
            controllers.architecture,
            controllers.weights,
            seeds,
            self.metrics,
            together=self._together,
        )

    def _failure_of(self, work: MachineEvaluations, error: RunError) -> Failure:
        """Return the failed evaluation; raise the error if a module failed rather than the simulation."""
        stack = error.stack if isinstance(error, SimulationError) else None
        of_simulation = isinstance(error, SimulationError) or isinstance(error.__cause__, _engine.EngineError)
        if self._together > 1 or not of_simulation:
            raise error
        candidate, episode = work.part[0].tolist()
        return Failure(candidate, episode, str(error), stack)

    def failure_of(self, reason: str, /) -> SimulationError | None:
        """Return the error of the simulation's code for a reason in a journal; None for other reasons."""
        return self._code_failures.find_error(reason) or self._fallback.failure_of(reason)

    def incidents(self) -> dict[str, int]:
        """Return the numbers of retries and of evaluations that failed in all attempts."""
        retries = self._repetition.retries + self._fallback.incidents().get("retries", 0)
        return ({"retries": retries} if retries else {}) | super().incidents()


class _Report:
    """Reports progress about ten times a second."""

    def __init__(self, on_progress: Progress, total: int) -> None:
        self._on_progress = on_progress
        self._total = total
        self._next = time.monotonic() + _REPORT_S

    def __call__(self, done: int, *, last: bool = False) -> None:
        now = time.monotonic()
        if last or now >= self._next:
            self._next = now + _REPORT_S
            self._on_progress(done, self._total, "")
