"""`swarmwright couple`: several FMUs as one system."""

from pathlib import Path

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._output import Output
from swarmwright.common.formatting import format_count


@click.command(
    "couple",
    cls=Command,
    example="swarmwright couple world.fmu radio.fmu --connect world.x:radio.x --output system.ssp\n"
    "swarmwright couple world.fmu left=motor.fmu right=motor.fmu --connect left.force:world.left "
    "--connect right.force:world.right --output robot.ssp",
)
@click.argument("fmus", nargs=-1, required=True, metavar="[NAME=]FILE.fmu...")
@click.option(
    "--connect",
    "connections",
    multiple=True,
    metavar="A.OUT:B.IN",
    help="Connect an output of a component to an input of another. Units, and scaled variables (-1 to 1) "
    "of Swarmwright's FMUs, are converted. Repeatable.",
)
@options.target_option("FILE.ssp", "File to write.", required=True)
@options.force_option
@options.json_option
def command(
    fmus: tuple[str, ...], connections: tuple[str, ...], target: Path, force: bool, output: Output
) -> None:
    """Connect FMUs to one system (SSP).

    The system is a System Structure and Parameterization 1.0 archive, which an experiment uses as
    `simulation: FILE.ssp`. Components are named like their files, or by NAME=FILE.fmu. Names, causalities
    and units of connections are checked.
    """
    from swarmwright.common.errors import InputError
    from swarmwright.export.exporting import write
    from swarmwright.simulations.fmu.ssp import component_files, write_system

    if target.suffix != ".ssp":
        raise InputError(f"{target}: the name of an SSP must end with .ssp")
    files = component_files(fmus)
    data, scaled = write_system(target.stem, files, connections)
    write({target.name: data}, target.parent, force=force)
    output.text(f"{target}: {', '.join(files)}; {format_count(len(connections), 'connection')}")
    for words in scaled.values():
        output.text(f"  {words}: converted")
    about = {"file": str(target), "components": list(files), "connections": list(connections)}
    output.json({**about, "scaled": scaled})
