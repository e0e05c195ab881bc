"""Caveats of a comparison: why the values of its groups may not be comparable."""

import math
import shlex
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING

from swarmwright.analysis.episodes import episodes_of, episodes_to_begin, limit
from swarmwright.analysis.indicators import Indicator, find_shared_indicators
from swarmwright.analysis.significance import FEW_RUNS
from swarmwright.analysis.table import Tested, span
from swarmwright.analysis.tasks import (
    Distinguished,
    describe_untested,
    different_tasks,
    differing_parameters,
    has_other_models,
)
from swarmwright.common.errors import SwarmwrightError
from swarmwright.methods.rankings.tournament import TournamentOptions
from swarmwright.runs.elites import has_elites
from swarmwright.runs.instances import averages_instances, instances
from swarmwright.runs.run import Run
from swarmwright.runs.store.folder import SWEEP

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Group, Task


HELD_OUT = "held_out"
"""Name of fitness on held-out seeds among the compared quantities."""
_NAMED = 3
"""Number of pairs or groups that a note names."""
_SIMILAR_RATIO = 1.1
"""Largest ratio of two runs' counts that needs no note."""
_FITNESS_CODE = {"code", "code.simulation", "code.ranking"}
"""Code that may change what fitness means; the code of methods and controllers is what is compared."""


def _command(groups: Sequence["Group"], option: str) -> str:
    """Return the command that compares the runs with an option; `RUN ..` if their folder has other runs."""
    paths = [run.path for group in groups for run in group.runs]
    paths += [run.path for group in groups for run in group.left_out]
    folder = paths[0].parent
    everything = {path.name for path in folder.iterdir() if path.is_dir()} if folder.is_dir() else set()
    all_of_it = {path.parent for path in paths} == {folder} and everything <= {path.name for path in paths}
    arguments = "RUN .."
    if all_of_it and len(paths) > 1:
        every = "" if (folder / SWEEP).is_file() else "/*"
        arguments = f"{shlex.quote(str(folder))}{every}"
    return f"`swarmwright runs compare {arguments} {option}`"


def _costs(groups: Sequence["Group"], tasks: Sequence["Task"], *, compare_at: bool) -> Iterator[str]:
    """Yield a note if evaluations of a task's groups took different numbers of episodes.

    compare_at: whether the groups can be compared after equal numbers of episodes.
    """
    shortest = min(episodes for group in groups for episodes in group.episodes)
    begun = max(episodes_to_begin(run) for group in groups for run in group.runs)
    command = _command(groups, f"--at-episodes {max(shortest, begun)}")
    after = f"; {command} compares all after as many" if compare_at else ""
    for task in tasks:
        rates = {group.label: group.episodes_per_evaluation for group in task.groups}
        least, most = min(rates.values()), max(rates.values())
        if most <= _SIMILAR_RATIO * least:
            continue
        named = "; ".join(f"{label}: {rate:.3g}" for label, rate in rates.items())
        rate_words = named if len(rates) <= _NAMED else f"{least:.3g} to {most:.3g}"
        where = f" of the task {task.label}" if task.label else ""
        yield (
            f"an evaluation{where} is not the same number of episodes in all groups ({rate_words}), so the "
            "same number of evaluations is not the same amount of simulation, which the column episodes "
            f"has{after}"
        )


def _lengths(groups: Sequence["Group"], indicator: Indicator, *, held_out: bool) -> Iterator[str]:
    """Yield a note if the runs, which are compared at their ends, have different numbers of evaluations."""
    shortest = min(group.evaluations[0] for group in groups)
    longest = max(group.evaluations[1] for group in groups)
    if longest <= _SIMILAR_RATIO * shortest:
        return
    at = {episodes_of(run, min(shortest, run.evaluations)) for group in groups for run in group.runs}
    episode_words = (
        f", which took {min(at):,} to {max(at):,} episodes" if max(at) > _SIMILAR_RATIO * min(at) else ""
    )
    command = _command(groups, f"{indicator.options} --at {shortest}".lstrip())
    if held_out:
        counts = "; ".join(f"{group.label}: {span(group.counts)}" for group in groups)
        counts_text = f" ({counts})" if len(groups) <= _NAMED else ""
        yield (
            f"budgets are unequal: the runs have {shortest:,} to {longest:,} evaluations{counts_text}, and "
            f"the best at the end of each was validated; {command} compares recorded fitness after as "
            f"many{episode_words}, and `swarmwright evaluate RUN --curve 20` evaluates the best so far of a "
            "run on held-out seeds over its evaluations"
        )
        return
    yield (
        f"the runs have {shortest:,} to {longest:,} evaluations, and each is compared at its end; {command} "
        f"compares all after as many{episode_words}"
    )


