"""`swarmwright evaluate`: a candidate once more, from its record or in other episodes."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import (
    ExistingPath,
    Servers,
    WholeNumber,
    broker_option,
    candidate_options,
    experiment_broker,
    json_option,
    servers_option,
    set_option,
    simulation_option,
    trust_option,
)
from swarmwright.cli._output import Output, show_warnings
from swarmwright.cli._server_output import server_output_option

if TYPE_CHECKING:
    from swarmwright import Experiment, PostEvaluation, Run
    from swarmwright.core.statistics import Estimate


@click.command(
    "evaluate",
    cls=Command,
    example="swarmwright evaluate runs/minisim-1\n"
    "swarmwright evaluate runs/minisim-1 --generation 3 --candidate 12\n"
    "swarmwright evaluate runs/minisim-1 --episodes 100 --seed 5000\n"
    "swarmwright evaluate runs/minisim-1 --episodes 100 --set parameters.speedDefenders=0.5\n"
    "swarmwright evaluate runs/minisim-1 --episodes 100 --metrics all --json",
)
@click.argument("run", type=ExistingPath(folder=True), metavar="RUN")
@click.option(
    "--episodes",
    type=WholeNumber(min=1, max=10_000_000),
    metavar="N",
    help="Evaluate in N episodes with other seeds than the record's. Default with --seed: 100.",
)
@click.option(
    "--seed",
    type=WholeNumber(min=0, max=2**62),
    metavar="S",
    help="Simulation seed of the first of these episodes; the others have S + 1, S + 2, .. Default: the "
    "held-out seeds of the run's validation, which evolution did not use; name another S for fresh ones.",
)
@candidate_options
@set_option("With --episodes, another value than the run's: parameters.maxSteps=40.")
@click.option(
    "--metrics",
    metavar="NAME,..",
    help="With --episodes, metrics that are measured beside those that the fitness needs: arrived,steps. "
    "'all': those that the simulation announces.",
)
@broker_option(
    default=None,
    text="Use the servers on this broker. Default: the run's, SWARMWRIGHT_BROKER's, or one started here.",
)
@servers_option
@simulation_option
@server_output_option
@trust_option
@json_option
def command(
    run: Path,
    episodes: int | None,
    seed: int | None,
    candidate: int | None,
    generation: int | None,
    settings: tuple[str, ...],
    metrics: str | None,
    broker: str | None,
    servers: Servers | None,
    simulation: str | None,
    as_json: bool,
) -> int:
    """Evaluate a candidate of a run once more.

    It is the best one of RUN unless another is named. Without --episodes and --seed, the seeds are those of
    the record, and the command reports whether the fitness is the same: the exit status is 0 if every episode
    is bit-identical, else 1. With one of them, the candidate is evaluated in other episodes: the best of a
    run was chosen by its fitness, so its recorded fitness is biased upwards wherever fitness depends on the
    seed.

    Where the code of the simulation was edited after the run, the copy in RUN is used, with a message.
    """
    from swarmwright import Run
    from swarmwright.experiment.experiment import ELSEWHERE
    from swarmwright.experiment.settings import refuse_seed
    from swarmwright.runs.code import used_for

    output = Output(as_json=as_json)
    show_warnings()
    opened = Run.open(run)
    again = episodes is None and seed is None
    only = ELSEWHERE - {"validate"}
    if not again:
        only |= {"parameters", "fitness", "ranking", "simulation"}
    reason = (
        "--set changes the conditions, so that the result cannot be compared with the record; add "
        "--episodes N"
        if again
        else "it does not say how a candidate is evaluated; parameters, fitness, ranking and where it is "
        "evaluated can be set"
    )
    used = used_for(opened, opened.evaluation(candidate, generation).generation, simulation)
    refuse_seed(settings)
    experiment = used.with_settings(settings, only=only, reason=reason)
    broker = experiment_broker(
        broker, experiment.broker, servers if servers is not None else experiment.servers
    )
    if again:
        if metrics is not None:
            raise click.UsageError("--metrics: add --episodes N; metrics are measured in new episodes only")
        return _repeated(output, opened, experiment, candidate, generation, broker, servers)
    from swarmwright import post_evaluate
    from swarmwright.cli._progress import episodes as shown_episodes
    from swarmwright.runs.post_evaluation import EPISODES

    with shown_episodes(output) as on_progress:
        found = post_evaluate(
            opened,
            candidate,
            generation,
            episodes=episodes or EPISODES,
            seed=seed,
            experiment=experiment,
            broker=broker,
            servers=servers,
            on_progress=on_progress,
            metrics="all" if metrics == "all" else [] if metrics is None else _names(metrics),
        )
    output.json({"run": str(run), **found.to_mapping()})
    _show(output, found, (opened.store.validation() or {}).get("seeds", ()))
    return 0


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _repeated(
    output: Output,
    run: "Run",
    experiment: "Experiment",
    candidate: int | None,
    generation: int | None,
    broker: str | None,
    servers: Servers | None,
) -> int:
    from swarmwright import repeat

    found = repeat(run, candidate, generation, experiment=experiment, broker=broker, servers=servers)
    output.json(
        {
            "number": found.number,
            "generation": found.generation,
            "candidate": found.candidate,
            "seeds": found.seeds,
            "recorded": found.recorded.tolist(),
            "repeated": found.repeated.tolist(),
            "same": found.same,
            "left_out": found.left_out,
        }
    )
    output.text(f"Candidate {found.candidate} of generation {found.generation}, evaluation {found.number}.")
    for episode, (before, now) in enumerate(
        zip(found.recorded.tolist(), found.repeated.tolist(), strict=True)
    ):
        output.text(f"  episode {episode}: recorded {before!r}, now {now!r}")
    if found.left_out:
        ran = len(found.recorded)
        output.text(
            f"It was dropped from the race after {ran} of {ran + found.left_out} episodes, "
            "which are compared."
        )
    output.text("The fitness is the same, to the bit." if found.same else "The fitness is NOT the same.")
    return 0 if found.same else 1


def _show(output: Output, found: "PostEvaluation", validation: Sequence[int]) -> None:
    values = found.to_mapping()
    output.text(
        f"Candidate {found.candidate} of generation {found.generation}, evaluation {found.number}: recorded "
        f"fitness {found.recorded + 0.0:.6g}."
    )
    count = len(found.episodes)
    output.text(f"{count} episode{'s' * (count > 1)} with {_seeds(found, validation)}:")
    if found.failed:
        output.text(f"  {found.failed} failed; the others:")
    deviation = values["standard_deviation"]
    spread = "" if deviation is None else f", standard deviation {deviation:.4g}"
    output.text(f"  mean {_interval(found.mean)}{spread}")
    output.text(f"  median {values['median']:.6g}, lowest {values['min']:.6g}, highest {values['max']:.6g}")
    options = found.ranking.options
    if hasattr(options, "slow"):
        output.text("  in the run's own simulation; the recorded fitness is made with the ranking's slow one")
    if options.episodes > 1 and found.fitness != found.mean:
        how = getattr(options, "aggregate", options.kind)
        what = f"  fitness, as the {how} of {options.episodes} episodes"
        enough = math.isfinite(found.fitness.mean)  # of those that did not fail
        output.text(f"{what}: {_interval(found.fitness) if enough else 'not known, too many failed'}")
    _show_metrics(output, found)


def _seeds(found: "PostEvaluation", validation: Sequence[int]) -> str:
    """Return which seeds they are, and what they have been used for before.

    validation: seeds of the run's own validation.
    """
    first, last, count = found.seeds[0], found.seeds[-1], len(found.seeds)
    seeds = f"seeds {first} to {last}" if count > 1 else f"seed {first}"
    if found.seen:
        return f"the {seeds}, {found.seen} of them used by the run"
    if not found.validated:
        return f"the held-out {seeds}"
    which = "the same as" if found.validated == count else f"{found.validated} of them"
    fresh = max(last, *validation) + 1
    return f"the held-out {seeds}, {which} those of the run's validation (fresh ones: --seed {fresh})"


def _show_metrics(output: Output, found: "PostEvaluation") -> None:
    from swarmwright.core.statistics import estimate

    for name, values in found.metrics.items():
        known = [value for value in values.tolist() if math.isfinite(value)]
        without = len(values) - len(known)
        gaps = f"; {without} of {len(values)} episodes have no finite value" if without else ""
        output.text(f"  {name}: mean {_interval(estimate(known))}{gaps}")


def _interval(estimate: "Estimate") -> str:
    if estimate.standard_error is None:
        return f"{estimate.mean + 0.0:.6g}"
    return (
        f"{estimate.mean + 0.0:.6g}, standard error {estimate.standard_error:.2g}, "
        f"95 % confidence interval {estimate.low:.6g} to {estimate.high:.6g} (Student's t)"
    )
