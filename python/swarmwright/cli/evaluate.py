"""`swarmwright evaluate`: repeat an evaluation from its record."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import (
    ExistingPath,
    Servers,
    broker_option,
    candidate_options,
    experiment_broker,
    json_option,
    servers_option,
)
from swarmwright.cli._output import Output, show_warnings


@click.command(
    "evaluate",
    cls=Command,
    example="swarmwright evaluate runs/minisim-1\n"
    "swarmwright evaluate runs/minisim-1 --generation 3 --candidate 12",
)
@click.argument("run", type=ExistingPath(folder=True), metavar="RUN")
@candidate_options
@broker_option(
    default=None,
    text="Use the servers on this broker. Default: the run's, SWARMWRIGHT_BROKER's, or one started here.",
)
@servers_option
@json_option
def command(
    run: Path,
    candidate: int | None,
    generation: int | None,
    broker: str | None,
    servers: Servers | None,
    as_json: bool,
) -> int:
    """Evaluate a candidate of RUN once more and say whether its fitness is the same.

    The seeds are those of the record. The exit status is 0 when every episode comes out the same to the bit,
    else 1.
    """
    from swarmwright import Run, repeat

    output = Output(as_json=as_json)
    show_warnings()
    opened = Run.open(run)
    experiment = opened.experiment
    wanted = servers if servers is not None else experiment.servers
    broker = experiment_broker(broker, experiment.broker, wanted)
    found = repeat(opened, candidate, generation, broker=broker, servers=servers)
    output.json(
        {
            "number": found.number,
            "generation": found.generation,
            "candidate": found.candidate,
            "recorded": found.recorded.tolist(),
            "repeated": found.repeated.tolist(),
            "same": found.same,
        }
    )
    output.text(f"Candidate {found.candidate} of generation {found.generation}, evaluation {found.number}.")
    for episode, (before, now) in enumerate(
        zip(found.recorded.tolist(), found.repeated.tolist(), strict=True)
    ):
        output.text(f"  episode {episode}: recorded {before!r}, now {now!r}")
    output.text("The fitness is the same, to the bit." if found.same else "The fitness is NOT the same.")
    return 0 if found.same else 1
