"""Messages about the fitness of a run's best candidates on held-out seeds."""

import shlex
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from swarmwright.common.formatting import format_count, format_table
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from swarmwright import ControllerEvaluation, PostEvaluation, Run, Transfer, Validation
    from swarmwright.common.statistics import Estimate


def validation_lines(validation: "Validation", run: "Run") -> Iterator[str]:
    """Yield lines on the recorded and the held-out fitness of the best, and on the next best candidates.

    run: the validated run.
    """
    from swarmwright.runs.instances import instances

    best, count = validation.best, len(validation.seeds)
    if not validation.depends_on_seed:
        yield (
            f"{f'All {count:,} held-out episodes' if count > 1 else 'The held-out episode'} gave the "
            "recorded fitness, so it does not seem to depend on the seed. Report the recorded fitness of "
            "this controller; to judge the method, run it with several seeds (`swarmwright sweep`)."
        )
        yield from _start_lines(validation, run)
        return
    options = best.ranking.options
    aggregation = f"generation {best.generation}"
    if validation.by_instance:
        used = len(instances(run, run.evaluation(best.candidate, best.generation)))
        aggregation = f"mean of the {used:,} instances it was evaluated on"
    elif not options.reevaluate:
        aggregation = f"{format_count(options.episodes, 'episode')} of {aggregation}"
    where = "" if validation.slow is None else f" in {escape_line(validation.slow)}"
    yield f"Recorded fitness {best.recorded + 0.0:.6g} ({aggregation}); selection biases it upwards."
    measured = (
        f"Fitness on {format_count(count, 'episode')} with held-out seeds{where}{_describe_failed(best)}"
    )
    if best.is_reportable:
        yield f"{measured}: {_format_estimate(best.fitness)}. Report this one."
    else:
        yield f"{measured}: {_format_estimate(best.fitness)} in the other {len(best.counted):,}."
        command = f"swarmwright evaluate {shlex.quote(str(run.path))} --episodes {count}"
        yield (
            "Do not report this value, which excludes failures. ranking.failed: NUMBER gives failed "
            f"episodes a fitness; for this run: {command} --set ranking.failed=NUMBER"
        )
    yield from _violation_lines(validation)
    if len(validation.candidates) > 1:
        yield from _next_best_lines(validation)
    yield from _start_lines(validation, run)


def _violation_lines(validation: "Validation") -> Iterator[str]:
    """Yield a line for each constraint that the best candidate violates on the held-out seeds."""
    from swarmwright.common.statistics import means
    from swarmwright.runs.feasibility import describe_limits

    for name, limits in validation.constraints.items():
        mean = means(validation.best.metrics[name].reshape(1, -1, 1))[0]
        if not limits.meets(mean).all():
            (limit,) = describe_limits({name: limits})
            yield f"It violates a constraint on these seeds: {limit}, but the mean is {mean[0]:.4g}."


def _describe_failed(evaluation: "ControllerEvaluation") -> str:
    """Return how many episodes failed and how they count; empty if none failed."""
    if not evaluation.failed:
        return ""
    value = evaluation.ranking.options.failure_fitness
    return f", of which {evaluation.failed:,} failed" + ("" if value is None else f" and count as {value:g}")


def explain_missing_validation(run: "Run") -> str | None:
    """Return why a finished run was not validated; None if it was, or does not need to be."""
    from swarmwright.runs.validation import check_affordability

    short = check_affordability(run)
    if short is None:
        return None
    return (
        f"Not validated on held-out seeds: {short.share:.0%} of the run's evaluations are "
        f"{format_count(short.affordable, 'episode') if short.affordable else 'no episode'}, fewer than the "
        f"{short.needed:,} that a validation needs. If fitness depends on the seed, the recorded fitness "
        f"is biased upwards; `{short.command}` validates the run."
    )