def budgets(groups: Sequence[Distinguished]) -> Iterator[str]:
    """Yield notes on different numbers of evaluations and on unfinished runs.

    groups: groups of runs that are compared by a function other than `compare`.
    """
    counts = [run.evaluations for group in groups for run in group.runs]
    if max(counts) > _SIMILAR_RATIO * min(counts) and len(groups) > 1:
        yield f"budgets are unequal: the runs have {min(counts):,} to {max(counts):,} evaluations"
    yield from _early([run for group in groups for run in group.runs if run.interrupted])


def _early(interrupted: Sequence[Run]) -> Iterator[str]:
    """Yield notes on unfinished runs that count."""
    running = [run for run in interrupted if run.state == "running"]
    for description, selected in (
        ("still running", running),
        ("ended early", [run for run in interrupted if run not in running]),
    ):
        if selected:
            yield f"{description}: {', '.join(str(run.path) for run in selected)}"


def _tasks(groups: Sequence["Group"], tasks: Sequence["Task"]) -> Iterator[str]:
    """Yield notes on groups that solve different tasks, and on those that are therefore not tested."""
    if any(task.pairs for task in tasks) and len(tasks) > 1:
        yield different_tasks()
    alone = describe_untested([(task.differs, [group.label for group in task.groups]) for task in tasks])
    if alone is not None:
        yield alone
    yield from describe_pooling(groups, tasks)


def describe_pooling(groups: Sequence[Distinguished], tasks: Sequence[object]) -> Iterator[str]:
    """Yield notes on differences between tested groups, besides method and controller.

    Args:
        groups: groups that are tested.
        tasks: tasks of the groups.
    """
    names = ", ".join(sorted(differing_parameters(groups)))
    if names and len(tasks) == 1:
        yield f"groups differ in the simulation's parameters, so they solve different tasks: {names}"
    if has_other_models(groups):
        yield (
            "groups have different reference models of the e-puck, which count as part of the design: their "
            "controllers have other sensors"
        )


def ties(pairs: Sequence[Tested]) -> Iterator[str]:
    """Yield a note on pairs whose p and interval of the difference disagree because of ties."""
    names = [
        f"{pair.first.label} against {pair.second.label}" for pair in pairs if pair.difference.contradicts
    ]
    if names:
        more = f" and {len(names) - _NAMED} more pairs" if len(names) > _NAMED else ""
        yield (
            f"p and the interval of the difference disagree for {'; '.join(names[:_NAMED])}{more}: values "
            "are tied, of which p takes account and the interval, which is then too wide, does not"
        )


def _values(
    groups: Sequence["Group"], indicator: Indicator, *, held_out: bool, beside: Collection[str]
) -> Iterator[str]:
    """Yield notes on why the values of groups may be too high or uncertain."""
    if any(isinstance(group.runs[0].experiment.ranking, TournamentOptions) for group in groups):
        yield (
            "the fitness of competitions is that against each run's own opponents, so it does not say which "
            "run is better; `swarmwright league FOLDER` lets their champions meet"
        )
        return
    if held_out:
        yield from _describe_validations(groups)
        return
    aggregations = {_describe_aggregation(group.runs[0]) for group in groups}
    if indicator.by != "fitness":
        yield from _elites_by_luck(groups, aggregations, indicator)
        return
    missing = [run for group in groups for run in group.runs if run.validation is None]
    if HELD_OUT in beside:
        command = "report fitness on held-out seeds, above, by which the order of groups may be another"
    elif missing:
        count = sum(len(group.runs) for group in groups)
        command = f"fitness on held-out seeds is known of {count - len(missing)} of {count} runs"
    else:
        command = f"{_command(groups, '--held-out')} compares fitness on held-out seeds"
    if len(aggregations) > 1:
        yield (
            "the best recorded fitness is made of different episodes "
            f"({'; '.join(sorted(aggregations))}), and the fewer they are, the more it is too high; {command}"
        )
    elif any(_may_be_lucky(run) for group in groups for run in group.runs):
        yield (
            "the best recorded fitness is too high where fitness depends on the seed, most of all with "
            f"new seeds in each generation; {command}"
        )
    elif any(_is_unknown(run) for run in missing):
        yield (
            "whether fitness depends on the seed is not known, as candidates had one episode each and runs "
            f"were not validated; {command}"
        )


