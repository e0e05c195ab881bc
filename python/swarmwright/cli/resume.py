"""`swarmwright resume`: go on with a run."""

from functools import partial
from pathlib import Path
from typing import Any

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._evaluating import Evaluating, evaluation_options
from swarmwright.cli._evolving import evolve
from swarmwright.cli._observing import ObserverOptions, observe_run_options


@click.command(
    "resume",
    cls=Command,
    example="swarmwright resume runs/minisim-1\n"
    "swarmwright resume runs/minisim-1 --generations 500\n"
    "swarmwright resume runs/minisim-1 --evaluations 20000",
)
@click.argument("run", type=options.ExistingPath(folder=True))
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
@observe_run_options
@evaluation_options(
    settings="Change the budget, or how and where to evaluate: method.evaluations=9000, timeouts.step=5."
)
def command(
    run: Path,
    wait: float | None,
    accept_changed_code: bool,
    simulation: str | None,
    observing: ObserverOptions,
    evaluating: Evaluating,
    **budget: Any,  # noqa: ANN401 - as click passes options
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

    opened = Run.open(run)
    check_free(opened.path)
    # Report errors before anything is printed or started.
    resumption = Resumption.of(opened, opened._store, evaluating.changes, budget)
    experiment = resumption.experiment
    if not resumption.has_all_generations:
        plan_continuation(opened, experiment, accept_changed_code=accept_changed_code, simulation=simulation)
    output = evaluating.output
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
    broker = evaluating.broker_of(experiment)
    work = partial(
        resume,
        opened,
        settings=evaluating.changes,
        broker=broker,
        servers=evaluating.servers,
        wait=wait,
        accept_changed_code=accept_changed_code,
        simulation=simulation,
        **budget,
    )
    return evolve(output, experiment, work, observing=observing, broker=broker, prefix=evaluating.prefix)
