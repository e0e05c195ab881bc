"""Comparison of groups of runs by their final fitness or another indicator, with statistical tests."""

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, islice
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis import episodes
from swarmwright.analysis.caveats import HELD_OUT, caveats
from swarmwright.analysis.episodes import (
    LeftOut,
    episodes_of,
    episodes_to_begin,
    find_exclusion,
    fitness_at,
    is_compared_by_generation,
    limit,
)
from swarmwright.analysis.groups import RunGroup, group, number_of
from swarmwright.analysis.indicators import FITNESS, By, Indicator, find_quick_indicators, measure
from swarmwright.analysis.significance import Difference, Kruskal, difference, holm, kruskal_wallis
from swarmwright.analysis.sweep_folders import runs_of_all, variant_of
from swarmwright.analysis.tasks import TaskGroups, group_by_task
from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError
from swarmwright.common.problems import format_value
from swarmwright.common.values import sort_key
from swarmwright.runs.failures import count_failed_evaluations
from swarmwright.runs.metric_curves import MetricCurves, Names, select_names
from swarmwright.runs.post_evaluation import EPISODES
from swarmwright.runs.run import Run
from swarmwright.runs.validation import format_validation_command

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swarmwright.analysis.tasks import TaskGroups


def check_options(
    at: int | None,
    at_episodes: int | None,
    by: object,
    reference: object,
    offset: object,
    *,
    held_out: bool,
) -> None:
    """Raise InputError for options of `compare` that are wrong or contradict each other."""
    for name, value in (("at", at), ("at_episodes", at_episodes)):
        if value is not None and value < 1:
            raise InputError(f"{name}: must be at least 1, not {value}")
    if at_episodes is not None and (at is not None or held_out or by != "fitness"):
        raise InputError(
            "at_episodes: compares the best recorded fitness after so many episodes; leave out at, held_out "
            "and by, or leave out at_episodes"
        )
    kinds = get_args(By)
    if by not in kinds:
        raise InputError(f"by: must be one of {', '.join(kinds)}, not {format_value(by)}")
    if held_out and by != "fitness":
        raise InputError(
            "held_out: compares fitness, which validations have; leave out held_out, or leave out by"
        )
    if reference is not None and by != "hypervolume":
        raise InputError(
            "reference: is the reference point of hypervolume; leave it out, or give by='hypervolume'"
        )
    if offset is not None and by != "qd_score":
        raise InputError("offset: is that of the QD score; leave it out, or give by='qd_score'")


def check_begun(runs: Sequence[Run], at: int) -> None:
    """Raise InputError if a run had not finished a generation that it needs after this many evaluations."""
    slowest = max(
        filter(is_compared_by_generation, runs), key=lambda run: run.history[0].evaluations, default=None
    )
    if slowest is not None and at < (needed := slowest.history[0].evaluations):
        raise InputError(
            f"at {at} evaluations {slowest.path} had no finished generation yet; compare at {needed} or later"
        )


def check_begun_in_episodes(runs: Sequence[Run], episodes: int) -> None:
    """Raise InputError if a run had nothing to compare after this many episodes."""
    for run in runs:
        needed = episodes_to_begin(run)
        if episodes < needed:
            raise InputError(
                f"at_episodes: {run.path} had nothing to compare after {episodes:,} episodes; compare at "
                f"{needed:,} or later"
            )


def check_validated(runs: Sequence[Run], at: int | None) -> None:
    """Raise InputError if a run was not validated, or is not compared at its end."""
    if at is not None:
        raise InputError(
            "at: the best candidates at the end of runs are validated; leave out at, or leave out held_out"
        )
    missing = [run for run in runs if run.validation is None]
    if missing:
        names = ", ".join(str(run.path) for run in missing[:3])
        others = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        command = format_validation_command(missing[0], _episodes(runs))
        raise InputError(f"{names}{others}: not validated on held-out seeds; `{command}` does it")


