"""The table of commands, imported on demand; a mistyped name is answered with the nearest."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from keyword import iskeyword
from typing import Any

import click

from swarmwright.common.suggestions import unknown

SECTIONS: dict[str, tuple[str, ...]] = {
    "Start": ("new", "import", "simulate", "schema"),
    "Run": ("optimize", "resume", "sweep"),
    "Analyse": ("runs", "plot", "replay", "draw", "evaluate", "compare", "transfer", "score"),
    "Deploy": ("export", "verify", "export-fmu", "couple"),
    "Servers": ("serve", "servers", "broker", "conformance"),
}
"""Headings of the help -> the commands below them, in the order of the work."""
COMMANDS = tuple(name for names in SECTIONS.values() for name in names)


SETTINGS = {
    "--generations": "--set method.generations={}",
    "--evaluations": "--set method.evaluations={}",
    "--population": "--set method.population={}",
    "--method": "--set method.kind={}",
}
"""Options that are expected where an experiment is given -> what has their effect, for a value."""


HELP_OPTIONS = ["-h", "--help"]


class Command(click.Command):
    """A command whose help ends with an example.

    instead: what has the effect of options that are expected and are not there, with {} for the value.
    """

    def __init__(
        self,
        *args: Any,  # noqa: ANN401 - click's signature
        example: str,
        instead: Mapping[str, str] | None = None,
        **kwargs: Any,  # noqa: ANN401 - click's signature
    ) -> None:
        # Here too, because click keeps the option that it made first, also where there was no program above.
        kwargs.setdefault("context_settings", {"help_option_names": HELP_OPTIONS})
        super().__init__(*args, **kwargs)
        self.example = example
        self.instead = dict(instead or {})

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments; name what has the effect of an option that is expected and is not there."""
        given = list(args)  # parsing changes it
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            other = self.instead.get(error.option_name)
            if other is None:
                raise
            instead = other.format(_value_of(error.option_name, given))
            raise click.UsageError(
                f"No such option '{error.option_name}'; it is '{instead}' here.", ctx
            ) from None

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the example as it is typed, unwrapped."""
        formatter.write_paragraph()
        formatter.write("Example:\n")
        for line in self.example.splitlines():
            formatter.write(f"  {line}\n")


def _value_of(option: str, given: list[str]) -> str:
    """Return the value that an option was given; VALUE where there is none."""
    for word, following in zip(given, [*given[1:], "--"], strict=True):
        if word.startswith(f"{option}="):
            return word.partition("=")[2]
        if word == option and not following.startswith("-"):
            return following
    return "VALUE"


class Group(click.Group):
    """A group of commands that answers a mistyped one with the nearest.

    sections: heading -> commands that the help lists below it; without sections, one list of all.
    """

    def __init__(
        self,
        *args: Any,  # noqa: ANN401 - click's signature
        modules: Mapping[str, str],
        example: str,
        sections: Mapping[str, Sequence[str]] | None = None,
        **kwargs: Any,  # noqa: ANN401 - click's signature
    ) -> None:
        super().__init__(*args, **kwargs)
        self.modules = dict(modules)
        self.example = example
        self.sections = dict(sections or {})

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the table."""
        return [*self.modules, *self.commands]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command's module, which names its command `command`."""
        if cmd_name not in self.modules:
            return super().get_command(ctx, cmd_name)
        command = import_module(self.modules[cmd_name]).command
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, or say which one was meant."""
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            raise click.UsageError(unknown("command", args[0], self.list_commands(ctx)), ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands, below the headings of their sections where there are any."""
        if not self.sections:
            super().format_commands(ctx, formatter)
            return
        widest = max(map(len, self.list_commands(ctx)))  # descriptions of all sections begin in one column
        for heading, names in self.sections.items():
            with formatter.section(heading):
                formatter.write_dl(
                    [
                        (name.ljust(widest), command.get_short_help_str(formatter.width))
                        for name in names
                        if (command := self.get_command(ctx, name)) is not None
                    ]
                )

    format_epilog = Command.format_epilog


def _print_version(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        from swarmwright import __version__
        from swarmwright.common.revision import revision

        commit = revision()
        click.echo(f"swarmwright {__version__}" + ("" if commit is None else f" (commit {commit})"))
        context.exit()


@click.group(
    cls=Group,
    # A module cannot be named like a keyword: `import` is in import_.py.
    modules={name: f"swarmwright.cli.{name.replace('-', '_')}{'_' * iskeyword(name)}" for name in COMMANDS},
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
    help="Show the version, and the commit where it is used from a checkout.",
)
def program() -> None:
    """Evolve controllers for swarms on many simulation servers through an MQTT broker."""
