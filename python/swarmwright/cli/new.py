"""`swarmwright new`: a commented experiment file to start from."""

import click

from swarmwright._suggest import unknown
from swarmwright.cli._commands import Command

TEMPLATES = ("minisim",)


@click.command("new", cls=Command, example="swarmwright new minisim > my.yaml")
@click.argument("template", metavar="NAME")
def command(template: str) -> None:
    """Print a commented experiment file to start from.

    NAME is the template: minisim.
    """
    from swarmwright import templates

    if template not in TEMPLATES:
        raise click.UsageError(unknown("template", template, TEMPLATES))
    make = getattr(templates, template)
    click.echo(make(), nl=False)
