"""`swarmwright evaluate`: a candidate on held-out seeds, an evaluation repeated, or a learning curve."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import (
    ExistingPath,
    OutputFile,
    OutputOption,
    Servers,
    WholeNumber,
    candidate_options,
    experiment_broker,
    experiment_broker_options,
    json_option,
    prefix_settings,
    server_output_option,
    servers_option,
    set_option,
    simulation_option,
    trust_option,
)
from swarmwright.cli._output import Output, show_warnings
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from swarmwright import ControllerEvaluation, Experiment, PostEvaluation, Repetition, Run
    from swarmwright.cli._options import Servers
    from swarmwright.common.statistics import Estimate


NOT_EVALUATED = (
    "it does not affect how a candidate is evaluated; set parameters, fitness, ranking, or where it is "
    "evaluated"
)


@click.command(
    "evaluate",
    cls=Command,
    example="swarmwright evaluate runs/minisim-1\n"
    "swarmwright evaluate runs/minisim-1 --generation 3 --candidate 12\n"
    "swarmwright evaluate runs/minisim-1 --episodes 100 --seed 5000\n"
    "swarmwright evaluate runs/minisim-1 --episodes 100 --set parameters.speedDefenders=0.5\n"
    "swarmwright evaluate runs/minisim-1 --episodes 100 --metrics all --json\n"
    "swarmwright evaluate runs/minisim-1 --curve 20 --out curve.png\n"
    "swarmwright evaluate minisim.yaml --controller mine.json --episodes 100",
)
@click.argument("run", type=ExistingPath(folder=None), metavar="RUN")
@click.option(
    "--controller",
    "controller_file",
    type=ExistingPath(folder=None),
    metavar="C",
    help="Controller file (JSON, or YAML of a machine) or run folder to evaluate instead; RUN may then be "
    "an experiment file. Needs --episodes or --seed.",
)
@click.option(
    "--episodes",
    type=WholeNumber(min=1, max=10_000_000),
    metavar="N",
    help="Evaluate in N episodes on seeds outside the record. Default with --seed: 100.",
)
@click.option(
    "--seed",
    type=WholeNumber(min=0, max=2**62),
    metavar="S",
    help="Simulation seed of the first episode; the others count up. Default: the held-out seeds of the "
    "run's validation; give S for fresh seeds.",
)
@click.option(
    "--curve",
    type=WholeNumber(min=1, max=100_000),
    metavar="N",
    help="Evaluate the best candidate after each of N evenly spaced generations, on the same held-out "
    "seeds. Default of --episodes: 100.",
)
@click.option(
    "--out",
    "file",
    cls=OutputOption,
    type=OutputFile(),
    metavar="FILE",
    help="With --curve: draw it (.png, .svg or .pdf), or write it as a table (.csv).",
)
@candidate_options
@set_option("With --episodes: override a value of the run: parameters.maxSteps=40.")
@click.option(
    "--metrics",
    metavar="NAME,..",
    help="With --episodes: additional metrics to measure, such as arrived,steps; 'all' for every "
    "announced metric.",
)
@experiment_broker_options()
@servers_option
@simulation_option
@server_output_option
@trust_option
@json_option
def command(
    run: Path,
    controller_file: Path | None,
    episodes: int | None,
    seed: int | None,
    curve: int | None,
    file: Path | None,
    candidate: int | None,
    generation: int | None,
    settings: tuple[str, ...],
    metrics: str | None,
    broker: str | None,
    prefix: str | None,
    servers: Servers | None,
    simulation: str | None,
    as_json: bool,
) -> int:
    """Repeat an evaluation, or evaluate on held-out seeds.

    By default, the recorded episodes of the best candidate of RUN are repeated. The exit status is 0 if all
    results are bit-identical, else 1.

    With --episodes or --seed, the candidate is evaluated on seeds that the run did not use. If fitness
    depends on the seed, report this fitness: selection biases the recorded fitness upwards.

    With --controller, that controller is evaluated in the simulation of RUN or of an experiment file.
    `swarmwright compare` compares two controllers.

    With --curve, the best candidates of several generations are evaluated. Fitness on held-out seeds falls
    where evolution overfits its seeds.

    If the simulation's code was edited after the run, the copy in RUN is used, with a message.
    """
    from swarmwright import Run
    from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD
    from swarmwright.experiment.settings import refuse_seed
    from swarmwright.runs.code import resolve_experiment
    from swarmwright.runs.edits import differences

    output = Output(as_json=as_json)
    show_warnings()
    _check_curve(curve, file, controller_file, candidate, generation, metrics)
    if controller_file is not None:
        _require_no_candidate(candidate, generation, simulation)
        if episodes is None and seed is None:
            raise click.UsageError(
                "--controller: the run has no recorded episodes of this controller; add --episodes N"
            )
        evaluation = _evaluate_controller(
            output,
            run,
            controller_file,
            episodes,
            seed,
            (*settings, *prefix_settings(prefix)),
            metrics,
            broker=broker,
            servers=servers,
        )
        source = {"run": str(run), "controller": str(controller_file), "settings": list(settings)}
        output.json({**source, **evaluation.to_mapping()})
        output.text(f"The controller of {controller_file}.")
        _show_settings(output, settings)
        _show(
            output,
            evaluation,
            f"the held-out {_format_span(evaluation)}" if seed is None else f"the {_format_span(evaluation)}",
        )
        return 0
    if run.is_file():
        raise click.UsageError(
            f"'{run}' is a file where a run folder is expected. Evaluate a controller file in an experiment, "
            "or in that of a run folder: swarmwright evaluate EXPERIMENT.yaml --controller FILE --episodes "
            "100"
        )
    opened = Run.open(run)
    repeats = episodes is None and seed is None and curve is None
    only = KEYS_OUTSIDE_RECORD - {"validate"} if repeats else settable()
    reason = (
        "--set changes the conditions, so the result cannot be compared with the record; add --episodes N"
        if repeats
        else NOT_EVALUATED
    )
    used = resolve_experiment(opened, opened.evaluation(candidate, generation).generation, simulation)
    refuse_seed(settings)
    experiment = used.with_settings((*settings, *prefix_settings(prefix)), only=only, reason=reason)
    broker = experiment_broker(
        broker, experiment.broker, servers if servers is not None else experiment.servers
    )
    if repeats:
        if metrics is not None:
            raise click.UsageError("--metrics: add --episodes N; metrics are measured in new episodes only")

        return show_repetition(output, opened, experiment, candidate, generation, broker, servers)
    if curve is not None:
        where = (broker, servers)
        _show_settings(output, settings)
        return show_learning_curve(output, opened, curve, file, episodes, seed, experiment, settings, where)
    from swarmwright import post_evaluate
    from swarmwright.cli._progress import episodes as shown_episodes
    from swarmwright.runs.post_evaluation import EPISODES

    with shown_episodes(output) as on_progress:
        evaluated = post_evaluate(
            opened,
            candidate,
            generation,
            episodes=episodes or EPISODES,
            seed=seed,
            experiment=experiment,
            broker=broker,
            servers=servers,
            on_progress=on_progress,
            metrics=_names(metrics),
        )
    output.json({"run": str(run), "settings": list(settings), **evaluated.to_mapping()})
    # Other parameters make other episodes of the same seeds.
    other = any(difference.matters for difference in differences(used.to_mapping(), experiment.to_mapping()))
    output.text(
        f"Candidate {evaluated.candidate} of generation {evaluated.generation}, evaluation "
        f"{evaluated.number}: recorded fitness {evaluated.recorded + 0.0:.6g}"
        f"{', without these settings' if other else ''}."
    )
    _show_settings(output, settings)
    validation = () if other else (opened._store.validation() or {}).get("seeds", ())
    _show(output, evaluated, _describe_seeds(evaluated, validation))
    return 0


def _show_settings(output: Output, settings: Sequence[str]) -> None:
    """Print the settings, on which the result depends."""
    if settings:
        output.text(f"Settings: {', '.join(settings)}")


def _check_curve(
    curve: int | None,
    file: Path | None,
    controller: Path | None,
    candidate: int | None,
    generation: int | None,
    metrics: str | None,
) -> None:
    """Raise a UsageError for options that exclude or need --curve."""
    if curve is None:
        if file is not None:
            raise click.UsageError("--out draws a learning curve; add --curve N")
        return
    for option, value in (
        ("--controller", controller), ("--candidate", candidate), ("--generation", generation),
        ("--metrics", metrics),
    ):  # fmt: skip
        if value is not None:
            raise click.UsageError(f"{option}: cannot be combined with --curve; leave it out")
    if file is not None and file.suffix.lower() not in {".csv", ".png", ".svg", ".pdf"}:
        raise click.UsageError(
            f"--out {file}: the name must end with .png, .svg or .pdf, or with .csv for a table"
        )


def _require_no_candidate(candidate: int | None, generation: int | None, simulation: str | None) -> None:
    """Raise a UsageError for options that choose a candidate of the run, or its code."""
    for option, value in (
        ("--candidate", candidate),
        ("--generation", generation),
        ("--simulation", simulation),
    ):
        if value is not None:
            raise click.UsageError(f"{option}: cannot be combined with --controller; leave it out")


def _evaluate_controller(
    output: Output,
    run: Path,
    file: Path,
    episodes: int | None,
    seed: int | None,
    settings: tuple[str, ...],
    metrics: str | None,
    *,
    broker: str | None,
    servers: Servers | None,
) -> "ControllerEvaluation":
    """Evaluate the controller of a file in the simulation of a run or of an experiment file."""
    from swarmwright import Run, post_evaluate
    from swarmwright.cli._experiments import experiment_of
    from swarmwright.cli._progress import episodes as shown_episodes
    from swarmwright.experiment.settings import refuse_seed
    from swarmwright.runs.code import resolve_experiment
    from swarmwright.runs.post_evaluation import EPISODES

    refuse_seed(settings)
    if run.is_dir():
        opened = Run.open(run)
        used = resolve_experiment(opened)
        experiment = used.with_settings(settings, only=settable(), reason=NOT_EVALUATED)
    else:
        opened, experiment = None, experiment_of(run, settings)
    broker = experiment_broker(
        broker, experiment.broker, servers if servers is not None else experiment.servers
    )
    with shown_episodes(output) as on_progress:
        return post_evaluate(
            opened or experiment,
            controller=file,
            episodes=episodes or EPISODES,
            seed=seed,
            experiment=experiment,
            broker=broker,
            servers=servers,
            on_progress=on_progress,
            metrics=_names(metrics),
        )


def _names(text: str | None) -> list[str] | Literal["all"]:
    if text == "all":
        return "all"
    return [] if text is None else [name.strip() for name in text.split(",") if name.strip()]


def settable() -> frozenset[str]:
    """Return the keys of an experiment that can be set for new episodes."""
    from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD

    return frozenset(KEYS_OUTSIDE_RECORD - {"validate"} | {"parameters", "fitness", "ranking", "simulation"})


def _show(output: Output, evaluation: "ControllerEvaluation", seeds: str) -> None:
    """Print the statistics; seeds: their description."""
    values = evaluation.to_mapping()
    count = len(evaluation.episodes)
    output.text(f"{count} episode{'s' * (count > 1)} with {seeds}:")
    value = evaluation.ranking.options.failure_fitness
    if evaluation.failed and value is None:
        output.text(
            f"  {evaluation.failed} failed; do not report the mean of the others (--set "
            "ranking.failed=NUMBER "
            "gives failed episodes a fitness):"
        )
    elif evaluation.failed:
        output.text(f"  {evaluation.failed} failed and count as {value:g}:")
    deviation = values["standard_deviation"]
    spread = "" if deviation is None else f", standard deviation {deviation:.4g}"
    output.text(f"  mean {_interval(evaluation.mean)}{spread}")
    output.text(f"  median {values['median']:.6g}, lowest {values['min']:.6g}, highest {values['max']:.6g}")
    options = evaluation.ranking.options
    if hasattr(options, "slow"):
        output.text("  in the run's own simulation; the recorded fitness includes the ranking's slow one")
    if options.episodes > 1 and evaluation.fitness != evaluation.mean:
        how = getattr(options, "aggregate", options.kind)
        label = f"  fitness, as the {how} of {options.episodes} episodes"
        enough = math.isfinite(evaluation.fitness.mean)  # of those that did not fail
        output.text(f"{label}: {_interval(evaluation.fitness) if enough else 'unknown, too many failed'}")
    _show_metrics(output, evaluation)


def _describe_seeds(evaluation: "PostEvaluation", validation: Sequence[int]) -> str:
    """Describe the seeds of an evaluation, and their previous use.

    validation: seeds of the run's own validation; empty without one, or if its episodes differ.
    """
    last, count = evaluation.seeds[-1], len(evaluation.seeds)
    seeds = _format_span(evaluation)
    if evaluation.seen:
        return f"the {seeds}, {evaluation.seen} of them used by the run"
    if not (evaluation.validated and validation):
        return f"the held-out {seeds}"
    overlap = "the same as" if evaluation.validated == count else f"{evaluation.validated} of them"
    fresh = max(last, *validation) + 1
    return f"the held-out {seeds}, {overlap} those of the run's validation (fresh ones: --seed {fresh})"


def _format_span(evaluation: "ControllerEvaluation") -> str:
    first, last = evaluation.seeds[0], evaluation.seeds[-1]
    return f"seeds {first} to {last}" if len(evaluation.seeds) > 1 else f"seed {first}"


def _show_metrics(output: Output, evaluation: "ControllerEvaluation") -> None:
    from swarmwright.common.statistics import estimate

    for name, values in evaluation.metrics.items():
        finite_values = [value for value in values.tolist() if math.isfinite(value)]
        without = len(values) - len(finite_values)
        gaps = f"; {without} of {len(values)} episodes have no finite value" if without else ""
        output.text(f"  {name}: mean {_interval(estimate(finite_values))}{gaps}")


def _interval(estimate: "Estimate") -> str:
    if estimate.standard_error is None:
        return f"{estimate.mean + 0.0:.6g}"
    return (
        f"{estimate.mean + 0.0:.6g}, standard error {estimate.standard_error:.2g}, "
        f"95 % confidence interval {estimate.low:.6g} to {estimate.high:.6g} (Student's t)"
    )


def show_learning_curve(
    output: Output,
    run: "Run",
    points: int,
    file: Path | None,
    episodes: int | None,
    seed: int | None,
    experiment: "Experiment",
    settings: Sequence[str],
    where: "tuple[str | None, Servers | None]",
) -> int:
    """Evaluate a learning curve and print it as a table; if there is a file, write or draw it."""
    from swarmwright import learning_curve
    from swarmwright.cli._progress import episodes as shown_episodes
    from swarmwright.runs.post_evaluation import EPISODES

    broker, servers = where
    with shown_episodes(output) as on_progress:
        curve = learning_curve(
            run,
            points,
            episodes=episodes or EPISODES,
            seed=seed,
            experiment=experiment,
            broker=broker,
            servers=servers,
            on_progress=on_progress,
        )
    if file is not None:
        (curve.export if file.suffix.lower() == ".csv" else curve.plot)(file)
    output.json(
        {**curve.to_mapping(), "settings": list(settings), "file": None if file is None else str(file)}
    )
    first, last, count = curve.seeds[0], curve.seeds[-1], len(curve.seeds)
    seeds = f"seed {first}" if count == 1 else f"seeds {first} to {last}"
    output.text(f"The {run.best_words}, in {count} episode{'s' * (count > 1)} with the {seeds}:")
    output.text("generation  evaluations   candidate     recorded     held-out  95 % interval")
    for point in curve.points:
        best = point.best.fitness
        interval = "" if best.low is None else f"  {best.low:.5g} to {best.high:.5g}"
        failed = f", {point.best.failed} failed" if point.best.failed else ""
        output.text(
            f"{point.generation:>10}{point.evaluations:>13,}{point.best.label:>12}"
            f"{point.best.recorded + 0.0:>13.5g}{best.mean + 0.0:>13.5g}{interval}{failed}"
        )
    if not curve.is_reportable:
        output.text(
            "Do not report these means, which exclude failed episodes; --set ranking.failed=NUMBER gives "
            "them a fitness."
        )
    if file is not None:
        output.text(f"The {'table' if file.suffix.lower() == '.csv' else 'figure'} is in {file}")
    return 0


def show_repetition(
    output: Output,
    run: "Run",
    experiment: "Experiment",
    candidate: int | None,
    generation: int | None,
    broker: str | None,
    servers: "Servers | None",
) -> int:
    """Repeat an evaluation and compare it with its record; return the exit status, 0 if they are the same."""
    from swarmwright import repeat

    repetition = repeat(run, candidate, generation, experiment=experiment, broker=broker, servers=servers)
    output.json(
        {
            "number": repetition.number,
            "generation": repetition.generation,
            "candidate": repetition.candidate,
            "seeds": repetition.seeds,
            "recorded": repetition.recorded.tolist(),
            "repeated": repetition.repeated.tolist(),
            "same": repetition.same,
            "left_out": repetition.left_out,
            "recorded_errors": repetition.recorded_errors,
            "errors": repetition.errors,
        }
    )
    output.text(
        f"Candidate {repetition.candidate} of generation {repetition.generation}, evaluation "
        f"{repetition.number}."
    )
    for episode, (before, now) in enumerate(
        zip(repetition.recorded.tolist(), repetition.repeated.tolist(), strict=True)
    ):
        output.text(f"  episode {episode}: recorded {_fitness(before)}, now {_fitness(now)}")
    if repetition.left_out:
        ran = len(repetition.recorded)
        output.text(
            f"It was dropped from the race after {ran} of {ran + repetition.left_out} episodes, "
            "which are compared."
        )
    if repetition.failed_again:
        for when, errors in (("as recorded", repetition.recorded_errors), ("now", repetition.errors)):
            output.text(f"Failed {when}: {'; '.join(map(escape_line, errors)) or 'the reason is not known'}")
    output.text(_compare_repetition(repetition))
    return 0 if repetition.same else 1


def _fitness(value: float) -> str:
    return "failed" if math.isnan(value) else repr(value)


def _compare_repetition(repetition: "Repetition") -> str:
    """Return a sentence on whether an evaluation and its repetition are the same."""
    if not repetition.failed_again:
        return "The fitness is the same, to the bit." if repetition.same else "The fitness is NOT the same."
    if repetition.failed_again == len(repetition.recorded):
        return "It failed again for the same reason." if repetition.same else "It failed for ANOTHER reason."
    if repetition.same:
        return "The fitness is the same, to the bit; the same episodes failed for the same reason."
    return "The fitness, or the reason why episodes failed, is NOT the same."
