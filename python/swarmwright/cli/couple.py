"""`swarmwright couple`: several FMUs as one system."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import OutputOption, json_option
from swarmwright.cli._output import Output


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
@click.option(
    "--output",
    "target",
    cls=OutputOption,
    type=click.Path(path_type=Path),
    required=True,
    metavar="FILE.ssp",
    help="File to write.",
)
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
@json_option
def command(
    fmus: tuple[str, ...], connections: tuple[str, ...], target: Path, force: bool, output: Output
) -> None:
    """Connect FMUs to one system (SSP).

    The system is a System Structure and Parameterization 1.0 archive, which an experiment uses as
    `simulation: FILE.ssp`. Components are named like their files, or by NAME=FILE.fmu. Names, causalities
    and units of connections are checked.
    """
    from swarmwright.common.errors import InputError
    from swarmwright.simulations.fmu.ssp import component_files, write_system

    if target.suffix != ".ssp":
        raise InputError(f"{target}: the name of an SSP must end with .ssp")
    if target.is_dir():
        raise InputError(f"{target}: is a folder; name a file with --output")
    if target.exists() and not force:
        raise InputError(f"{target}: already exists; choose another --output, or overwrite it with --force")
    files = component_files(fmus)
    data, scaled = write_system(target.stem, files, connections)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror}") from error
    plural = "" if len(connections) == 1 else "s"
    output.text(f"{target}: {', '.join(files)}; {len(connections)} connection{plural}")
    for words in scaled.values():
        output.text(f"  {words}: converted")
    about = {"file": str(target), "components": list(files), "connections": list(connections)}
    output.json({**about, "scaled": scaled})
