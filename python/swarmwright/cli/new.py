"""`swarmwright new`: a commented experiment file to start from."""

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._output import document


@click.command(
    "new",
    cls=Command,
    example="swarmwright new minisim > my.yaml\nswarmwright new emergency_exit > exit.yaml\n"
    "swarmwright new arena > swarm.yaml",
)
@click.argument("template", metavar="NAME")
def command(template: str) -> None:
    """Print a commented experiment file to start from.

    NAME is the template: arena, emergency_exit or minisim.
    """
    from swarmwright import InputError, templates

    try:
        document(templates.text(template))
    except InputError as error:
        raise click.UsageError(str(error)) from error
