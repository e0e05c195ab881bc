"""The command line's reference page, made of the help texts."""

from collections import Counter
from collections.abc import Iterator, Sequence

import click

from swarmwright.cli._commands import program

INTRODUCTION = """\
# Command line

All commands and options of `swarmwright`. `swarmwright COMMAND --help` prints the same, including the
[common options](#common-options), which several commands share and which are listed once below. (`make docs`
generates this page from the help texts; edit those.)

| exit status | meaning |
|---|---|
| 0 | success; also after Ctrl-C in commands that run until then (`broker`, `serve`, `servers --watch`) |
| 1 | failure, or a check or comparison found a difference |
| 2 | invalid input |
| 130 | interrupted; finished generations are kept |

With `--json`, a command prints one JSON object per line and nothing else; NaN and infinities are null.
Options for files and folders to write are accepted as `--out` and `--output`, and as `--save` if the file
holds what is otherwise shown. For completion with the Tab key, run `eval
"$(_SWARMWRIGHT_COMPLETE=bash_source swarmwright)"`, for example in `~/.bashrc`; `zsh_source` and
`fish_source` are for zsh and fish.

Credentials come from the environment, never from the command line. A broker that the same user runs on this
machine needs none.

| environment variable | meaning |
|---|---|
| SWARMWRIGHT_USERNAME, SWARMWRIGHT_PASSWORD or SWARMWRIGHT_PASSWORD_FILE | account on the broker |
| SWARMWRIGHT_CA_FILE | TLS: certificate authority of the broker |
| SWARMWRIGHT_CERTIFICATE_FILE, SWARMWRIGHT_KEY_FILE | TLS: client certificate, if the broker requires one |
| SWARMWRIGHT_BROKER, SWARMWRIGHT_PREFIX | default broker and topic prefix |
| SWARMWRIGHT_KEEP_ALIVE | keep-alive interval of connections, 1 to 3600 whole seconds (30) |
| SWARMWRIGHT_PLOT=0 | end runs without a plot, which saves a second of processor time each |
| SWARMWRIGHT_INSTRUCTIONS | limit the instruction set (portable, avx2, avx512), to check independence of it |
| SWARMWRIGHT_DEBUG=1 | show the traceback of an internal error |
| NO_COLOR | turn colours off |
"""
Record = tuple[str, str]
"""The names of an option, and its help."""


def reference() -> str:
    """Return the page as Markdown."""
    contexts = list(_walk_commands(program, None, "swarmwright"))
    counts = Counter(record for context in contexts for record in _option_records(context).values())
    common = [record for record in counts if counts[record] > 1]
    # Of two descriptions of one option, the more frequent is common; the other stays with its commands.
    common = [
        record for record in common
        if counts[record] == max(count for other, count in counts.items() if other[0] == record[0])
    ]  # fmt: skip
    formatter = contexts[0].make_formatter()
    with formatter.indentation():
        formatter.write_dl(common)
    sections = [INTRODUCTION, f"## Common options\n\n```text\n{formatter.getvalue().rstrip()}\n```\n"]
    return "\n".join([*sections, *(_format_command(context, common) for context in contexts)])


def _walk_commands(
    command: click.Command, parent: click.Context | None, name: str
) -> Iterator[click.Context]:
    """Yield a context of the command, and of each command below it."""
    with click.Context(
        command, info_name=name, parent=parent, max_content_width=100, terminal_width=100,
        help_option_names=["-h", "--help"],
    ) as context:  # fmt: skip
        yield context
        if isinstance(command, click.Group):
            for inner_name in command.list_commands(context):
                inner = command.get_command(context, inner_name)
                assert inner is not None
                yield from _walk_commands(inner, context, inner_name)


def _option_records(context: click.Context) -> dict[click.Option, Record]:
    options = [option for option in context.command.get_params(context) if isinstance(option, click.Option)]
    return {option: record for option in options if (record := option.get_help_record(context)) is not None}


def _format_command(context: click.Context, common: Sequence[Record]) -> str:
    """Return the section of a command, which names its common options below the others."""
    hidden = [option for option, record in _option_records(context).items() if record in common]
    for option in hidden:
        option.hidden = True
    text = f"## {context.command_path}\n\n```text\n{context.command.get_help(context).rstrip()}\n```\n"
    for option in hidden:
        option.hidden = False
    names = ", ".join(f"`{option.opts[-1]}`" for option in hidden if "--help" not in option.opts)
    return f"{text}\nCommon options: {names}.\n" if names else text


if __name__ == "__main__":
    print(reference(), end="")