def _episodes(runs: Iterable[Run]) -> int:
    """Return the number of held-out episodes with which to validate a run for comparison with others."""
    return max((len(run.unseen.seeds) for run in runs if run.unseen is not None), default=EPISODES)


Named = Literal["rank", "name", "given"]
Order: TypeAlias = Named | Sequence[str]
"""By rank (best median first), by name, in the given order of the runs, or a list of labels, followed by the
rest."""


def check_order(order: object, groups: "Sequence[Group]") -> None:
    """Raise InputError unless `order` is a known name or a list of labels of these groups."""
    if isinstance(order, str):
        if order not in get_args(Named):
            names = ", ".join(get_args(Named))
            raise InputError(f"order: must be one of {names}, or a list of labels, not {format_value(order)}")
        return
    if not isinstance(order, Sequence):
        raise InputError(f"order: must be a name or a list of labels, not {format_value(order)}")
    labels = [known_group.label for known_group in groups]
    unknown = [name for name in order if name not in labels]
    if unknown:
        available = ", ".join(map(repr, labels))
        raise InputError(f"order: there is no group {unknown[0]!r}; there are {available}")


def sort_groups(groups: "Sequence[Group]", order: Order) -> "list[Group]":
    """Return the groups of a task in an order that `check_order` accepts."""
    if order == "given":
        return list(groups)
    keys = {key for known_group in groups for key in known_group.differs}
    # Group numbers follow the order of the runs; names do not depend on it.
    named = sorted(
        groups, key=lambda known_group: (number_of(known_group.label), sort_key(known_group.differs, keys))
    )
    if order == "name":
        return named
    ranked = sorted(named, key=lambda known_group: -known_group.median)
    if order == "rank":
        return ranked
    positions = {label: position for position, label in enumerate(order)}
    return sorted(ranked, key=lambda known_group: positions.get(known_group.label, len(positions)))


def sort_tasks(tasks: "Sequence[TaskGroups]", order: Order) -> "list[TaskGroups]":
    """Return tasks in an order that depends on the order of the runs only if that order is requested."""
    if order == "given":
        return list(tasks)
    keys = {key for task in tasks for key in task.differs}
    return sorted(tasks, key=lambda task: sort_key(task.differs, keys))


_RECORDED = "Best recorded fitness of each run, in the episodes by which its candidates were selected:"


@dataclass(frozen=True)
class Group:
    """Runs whose experiments differ only in the seed."""

    label: str
    """Description of what distinguishes the group."""
    differs: dict[str, Any]
    """Keys of the experiment that differ between the groups, with this group's values."""
    runs: tuple[Run, ...]
    final: NDArray[np.float64]
    """Compared value of each run, (runs,), more is better: its best fitness, the fitness of its best
    candidate on held-out seeds, or an indicator. If no candidate could be evaluated, fitness is NaN and the
    indicator 0."""
    counts: tuple[int, ...]
    """Number of counted evaluations of each run."""
    episodes: tuple[int, ...]
    """Episodes of these evaluations: `ranking.episodes` each, without those that a race skipped."""
    failed: tuple[int, ...]
    """Number of these evaluations that failed in at least one episode."""
    left_out: tuple[LeftOut, ...] = ()
    """Excluded runs of the group, for example because they have not finished."""

    @property
    def held_out_failed(self) -> tuple[int, ...]:
        """Number of held-out episodes that failed, of each run's best candidate; 0 without a validation."""
        return tuple(0 if run.validation is None else run.validation.best.failed for run in self.runs)

    def quantile(self, share: float) -> float:
        """Return a quantile of `final`; a run without any fitness counts as minus infinity."""
        values = np.sort(np.where(np.isnan(self.final), -np.inf, self.final))
        position = share * (len(values) - 1)
        low = int(position)
        part = position - low
        high = min(low + 1, len(values) - 1)
        if part == 0 or values[low] == values[high]:
            return float(values[low])
        return float(values[low] * (1 - part) + values[high] * part)

    @property
    def median(self) -> float:
        """Median of `final`."""
        return self.quantile(0.5)

    @property
    def quartiles(self) -> tuple[float, float]:
        """Lower and upper quartile of `final`."""
        return self.quantile(0.25), self.quantile(0.75)

    @property
    def evaluations(self) -> tuple[int, int]:
        """Smallest and largest number of counted evaluations of a run."""
        return min(self.counts), max(self.counts)

    @property
    def episodes_per_evaluation(self) -> float:
        """Mean number of episodes per evaluation; 0 if no evaluation counts."""
        return sum(self.episodes) / max(sum(self.counts), 1)


