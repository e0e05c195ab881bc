"""The table of commands, which are imported on demand.

Other packages, and parts of this one that nothing imports, add commands in the entry-point group
`swarmwright.commands`.
"""

import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib import import_module
from keyword import iskeyword
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli._output import show_warnings
from swarmwright.common.errors import InputError, PlugInError, SwarmwrightError
from swarmwright.common.suggestions import unknown
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

SECTIONS: dict[str, tuple[str, ...]] = {
    "Start": ("new", "import", "simulate", "schema"),
    "Run": ("optimize", "resume", "sweep"),
    "Analyse": (
        "ui",
        "runs",
        "plot",
        "replay",
        "draw",
        "evaluate",
        "compare",
        "progress",
        "league",
        "validate",
        "transfer",
        "score",
    ),
    "Deploy": ("export", "verify", "export-fmu", "couple"),
    "Servers": ("serve", "servers", "broker", "conformance"),
}
"""Headings of the help -> the commands below them, in the order of use."""
COMMANDS = tuple(name for names in SECTIONS.values() for name in names)
PLUG_INS = "swarmwright.commands"
"""Group of entry points; each is a `click.Command`."""
ANNOUNCED = {
    "score": "Evaluate the candidates of a FREVO result.",
    "conformance": "Check that a server or a tool follows the protocol.",
}
"""Our commands that are entry points -> their line in the help, for which they need not be loaded."""


SETTINGS = {
    "--generations": "--set method.generations={}",
    "--evaluations": "--set method.evaluations={}",
    "--population": "--set method.population={}",
    "--method": "--set method.kind={}",
}
"""Options that users expect of commands with an experiment -> their replacement, {} for the value."""


HELP_OPTIONS = ["-h", "--help"]


class Command(click.Command):
    """A command whose help ends with an example.

    instead: options that users expect but that do not exist -> their replacement, with {} for the value.
    """

    def __init__(
        self,
        *args: Any,  # noqa: ANN401 - click's signature
        example: str,
        instead: Mapping[str, str] | None = None,
        **kwargs: Any,  # noqa: ANN401 - click's signature
    ) -> None:
        # Also here, because click keeps the help option that it creates first, even without a parent.
        kwargs.setdefault("context_settings", {"help_option_names": HELP_OPTIONS})
        super().__init__(*args, **kwargs)
        self.example = example
        self.instead = dict(instead or {})

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments; suggest the replacement of an expected option that does not exist."""
        words = list(args)  # parsing consumes args
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            other = self.instead.get(error.option_name)
            if other is None:
                raise
            instead = other.format(_value_of(error.option_name, words))
            raise click.UsageError(f"No such option '{error.option_name}'; use '{instead}'.", ctx) from None

    def invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401 - click's signature
        """Run the command, and show warnings of the library."""
        with show_warnings():
            return super().invoke(ctx)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the example without wrapping."""
        formatter.write_paragraph()
        formatter.write("Example:\n")
        for line in self.example.splitlines():
            formatter.write(f"  {line}\n")


def _value_of(option: str, words: list[str]) -> str:
    """Return the value of an option on the command line, or VALUE if it has none."""
    for word, following in zip(words, [*words[1:], "--"], strict=True):
        if word.startswith(f"{option}="):
            return word.partition("=")[2]
        if word == option and not following.startswith("-"):
            return following
    return "VALUE"


