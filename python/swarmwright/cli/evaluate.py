"""`swarmwright evaluate`: a candidate on held-out seeds, an evaluation repeated, or a learning curve."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._evaluating import Evaluating, evaluation_options
from swarmwright.cli._output import Output
from swarmwright.common.formatting import format_count
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from swarmwright import ControllerEvaluation, LearningCurve, PostEvaluation, Repetition
    from swarmwright.common.statistics import Estimate


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
@click.argument("run", type=options.ExistingPath(folder=None))
@options.controller_option(
    "Controller file (JSON, or YAML of a machine) or run folder to evaluate instead; RUN may then be "
    "an experiment file. Needs --episodes or --seed."
)
@options.episodes_option("Evaluate in N episodes on seeds outside the record. Default with --seed: 100.")
@options.seed_option(
    "Simulation seed of the first episode; the others count up. Default: the held-out seeds of the "
    "run's validation; give S for fresh seeds."
)
@click.option(
    "--curve",
    type=options.WholeNumber(min=1, max=100_000),
    help="Evaluate the best candidate after each of N evenly spaced generations, on the same held-out "
    "seeds. Default of --episodes: 100.",
)
@options.figure_option("--out", "With --curve: draw it (.png, .svg or .pdf), or write it as a table (.csv).")
@options.candidate_options
@click.option(
    "--metrics",
    metavar="NAME,..",
    help="With --episodes: additional metrics to measure, such as arrived,steps; 'all' for every "
    "announced metric.",
)
@options.simulation_option
@evaluation_options(settings="With --episodes: override a value of the run: parameters.maxSteps=40.")
def command(
    run: Path,
    controller: Path | None,
    episodes: int | None,
    seed: int | None,
    curve: int | None,
    file: Path | None,
    candidate: int | None,
    generation: int | None,
    metrics: str | None,
    simulation: str | None,
    evaluating: Evaluating,
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
    from swarmwright import PostEvaluation, Run, learning_curve, post_evaluate, repeat
    from swarmwright.cli._experiments import experiment_of
    from swarmwright.runs.code import resolve_experiment
    from swarmwright.runs.edits import differences
    from swarmwright.runs.post_evaluation import EPISODES

    options.exclude("--curve", "--controller", "--candidate", "--generation", "--metrics")
    options.exclude("--controller", "--candidate", "--generation", "--simulation")
    options.need("--controller", "--episodes", "--seed")
    options.need("--metrics", "--episodes", "--seed")
    options.need("--out", "--curve")
    if file is not None and file.suffix.lower() not in {".csv", ".png", ".svg", ".pdf"}:
        raise click.UsageError(
            f"--out {file}: the name must end with .png, .svg or .pdf, or with .csv for a table"
        )
    if controller is None and run.is_file():
        raise click.UsageError(
            f"'{run}' is a file where a run folder is expected. Evaluate a controller file in an experiment, "
            "or in that of a run folder: swarmwright evaluate EXPERIMENT.yaml --controller FILE "
            "--episodes 100"
        )
    repeats = episodes is None and seed is None and curve is None
    output, opened = evaluating.output, Run.open(run) if controller is None or run.is_dir() else None
    if opened is None:
        evaluating.refuse_seed()
        used = experiment = experiment_of(run, evaluating.changes)
    else:
        at = None if controller else opened.evaluation(candidate, generation).generation
        used = resolve_experiment(opened, at, simulation)
        experiment = evaluating.change(used, repeats=repeats)
    if opened is not None and repeats:
        broker, servers = evaluating.broker_of(experiment), evaluating.servers
        repetition = repeat(
            opened, candidate, generation, experiment=experiment, broker=broker, servers=servers
        )
        return show_repetition(output, repetition)
    with evaluating.episodes(experiment, episodes or EPISODES, seed) as where:
        arguments: dict[str, Any] = where._asdict() | {"experiment": experiment}
        del arguments["metrics"]
        if opened is not None and curve is not None:
            learned = learning_curve(opened, curve, **arguments)
        else:
            subject: Any = opened or experiment
            arguments |= {"controller": controller, "metrics": _names(metrics)}
            evaluation: ControllerEvaluation = post_evaluate(subject, candidate, generation, **arguments)
    if curve is not None:
        evaluating.show_settings()
        show_learning_curve(output, learned, file, evaluating.settings)
        return 0
    source = {"run": str(run)} | ({} if controller is None else {"controller": str(controller)})
    output.json({**source, "settings": list(evaluating.settings), **evaluation.to_mapping()})
    if isinstance(evaluation, PostEvaluation):
        # Other parameters make other episodes of the same seeds.
        other = any(changes.matters for changes in differences(used.to_mapping(), experiment.to_mapping()))
        output.text(
            f"Candidate {evaluation.candidate} of generation {evaluation.generation}, evaluation "
            f"{evaluation.number}: recorded fitness {evaluation.recorded + 0.0:.6g}"
            f"{', without these settings' if other else ''}."
        )
        validation = () if other or opened is None else (opened._store.validation() or {}).get("seeds", ())
        seeds = _describe_seeds(evaluation, validation)
    else:
        output.text(f"The controller of {controller}.")
        seeds = f"the {'held-out ' if seed is None else ''}{format_seeds(evaluation.seeds)}"
    evaluating.show_settings()
    _show(output, evaluation, seeds)
    return 0


def _names(text: str | None) -> list[str] | Literal["all"]:
    if text == "all":
        return "all"
    return [] if text is None else [name.strip() for name in text.split(",") if name.strip()]


def _show(output: Output, evaluation: "ControllerEvaluation", seeds: str) -> None:
    """Print the statistics; seeds: their description."""
    values = evaluation.to_mapping()
    output.text(f"{format_count(len(evaluation.episodes), 'episode')} with {seeds}:")
    value = evaluation.ranking.options.failure_fitness
    if evaluation.failed and value is None:
        output.text(
            f"  {evaluation.failed} failed; do not report the mean of the others (--set "
            "ranking.failed=NUMBER gives failed episodes a fitness):"
        )
    elif evaluation.failed:
        output.text(f"  {evaluation.failed} failed and count as {value:g}:")
    deviation = values["standard_deviation"]
    spread = "" if deviation is None else f", standard deviation {deviation:.4g}"
    output.text(f"  mean {_interval(evaluation.mean)}{spread}")
    output.text(f"  median {values['median']:.6g}, lowest {values['min']:.6g}, highest {values['max']:.6g}")
    ranking = evaluation.ranking.options
    if hasattr(ranking, "slow"):
        output.text("  in the run's own simulation; the recorded fitness includes the ranking's slow one")
    if ranking.episodes > 1 and evaluation.fitness != evaluation.mean:
        how = getattr(ranking, "aggregate", ranking.kind)
        label = f"  fitness, as the {how} of {ranking.episodes} episodes"
        enough = math.isfinite(evaluation.fitness.mean)  # of those that did not fail
        output.text(f"{label}: {_interval(evaluation.fitness) if enough else 'unknown, too many failed'}")
    _show_metrics(output, evaluation)


def _describe_seeds(evaluation: "PostEvaluation", validation: Sequence[int]) -> str:
    """Describe the seeds of an evaluation, and their previous use.

    validation: seeds of the run's own validation; empty without one, or if its episodes differ.
    """
    last, count = evaluation.seeds[-1], len(evaluation.seeds)
    seeds = format_seeds(evaluation.seeds)
    if evaluation.seen:
        return f"the {seeds}, {evaluation.seen} of them used by the run"
    if not (evaluation.validated and validation):
        return f"the held-out {seeds}"
    overlap = "the same as" if evaluation.validated == count else f"{evaluation.validated} of them"
    fresh = max(last, *validation) + 1
    return f"the held-out {seeds}, {overlap} those of the run's validation (fresh ones: --seed {fresh})"


def format_seeds(seeds: Sequence[int]) -> str:
    """Return consecutive seeds as text: seeds 3 to 7."""
    return f"seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"seed {seeds[0]}"


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
    output: Output, curve: "LearningCurve", file: Path | None, settings: Sequence[str]
) -> None:
    """Print a learning curve as a table; if there is a file, write or draw it."""
    from swarmwright.analysis.table import columns

    is_table = file is not None and file.suffix.lower() == ".csv"
    if file is not None:
        (curve.export if is_table else curve.plot)(file)
    output.json(
        {**curve.to_mapping(), "settings": list(settings), "file": None if file is None else str(file)}
    )
    count = format_count(len(curve.seeds), "episode")
    output.text(f"The {curve.run.best_words}, in {count} with the {format_seeds(curve.seeds)}:")
    rows = [["generation", "evaluations", "candidate", "recorded", "held-out", "95 % interval"]]
    for point in curve.points:
        best = point.best.fitness
        interval = "-" if best.low is None else f"{best.low:.5g} to {best.high:.5g}"
        failed = f", {point.best.failed} failed" if point.best.failed else ""
        numbers = (f"{point.best.recorded + 0.0:.5g}", f"{best.mean + 0.0:.5g}", f"{interval}{failed}")
        rows.append([str(point.generation), f"{point.evaluations:,}", point.best.label, *numbers])
    for line in columns(rows):
        output.text(line)
    if not curve.is_reportable:
        output.text(
            "Do not report these means, which exclude failed episodes; --set ranking.failed=NUMBER gives "
            "them a fitness."
        )
    if file is not None:
        output.text(f"The {'table' if is_table else 'figure'} is in {file}")


_REPETITION = (
    "number",
    "generation",
    "candidate",
    "seeds",
    "recorded",
    "repeated",
    "same",
    "left_out",
    "recorded_errors",
    "errors",
)
"""Fields of a repetition for `--json`."""


def show_repetition(output: Output, repetition: "Repetition") -> int:
    """Compare a repetition with its record; return the exit status, 0 if they are the same."""
    recorded, repeated = repetition.recorded.tolist(), repetition.repeated.tolist()
    values = {name: getattr(repetition, name) for name in _REPETITION}
    output.json(values | {"recorded": recorded, "repeated": repeated})
    output.text(
        f"Candidate {repetition.candidate} of generation {repetition.generation}, evaluation "
        f"{repetition.number}."
    )
    for episode, (before, now) in enumerate(zip(recorded, repeated, strict=True)):
        output.text(f"  episode {episode}: recorded {_fitness(before)}, now {_fitness(now)}")
    if repetition.left_out:
        ran = len(recorded)
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
