"""Checks of the ranking of an experiment with its method, its validation and its fitness expression."""

from swarmwright.common.plug_in_code import is_plug_in
from swarmwright.common.problems import Report
from swarmwright.experiment.document import AUTO, Checked
from swarmwright.experiment.unavailable import ranking_of
from swarmwright.methods import METHODS, MethodOptions
from swarmwright.methods.rankings import Ranking, RankingOptions
from swarmwright.methods.rankings.race import RaceOptions
from swarmwright.methods.rankings.slow_simulation import METRIC, SlowOptions
from swarmwright.methods.rankings.transferability import TransferabilityOptions
from swarmwright.simulations.fitness import FitnessExpression


def check_ranking(checked: Checked, report: Report) -> None:
    """Check that the ranking fits the method, the validation and the fitness expression.

    Args:
        checked: ranking, method, validate and fitness, as far as they could be checked by themselves.
        report: takes each problem.
    """
    _check_reevaluation(checked, report)
    _check_failed(checked, report)
    problem = metrics_problem(checked.get("ranking"), checked.get("method"))
    if problem is not None:
        report(("ranking", "kind"), problem)
    _check_validation(checked, report)
    _check_metrics(checked, report)


def _check_reevaluation(checked: Checked, report: Report) -> None:
    """Check that the ranking's options fit the method."""
    ranking, method = checked.get("ranking"), checked.get("method")
    if not (isinstance(ranking, RankingOptions) and isinstance(method, MethodOptions)):
        return
    kind: str = method.kind
    if isinstance(ranking, RaceOptions):
        _check_race(ranking, method, kind, report)
    if isinstance(ranking, SlowOptions):
        _check_slow(method, kind, report)
    if method.operation == "steady_state":
        for key, unwanted, reason in (
            ("reevaluate", ranking.reevaluate, "members are not evaluated again in steady state"),
            ("seeds", ranking.seeds == "new", "generations have no seeds of their own in steady state"),
        ):
            if unwanted:
                report(("ranking", key), f"{reason}; leave the key out, or take operation: generational")
        return
    if ranking.reevaluate and not METHODS.get(kind).keeps_members:
        report(
            ("ranking", "reevaluate"),
            f"{kind} keeps no members from one generation to the next that could be evaluated again; leave "
            "the key out, or take a method that does, such as nnga",
        )


def _check_failed(checked: Checked, report: Report) -> None:
    """Check that failed episodes get a fitness only where nothing but fitness is compared."""
    ranking, method = checked.get("ranking"), checked.get("method")
    if not isinstance(ranking, RankingOptions) or ranking.failure_fitness is None:
        return
    compares = None
    if isinstance(method, MethodOptions) and method.needed_metrics:
        compares = f"{method.kind} also compares metrics ({', '.join(method.needed_metrics)})"
    elif isinstance(ranking, TransferabilityOptions):
        compares = "transferability also compares metrics"
    if compares is not None:
        report(
            ("ranking", "failed"),
            f"{compares}, which a failed episode does not have, so a fitness alone does not rank it; take "
            "failed: last or failed: stop",
        )


def _check_race(ranking: RaceOptions, method: MethodOptions, kind: str, report: Report) -> None:
    """Check that there are generations of candidates that can race, and tests between episodes."""
    if ranking.episodes <= ranking.first_test:
        report(
            ("ranking", "episodes"),
            f"{ranking.episodes} leaves nothing to race for, since the first test is made after "
            f"{ranking.first_test} episodes (first_test); take more episodes, or an earlier test",
        )
    if method.operation == "steady_state":
        reason = "in steady state no generation can race; take operation: generational, or kind: absolute"
    elif METHODS.get(kind).by_instance:
        reason = f"{kind} races its candidates itself, over generations; take kind: absolute"
    else:
        return
    report(("ranking", "kind"), reason)


def metrics_problem(ranking: object, method: object) -> str | None:
    """Return why a ranking is refused with a method that also compares metrics; None where it is not."""
    if not (isinstance(method, MethodOptions) and method.needed_metrics):
        return None
    kind: str = method.kind
    names = ", ".join(method.needed_metrics)
    if isinstance(ranking, RaceOptions):
        return (
            f"race leaves out episodes of candidates, so {kind} would compare their metrics ({names}) as "
            "means over different seeds; take kind: absolute"
        )
    if isinstance(ranking, SlowOptions):
        slow: str = ranking.kind
        return (
            f"{kind} cannot be combined with {slow}: most fitness values would be estimates, those of "
            f"overestimated candidates would be kept, and compared with metrics ({names}) of the fast "
            "simulation; take ranking.kind: absolute, and evaluate the result in the slow simulation"
        )
    return None


def _check_slow(method: MethodOptions, kind: str, report: Report) -> None:
    """Check that there are generations of which some candidates can be evaluated in a second simulation."""
    if method.operation == "steady_state":
        reason = (
            "in steady state there are no generations of which the best could be chosen; take operation: "
            "generational, or kind: absolute"
        )
    elif METHODS.get(kind).by_instance:
        reason = f"{kind} races its candidates in one simulation; take another method, or kind: absolute"
    else:
        return
    report(("ranking", "kind"), reason)


def _check_metrics(checked: Checked, report: Report) -> None:
    """Check that no metric of the fitness is called like the one that a ranking adds to the record."""
    fitness, ranking = checked.get("fitness"), checked.get("ranking")
    if (
        isinstance(ranking, SlowOptions)
        and fitness is not None
        and METRIC in FitnessExpression(fitness).metrics
    ):
        report(
            ("fitness",),
            f"{METRIC} is what the ranking {ranking.kind} calls the fitness in the slow simulation; give the "
            "simulation's metric another name",
        )


def _check_validation(checked: Checked, report: Report) -> None:
    """Check that a validation has enough episodes for one fitness, as the ranking makes it."""
    options, ranking = checked.get("validate"), checked.get("ranking")
    if options is None or ranking is None or options.episodes in {AUTO, 0}:
        return
    if not makes_fitness(ranking, options.episodes):
        report(
            ("validate", "episodes"),
            f"must be at least ranking.episodes, {ranking.episodes}, of which a fitness is made, not "
            f"{options.episodes}",
        )


def makes_fitness(ranking: RankingOptions, episodes: int) -> bool:
    """Return whether so many episodes are enough for one fitness, as the ranking makes it."""
    kind = ranking_of(ranking)
    if kind.samples is Ranking.samples or is_plug_in(kind):
        return episodes >= ranking.episodes  # without asking the code of plug-ins
    return len(kind(ranking).samples([0.0] * episodes)) > 0
