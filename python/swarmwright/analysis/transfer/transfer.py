"""Evaluate candidates of runs in other simulations, and measure the loss of fitness."""

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from swarmwright.analysis.caveats import budgets, describe_pooling, ties
from swarmwright.analysis.groups import RunGroup, group
from swarmwright.analysis.significance import FEW_RUNS
from swarmwright.analysis.tasks import describe_untested, different_tasks, group_by_task
from swarmwright.analysis.transfer.result import Transfer
from swarmwright.common.arguments import check_arguments, integer, require_list, text
from swarmwright.common.errors import InputError
from swarmwright.common.formatting import format_count
from swarmwright.experiment.ranges import E_PUCKS, Range, ranges_of, require_e_pucks
from swarmwright.experiment.targets import OtherSimulation, Target, is_same, targets_of
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.post_evaluation import choose_unseen_seeds
from swarmwright.runs.run import Run, open_run
from swarmwright.runs.transfer.at_end import read_seeds
from swarmwright.runs.transfer.evaluation import Plan, Work
from swarmwright.runs.transfer.transferred import Transferred
from swarmwright.runs.validation import find_leading
from swarmwright.servers.evaluation.base import Progress, Servers

CANDIDATES, SEEDS = 10, 30
"""Default numbers of candidates per run and of seeds."""


@check_arguments
def transfer(
    runs: Iterable[Run | str | os.PathLike[str]],
    to: Sequence[str] = (),
    *,
    vary: Mapping[str, Sequence[float]] | Sequence[Range] = (),
    pseudo_reality: bool = False,
    candidates: int = CANDIDATES,
    random: int = 0,
    seeds: int = SEEDS,
    seed: int | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    prefix: str | None = None,
    on_progress: Progress | None = None,
) -> Transfer:
    """Evaluate the best candidates of runs in other simulations, and measure the loss of fitness.

    Evolved controllers exploit the peculiarities of their simulation. The fitness that they lose in another
    one, or in models sampled around their own, indicates how much they will lose on robots.

    Args:
        runs: run folders, or runs. Those that differ only in the seed form a group; groups that solve the
            same task are compared.
        to: names of simulations, as in experiments, with the same sensors and actuators; or files (.yaml)
            with the keys of the experiment that differ, such as simulation, parameters and servers.
        vary: parameter -> its lowest and highest value, both included; integers if both are:
            {"parameters.speedDefenders": (0.4, 0.8)}. Every episode has a separate model.
        pseudo_reality: also vary the noise of the arena's e-pucks, in ranges around the reference model's:
            drive 0 to 0.15, proximity and ground 0 to 0.1, light 0 to 0.9, message loss 0.8 to 0.95.
        candidates: number of best candidates with different controllers per run, at least 1.
        random: number of additional random controllers, at least 0.
        seeds: number of episodes, with held-out seeds that are the same for all candidates and runs; at least
            2.
        seed: simulation seed of the first episode; the others follow. Default: seeds of the runs'
            validations, which the evolution of no run used.
        broker: address of the broker whose servers offer simulations that are not available here, and all
            simulations if the run had a broker; not for targets whose file names servers or a broker.
        servers: as in `optimize`, likewise.
        prefix: topic prefix, in place of the runs' and targets'; not for targets whose file names servers or
            a broker.
        on_progress: as in `optimize`.

    Raises:
        InputError: there is no run or target, a target does not fit the controllers, or a number is out of
            range.
        RunError: no broker, no suitable server, or every episode failed.

    Examples:
        >>> faster = {"parameters.speedDefenders": (0.4, 0.8)}
        >>> loss = swarmwright.transfer(["result"], vary=faster, candidates=2, seeds=5)
        >>> loss.targets
        ('pseudo-reality',)

    See also: `post_evaluate`, for other seeds of the same simulation.
    """
    require_list("runs", runs, "run folders")
    require_list("to", to, "simulations or files of them")
    to = [
        text("to", opened_runs, "a list of names of simulations, or of files of them") for opened_runs in to
    ]
    seeds = integer("seeds", seeds)
    opened = [open_run(run) for run in runs]
    if not opened:
        raise InputError("there are no runs to transfer; name run folders such as runs/minisim-1")
    for name, number, least in (("candidates", candidates, 1), ("random", random, 0), ("seeds", seeds, 2)):
        if number < least:
            raise InputError(f"{name}: must be at least {least}, not {number}")
    groups, notes = group(opened, besides={"parameters.seed"})
    counted_runs = [run for group in groups for run in group.runs]
    ranges = ranges_of(vary)
    if pseudo_reality:
        for run in counted_runs:
            require_e_pucks(run.experiment)
        ranges = [*E_PUCKS, *ranges]
    targets = targets_of(to, ranges)
    used = set[int]().union(*(run._store.collect_seeds() for run in counted_runs))
    first = min(run.experiment.first_seed for run in counted_runs)
    episodes = choose_unseen_seeds(first, used if seed is None else set(), seeds, seed)
    plans = [_plan(run, targets, candidates, random, seeds) for run in counted_runs]
    for plan in plans:
        plan.check(broker)
    total = sum(plan.episodes(seeds) for plan in plans)
    work = Work(episodes, broker, servers, on_progress, total, prefix=prefix)
    transfers = [
        transferred
        for run, plan in zip(counted_runs, plans, strict=True)
        for transferred in _evaluate_run(run, plan, work)
    ]
    names = tuple(target.name for target in targets)
    sentences = (*notes, *_check_equal(plans), *_cautions(groups, transfers))
    result = Transfer(tuple(episodes), names, tuple(transfers), tuple(groups), sentences)
    return replace(result, notes=(*sentences, *ties(result.pairs)))


