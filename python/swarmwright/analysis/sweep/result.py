"""The Python interface of sweeps."""

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
    has_held_out_fitness,
)
from swarmwright.analysis.episodes import LeftOut, episodes_of, find_exclusion
from swarmwright.analysis.groups import (
    collect_mission_names,
    differing_keys,
    flatten_experiment,
    restore_mission_names,
)
from swarmwright.analysis.indicators import By, find_quick_indicators, measure
from swarmwright.analysis.sweep.execution import conduct
from swarmwright.analysis.sweep.file import Sweep
from swarmwright.analysis.sweep.remaining import Status
from swarmwright.analysis.sweep.run import Listener, Task, list_tasks
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
    """A failed run."""

    variant: str
    """Label of its variant."""
    seed: int
    message: str


@dataclass(frozen=True)
class SweepResult:
    """The result of a sweep, from `swarmwright.sweep`."""

    path: Path
    """Folder of the runs."""
    runs: tuple[Run, ...]
    """Finished runs: all variants with the first seed, then with the next seed."""
    labels: tuple[str, ...]
    """Label of each run's variant."""
    failures: tuple[Failure, ...]
    """Failed runs with their reasons."""
    interrupted: bool
    """Whether Ctrl-C ended the sweep early; the same call continues it."""
    busy: tuple[Path, ...] = ()
    """Folders of runs that another process works on; they are not in `runs`."""
    unfinished: tuple[Run, ...] = ()
    """Runs that have begun but not finished, for example because they failed or were interrupted."""
    unreadable: tuple[LeftOut, ...] = ()
    """Runs that are missing or cannot be read."""

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Excluded runs with their reasons: the unfinished and unreadable runs."""
        excluded = []
        for run in self.unfinished:
            variant = variant_of(run.path)
            label = "" if variant is None else variant[0]
            excluded.append(find_exclusion(run, label, None, None, unfinished=False))
        return (*(entry for entry in excluded if entry is not None), *self.unreadable)

    def table(self) -> list[dict[str, Any]]:
        """Return a row for each run, for example for `pandas.DataFrame(result.table())`.

        Keys: variant, seed, left_out (the reason of an excluded run, otherwise empty), fitness (the best of
        the run; NaN for excluded runs, which come last), held_out (its fitness on held-out seeds; NaN without
        a validation, or if fitness does not depend on the seed), held_out_failed (failed held-out episodes of
        the best, which held_out excludes unless `ranking.failed` is a number), evaluations, failed (failed
        evaluations), episodes, failed_episodes, generations, seconds, run (its folder), then the keys in
        which the experiments differ, such as method.population; with several methods, each has keys for its
        options, such as method.cma_es.step. If all runs have them, these are preceded by hypervolume (if it
        is computed quickly: fronts of at most 1,000 candidates with three objectives, including fitness, or
        300 with four), or by qd_score and coverage, as in `compare`.
        """
        missions = collect_mission_names(self.runs)
        experiments = [restore_mission_names(flatten_experiment(run), run, missions) for run in self.runs]
        differing = option_columns(list(zip(experiments, differing_keys(experiments), strict=True)))
        indicators = {by: measure(by, self.runs)[1] for by in find_quick_indicators(self.runs)}
        missing = dict.fromkeys(["fitness", "held_out", *indicators], math.nan)
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
                **{by: values[index] for by, values in indicators.items()},
                **keys,
            }
            for index, (run, label, keys) in enumerate(zip(self.runs, self.labels, differing, strict=True))
        ] + [
            {
                "variant": missing_run.label,
                "seed": missing_run.seed,
                "left_out": missing_run.reason,
                **missing,
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
        """Draw the comparison; return the figure, and write it to a path if given (.png, .svg, .pdf).

        Besides the curves of recorded fitness, it shows fitness on held-out seeds if all runs were validated
        and fitness depends on the seed. The notes of the comparison, which a figure does not show, are logged
        as warnings of the logger "swarmwright".

        The other arguments are those of `Comparison.figure`.
        """
        from swarmwright.display.figures.style import save

        comparison = self.compare(held_out=has_held_out_fitness(self.runs))
        for note in comparison.notes:
            logging.getLogger("swarmwright").warning("%s", note)
        figure = comparison.figure(x=x, metrics=metrics, style=style, width=width, title=title)
        if path is not None:
            save(figure, Path(path))
        return figure

    def __str__(self) -> str:
        """Return the report of the command `sweep`: comparisons with their notes, and failures."""
        failed = (
            f"Failed: {failure.variant}, seed {failure.seed}: {failure.message}" for failure in self.failures
        )
        comparisons = compare_all((*self.runs, *self.unfinished), self.unreadable)
        return "\n\n".join([repr(self), *map(str, comparisons), *failed])

    def __repr__(self) -> str:
        """Return the folder and the numbers of runs."""
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
        state = [("interrupted", "the same call continues")] if self.interrupted else []
        excluded = f", {len(self.left_out)} left out" if self.left_out else ""
        title = f"Sweep in {self.path}: {len(self.runs)} runs{excluded}"
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
    """Run all variants of an experiment with all seeds.

    Finished runs are not repeated and interrupted runs are resumed, so after Ctrl-C the same call continues.
    More seeds, more values or larger limits extend a sweep: finished runs are prolonged to the larger limits.
    A failed run does not stop the others; runs that another process works on are left to it.

    Args:
        source: an `Experiment`; the path of a sweep file; the path of a sweep.json, to repeat its sweep, or
            to complete it in its folder without `out`; or a mapping with the keys of a sweep file:
            `experiment` (an `Experiment`, a mapping, or the path of a file), `grid`, `seeds`, `out`. With
            `grid` or `seeds`, it can also be the mapping of an experiment or the path of its file.
        grid: for an experiment: a mapping from keys such as "method.population" to lists of values, whose
            combinations are the variants, or a list of such mappings; by default only the experiment itself.
        seeds: for an experiment: their number, or a list; by default 5.
        jobs: number of parallel runs, in separate processes. By default, one per processor with servers
            "local", one per server that is started, or on a broker as many as its servers can serve. It does
            not affect the records. Simulations defined in a notebook run sequentially.
        broker: as in `optimize`.
        servers: as in `optimize`, for all runs together.
        out: folder for the runs; by default the source's, or else runs/ and the name of the file.
        progress: show the progress; by default only in a notebook.

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
    todo = list_tasks(loaded)
    shows_progress = is_notebook() if progress is None else progress
    listener = _ProgressText(todo) if shows_progress else Listener()
    outcome = conduct(loaded, todo, listener, jobs=jobs, broker=broker, servers=servers)
    if isinstance(listener, _ProgressText):
        listener.close()
    finished = [task for task in todo if task in outcome.runs]
    runs, unreadable = outcome.open_runs()
    return SweepResult(
        loaded.out,
        tuple(outcome.runs[task] for task in finished),
        tuple(task.variant.label for task in finished),
        tuple(Failure(task.variant.label, task.seed, message) for task, message in outcome.failures.items()),
        outcome.interrupted,
        tuple(task.folder for task in outcome.busy),
        tuple(run for run in runs if run not in outcome.finished),
        tuple(unreadable),
    )


