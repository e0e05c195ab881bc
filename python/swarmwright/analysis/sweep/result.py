"""Sweeps in Python."""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.analysis.comparison import (
    Comparison,
    Order,
    check_options,
    compare_all,
    compare_opened,
    held_out_known,
)
from swarmwright.analysis.episodes import LeftOut, episodes_of, left_out
from swarmwright.analysis.groups import as_written, differing_keys, flattened_of, written_missions
from swarmwright.analysis.indicators import By, measure, quick_indicators
from swarmwright.analysis.sweep.execution import conduct
from swarmwright.analysis.sweep.file import Sweep
from swarmwright.analysis.sweep.remaining import Status
from swarmwright.analysis.sweep.run import Listener, Task, tasks
from swarmwright.analysis.sweep_folders import variant_of
from swarmwright.analysis.table import option_columns
from swarmwright.common.arguments import check_arguments, path_of
from swarmwright.common.errors import InputError
from swarmwright.common.formatting import format_duration
from swarmwright.common.html import Text, facts, is_notebook, table
from swarmwright.experiment.experiment import Experiment
from swarmwright.runs.metric_curves import Names
from swarmwright.runs.run import Run
from swarmwright.servers.evaluation.base import Servers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swarmwright.runs.optimization.generation import Generation


_MOST_JOBS = 1024


@dataclass(frozen=True)
class Failure:
    """A run that failed."""

    variant: str
    """The label of its variant."""
    seed: int
    message: str