@dataclass(frozen=True)
class Pair:
    """Two groups and the difference between them."""

    first: Group
    second: Group
    difference: Difference
    """Statistics of the first group against the second."""
    p_holm: float
    """p, corrected for the number of pairs of the task after Holm."""

    @property
    def magnitude(self) -> str:
        """Effect size in words: negligible, small, medium or large; empty if `p_holm` is above 0.05."""
        return self.difference.magnitude_at(self.p_holm)


@dataclass(frozen=True)
class Task:
    """Groups whose runs solve the same task: the same simulation, parameters and definition of fitness."""

    label: str
    """Description of what distinguishes the task; empty if all groups are tested against each other."""
    differs: dict[str, Any]
    """Keys of the experiment that differ between the tasks, with this task's values."""
    groups: tuple[Group, ...]
    pairs: tuple[Pair, ...]
    """Every group of the task against every later one."""
    kruskal: Kruskal | None
    """Test of all groups of the task at once; None for fewer than three."""


@dataclass(frozen=True)
class Comparison:
    """Groups of runs, tested by final fitness or another indicator; returned by `swarmwright.compare`.

    `print(comparison)` shows it as a table, `figure()` as a picture, `to_mapping()` as plain values.
    """

    groups: tuple[Group, ...]
    """Groups with at least one counted run, task by task, in the requested order."""
    tasks: tuple[Task, ...]
    """The groups by the task that they solve; tests are within a task. There is a single task if all groups
    solve the same task, or differ only in parameters other than the mission."""
    at: int | None
    """Evaluations after which runs are compared; None: at each run's end, or after `at_episodes`."""
    notes: tuple[str, ...]
    """Caveats, a sentence each."""
    held_out: bool = False
    """Whether fitness on held-out seeds is compared."""
    indicator: Indicator = FITNESS
    """Compared quantity, in `by`, and its constants: `offset` of the QD score, `reference` and `ranges` of
    the hypervolume."""
    heading: str = ""
    """Description of what is compared, if this is one of several comparisons of the same runs by fitness."""
    at_episodes: int | None = None
    """Episodes after which runs are compared, instead of evaluations."""
    left_out: tuple[LeftOut, ...] = ()
    """Excluded runs: those that have not finished, have no generation, or cannot be read."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """Custom names of groups, tasks and designs."""

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """Pairs of all tasks: every group against every later one of its task."""
        return tuple(pair for task in self.tasks for pair in task.pairs)

    @property
    def kruskal(self) -> Kruskal | None:
        """Test of all groups at once; None for fewer than three groups, or for several tasks."""
        return self.tasks[0].kruskal if len(self.tasks) == 1 else None

    def __str__(self) -> str:
        from swarmwright.analysis.table import table

        return table(self)

    def __repr__(self) -> str:
        """Return what is compared, and the numbers of runs and groups."""
        quantity = "fitness on held-out seeds" if self.held_out else self.indicator.by
        runs = sum(len(group.runs) for group in self.groups)
        return f"<Comparison by {quantity}: {runs} runs in {len(self.groups)} groups>"

    def _repr_html_(self) -> str:
        """Return groups, tests and notes as tables, for notebooks."""
        from swarmwright.analysis.table import html_of

        return html_of(self)

    def to_mapping(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON."""
        from swarmwright.analysis.table import to_mapping

        return to_mapping(self)

    @check_arguments
    def figure(
        self,
        *,
        x: str = "evaluations",
        metrics: Names | None = None,
        style: str = "screen",
        width: str | float | None = None,
        title: str | None = None,
    ) -> "Figure":
        """Return a matplotlib figure: best fitness or the indicator over `x`, and the values of all runs.

        Up to 20 tasks have separate axes.

        Args:
            x: "evaluations" or "generations". If the hypervolume takes too long to compute (more than four
                objectives, including fitness, or large fronts with three or four), best fitness is drawn over
                `x`.
            metrics: draw fitness and these metrics, averaged over the best quarter of each generation by
                fitness: names of metrics that all runs have recorded, or "all". For groups of one task.
            style: "screen", or that of a publisher: "ieee", "nature", "science", "acm", "elsevier" or
                "springer", with the widths of its columns, its fonts and sizes, and without a title.
            width: "column" (the default) or "page" of the style, inches, or a length such as "89 mm".
            title: replaces the figure's title; "" for none.

        Raises InputError for an unknown style or width, and for a metric that a run has not recorded.
        """
        from swarmwright.display.figures.style import Page, use_page

        with use_page(Page.from_options(style, width, title)):
            return self._draw_figure(x, metrics)

    def _draw_figure(self, x: str, metrics: Names | None) -> "Figure":
        """Return `figure` with the current style."""
        from swarmwright.analysis.designs import designs_of
        from swarmwright.display.figures.comparison import draw
        from swarmwright.display.figures.metrics import draw_groups, runs_of, title_of_groups

        designs = designs_of(self.tasks, self.labels)
        if metrics is None:
            return draw(self, designs, x=x)
        if len(self.tasks) > 1:
            raise InputError("metrics: groups solve several tasks; compare the runs of each task alone")
        runs = runs_of(designs)
        names = select_names(runs, metrics)
        return draw_groups(designs, [MetricCurves(run, names) for run in runs], title_of_groups(designs), x=x)

    @check_arguments
    def plot(
        self,
        path: str | PathLike[str],
        *,
        x: str = "evaluations",
        metrics: Names | None = None,
        style: str = "screen",
        width: str | float | None = None,
        title: str | None = None,
    ) -> Path:
        """Draw `figure`, with its arguments, into a file (.png, .svg or .pdf); return its path.

        Raises InputError as `figure`, and for another suffix or a file that cannot be written.
        """
        from swarmwright.display.figures.style import save

        figure = self.figure(x=x, metrics=metrics, style=style, width=width, title=title)
        return save(figure, Path(path))

    @check_arguments
    def export(self, path: str | PathLike[str]) -> Path:
        """Write a table in the format of the file's suffix; return its path.

        .csv: a row for each run: task, group, run (its folder, relative to that of the table), seed, left_out
        (the reason of an excluded run, otherwise empty), counted evaluations and episodes, failed (number of
        failed ones among these evaluations), fitness (the best recorded one of these), the compared indicator
        if any, held_out_fitness, held_out_episodes, held_out_failed (number of failed ones among these, which
        held_out_fitness excludes unless `ranking.failed` is a number), held_out_standard_error, held_out_low
        and held_out_high (95 % interval; empty before a run's end and without a validation), seconds of the
        whole run, record_sha256, and the keys that differ; nan if no candidate could be evaluated. Excluded
        runs come last, without values.
        .tex: groups and tests of each task as LaTeX tables for the package booktabs.

        Raises InputError for another suffix or a file that cannot be written.
        """
        from swarmwright.analysis.table import write

        return write(self, Path(path))