def _with_grid(
    source: Experiment | str | PathLike[str] | Mapping[str, Any],
    grid: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None,
    seeds: int | Sequence[int] | None,
) -> str | PathLike[str] | Mapping[str, Any]:
    """Return the source of a sweep; an experiment as a mapping with its grid and seeds."""
    options = {key: value for key, value in (("grid", grid), ("seeds", seeds)) if value is not None}
    if not isinstance(source, Experiment):
        if not options:
            return source
        if isinstance(source, Mapping) and "experiment" in source:
            raise InputError(
                f"{next(iter(options))}: is only for an experiment; the source is a sweep, so set its key of "
                "the same name"
            )
    return {"experiment": source, **options}


class _ProgressText(Status):
    """Shows the progress of a sweep as a text that is replaced."""

    def __init__(self, todo: list[Task]) -> None:
        super().__init__(len(todo))
        self.begin(todo)
        self._text = Text()

    def generation(self, task: Task, generation: "Generation") -> None:
        """Update the text."""
        super().generation(task, generation)
        self.tick()

    def tick(self) -> None:
        """Update the text."""
        self._text.show(self._line())

    def close(self) -> None:
        """Show the last state."""
        self._text.show(self._line(), at_once=True)
        self._text.close()

    def _line(self) -> str:
        failed = f", {self.failures} failed" if self.failures else ""
        seconds = self.seconds_left()
        time_left = f", {format_duration(seconds)} left" if seconds is not None and self.active_runs else ""
        running = "; ".join(run.words for run in list(self.active_runs.values())[:4])
        return f"{self.finished} of {self.total} runs done{failed}{time_left}" + (
            f"; {running}" if running else ""
        )
