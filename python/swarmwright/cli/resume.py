"""`swarmwright resume`: go on with a run."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._evolving import evolve, watch_options
from swarmwright.cli._observing import Observing, observe_options
from swarmwright.cli._options import (
    ExistingPath,
    Servers,
    WholeNumber,
    broker_option,
    experiment_broker,
    json_option,
    servers_option,
    wait_option,
)
from swarmwright.cli._output import Output, show_warnings


@click.command(
    "resume",
    cls=Command,
    example="swarmwright resume runs/minisim-1\nswarmwright resume runs/minisim-1 --generations 500",
)
@click.argument("run", type=ExistingPath(folder=True), metavar="RUN")
@broker_option(
    default=None,
    text="Use the servers on this broker. Default: the run's, SWARMWRIGHT_BROKER's, or one started here.",
)
@servers_option
@wait_option
@click.option(
    "--generations",
    type=WholeNumber(min=1),
    metavar="G",
    help="A larger budget than the experiment's; prolongs finished runs, too.",
)
@watch_options
@observe_options
@json_option
def command(
    run: Path,
    broker: str | None,
    servers: Servers | None,
    wait: float | None,
    generations: int | None,
    tensorboard: Path | None,
    mlflow: str | None,
    log: Path | None,
    log_level: str,
    metrics: tuple[str, int] | None,
    as_json: bool,
) -> int:
    """Go on with RUN where it was interrupted, killed, or failed.

    What comes out is what an undisturbed run gives, to the bit. A finished RUN is left as it is.
    """
    from swarmwright import Run, resume

    output = Output(as_json=as_json)
    show_warnings()
    opened = Run.open(run)
    experiment = opened.experiment
    wanted = servers if servers is not None else experiment.servers
    broker = experiment_broker(broker, experiment.broker, wanted)
    if opened.state == "done" and not generations:
        output.text(f"{run} is finished: there is nothing left to do.")
    else:
        whole = generations or experiment.generations
        output.text(
            f"{opened.generations} of {whole} generations are stored; through these, then on from there."
        )
    return evolve(
        output,
        experiment if generations is None else experiment.replace(method={"generations": generations}),
        lambda on_generation, on_progress: resume(
            opened,
            on_generation,
            generations=generations,
            on_progress=on_progress,
            broker=broker,
            servers=servers,
            wait=wait,
        ),
        tensorboard=tensorboard,
        mlflow=mlflow,
        observing=Observing(log, log_level, metrics),
    )