@dataclass(frozen=True)
class SweepResult:
    """The result of a sweep; made by `swarmwright.sweep`."""

    path: Path
    """The folder of the runs."""
    runs: tuple[Run, ...]
    """Finished runs: every variant with the first seed, then with the next one."""
    labels: tuple[str, ...]
    """The label of each run's variant."""
    failures: tuple[Failure, ...]
    """Runs that failed, and why."""
    interrupted: bool
    """Whether Ctrl-C ended it before all runs were done; the same call goes on."""
    busy: tuple[Path, ...] = ()
    """Folders of runs that another process works on; they are not among `runs`."""
    unfinished: tuple[Run, ...] = ()
    """Runs that have begun and not finished: they failed or were interrupted, for example."""
    unreadable: tuple[LeftOut, ...] = ()
    """Runs that are missing or cannot be read."""

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Runs that do not count in tables and comparisons, and why: the unfinished and unreadable ones."""
        found = []
        for run in self.unfinished:
            variant = variant_of(run.path)
            label = "" if variant is None else variant[0]
            found.append(left_out(run, label, None, None, unfinished=False))
        return (*(candidate for candidate in found if candidate is not None), *self.unreadable)

    def table(self) -> list[dict[str, Any]]:
        """Return a row for each run, for `pandas.DataFrame(result.table())` and the like.

        Keys: variant, seed, left_out (why the run does not count, else empty), fitness (the best of the run;
        NaN for runs that do not count, which come last), held_out (its fitness on held-out seeds; NaN where
        it was not validated, or where fitness does not depend on the seed), held_out_failed (held-out
        episodes of the best that failed, which held_out leaves out unless `ranking.failed` is a number),
        evaluations, failed (of these evaluations), episodes, failed_episodes, generations, seconds, run (its
        folder), then what the experiments differ in, such as
        method.population; with several methods, each has keys for its options, such as method.cma_es.step.
        Where all runs can be compared by them, before these: hypervolume (where it takes little time: fronts
        of at most 1,000 candidates with three objectives, fitness included, or 300 with four), or qd_score
        and coverage, as `compare` has them.
        """
        missions = written_missions(self.runs)
        experiments = [as_written(flattened_of(run), run, missions) for run in self.runs]
        differing = option_columns(list(zip(experiments, differing_keys(experiments), strict=True)))
        of_runs = {by: measure(by, self.runs)[1] for by in quick_indicators(self.runs)}
        without = dict.fromkeys(["fitness", "held_out", *of_runs], math.nan)
        return [
            {
                "variant": label,
                "seed": run.experiment.seed,
                "left_out": "",
                "fitness": run.history[-1].best_so_far,
                "held_out": math.nan if run.unseen is None else run.unseen.fitness.mean,
                "held_out_failed": 0 if run.validation is None else run.validation.best.failed,
                "evaluations": run.evaluations,
                "failed": run.failed_evaluations,
                "episodes": episodes_of(run, run.evaluations),
                "failed_episodes": run.failed_episodes,
                "generations": run.generations,
                "seconds": run.seconds,
                "run": str(run.path),
                **{by: values[index] for by, values in of_runs.items()},
                **keys,
            }
            for index, (run, label, keys) in enumerate(zip(self.runs, self.labels, differing, strict=True))
        ] + [
            {
                "variant": missing_run.label,
                "seed": missing_run.seed,
                "left_out": missing_run.reason,
                **without,
                "evaluations": missing_run.evaluations,
                "run": str(missing_run.path),
            }
            for missing_run in self.left_out
        ]

    @check_arguments
    def compare(
        self,
        *,
        at: int | None = None,
        at_episodes: int | None = None,
        held_out: bool = False,
        by: By = "fitness",
        reference: Mapping[str, float] | None = None,
        offset: float | None = None,
        unfinished: bool = False,
        order: Order = "rank",
        labels: Mapping[str, str] | None = None,
    ) -> Comparison:
        """Compare the variants; see `swarmwright.compare`. Raises InputError when no run counts."""
        check_options(at, at_episodes, by, reference, offset, held_out=held_out)
        return compare_opened(
            (*self.runs, *self.unfinished),
            self.unreadable,
            at=at,
            at_episodes=at_episodes,
            held_out=held_out,
            by=by,
            reference=reference,
            offset=offset,
            unfinished=unfinished,
            order=order,
            labels=labels,
        )

    @check_arguments
    def plot(
        self,
        path: str | PathLike[str] | None = None,
        *,
        x: str = "evaluations",
        metrics: Names | None = None,
        style: str = "screen",
        width: str | float | None = None,
        title: str | None = None,
    ) -> "Figure":
        """Return the figure of the comparison; write it as well where a path is given (.png, .svg, .pdf).

        Beside the curves of recorded fitness, it has fitness on held-out seeds where all runs were validated
        and fitness depends on the seed. Caveats of the comparison, which a figure does not show, are logged
        as warnings of the logger "swarmwright".

        The arguments are those of `Comparison.figure`.
        """
        from swarmwright.display.figures.style import save

        comparison = self.compare(held_out=held_out_known(self.runs))
        for note in comparison.notes:
            logging.getLogger("swarmwright").warning("%s", note)
        figure = comparison.figure(x=x, metrics=metrics, style=style, width=width, title=title)
        if path is not None:
            save(figure, Path(path))
        return figure

    def __str__(self) -> str:
        """Return what the command `sweep` prints at the end: comparisons with their caveats, and failures."""
        failed = (
            f"Failed: {failure.variant}, seed {failure.seed}: {failure.message}" for failure in self.failures
        )
        comparisons = compare_all((*self.runs, *self.unfinished), self.unreadable)
        return "\n\n".join([repr(self), *map(str, comparisons), *failed])

    def __repr__(self) -> str:
        """Name the folder and how many runs there are."""
        failed = f", {len(self.failures)} failed" if self.failures else ""
        failed += f", {len(self.left_out)} left out" if self.left_out else ""
        busy = f", {len(self.busy)} left to other processes" if self.busy else ""
        return f"<SweepResult {self.path}: {len(self.runs)} runs{failed}{busy}>"

    def _repr_html_(self) -> str:
        """Return the runs as a table, for notebooks."""
        rows = [
            (label, run.experiment.seed, f"{run.history[-1].best_so_far:.6g}", f"{run.evaluations:,}")
            for run, label in zip(self.runs, self.labels, strict=True)
        ]
        failed = [
            (f"failed: {failure.variant}, seed {failure.seed}", failure.message) for failure in self.failures
        ]
        state = [("interrupted", "the same call goes on")] if self.interrupted else []
        without = f", {len(self.left_out)} left out" if self.left_out else ""
        title = f"Sweep in {self.path}: {len(self.runs)} runs{without}"
        return facts(title, [*failed, *state]) + table(
            ("variant", "seed", "best fitness", "evaluations"), rows
        )


@check_arguments
def sweep(
    source: Experiment | str | PathLike[str] | Mapping[str, Any],
    grid: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    *,
    seeds: int | Sequence[int] | None = None,
    jobs: int | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    out: str | PathLike[str] | None = None,
    progress: bool | None = None,
) -> SweepResult:
    """Run an experiment in every variant and with every seed; return what came out.

    A run that is finished is not run again, one that was interrupted goes on: after Ctrl-C, the same call
    continues. More seeds, values or larger limits extend a sweep: finished runs go on to the larger limits. A
    run that fails does not stop the others; one that another process works on is left to it.

    Args:
        source: path of a sweep file; of the sweep.json of a sweep, which is repeated, or completed in its
            folder without `out`; or a mapping with a file's keys: `experiment` (an `Experiment`, a mapping,
            or the path of a file), `grid` (a mapping from keys such as "method.population" to lists of
            values, or a list of such mappings), `seeds` (how many, or a list; default 5), `out`. An
            `Experiment`, or with `grid` or `seeds` also its mapping or the path of its file, is the
            experiment.
        grid: of an experiment: from keys such as "method.population" to lists of values, of which every
            combination is a variant, or a list of such mappings; default: the experiment alone.
        seeds: of an experiment: how many, or a list; default 5.
        jobs: runs at a time, in separate processes. Default: one for each processor with servers
            "local", one for each server that is started; on a broker as many as its servers can serve. The
            records do not depend on it. Simulations of a notebook are run one after the other.
        broker: as in `optimize`.
        servers: as in `optimize`, for all runs together.
        out: folder for the runs; default: the source's, else runs/ and the name of the file.
        progress: show how far it is; default: in a notebook.

    Raises:
        InputError: the source or a variant is wrong, or a folder holds something else.
        RunError: no broker, or servers do not start.

    Examples:
        >>> study = swarmwright.sweep(
        ...     {"simulation": "minisim", "method": {"population": 10, "generations": 2}},
        ...     {"method.kind": ["nnga", "random_search"]},
        ...     seeds=2,
        ...     servers="in-process",
        ...     out="two",
        ... )
        >>> [run.path.name for run in study.runs]
        ['nnga-1', 'random_search-1', 'nnga-2', 'random_search-2']

    See also: `compare`, for the statistics of the runs.
    """
    if jobs is not None and not 1 <= jobs <= _MOST_JOBS:
        raise InputError(f"jobs: must be from 1 to {_MOST_JOBS}, not {jobs}")
    folder = None if out is None else Path(out)
    source = _with_grid(source, grid, seeds)
    loaded = (
        Sweep.from_mapping(source, out=folder)
        if isinstance(source, Mapping)
        else Sweep.load(path_of("source", source, "a file of a sweep"), out=folder)
    )
    todo = tasks(loaded)
    wanted = is_notebook() if progress is None else progress
    listener = _Shown(todo) if wanted else Listener()
    outcome = conduct(loaded, todo, listener, jobs=jobs, broker=broker, servers=servers)
    if isinstance(listener, _Shown):
        listener.close()
    finished = [task for task in todo if task in outcome.runs]
    read, unreadable = outcome.compared()
    return SweepResult(
        loaded.out,
        tuple(outcome.runs[task] for task in finished),
        tuple(task.variant.label for task in finished),
        tuple(Failure(task.variant.label, task.seed, message) for task, message in outcome.failures.items()),
        outcome.interrupted,
        tuple(task.folder for task in outcome.busy),
        tuple(run for run in read if run not in outcome.finished),
        tuple(unreadable),
    )


def _with_grid(
    source: Experiment | str | PathLike[str] | Mapping[str, Any],
    grid: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None,
    seeds: int | Sequence[int] | None,
) -> str | PathLike[str] | Mapping[str, Any]:
    """Return the source of a sweep; an experiment with its grid and seeds as a mapping."""
    given = {key: value for key, value in (("grid", grid), ("seeds", seeds)) if value is not None}
    if not isinstance(source, Experiment):
        if not given:
            return source
        if isinstance(source, Mapping) and "experiment" in source:
            raise InputError(
                f"{next(iter(given))}: belongs to an experiment, and this source is a sweep, which has a key "
                "of that name itself"
            )
    return {"experiment": source, **given}


class _Shown(Status):
    """Shows how far a sweep is, as a text that is replaced."""

    def __init__(self, todo: list[Task]) -> None:
        super().__init__(len(todo))
        self.begin(todo)
        self._text = Text()

    def generation(self, task: Task, generation: "Generation") -> None:
        """Show it."""
        super().generation(task, generation)
        self.tick()

    def tick(self) -> None:
        """Show it."""
        self._text.show(self._line())

    def close(self) -> None:
        """Show the last state."""
        self._text.show(self._line(), at_once=True)
        self._text.close()

    def _line(self) -> str:
        failed = f", {self.failures} failed" if self.failures else ""
        left = self.seconds_left()
        rest = f", {format_duration(left)} left" if left is not None and self.under_way else ""
        running = "; ".join(run.words for run in list(self.under_way.values())[:4])
        return f"{self.finished} of {self.total} runs done{failed}{rest}" + (
            f"; {running}" if running else ""
        )