def _start_lines(validation: "Validation", run: "Run") -> Iterator[str]:
    """Yield lines on the starting controller, and on whether the best is better."""
    if validation.start is None:
        return
    count = len(validation.seeds)
    if validation.start.failed == count:
        where = f"all of these {format_count(count, 'episode')}" if count > 1 else "this episode"
        yield f"The starting controller failed in {where}."
        return
    where = f"these {format_count(count, 'episode')}" if count > 1 else "this episode"
    yield (
        f"The starting controller on {where}{_describe_failed(validation.start)}: "
        f"{_format_estimate(validation.start.fitness)}."
    )
    gain = validation.gain
    if gain is None or gain.mean > 0 or (gain.mean == 0 and gain.low == gain.high):
        return  # better, or known to be as good: in each episode, or in the only one
    interval = ""
    if gain.low is not None and gain.high is not None:
        interval = f", 95 % interval {gain.low:.2g} to {gain.high:.2g} of the differences"
    worse = gain.high is None or gain.high < 0
    compared = f"worse than that by {-gain.mean:.2g}" if worse else "not better than that"
    yield (
        f"The best of the run is {compared}{interval}: the method samples around the controller and does not "
        f"keep it. {_nearer(run)}nnga, de and pso keep it among their candidates."
    )


def _nearer(run: "Run") -> str:
    """Return advice on the option that draws samples nearer to the controller; plug-ins have none."""
    options = run.experiment.method
    key = next((name for name in ("noise", "step") if name in type(options).model_fields), None)
    return f"A smaller method.{key} samples nearer to it; " if key else "The methods "


def _next_best_lines(validation: "Validation") -> Iterator[str]:
    """Yield a table of all candidates, and a line if one is better than the best of the run."""
    yield f"The {len(validation.candidates)} best of the run, on these seeds:"
    rows = [("generation", "candidate", "recorded", "held-out", "95 % interval")]
    for candidate in validation.candidates:
        fitness = candidate.fitness
        interval = "" if fitness.low is None else f"{fitness.low:.4g} to {fitness.high:.4g}"
        if candidate.failed:
            interval = f"{interval}, {candidate.failed} failed".removeprefix(", ")
        numbers = (f"{candidate.recorded + 0.0:.6g}", f"{fitness.mean + 0.0:.4g}")
        rows.append((str(candidate.generation), str(candidate.candidate), *numbers, interval))
    yield from format_table(rows, "  ")
    if not all(candidate.is_reportable for candidate in validation.candidates):
        yield "Means exclude failed episodes, so candidates with failures cannot be compared with the others."
    lead = validation.lead
    if lead is not None and lead.low is not None and lead.low > 0:
        ahead = validation.leading
        others = len(validation.candidates) - 1
        corrected = f", corrected for {others} candidates after Bonferroni" if others > 1 else ""
        yield (
            f"Candidate {ahead.candidate} of generation {ahead.generation} is better than the best of the "
            f"run by {lead.mean:.2g}, 95 % interval {lead.low:.2g} to {lead.high:.2g} of the differences"
            f"{corrected}."
        )


def validation_facts(validation: "Validation") -> dict[str, Any]:
    """Return plain values for `--json`."""
    return {
        "depends_on_seed": validation.depends_on_seed,
        "episodes": len(validation.seeds),
        "seed": validation.seeds[0],
        "confidence": 0.95,
        "interval": "t",
        "candidates": [validation.summarize(candidate) for candidate in validation.candidates],
        **({} if validation.start is None else {"start": validation.start.summary()}),
    }


def transfer_of(run: "Run") -> "Transfer | None":
    """Return the results of a run in other simulations; None without such simulations."""
    if not run.transferred:
        return None
    from swarmwright.analysis.transfer.transfer import load_run_transfer

    return load_run_transfer(run)


def with_error(mean: float, error: float | None) -> str:
    """Return a mean with its standard error: 7.81 with standard error 0.31."""
    return f"{mean + 0.0:.4g}" + ("" if error is None else f" with standard error {error:.2g}")


def unseen_facts(evaluation: "PostEvaluation") -> dict[str, Any]:
    """Return plain values of the best for `--json`."""
    fitness = evaluation.fitness
    return {
        "fitness": fitness.mean,
        "standard_error": fitness.standard_error,
        "low": fitness.low,
        "high": fitness.high,
        "episodes": len(evaluation.episodes),
        "failed": evaluation.failed,
        "reportable": evaluation.is_reportable,
        "seed": evaluation.seeds[0],
    }


def _format_estimate(estimate: "Estimate") -> str:
    if estimate.low is None:
        return f"{estimate.mean + 0.0:.4g}"
    return (
        f"{estimate.mean + 0.0:.4g}, 95 % confidence interval {estimate.low:.4g} to {estimate.high:.4g} "
        "(Student's t)"
    )
