"""The progress of a sweep: finished runs, active runs, and the remaining time."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean

from swarmwright.analysis.sweep.run import Listener, Task
from swarmwright.analysis.sweep.variants import Variant
from swarmwright.runs.optimization.generation import Generation, format_progress
from swarmwright.runs.run import Run

_ASSUMED_GENERATIONS = 1000
"""Number of generations if it is unknown."""


@dataclass
class ActiveRun:
    """A run in progress."""

    task: Task
    start: float
    """Time of the clock when it started or resumed."""
    generation: Generation | None = None
    """The last finished generation."""
    report_time: float = 0.0
    """Time of the clock when that generation was reported."""
    part: float = 0.0
    """Evaluated share of the present generation, 0 to 1."""
    waiting_for: str = ""

    @property
    def done(self) -> int:
        """Number of finished generations."""
        return 0 if self.generation is None else self.generation.generation + 1

    @property
    def share(self) -> float:
        """Finished share of the run, 0 to 1."""
        if self.generation is None:
            return self.part / (self.task.variant.experiment.budget.generations or _ASSUMED_GENERATIONS)
        share = self.generation.share
        return min(share + self.part * share / self.done, 1.0)

    @property
    def words(self) -> str:
        """Label and progress: "nnga, seed 2: 7 of 20 generations"."""
        progress = format_progress(self.task.variant.experiment.budget, self.generation)
        return f"{self.task.variant.label}, seed {self.task.seed}: {progress}"

    def estimate_seconds_left(self, now: float) -> float | None:
        """Return the estimated remaining seconds; None before the first generation."""
        if self.generation is None:
            return None
        return max(self.generation.seconds_left - (now - self.report_time), 0.0)


class Status(Listener):
    """The progress of a sweep, for display.

    total: number of runs. clock: returns seconds, from any origin.
    """

    def __init__(self, total: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.total = total
        self.jobs = 1
        self.finished = self.failures = self.elsewhere = 0
        self.active_runs: dict[Task, ActiveRun] = {}
        self._durations: dict[Variant, list[float]] = {}
        self._waiting: list[Variant] = []

    def begin(self, tasks: Sequence[Task]) -> None:
        """Set the runs of the sweep."""
        self._waiting = [task.variant for task in tasks]

    def on_already_finished(self, task: Task, run: Run) -> None:
        """Count a run that was finished before; its duration is the estimate for its variant."""
        self._end(task, run.seconds)
        self.finished += 1

    def on_finished_elsewhere(self, task: Task, run: Run) -> None:
        """Count a run that another process has finished."""
        Status.on_already_finished(self, task, run)

    def on_plan(self, runs: int, jobs: int) -> None:  # noqa: ARG002 - `begin` has the runs
        """Set the number of parallel runs."""
        self.jobs = max(jobs, 1)

    def on_begin(self, task: Task) -> None:
        """Add an active run."""
        self.active_runs[task] = ActiveRun(task, self._clock())

    def generation(self, task: Task, generation: Generation) -> None:
        """Set the last generation of a run."""
        run = self.active_runs[task]
        run.generation, run.report_time, run.part, run.waiting_for = generation, self._clock(), 0.0, ""

    def evaluating(self, task: Task, done: int, total: int, waiting_for: str) -> None:
        """Set the progress of a generation."""
        run = self.active_runs[task]
        run.part, run.waiting_for = (done / total if total else 0.0), waiting_for

    def on_end(self, task: Task, run: Run) -> None:
        """Count a finished run and its duration."""
        self._end(task, run.seconds)
        self.finished += 1

    def on_failure(self, task: Task, message: str) -> None:  # noqa: ARG002 - displayed by subclasses
        """Count a failed run."""
        self._end(task, None)
        self.failures += 1

    def busy(self, task: Task) -> None:
        """Count a run of another process."""
        self._end(task, None)
        self.elsewhere += 1

    def _end(self, task: Task, seconds: float | None) -> None:
        self.active_runs.pop(task, None)
        self._waiting.remove(task.variant)
        if seconds is not None:
            self._durations.setdefault(task.variant, []).append(seconds)

    def seconds_left(self) -> float | None:
        """Return the estimated remaining time of the sweep; None before the first generation.

        A waiting run is estimated by the mean of its variant, from finished and active runs, or else by the
        mean of all variants with an estimate.
        """
        now = self._clock()
        durations = {variant: list(seconds) for variant, seconds in self._durations.items()}
        remaining = []
        for run in self.active_runs.values():
            seconds_left = run.estimate_seconds_left(now)
            if seconds_left is not None:
                remaining.append(seconds_left)
                if run.task.variant not in self._durations and run.generation is not None:
                    total = run.generation.seconds + seconds_left
                    durations.setdefault(run.task.variant, []).append(total)
        if not durations:
            return None
        means = {variant: fmean(seconds) for variant, seconds in durations.items()}
        overall_mean = fmean(means.values())
        unknown = [run.task.variant for run in self.active_runs.values() if run.generation is None]
        waiting = list(self._waiting)
        for run in self.active_runs.values():
            waiting.remove(run.task.variant)
        remaining += [means.get(variant, overall_mean) for variant in unknown + waiting]
        return max(sum(remaining) / self.jobs, max(remaining, default=0.0))