@check_arguments
def compare(
    runs: Iterable[Run | str | os.PathLike[str]] | str | os.PathLike[str],
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
    """Compare runs: group them by the differences between their experiments, and test whether groups differ.

    Runs that differ only in their seed form a group; of several runs with the same experiment and seed, one
    counts. The best fitness of each run is compared by the Mann-Whitney U test, with Vargha and Delaney's A12
    as the effect size and the Hodges-Lehmann estimate of the difference with its 95 % confidence interval;
    three or more groups also by the Kruskal-Wallis test, and p of pairs is corrected after Holm. A single
    group is described and not tested.

    Only finished runs count. Others are excluded, named in a note, and listed in `left_out`: runs that
    failed, were interrupted or killed or are still running, have no finished generation, are missing in a
    sweep, or cannot be read. With `at` and `at_episodes`, all runs with that many evaluations or episodes
    count, finished or not. `print(comparison)` shows the number of excluded runs of each group, and all
    caveats.

    Groups with different simulations, parameters of the simulation or definitions of fitness, such as those
    of a sweep over methods and missions, solve different tasks: tests are then within a task, and p is
    corrected for the pairs of that task. Runs that differ only in the reference model of the arena's e-puck
    (`e-puck-rm1.1`, `e-puck-rm1.2`) have the same task, since both describe the same robot. Groups that
    differ only in parameters are tested against each other, with a note, unless they have different missions.

    Runs of `nsga2` with the same objectives can be compared by the hypervolume of their fronts, and those of
    `map_elites` and `novelty` with the same measures, ranges and bins by the QD score and the coverage of
    their archives, with the same tests. Fronts and archives are made from all counted evaluations.

    Args:
        runs: run folders, folders of sweeps (which stand for their runs), or runs; or the folder of a single
            sweep. Files are ignored with a warning.
        at: compare the best of the first `at` evaluations instead of all. Runs that ended earlier count with
            what they have. If candidates are evaluated again (racing, `reevaluate`), the last generation
            finished by then counts.
        at_episodes: like `at`, but with the evaluations of each run that took at most this many episodes,
            which are fewer if `ranking.episodes` is larger. All runs then have the same amount of simulation.
        held_out: compare the fitness of each run's best candidate on held-out seeds, from its validation,
            instead of the best recorded fitness, which is too high if fitness depends on the seed.
        by: "fitness", "hypervolume", "qd_score" (sum over elites of fitness minus the offset) or "coverage"
            (share of cells that have an elite).
        reference: of the hypervolume: values of `fitness` and of each objective that are worse than all
            values of interest; the hypervolume is then in the units of the objectives. Default: each
            objective is scaled from 0 to 1 between its worst and its best value in the fronts of these runs,
            and the reference point is -0.1 in each.
        offset: offset of the QD score, the worst possible fitness. Default: 0, or the lowest fitness of an
            elite of these runs if that is negative.
        unfinished: count unfinished runs as well, with what they have.
        order: order of the groups of a task in tables and figures: "rank" (by median, best first), "name",
            "given" (as in `runs`), or a list of labels; groups that it does not name follow by rank. The
            first group of a pair is the one that comes first.
        labels: new names of groups, of entries of the figure's legend, and of tasks: present name -> new
            name.

    Raises:
        InputError: no run is given, a folder is not a run, no run counts, `at` or `at_episodes` is below 1 or
            a run had no finished generation by then, with `held_out` a run has no validation, a run does not
            have the compared quantity, or `order` or `labels` name an unknown group.

    Examples:
        >>> comparison = swarmwright.compare(["study/nnga-1", "study/random_search-1"])
        >>> [group.label for group in comparison.groups]
        ['random_search', 'nnga']

    See also: `compare_controllers`, for two controllers in the same episodes; `sweep`, which makes the runs.
    """
    opened, unreadable = runs_of_all(runs)
    check_options(at, at_episodes, by, reference, offset, held_out=held_out)
    return compare_opened(
        opened,
        unreadable,
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


def compare_all(runs: Sequence[Run], unreadable: Sequence[LeftOut] = ()) -> list[Comparison]:
    """Return the comparisons that are printed at the end of a sweep, the most important first.

    By fitness on held-out seeds, if every counted run was validated and fitness depends on the seed; by
    recorded fitness; then by the indicators that all runs have and that are computed quickly. Empty if no run
    counts.

    unreadable: runs of the sweep that are missing or cannot be read.
    """
    count = counting(runs)
    if not count:
        return []
    validated = has_held_out_fitness(runs)
    quick = find_quick_indicators(count)
    first = [compare_opened(runs, unreadable, held_out=True, beside=quick)] if validated else []
    recorded = compare_opened(runs, unreadable, beside=[*[HELD_OUT] * validated, *quick])
    return [*first, recorded, *(compare_opened(runs, unreadable, by=by) for by in quick)]


def counting(runs: Iterable[Run]) -> list[Run]:
    """Return the runs that count if runs are compared at their ends."""
    return [run for run in runs if find_exclusion(run, "", None, None, unfinished=False) is None]


def has_held_out_fitness(runs: Sequence[Run]) -> bool:
    """Return whether every counted run was validated, and the fitness of at least one depends on the seed."""
    count = counting(runs)
    return all(run.validation is not None for run in count) and any(run.unseen is not None for run in count)


def compare_opened(
    opened: Sequence[Run],
    unreadable: Sequence[LeftOut] = (),
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
    beside: Collection[str] = (),
) -> Comparison:
    """Compare runs like `compare`.

    Args:
        opened: runs.
        unreadable: runs that are missing or cannot be read.
        at: this and the following as in `compare`.
        at_episodes: ..
        held_out: ..
        by: ..
        reference: ..
        offset: ..
        unfinished: ..
        order: ..
        labels: ..
        beside: other quantities by which the runs are also compared.
    """
    if not opened:
        raise InputError("there are no runs to compare; name run folders such as runs/minisim-1")
    grouped, notes = group(opened)
    counted_groups, without = _select_counted(grouped, unreadable, at, at_episodes, unfinished=unfinished)
    runs = [run for run_group in counted_groups for run in run_group.runs]
    if held_out:
        check_validated(runs, at)
    if at is not None:
        check_begun(runs, at)
    if at_episodes is not None:
        check_begun_in_episodes(runs, at_episodes)
    indicator = FITNESS
    if by == "fitness":
        values_and_counts = [
            (_get_held_out_mean(run), run.evaluations)
            if held_out
            else fitness_at(run, limit(run, at, at_episodes))
            for run in runs
        ]
    else:
        indicator, measured = measure(by, runs, at, reference=reference, offset=offset)
        counts = [run.evaluations if at is None else min(at, run.evaluations) for run in runs]
        values_and_counts = list(zip(measured, counts, strict=True))
    values = iter(values_and_counts)
    groups = [
        _group(run_group, list(islice(values, len(run_group.runs))), without) for run_group in counted_groups
    ]
    check_order(order, groups)
    tasks = tuple(
        _task(task_groups, sort_groups([groups[index] for index in task_groups.indices], order))
        for task_groups in sort_tasks(group_by_task(counted_groups, by=by, held_out=held_out), order)
    )
    if labels:
        tasks = _rename_labels(tasks, labels, without)
    groups = [of_task for task in tasks for of_task in task.groups]
    found_caveats = caveats(
        groups, tasks, at, indicator, at_episodes=at_episodes, held_out=held_out, beside=beside
    )
    return Comparison(
        tuple(groups),
        tasks,
        at,
        (*notes, *episodes.notes(without), *found_caveats),
        held_out,
        indicator,
        _RECORDED if HELD_OUT in beside else "",
        at_episodes,
        tuple(without),
        dict(labels or {}),
    )


def _select_counted(
    grouped: Sequence[RunGroup],
    unreadable: Sequence[LeftOut],
    at: int | None,
    at_episodes: int | None,
    *,
    unfinished: bool,
) -> tuple[list[RunGroup], list[LeftOut]]:
    """Return the groups with the counted runs, and the excluded runs.

    Raises InputError if no run counts.
    """
    counted_groups: list[RunGroup] = []
    excluded: list[LeftOut] = []
    labels = {str(run.path): run_group.label for run_group in grouped for run in run_group.runs}
    for run_group in grouped:
        counts = []
        for run in run_group.runs:
            exclusion = find_exclusion(run, run_group.label, at, at_episodes, unfinished=unfinished)
            if exclusion is None:
                counts.append(run)
            else:
                excluded.append(exclusion)
        if counts:
            counted_groups.append(replace(run_group, runs=tuple(counts)))
    if not counted_groups:
        raise InputError(_none_counts(excluded))
    for lacking in unreadable:
        label, folders = variant_of(lacking.path) or (lacking.label, [])
        label = next((labels[str(folder)] for folder in folders if str(folder) in labels), label)
        excluded.append(replace(lacking, label=label))
    return counted_groups, excluded


def _none_counts(without: Sequence[LeftOut]) -> str:
    """Explain why no run counts, and how runs could."""
    first = without[0]
    if not any(run.evaluations for run in without):
        return f"{first.path}: {first.reason} to compare"
    most = max(run.evaluations for run in without)
    return (
        f"no run has finished, so none is compared: {first.path} ({first.reason})"
        + (f" and {len(without) - 1:,} more" if len(without) > 1 else "")
        + f"; continue them with `swarmwright resume RUN`, compare them after as many evaluations (at: up to "
        f"{most:,}), or ask for unfinished ones as they are (unfinished)"
    )


def _rename_labels(
    tasks: Sequence[Task], labels: Mapping[str, str], without: Sequence[LeftOut]
) -> tuple[Task, ...]:
    """Return tasks with other names. Raises InputError for an unknown name, or if two would have the same."""
    from swarmwright.analysis.designs import designs_of

    groups = [group.label for task in tasks for group in task.groups]
    available = [*groups, *(run.label for run in without), *(task.label for task in tasks)]
    available += [design.name for design in designs_of(tasks)]
    unknown = [name for name in labels if name not in available]
    if unknown:
        names = ", ".join(repr(name) for name in dict.fromkeys(available) if name)
        raise InputError(f"labels: there is no {unknown[0]!r} to be called otherwise; there are {names}")
    new_names = [labels.get(label, label) for label in groups]
    duplicate = next((name for name in new_names if new_names.count(name) > 1), None)
    if duplicate is not None:
        raise InputError(f"labels: two groups would be called {duplicate!r}; give them different names")
    renamed = []
    for task in tasks:
        members = {
            group.label: replace(group, label=labels.get(group.label, group.label)) for group in task.groups
        }
        pairs = tuple(
            replace(pair, first=members[pair.first.label], second=members[pair.second.label])
            for pair in task.pairs
        )
        label = labels.get(task.label, task.label)
        renamed.append(replace(task, label=label, groups=tuple(members.values()), pairs=pairs))
    return tuple(renamed)


def _task(groups_of_task: TaskGroups, groups: Sequence[Group]) -> Task:
    """Return the groups of a task with their tests."""
    pairs = list(combinations(groups, 2))
    differences = [difference(first.final, second.final) for first, second in pairs]
    corrected = holm([difference_of_pair.p for difference_of_pair in differences])
    return Task(
        groups_of_task.label,
        groups_of_task.differs,
        tuple(groups),
        tuple(
            Pair(first, second, difference_of_pair, p)
            for (first, second), difference_of_pair, p in zip(pairs, differences, corrected, strict=True)
        ),
        kruskal_wallis([group.final for group in groups]) if len(groups) > 2 else None,
    )


def _group(
    run_group: RunGroup, values_and_counts: Sequence[tuple[float, int]], excluded: Sequence[LeftOut]
) -> Group:
    """Return a group with its values.

    Args:
        run_group: the group.
        values_and_counts: the compared value of each run, and its number of evaluations.
        excluded: excluded runs of all groups.
    """
    final = np.array([value for value, _ in values_and_counts], dtype=np.float64)
    counts = tuple(count for _, count in values_and_counts)
    episodes = tuple(map(episodes_of, run_group.runs, counts))
    failed = tuple(map(count_failed_evaluations, run_group.runs, counts))
    lacking = tuple(run for run in excluded if run.label == run_group.label)
    return Group(run_group.label, run_group.differs, run_group.runs, final, counts, episodes, failed, lacking)


def _get_held_out_mean(run: Run) -> float:
    assert run.validation is not None
    return run.validation.best.fitness.mean
