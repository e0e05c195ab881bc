"""`swarmwright schema`: the JSON Schema of experiment files."""

import json

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._output import print_document


@click.command(
    "schema",
    cls=Command,
    example="swarmwright schema > experiment.schema.json\n"
    "# first line of my.yaml, read by editors with a YAML language server:\n"
    "# yaml-language-server: $schema=experiment.schema.json",
)
def command() -> None:
    """Print the JSON Schema of experiment files.

    Editors use it to complete keys, show their meaning and mark mistakes.
    """
    from swarmwright import Experiment

    print_document(json.dumps(Experiment.json_schema(), indent=2, allow_nan=False) + "\n")