def _plan(run: Run, targets: Sequence[Target], candidates: int, random: int, seeds: int) -> Plan:
    best = find_leading(run.experiment, run._store, candidates)
    return Plan.of(resolve_experiment(run, best[0].generation), best, targets, random=random, seeds=seeds)


def _evaluate_run(run: Run, plan: Plan, work: Work) -> Iterator[Transferred]:
    """Evaluate the candidates of a run in its own simulation and in all targets."""
    source = work.evaluate_source(plan)
    ranking = plan.experiment.new_ranking()
    for target, experiments in plan.targets:
        target_fitness = work.evaluate_target(plan, target, experiments)
        yield Transferred(run, target.name, plan.candidates, source, target_fitness, ranking)


def _check_equal(plans: Sequence[Plan]) -> Iterator[str]:
    """Yield notes on targets that are the simulation in which the candidates evolved."""
    same = {
        target.name: None
        for plan in plans
        for target, experiments in plan.targets
        if isinstance(target, OtherSimulation) and is_same(experiments[0], plan.experiment)
    }
    for name in same:
        yield (
            f"{name} is what candidates were evolved in, with the same parameters: nothing is lost there but "
            "by chance; to change parameters, name a file (.yaml) with those that differ, or vary them"
        )


def _describe_failures(failures: Sequence[Transferred]) -> Iterator[str]:
    """Yield notes on the number of failed episodes in each simulation, and on how they count."""
    failed_targets: dict[str, int] = {}
    evaluate_source: dict[str, int] = {}  # equal for all targets of a run
    for transferred in failures:
        failed_targets[transferred.target] = failed_targets.get(transferred.target, 0) + transferred.failed
        evaluate_source[str(transferred.run.path)] = transferred.source_failed
    left_out = any(transferred.ranking.options.failure_fitness is None for transferred in failures)
    how = (
        "are left out, so the means are those of the episodes that worked and not to be reported; "
        "ranking.failed: NUMBER gives failures a fitness"
        if left_out
        else "count with the fitness that ranking.failed gives them"
    )
    for where, count in {"the runs' own simulation": sum(evaluate_source.values()), **failed_targets}.items():
        if count:
            yield f"{format_count(count, 'episode')} failed in {where} and {how}"


def _cautions(groups: Sequence[RunGroup], cautions: Sequence[Transferred]) -> Iterable[str]:
    yield from _describe_failures(cautions)
    if len(groups) > 1 and min(len(group.runs) for group in groups) < FEW_RUNS:
        yield f"with fewer than {FEW_RUNS} runs of a group a test has little power"
    tasks = group_by_task(groups, by="fitness", held_out=False)
    if any(len(task.indices) > 1 for task in tasks) and len(tasks) > 1:
        yield different_tasks()
    members = [(task.differs, [groups[index].label for index in task.indices]) for task in tasks]
    alone = describe_untested(members)
    if alone is not None:
        yield alone
    yield from describe_pooling(groups, tasks)
    yield from budgets(groups)
    if any(not math.isfinite(transferred.losses[0].mean) for transferred in cautions):
        yield "the best of a run failed in every episode"


def load_run_transfer(run: Run) -> Transfer | None:
    """Return the transfer at the end of a run whose `validate` names simulations; None if there is none."""
    transfers_of_run = run.transferred
    if not transfers_of_run:
        return None
    groups, _ = group([run])
    names = tuple(transferred.target for transferred in transfers_of_run)
    return Transfer(
        tuple(read_seeds(run)),
        names,
        transfers_of_run,
        tuple(groups),
        tuple(_cautions(groups, transfers_of_run)),
    )