def _failures(groups: Sequence["Group"], *, held_out: bool) -> Iterator[str]:
    """Yield notes on failed evaluations, and on figures that exclude failed episodes."""
    without = [group for group in groups if group.runs[0].experiment.ranking.failure_fitness is None]
    groups_with_failures = [group for group in without if any(group.failed)]
    if groups_with_failures:
        shares = "; ".join(
            f"{group.label}: {100 * sum(group.failed) / sum(group.counts):.3g} %"
            for group in groups_with_failures[:_NAMED]
        )
        more = (
            f" and {len(groups_with_failures) - _NAMED} more groups"
            if len(groups_with_failures) > _NAMED
            else ""
        )
        yield (
            f"evaluations failed ({shares}{more}) and rank below all others, so the best candidates are "
            "those that happened to work in the episodes of the run"
        )
    lost = [group for group in without if any(group.held_out_failed)] if held_out else []
    if lost:
        named = "; ".join(
            f"{group.label}: {sum(group.held_out_failed):,} in {sum(map(bool, group.held_out_failed))} of "
            f"{len(group.runs)} runs"
            for group in lost[:_NAMED]
        )
        more = f" and {len(lost) - _NAMED} more groups" if len(lost) > _NAMED else ""
        yield (
            f"the best candidates failed in held-out episodes, which their means leave out ({named}{more}): "
            "do not report these means; ranking.failed: NUMBER gives failed episodes a fitness"
        )


def _elites_by_luck(
    groups: Sequence["Group"], aggregations: Collection[str], indicator: Indicator
) -> Iterator[str]:
    """Yield a note that elites may owe their places to their seeds.

    aggregations: descriptions of how recorded fitness is aggregated.
    """
    if len(aggregations) > 1:
        yield (
            f"the elites were chosen by different episodes ({'; '.join(sorted(aggregations))}), and the "
            f"fewer they are, the more the {indicator.words} is too high where values depend on the seed"
        )
    elif any(_may_be_lucky(run) for group in groups for run in group.runs):
        yield (
            f"the elites are what came out best with the seeds of the run, so the {indicator.words} is too "
            "high where values depend on the seed"
        )


def _elites(groups: Sequence["Group"]) -> Iterator[str]:
    """Yield a note if methods with fronts or archives are compared only by their best candidate."""
    kinds = [group.label for group in groups if has_elites(group.runs[0])]
    if not kinds:
        return
    shared = find_shared_indicators([group.runs[0] for group in groups])
    yield f"only the best fitness is compared, not the archive or the front of {' and '.join(kinds)}: " + (
        f"{_command(groups, f'--by {shared[0]}')} compares these{' (or --by coverage)' * (len(shared) > 1)}"
        if shared
        else "`swarmwright runs compare` has --by hypervolume for fronts with the same objectives, --by "
        "qd_score and --by coverage for archives with the same measures"
    )


def _describe_validations(groups: Sequence["Group"]) -> Iterator[str]:
    """Yield notes on why the runs' fitness on held-out seeds may not be comparable."""
    of_runs = [run.unseen.seeds for group in groups for run in group.runs if run.unseen is not None]
    least, most = (limit(map(len, of_runs), default=0) for limit in (min, max))
    if least != most:
        yield (
            f"the runs were validated in {least:,} to {most:,} episodes, and the fewer they are, the less "
            f"certain fitness is; `swarmwright resume RUN --set validate.episodes={most}` validates a run "
            "in as many"
        )
    elif len(set(map(tuple, of_runs))) > 1:
        yield "the runs were validated on different held-out seeds"


def _may_be_lucky(run: Run) -> bool:
    """Return whether the best candidate of a run may owe its recorded fitness to its seeds.

    For a run that was not validated, fitness depends on the seed if its recorded episodes differ.
    """
    if run.experiment.ranking.seeds == "new" or run.unseen is not None:
        return True
    return run.validation is None and len(set(_episodes(run))) > 1


def _is_unknown(run: Run) -> bool:
    """Return whether it is unknown if the fitness of a run without validation depends on the seed."""
    return len(_episodes(run)) == 1


