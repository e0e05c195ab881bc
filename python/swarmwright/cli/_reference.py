"""The command line's reference page, made of the help texts."""

import click

from swarmwright.cli._commands import program

INTRODUCTION = """\
# Command line

All commands and options of `swarmwright`, as `swarmwright COMMAND --help` prints them. (`make docs` generates
this page from the help texts; edit those.) Exit status of every command: 0 if it is done; 1 if it failed, or
what it checked or compared is not as it should be; 2 if the input is wrong; 130 if it was interrupted:
finished generations, if any, are kept. Commands that run until Ctrl-C (`broker`, `serve`, `servers --watch`)
end with 0 then. With `--json` a command prints one JSON object per line and nothing else; numbers that JSON
does not know (NaN, infinities) are null. `NO_COLOR` turns colours off. SWARMWRIGHT_DEBUG=1 shows Python's
traceback of an internal error. With SWARMWRIGHT_PLOT=0 runs end without their plot, which saves about a
second of processor time each, for example on a cluster. SWARMWRIGHT_INSTRUCTIONS (portable, avx2, avx512)
limits the instruction set that is used, to see that results do not depend on it.

An option that names the file or folder to write is accepted as `--out` and as `--output` in every command;
where the file holds what is otherwise shown, as `--save`, too.

Bash completes commands and options with the Tab key after `eval "$(_SWARMWRIGHT_COMPLETE=bash_source
swarmwright)"`, for example in `~/.bashrc`; `zsh_source` and `fish_source` are for zsh and fish.

Credentials are never given on the command line. They come from the environment: SWARMWRIGHT_USERNAME,
SWARMWRIGHT_PASSWORD or a file named by SWARMWRIGHT_PASSWORD_FILE, and for TLS SWARMWRIGHT_CA_FILE, the
certificate authority of the broker, and, where the broker requires a client certificate,
SWARMWRIGHT_CERTIFICATE_FILE and SWARMWRIGHT_KEY_FILE. SWARMWRIGHT_BROKER is the address of the broker where
none is given, SWARMWRIGHT_PREFIX the prefix of topics on it, SWARMWRIGHT_KEEP_ALIVE the keep-alive interval
of connections to it, 1 to 3600 whole seconds (30). For a broker that the same user runs on this machine
nothing needs to be set.
"""


def reference() -> str:
    """The page, Markdown."""
    with click.Context(
        program, info_name="swarmwright", max_content_width=100, terminal_width=100,
        help_option_names=["-h", "--help"],
    ) as context:  # fmt: skip
        sections = [INTRODUCTION, *_sections(program, context)]
    return "\n".join(sections)


def _sections(command: click.Command, context: click.Context) -> list[str]:
    sections = [f"## {context.command_path}\n\n```text\n{command.get_help(context).rstrip()}\n```\n"]
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            with click.Context(
                inner, info_name=name, parent=context, max_content_width=100, terminal_width=100,
                help_option_names=["-h", "--help"],
            ) as below:  # fmt: skip
                sections += _sections(inner, below)
    return sections


if __name__ == "__main__":
    print(reference(), end="")
