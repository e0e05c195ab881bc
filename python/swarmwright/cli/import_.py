"""`swarmwright import`: a FREVO session becomes an experiment."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import ExistingPath
from swarmwright.cli._output import Output, complain, document

FIELD_HELP = "The field, as JSON or FREVO's .ser. Default: the one that FILE names, beside FILE."


@click.command(
    "import",
    cls=Command,
    example="swarmwright import old/stadium.zse -o stadium.yaml\n"
    "swarmwright optimize stadium.yaml\n"
    "swarmwright import old/light.zse --simulation light.py:Light -o light.yaml",
)
@click.argument("file", type=ExistingPath(), metavar="FILE.zse")
@click.option(
    "-o",
    "--output",
    "target",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.yaml",
    help="Write there, into a new file. Default: print.",
)
@click.option("--field", type=ExistingPath(), metavar="FIELD", help=FIELD_HELP)
@click.option(
    "--simulation",
    metavar="NAME",
    help="Take this simulation in the place of FREVO's problem: a title, or a class as pong.py:Pong.",
)
@click.option(
    "--method", metavar="KIND", help="Take this method, with its defaults, in the place of FREVO's."
)
@click.option(
    "--controller",
    metavar="KIND",
    help="Take this controller, with its defaults, in the place of FREVO's representation.",
)
@click.option(
    "--ranking", metavar="KIND", help="Take this ranking, with its defaults, in the place of FREVO's."
)
def command(
    file: Path,
    target: Path | None,
    field: Path | None,
    simulation: str | None,
    method: str | None,
    controller: str | None,
    ranking: str | None,
) -> None:
    """Make an experiment of a FREVO session.

    What can be taken over: Emergency Exit; NNGA, CEA2D, PSO and RandomSearch; FullyMeshedNet,
    CompleteNetwork, ThreeLayerNetwork, MultiLayerNetwork and MealyFSM; AbsoluteRanking. For other components
    a replacement can be named. Comments in the experiment say how every entry of FILE.zse was mapped.
    """
    if target is not None and not target.parent.is_dir():
        raise click.UsageError(f"'{target}': there is no folder '{target.parent}'; create it first.")
    if target is not None and target.exists():
        raise click.UsageError(f"'{target}' exists and is not written over; name another file, or remove it.")
    from swarmwright import frevo
    from swarmwright.core.files import write_text

    imported = frevo.load(
        file,
        field=field,
        folder=Path() if target is None else target.parent,
        simulation=simulation,
        method=method,
        controller=controller,
        ranking=ranking,
    )
    for note in imported.notes:
        complain(f"not as in FREVO: {note}")
    if target is None:
        document(imported.yaml)
    else:
        write_text(target, imported.yaml)
        Output().text(f"The experiment is in {target}")