class Group(click.Group):
    """A group of commands; for a mistyped name, the error suggests the nearest.

    modules: name -> module with the function `command`.
    plug_ins: group of entry points with further commands.
    sections: heading -> commands that the help lists below it; empty for a single list.
    """

    command_class = Command

    def __init__(
        self,
        *args: Any,  # noqa: ANN401 - click's signature
        modules: Mapping[str, str],
        example: str,
        plug_ins: str | None = None,
        sections: Mapping[str, Sequence[str]] | None = None,
        **kwargs: Any,  # noqa: ANN401 - click's signature
    ) -> None:
        super().__init__(*args, **kwargs)
        self.modules = dict(modules)
        self.example = example
        self.sections = dict(sections or {})
        self._plug_ins = plug_ins

    @cached_property
    def _entry_points(self) -> "dict[str, list[EntryPoint]]":
        """Entry points of commands by name, not imported."""
        if self._plug_ins is None:
            return {}
        from swarmwright.common.entry_points import find_entry_points

        return find_entry_points(self._plug_ins)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the table, then those from other packages."""
        own = list(
            dict.fromkeys([*(name for names in self.sections.values() for name in names), *self.modules])
        )
        return [*own, *self.commands, *sorted(set(self._entry_points) - set(own))]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command from its module or entry point."""
        if cmd_name not in self.modules:
            if cmd_name in self._entry_points:
                return self._plug_in(ctx, cmd_name)
            if self._plug_ins is not None and cmd_name in ANNOUNCED:
                raise InputError(
                    f"command '{cmd_name}': the installed package is older than its code; reinstall "
                    "Swarmwright"
                )
            return super().get_command(ctx, cmd_name)
        command = import_module(self.modules[cmd_name]).command
        assert isinstance(command, click.Command)
        return command

    def _plug_in(self, ctx: click.Context | None, name: str) -> click.Command | None:
        """Import the command of an entry point; during shell completion, None for a broken one."""
        from swarmwright.common.entry_points import (
            OWN,
            choose_entry_point,
            describe_plug_in,
            distribution,
            load_plug_in,
        )

        try:
            point = choose_entry_point("command", self._entry_points[name])
            command = load_plug_in("command", point)
            if not isinstance(command, click.Command):
                raise InputError(f"{describe_plug_in('command', point)} is not a click.Command")
        except SwarmwrightError:
            if ctx is not None and ctx.resilient_parsing:
                return None
            raise
        return (
            command
            if distribution(point) == OWN
            else _report_errors(command, describe_plug_in("command", point))
        )

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, or suggest the nearest."""
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            raise click.UsageError(unknown("command", args[0], self.list_commands(ctx)), ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands below the headings of their sections, if there are any."""
        if not self.sections:
            super().format_commands(ctx, formatter)
            return
        widest = max(map(len, self.list_commands(ctx)))  # aligns the descriptions of all sections
        for heading, names in self.sections.items():
            with formatter.section(heading):
                formatter.write_dl(
                    [(name.ljust(widest), self._line(ctx, name, formatter.width)) for name in names]
                )
        others = set(self._entry_points) - {name for names in self.sections.values() for name in names}
        if others:
            with formatter.section("Other packages"):
                formatter.write_dl([(name.ljust(widest), self._origin(name)) for name in sorted(others)])

    def _line(self, ctx: click.Context, name: str, width: int) -> str:
        if name in ANNOUNCED:
            return ANNOUNCED[name]
        command = self.get_command(ctx, name)
        assert command is not None
        return command.get_short_help_str(width)

    def _origin(self, name: str) -> str:
        """Return the line in the help for a command of another package, which is not imported."""
        from swarmwright.common.entry_points import distribution

        return f"Added by the package {', '.join(sorted(set(map(distribution, self._entry_points[name]))))}."

    format_epilog = Command.format_epilog


def _report_errors(command: click.Command, name: str) -> click.Command:
    """Let errors of another package's command name the package, without a traceback."""
    invoke = command.invoke

    def invoke_reporting(ctx: click.Context) -> Any:  # noqa: ANN401 - as click
        try:
            return invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort, SwarmwrightError, OSError):
            raise
        except Exception as error:
            if os.environ.get("SWARMWRIGHT_DEBUG"):
                raise
            raise PlugInError(f"{name}: {type(error).__name__}: {escape_line(str(error))}") from error

    command.invoke = invoke_reporting  # type: ignore[method-assign]
    return command


def _print_version(context: click.Context, _parameter: click.Parameter, is_set: bool) -> None:
    if is_set and not context.resilient_parsing:
        from swarmwright import __version__
        from swarmwright.common.revision import revision

        commit = revision()
        click.echo(f"swarmwright {__version__}" + ("" if commit is None else f" (commit {commit})"))
        context.exit()


@click.group(
    cls=Group,
    # A module cannot be named like a keyword: `import` is in import_.py.
    modules={
        name: f"swarmwright.cli.{name.replace('-', '_')}{'_' * iskeyword(name)}"
        for name in COMMANDS
        if name not in ANNOUNCED
    },
    plug_ins=PLUG_INS,
    sections=SECTIONS,
    context_settings={"help_option_names": HELP_OPTIONS, "max_content_width": 110},
    example="swarmwright new minisim > my.yaml\nswarmwright optimize my.yaml --servers 2",
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the version, and the commit of a checkout.",
)
def program() -> None:
    """Evolve controllers for swarms on many simulation servers through an MQTT broker."""
