"""`swarmwright runs`: what lies in a run folder, for other tools."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command, Group
from swarmwright.cli._options import ExistingPath, json_option
from swarmwright.cli._output import Output


@click.group("runs", cls=Group, modules={}, example="swarmwright runs export runs/minisim-1 evaluations.csv")
def command() -> None:
    """Read run folders."""


@command.command("export", cls=Command, example="swarmwright runs export runs/minisim-1 evaluations.csv")
@click.argument("run", type=ExistingPath(folder=True), metavar="RUN")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.csv")
@json_option
def export(run: Path, file: Path, as_json: bool) -> None:
    """Write the record of RUN as a table, a line per evaluation.

    Sorted by generation and candidate. Columns: generation, candidate, fitness, then the fitness of each
    episode, then the genome.
    """
    if not file.parent.is_dir():
        raise click.UsageError(f"'{file}': there is no folder '{file.parent}'; create it first.")
    from swarmwright import Run

    Run.open(run).export(file)
    output = Output(as_json=as_json)
    output.text(f"The record is in {file}")
    output.json({"run": str(run), "file": str(file)})
