"""Messages about the runs of a sweep as they end, in the order in which they were begun."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from swarmwright import Generation, Run
from swarmwright.analysis.sweep import Task
from swarmwright.analysis.sweep.remaining import Status
from swarmwright.cli._observing import ToolObserver
from swarmwright.cli._output import Output
from swarmwright.cli._signals import check
from swarmwright.cli._sweep_progress import PlainStatus, shown
from swarmwright.cli._validation import unseen_facts, with_error
from swarmwright.runs.callbacks import TensorBoard


class Report(Status):
    """Says how each run ended, and shows how far the others are.

    Runs side by side end in any order; their messages come in the order of the tasks, so that the output is
    reproducible.
    """

    def __init__(
        self, output: Output, observer: ToolObserver, tasks: Sequence[Task], tensorboard: Path | None = None
    ) -> None:
        super().__init__(len(tasks))
        self.begin(tasks)
        self._output = output
        self._observer = observer
        self._tasks = list(tasks)
        self._ready: dict[Task, Callable[[], None]] = {}
        self._said = 0
        self._tensorboard = tensorboard
        self._writers: dict[Task, TensorBoard] = {}
        self._tick: Callable[[], None] = PlainStatus(output, self).tick

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show how far it is, for the time of a `with` block."""
        try:
            with shown(self._output, self) as status:
                self._tick = status.tick
                yield
        finally:
            for task in list(self._writers):
                self._close(task)

    def found(self, task: Task, run: Run) -> None:
        """Say that a run was finished before."""
        super().found(task, run)
        self._say(task, lambda: self._ended(task, run, "was finished before"))

    def finished_elsewhere(self, task: Task, run: Run) -> None:
        """Say that another process did it."""
        super().finished_elsewhere(task, run)
        self._say(task, lambda: self._ended(task, run, "finished by another process"))

    def begun(self, task: Task) -> None:
        """Tell programs that watch."""
        super().begun(task)
        self._observer.started(task.experiment)
        if self._tensorboard is not None:
            self._writers[task] = TensorBoard(self._tensorboard / task.folder.name, task.experiment)

    def generation(self, task: Task, generation: Generation) -> None:
        """Tell programs that watch, and show it."""
        check()
        super().generation(task, generation)
        self._observer.generation(generation)
        if task in self._writers:
            self._writers[task](generation)
        self._tick()

    def evaluating(self, task: Task, done: int, total: int, waiting_for: str) -> None:
        """Show it."""
        super().evaluating(task, done, total, waiting_for)
        self._tick()

    def ended(self, task: Task, run: Run) -> None:
        """Say what came out."""
        super().ended(task, run)
        self._observer.ended(run)
        if task in self._writers:
            self._writers[task].conclude(run)
            self._close(task)
        self._say(task, lambda: self._ended(task, run, f"{run.seconds:.1f} s"))

    def failed(self, task: Task, message: str) -> None:
        """Say why."""
        super().failed(task, message)
        self._close(task)
        self._observer.log.write("error", "run_failed", seed=task.seed, message=message)
        self._say(task, lambda: self._failed(task, message))

    def busy(self, task: Task) -> None:
        """Say that another process does it."""
        super().busy(task)
        self._close(task)
        self._say(task, lambda: self._busy(task))

    def tick(self) -> None:
        """Show how far it is."""
        self._tick()

    def conclude(self) -> None:
        """Print what was held back for runs that no longer end."""
        for task in self._tasks[self._said :]:
            if task in self._ready:
                self._ready.pop(task)()

    def _close(self, task: Task) -> None:
        """Write what is left for TensorBoard of a run that has ended."""
        writer = self._writers.pop(task, None)
        if writer is not None:
            writer.close()

    def _say(self, task: Task, say: Callable[[], None]) -> None:
        self._ready[task] = say
        while self._said < len(self._tasks) and self._tasks[self._said] in self._ready:
            self._ready.pop(self._tasks[self._said])()
            self._said += 1

    def _where(self, task: Task) -> str:
        return f"[{self._tasks.index(task) + 1}/{self.total}] {task.variant.label}, seed {task.seed}"

    def _ended(self, task: Task, run: Run, how: str) -> None:
        best, unseen = run.history[-1].best_so_far, run.unseen
        held_out = ""
        if unseen is not None:
            lost = f", {unseen.failed_words}" if unseen.failed else ""
            held_out = (
                f" ({with_error(unseen.fitness.mean, unseen.fitness.standard_error)} on held-out seeds{lost})"
            )
        failed = f" of which {run.failed_evaluations:,} failed," if run.failed_evaluations else ""
        self._output.text(
            f"{self._where(task)}: best fitness {best + 0.0:.6g}{held_out}, {run.evaluations:,} evaluations,"
            f"{failed} {how}"
        )
        self._output.json(
            {
                "variant": task.variant.label, "seed": task.seed, "run": str(run.path), "fitness": best,
                "evaluations": run.evaluations, "failed": run.failed_evaluations,
            }
            | ({} if unseen is None else {"unseen": unseen_facts(unseen)})
        )  # fmt: skip

    def _failed(self, task: Task, message: str) -> None:
        self._output.item(f"{self._where(task)}: failed: {message}")
        self._output.json({"variant": task.variant.label, "seed": task.seed, "error": message})

    def _busy(self, task: Task) -> None:
        self._output.text(f"{self._where(task)}: left to another process, which works on it")
        self._output.json({"variant": task.variant.label, "seed": task.seed, "state": "running"})