def _episodes(run: Run) -> list[float]:
    """Return the fitness of all recorded episodes of a run's best candidate, except failed ones."""
    try:
        evaluations = instances(run, run.evaluation())
    except SwarmwrightError:  # a damaged generation, which the comparison does not need
        return []
    return [
        value for evaluation in evaluations for value in evaluation.episodes.tolist() if math.isfinite(value)
    ]


def _describe_aggregation(run: Run) -> str:
    """Describe how recorded fitness is aggregated."""
    experiment = run.experiment
    if averages_instances(experiment):
        return "the mean of all instances of racing"
    episodes = experiment.ranking.episodes
    past = " and those before, evaluated again" if experiment.ranking.reevaluate else ""
    return f"{episodes} episode{'s' if episodes > 1 else ''}{past}"


def _describe_limits(groups: Sequence["Group"], at: int | None, at_episodes: int | None) -> Iterator[str]:
    """Yield notes on what counts if runs are compared after equal numbers of evaluations or episodes."""
    if at is None and at_episodes is None:
        return
    words = f"{at:,} evaluations" if at_episodes is None else f"{at_episodes:,} episodes"
    ended = [
        str(run.path)
        for group in groups
        for run in group.runs
        if (
            run.evaluations < (at or 0)
            if at_episodes is None
            else episodes_of(run, run.evaluations) < at_episodes
        )
    ]
    if ended:
        more = f" and {len(ended) - 5} more" if len(ended) > 5 else ""
        yield f"ended before {words}, and count with what they had: {', '.join(ended[:5])}{more}"
    waiting = [group.label for group in groups if _has_unfinished_evaluations(group, at, at_episodes)]
    if waiting:
        yield (
            f"candidates of {' and '.join(waiting)} are evaluated again, so the last generation that was "
            f"finished within the first {words} counts"
        )


def _has_unfinished_evaluations(group: "Group", at: int | None, at_episodes: int | None) -> bool:
    """Return whether evaluations of an unfinished generation are excluded."""
    return any(
        count < min(limit(run, at, at_episodes) or 0, run.evaluations)
        for run, count in zip(group.runs, group.counts, strict=True)
    )


def caveats(
    groups: Sequence["Group"],
    tasks: Sequence["Task"],
    at: int | None,
    indicator: Indicator,
    *,
    at_episodes: int | None = None,
    held_out: bool,
    beside: Collection[str] = (),
) -> list[str]:
    """Return what restricts the conclusions of a comparison, a sentence each.

    Args:
        groups: compared groups.
        tasks: the groups by the task that they solve; with several tasks, tests are within a task.
        at: evaluations after which runs are compared; None: at their ends.
        indicator: compared quantity.
        at_episodes: episodes after which runs are compared, instead of evaluations.
        held_out: whether fitness on held-out seeds is compared.
        beside: other quantities by which the same runs are also compared: indicators, or `HELD_OUT`.
    """
    notes = list(indicator.notes)
    few = [group for group in groups if len(group.runs) < FEW_RUNS]
    if few and len(groups) > 1:
        least, most = (limit(len(group.runs) for group in few) for limit in (min, max))
        counts = "; ".join(f"{group.label}: {len(group.runs)}" for group in few)
        if len(few) > 3:
            counts = f"{len(few)} groups have {least if least == most else f'{least} to {most}'}"
        notes.append(f"with fewer than {FEW_RUNS} runs in a group ({counts}) a test has little power")
    notes += _describe_limits(groups, at, at_episodes)
    if at_episodes is None:
        if at is None and len(groups) > 1:
            notes += _lengths(groups, indicator, held_out=held_out)
        notes += _costs(groups, tasks, compare_at=indicator.by == "fitness" and not held_out)
    notes += _tasks(groups, tasks)
    notes += _failures(groups, held_out=held_out)
    notes += _values(groups, indicator, held_out=held_out, beside=beside)
    notes += ties([pair for task in tasks for pair in task.pairs])
    if indicator.by == "fitness" and not set(beside) - {HELD_OUT}:
        notes += _elites(groups)
    if any(_FITNESS_CODE & group.differs.keys() for group in groups):
        notes.append(
            f"{indicator.words} that different code computed is compared: `swarmwright runs show` names the "
            "files"
        )
    notes += _early([run for group in groups for run in group.runs if run.interrupted])
    return notes
