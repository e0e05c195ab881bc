"""Types of options that several commands share."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest

from swarmwright.cli._commands import Group, program
from swarmwright.cli._options import OutputOption, SaveOption

NAMES = {"--out", "--output", "--save", "--plot"}


def commands(group: Group, context: click.Context) -> Iterator[click.Command]:
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, Group):
            yield from commands(command, context)
        yield command


def test_every_output_may_be_named_as_in_other_commands() -> None:
    context = click.Context(program)
    found = 0
    for command in commands(program, context):
        for option in command.params:
            if isinstance(option, click.Option) and NAMES & set(option.opts):
                found += 1
                assert isinstance(option, OutputOption), command.name
                assert len(NAMES & set(option.opts)) == 1, "help has one name"
                if {"--save", "--plot"} & set(option.opts):
                    assert isinstance(option, SaveOption), command.name
    assert found >= 12


@pytest.mark.parametrize("name", ["--out", "--output", "--save"])
def test_what_is_shown_is_written_whatever_the_option_is_called(name: str) -> None:
    command = program.get_command(click.Context(program), "draw")
    assert command is not None
    with command.make_context("draw", [".", name, "x.svg"]) as context:
        assert context.params["file"] == Path("x.svg")


@pytest.mark.slow
def test_mistakes_have_the_name_that_help_has(program: Any) -> None:
    told = program("replay", ".", "--out", "no/x.gif")
    assert told.returncode == 2
    assert "Invalid value for '--save': 'no/x.gif': there is no folder 'no'" in told.stderr
    assert "--out" not in program("replay", "--help").stdout
