"""Checks of an experiment's ranking with its method, validation and fitness expression."""

from swarmwright.common.plug_in_code import is_plug_in
from swarmwright.common.problems import Report
from swarmwright.experiment.document import AUTO, Checked
from swarmwright.experiment.unavailable import ranking_of
from swarmwright.methods import METHODS, MethodOptions
from swarmwright.methods.rankings import Ranking, RankingOptions
from swarmwright.methods.rankings.race import RaceOptions
from swarmwright.methods.rankings.slow_simulation import METRIC, SlowOptions
from swarmwright.methods.rankings.tournament import TournamentOptions
from swarmwright.methods.rankings.transferability import TransferabilityOptions
from swarmwright.simulations.fitness import FitnessExpression


def check_ranking(checked: Checked, report: Report) -> None:
    """Check that the ranking is compatible with the method, the validation and the fitness expression.

    Args:
        checked: ranking, method, validate and fitness, if they are valid by themselves.
        report: called with each problem.
    """
    _check_reevaluation(checked, report)
    _check_failed(checked, report)
    problem = metrics_problem(checked.get("ranking"), checked.get("method"))
    if problem is not None:
        report(("ranking", "kind"), problem)
    _check_constraints(checked, report)
    _check_validation(checked, report)
    _check_metrics(checked, report)


def _check_reevaluation(checked: Checked, report: Report) -> None:
    """Check that the ranking's options are compatible with the method."""
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
            ("reevaluate", ranking.reevaluate, "steady state does not evaluate members again"),
            ("seeds", ranking.seeds == "new", "steady state has no generations with new seeds"),
        ):
            if unwanted:
                report(("ranking", key), f"{reason}; leave the key out, or use operation: generational")
        return
    if getattr(method, "reevaluate", 0) and ranking.seeds != "new":
        report(
            ("ranking", "seeds"),
            "must be new with method.reevaluate, as evaluations on the same seeds would say nothing new",
        )
    if ranking.reevaluate and not METHODS.get(kind).keeps_members:
        report(
            ("ranking", "reevaluate"),
            f"{kind} has no survivors to evaluate again; leave the key out, or use a method with survivors, "
            "such as nnga",
        )


def _check_failed(checked: Checked, report: Report) -> None:
    """Check that failed episodes get a fitness only if metrics are not compared."""
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
            f"{compares}, which failed episodes lack; use failed: last or failed: stop",
        )


def _check_constraints(checked: Checked, report: Report) -> None:
    """Check that every candidate has the means of its metrics over the same episodes."""
    ranking, method = checked.get("ranking"), checked.get("method")
    if not checked.get("constraints") or not isinstance(ranking, RankingOptions):
        return
    kind: str = ranking.kind
    if isinstance(ranking, RaceOptions | SlowOptions | TournamentOptions):
        report(
            ("constraints",),
            f"are not possible with ranking.kind: {kind}, which does not evaluate all candidates in the same "
            "episodes; use kind: absolute",
        )
    elif ranking.reevaluate:
        report(
            ("constraints",),
            "are not possible with ranking.reevaluate, as survivors would have fitness and metrics of "
            "different episodes; leave that key out",
        )
    elif ranking.failure_fitness is not None:
        report(
            ("ranking", "failed"),
            "constraints compare metrics, which failed episodes lack; use failed: last or failed: stop",
        )
    elif isinstance(method, MethodOptions) and METHODS.get(method.kind).by_instance:
        name: str = method.kind
        report(
            ("constraints",),
            f"are not possible with {name}, which evaluates candidates on different numbers of instances; "
            "use another method",
        )


def _check_race(ranking: RaceOptions, method: MethodOptions, kind: str, report: Report) -> None:
    """Check that generations can race, with tests between episodes."""
    if ranking.episodes <= ranking.first_test:
        report(
            ("ranking", "episodes"),
            f"{ranking.episodes} is too few for a race with its first test after {ranking.first_test} "
            "episodes (first_test); increase episodes or decrease first_test",
        )
    if method.operation == "steady_state":
        reason = (
            "steady state has no generations that can race; use operation: generational, or kind: absolute"
        )
    elif METHODS.get(kind).by_instance:
        reason = f"{kind} already races its candidates over generations; use kind: absolute"
    else:
        return
    report(("ranking", "kind"), reason)


def metrics_problem(ranking: object, method: object) -> str | None:
    """Return why a ranking is refused with a method that also compares metrics, or None."""
    if not (isinstance(method, MethodOptions) and method.needed_metrics):
        return None
    kind: str = method.kind
    names = ", ".join(method.needed_metrics)
    if isinstance(ranking, RaceOptions):
        return (
            f"race skips episodes, so {kind} would compare metrics ({names}) over different seeds; use kind: "
            "absolute"
        )
    if isinstance(ranking, SlowOptions):
        slow: str = ranking.kind
        return (
            f"{kind} cannot be combined with {slow}, as it would keep overestimated candidates and compare "
            f"them with metrics ({names}) of the fast simulation; use ranking.kind: absolute, and "
            "evaluate the result in the slow simulation"
        )
    return None


def _check_slow(method: MethodOptions, kind: str, report: Report) -> None:
    """Check that generations have candidates to evaluate in a second simulation."""
    if method.operation == "steady_state":
        reason = (
            "steady state has no generations from which to choose the best; use operation: generational, or "
            "kind: absolute"
        )
    elif METHODS.get(kind).by_instance:
        reason = f"{kind} races its candidates in one simulation; use another method, or kind: absolute"
    else:
        return
    report(("ranking", "kind"), reason)


def _check_metrics(checked: Checked, report: Report) -> None:
    """Check that no metric of the fitness has the name that a ranking adds to the record."""
    fitness, ranking = checked.get("fitness"), checked.get("ranking")
    if (
        isinstance(ranking, SlowOptions)
        and fitness is not None
        and METRIC in FitnessExpression(fitness).metrics
    ):
        report(
            ("fitness",),
            f"the ranking {ranking.kind} uses the name {METRIC} for the fitness in the slow simulation; "
            "rename the simulation's metric",
        )


def _check_validation(checked: Checked, report: Report) -> None:
    """Check that a validation has enough episodes for one fitness value of the ranking."""
    options, ranking = checked.get("validate"), checked.get("ranking")
    if options is None or ranking is None or options.episodes in {AUTO, 0}:
        return
    if not makes_fitness(ranking, options.episodes):
        report(
            ("validate", "episodes"),
            f"must be at least ranking.episodes, {ranking.episodes}, for one fitness value, not "
            f"{options.episodes}",
        )


def makes_fitness(ranking: RankingOptions, episodes: int) -> bool:
    """Return whether `episodes` are enough for one fitness value of the ranking."""
    kind = ranking_of(ranking)
    if kind.samples is Ranking.samples or is_plug_in(kind):
        return episodes >= ranking.episodes  # does not run the code of plug-ins
    return len(kind(ranking).samples([0.0] * episodes)) > 0
