"""`swarmwright sweep`: an experiment in many variants, and how they compare."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._observing import Observing, ToolObserver, observe_options, observed
from swarmwright.cli._options import (
    ExistingPath,
    Servers,
    broker_option,
    experiment_broker,
    json_option,
    servers_option,
)
from swarmwright.cli._output import Output, show_warnings
from swarmwright.cli._signals import INTERRUPTED, check

if TYPE_CHECKING:
    from swarmwright import Generation, Run
    from swarmwright._sweep import Crew, Task

FAILED = 1


@click.command(
    "sweep",
    cls=Command,
    example="swarmwright sweep methods.yaml --servers 4\nswarmwright sweep methods.yaml --out results",
)
@click.argument("file", type=ExistingPath(), metavar="FILE")
@broker_option(
    default=None,
    text="Use the servers on this broker. Default: FILE's, SWARMWRIGHT_BROKER's, or one started here.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder for the runs. Default: the file's, else runs/ and the file's name.",
)
@servers_option
@observe_options
@json_option
def command(
    file: Path,
    broker: str | None,
    out: Path | None,
    servers: Servers | None,
    log: Path | None,
    log_level: str,
    metrics: tuple[str, int] | None,
    as_json: bool,
) -> int:
    """Run an experiment in every variant and with every seed that FILE names, and compare them.

    All runs share one broker and its servers. A run that is finished is not run again, one that was
    interrupted goes on: after Ctrl-C the same command continues. At the end the comparison is printed, and
    drawn into comparison.png in the folder of the runs.
    """
    from swarmwright._sweep import Crew, Sweep, tasks

    output = Output(as_json=as_json)
    show_warnings()
    sweep = Sweep.load(file, out=out)
    first = sweep.variants[0].experiment
    broker = experiment_broker(broker, first.broker, servers if servers is not None else first.servers)
    todo = tasks(sweep)
    for task in todo:
        task.found()  # complain before anything is started
    output.text(
        f"{_count(len(sweep.variants), 'variant')} with {_count(len(sweep.seeds), 'seed')} each: "
        f"{_count(len(todo), 'run')} in {sweep.out}"
    )
    interrupted = False
    with observed(output, Observing(log, log_level, metrics)) as observer:
        progress = _Progress(output, observer, len(todo))
        try:
            with Crew(sweep, broker=broker, servers=servers) as crew:
                for task in todo:
                    if not progress.do(crew, task):
                        interrupted = True
                        break
        except KeyboardInterrupt:
            interrupted = True
    if progress.done:
        _conclude(output, progress.done, sweep.out)
    if interrupted:
        output.text(f"Interrupted after {len(progress.done)} of {len(todo)} runs; the same command goes on.")
        return INTERRUPTED
    return FAILED if progress.failed else 0


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


class _Progress:
    """Does tasks and says how each ended."""

    def __init__(self, output: Output, observer: ToolObserver, total: int) -> None:
        self._output = output
        self._observer = observer
        self._total = total
        self._count = 0
        self.done: list[Run] = []
        self.failed = 0

    def do(self, crew: "Crew", task: "Task") -> bool:
        """Do a task; whether to go on with the next one."""
        from swarmwright import RunError

        self._count += 1
        before = task.found()
        if before is not None and not before.interrupted:
            self._say(task, before, "was finished before")
            return True
        self._observer.started(task.experiment)
        try:
            run = crew.run(task, self._generation)
        except RunError as error:
            self._observer.log.write("error", "run_failed", seed=task.seed, message=str(error))
            self.failed += 1
            self._output.text(f"{self._where(task)}: failed: {error}")
            self._output.json({"variant": task.variant.label, "seed": task.seed, "error": str(error)})
            return True
        self._observer.ended(run)
        if run.interrupted:
            return False
        self._say(task, run, f"{run.seconds:.1f} s")
        return True

    def _generation(self, generation: "Generation") -> bool:
        check()
        self._observer.generation(generation)
        return True

    def _where(self, task: "Task") -> str:
        return f"[{self._count}/{self._total}] {task.variant.label}, seed {task.seed}"

    def _say(self, task: "Task", run: "Run", how: str) -> None:
        self.done.append(run)
        best = run.history[-1].best_so_far
        self._output.text(
            f"{self._where(task)}: best fitness {best + 0.0:.6g}, {run.evaluations:,} evaluations, {how}"
        )
        self._output.json(
            {
                "variant": task.variant.label, "seed": task.seed, "run": str(run.path), "fitness": best,
                "evaluations": run.evaluations,
            }
        )  # fmt: skip


def _conclude(output: Output, runs: "list[Run]", folder: Path) -> None:
    from swarmwright import compare

    comparison = compare(runs)
    picture = comparison.plot(folder / "comparison.png")
    output.text(f"\n{comparison}\nThe figure is in {picture}")
    output.json({"comparison": comparison.to_mapping(), "picture": str(picture)})
