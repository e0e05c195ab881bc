"""`swarmwright resume`: go on with a run."""

from functools import partial
from pathlib import Path

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._evolving import evolve, watch_options
from swarmwright.cli._observing import ObserverOptions, observe_options
from swarmwright.cli._output import Output, show_warnings


@click.command(
    "resume",
    cls=Command,
    example="swarmwright resume runs/minisim-1\n"
    "swarmwright resume runs/minisim-1 --generations 500\n"
    "swarmwright resume runs/minisim-1 --evaluations 20000",
)
@click.argument("run", type=options.ExistingPath(folder=True))
@options.experiment_broker_options()
@options.servers_option
@options.server_output_option
@options.wait_option
@click.option(
    "--generations",
    type=options.WholeNumber(min=1),
    metavar="G",
    help="Extend the budget to G generations, also of a finished run. Other limits stay.",
)
@click.option(
    "--evaluations", type=options.WholeNumber(min=1), help="Extend the budget to N evaluations of candidates."
)
@click.option(
    "--seconds",
    type=options.finite_number,
    metavar="S",
    help="Extend the budget to S seconds over all sessions.",
)
@click.option(
    "--accept-changed-code",
    is_flag=True,
    help="Continue although the code of the simulation or a plug-in was edited; the run records it.",
)
@options.simulation_option
@options.set_option(
    "Change the budget, or how and where to evaluate: method.evaluations=9000, timeouts.step=5."
)
@watch_options
@observe_options
@options.trust_option
@options.json_option
def command(
    run: Path,
    broker: str | None,
    prefix: str | None,
    servers: options.Servers | None,
    wait: float | None,
    generations: int | None,
    evaluations: int | None,
    seconds: float | None,
    accept_changed_code: bool,
    simulation: str | None,
    settings: tuple[str, ...],
    observing: ObserverOptions,
    output: Output,
) -> int:
    """Continue a run that was interrupted or failed.

    The result is bit-identical to that of an uninterrupted run. A finished RUN stays unchanged unless
    --generations, --evaluations, --seconds or --set extend it. A run is refused if experiment.yaml, or the
    code of its simulation or a plug-in, was edited.
    """
    from swarmwright import Run, resume
    from swarmwright.runs.code import plan_continuation
    from swarmwright.runs.optimization.resuming import Resumption
    from swarmwright.runs.store.lock import check_free
    from swarmwright.runs.transfer import at_end

    show_warnings()
    opened = Run.open(run)
    check_free(opened.path)
    settings = (*settings, *options.prefix_settings(prefix))
    # Report errors before anything is printed or started.
    budget = {"generations": generations, "evaluations": evaluations, "seconds": seconds}
    resumption = Resumption.of(opened, opened._store, settings, budget)
    experiment = resumption.experiment
    if not resumption.has_all_generations:
        plan_continuation(opened, experiment, accept_changed_code=accept_changed_code, simulation=simulation)
    broker = options.experiment_broker(experiment, broker, servers)
    if resumption.has_all_generations:
        due = resumption.validation_is_due
        if not due and at_end.is_due(experiment, opened._store):
            left = "its best candidates are transferred"
        else:
            left = "its best candidates are validated" if due else "there is nothing left to do"
        output.text(f"{run} is finished: {left}.")
    else:
        limit = experiment.budget.generations
        whole = "" if limit is None else f" of {limit}"
        output.text(
            f"{opened.generations}{whole} generations are stored. Replaying them from the record, then "
            "continuing."
        )
    return evolve(
        output,
        experiment,
        partial(
            resume,
            opened,
            generations=generations,
            evaluations=evaluations,
            seconds=seconds,
            settings=settings,
            broker=broker,
            servers=servers,
            wait=wait,
            accept_changed_code=accept_changed_code,
            simulation=simulation,
        ),
        observing=observing,
        broker=broker,
        prefix=prefix,
    )
