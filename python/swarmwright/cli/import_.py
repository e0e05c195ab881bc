"""`swarmwright import`: files of other tools become an experiment."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._experiments import importer_of
from swarmwright.cli._options import ExistingPath, OutputFile, SaveOption
from swarmwright.cli._output import Output, complain, print_document

_FIELD = "For a FREVO session: the field, as JSON or FREVO's .ser. Default: the one FILE names, next to FILE."


@click.command(
    "import",
    cls=Command,
    example="swarmwright import old/stadium.zse -o stadium.yaml\n"
    "swarmwright optimize stadium.yaml\n"
    "swarmwright import old/light.zse --simulation light.py:Light -o light.yaml\n"
    "swarmwright import minisim.xml parameters.json swarm.xml -o drawn.yaml",
)
@click.argument("files", type=ExistingPath(folder=None), nargs=-1, required=True, metavar="FILE..")
@click.option(
    "-o",
    "--output",
    "target",
    cls=SaveOption,
    type=OutputFile(),
    metavar="FILE.yaml",
    help="Write to this new file instead of standard output.",
)
@click.option("--field", type=ExistingPath(), metavar="FIELD", help=_FIELD)
@click.option(
    "--simulation",
    metavar="NAME",
    help="Use this simulation instead of the problem: a title, or a class such as pong.py:Pong.",
)
@click.option(
    "--method",
    metavar="KIND",
    help="Use this method with its defaults. Default: the session's method, or nnga for a model.",
)
@click.option(
    "--controller",
    metavar="KIND",
    help="Use this controller with its defaults instead of the session's or model's.",
)
@click.option("--ranking", metavar="KIND", help="For a FREVO session: use this ranking with its defaults.")
def command(
    files: tuple[Path, ...],
    target: Path | None,
    field: Path | None,
    simulation: str | None,
    method: str | None,
    controller: str | None,
    ranking: str | None,
) -> None:
    """Make an experiment from a FREVO session or a model.

    FILE is a FREVO session (.zse) or a file exported by a modelling tool; its content decides. A folder
    stands for its .json, .scxml, .sysml and .xml files.

    Supported components of sessions: Emergency Exit; NNGA, CEA2D, GASpecies, CuckooSearch, PSO,
    RandomSearch, NoveltySearch and NoveltySpecies; FullyMeshedNet, CompleteNetwork, ThreeLayerNetwork,
    MultiLayerNetwork, MealyFSM, HebbNet and NEAT; AbsoluteRanking, NoveltyRanking
    (with NNGA), and with --simulation FullTournament, SwissSystem, MultiSwiss and MultiSort. Name a
    replacement for any other component.

    Supported models: FREVO problem descriptions (<icomponent>), OptimisedParameters (JSON), SwarmComposition
    (XML), abstraction descriptions (ADF JSON) and state machines (SCXML) of Modelio's CPSwarm modules, and
    SysML v2's textual notation. Pass all files of a model in one command.

    Comments in the experiment name the origin of each line.
    """
    if target is not None and target.exists():
        raise click.UsageError(f"'{target}' already exists; choose another file, or remove it.")
    from swarmwright.common.files import write_text
    from swarmwright.experiment.importing import ImportOptions

    importer = importer_of(files)
    options = ImportOptions(target, simulation, method, controller, ranking, field)
    for name in sorted(importer.unused):
        if getattr(options, name) is not None:
            raise click.UsageError(f"--{name} does not apply to {importer.words}.")
    imported = importer.load(files, options)
    for note in imported.notes:
        complain(note)
    for name, text in imported.files.items():
        beside = (target or Path()).parent / name
        if beside.exists():
            raise click.UsageError(f"'{beside}' already exists; remove it.")
        write_text(beside, text)
        Output().text(f"The behaviour is in {beside}")
    if target is None:
        print_document(imported.yaml)
    else:
        write_text(target, imported.yaml)
        Output().text(f"The experiment is in {target}")
