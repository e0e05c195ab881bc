"""The progress of a sweep: finished runs, active runs, and the remaining time."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean

from swarmwright.analysis.sweep.run import Listener, Task
from swarmwright.analysis.sweep.variants import Variant
from swarmwright.runs.optimization.generation import Generation, format_progress
from swarmwright.runs.run import Run

_ASSUMED_GENERATIONS = 1000  # generations, where their number is not known


@dataclass
class UnderWay:
    """An active run."""

    task: Task
    begun: float
    """By the clock, when it was begun or gone on with."""
    generation: Generation | None = None
    """The last one."""
    heard: float = 0.0
    """By the clock, when that was told."""
    part: float = 0.0
    """How much of the generation under way is evaluated, 0 to 1."""
    waiting_for: str = ""

    @property
    def done(self) -> int:
        """Generations that are done."""
        return 0 if self.generation is None else self.generation.generation + 1

    @property
    def share(self) -> float:
        """How much of the run is done, 0 to 1."""
        if self.generation is None:
            return self.part / (self.task.variant.experiment.budget.generations or _ASSUMED_GENERATIONS)
        share = self.generation.share
        return min(share + self.part * share / self.done, 1.0)

    @property
    def words(self) -> str:
        """Which run it is, and how far: "nnga, seed 2: 7 of 20 generations"."""
        far = format_progress(self.task.variant.experiment.budget, self.generation)
        return f"{self.task.variant.label}, seed {self.task.seed}: {far}"

    def left(self, now: float) -> float | None:
        """Return seconds that it still takes; None before anything is known."""
        if self.generation is None:
            return None
        return max(self.generation.seconds_left - (now - self.heard), 0.0)


class Status(Listener):
    """The progress of a sweep, for display.

    total: runs of the sweep. clock: returns seconds, from any origin.
    """

    def __init__(self, total: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.total = total
        self.jobs = 1
        self.finished = self.failures = self.elsewhere = 0
        self.under_way: dict[Task, UnderWay] = {}
        self._took: dict[Variant, list[float]] = {}
        self._waiting: list[Variant] = []

    def begin(self, tasks: Sequence[Task]) -> None:
        """Take note of all runs."""
        self._waiting = [task.variant for task in tasks]

    def found(self, task: Task, run: Run) -> None:
        """A run was finished before: it tells how long others of its variant will take."""
        self._end(task, run.seconds)
        self.finished += 1

    def finished_elsewhere(self, task: Task, run: Run) -> None:
        """Another process has done a run: it tells as much."""
        Status.found(self, task, run)

    def planned(self, runs: int, jobs: int) -> None:  # noqa: ARG002 - `begin` was told
        """Note how many there are at a time."""
        self.jobs = max(jobs, 1)

    def begun(self, task: Task) -> None:
        """Note when."""
        self.under_way[task] = UnderWay(task, self._clock())

    def generation(self, task: Task, generation: Generation) -> None:
        """Note how far it is."""
        run = self.under_way[task]
        run.generation, run.heard, run.part, run.waiting_for = generation, self._clock(), 0.0, ""

    def evaluating(self, task: Task, done: int, total: int, waiting_for: str) -> None:
        """Note how far the generation is."""
        run = self.under_way[task]
        run.part, run.waiting_for = (done / total if total else 0.0), waiting_for

    def ended(self, task: Task, run: Run) -> None:
        """Note how long it took."""
        self._end(task, run.seconds)
        self.finished += 1

    def failed(self, task: Task, message: str) -> None:  # noqa: ARG002 - who shows it has it
        """Count it."""
        self._end(task, None)
        self.failures += 1

    def busy(self, task: Task) -> None:
        """Count it."""
        self._end(task, None)
        self.elsewhere += 1

    def _end(self, task: Task, seconds: float | None) -> None:
        self.under_way.pop(task, None)
        self._waiting.remove(task.variant)
        if seconds is not None:
            self._took.setdefault(task.variant, []).append(seconds)

    def seconds_left(self) -> float | None:
        """Return an estimate of the time to the end; None before anything is known.

        A run that waits takes as long as others of its variant, finished or under way, or else as the mean of
        all variants of which something is known.
        """
        now = self._clock()
        known = {variant: list(seconds) for variant, seconds in self._took.items()}
        left = []
        for progress in self.under_way.values():
            rest = progress.left(now)
            if rest is not None:
                left.append(rest)
                if progress.task.variant not in self._took and progress.generation is not None:
                    known.setdefault(progress.task.variant, []).append(progress.generation.seconds + rest)
        if not known:
            return None
        means = {variant: fmean(seconds) for variant, seconds in known.items()}
        others = fmean(means.values())
        unknown = [run.task.variant for run in self.under_way.values() if run.left(now) is None]
        waiting = list(self._waiting)
        for progress in self.under_way.values():
            waiting.remove(progress.task.variant)
        left += [means.get(variant, others) for variant in unknown + waiting]
        return max(sum(left) / self.jobs, max(left, default=0.0))
