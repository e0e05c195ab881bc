"""`swarmwright ui`: the window in the browser."""

import contextlib
import tempfile
from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import ExistingPath, WholeNumber, broker_option, prefix_option
from swarmwright.cli._output import Output
from swarmwright.cli._pictures import has_display, open_in_browser
from swarmwright.common.errors import InputError
from swarmwright.experiment.broker_address import DEFAULT_BROKER


@click.command(
    "ui", cls=Command, example="swarmwright ui\nswarmwright ui results --port 8501 --read-only --no-browser"
)
@click.argument("folder", type=ExistingPath(folder=True), metavar="[FOLDER]", required=False)
@click.option(
    "--port", type=WholeNumber(0, 65535), help="Port to listen on, 0 for a free one. Default: 8501."
)
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    metavar="ADDRESS",
    help="Address to listen on. Other machines need --password-file, --certificate and --key.",
)
@click.option(
    "--certificate", type=ExistingPath(folder=False), metavar="FILE", help="Certificate for TLS (PEM)."
)
@click.option(
    "--key", type=ExistingPath(folder=False), metavar="FILE", help="Private key of the certificate (PEM)."
)
@click.option(
    "--password-file",
    type=ExistingPath(folder=False),
    metavar="FILE",
    help="Ask for the password in the first line of FILE, which only you can read, instead of a token.",
)
@click.option(
    "--host-name",
    "hosts",
    multiple=True,
    metavar="NAME",
    help="A name by which browsers reach the window, as behind a proxy. Can be given several times.",
)
@broker_option(default=DEFAULT_BROKER, text="Address of the broker whose servers are shown.")
@prefix_option
@click.option("--read-only", is_flag=True, help="Refuse everything that changes a run or starts one.")
@click.option(
    "--no-browser",
    is_flag=True,
    help="Only print the address. By default, a browser opens where there is a display.",
)
def command(
    folder: Path | None,
    port: int | None,
    host: str,
    certificate: Path | None,
    key: Path | None,
    password_file: Path | None,
    hosts: tuple[str, ...],
    broker: str,
    prefix: str,
    read_only: bool,
    no_browser: bool,
) -> None:
    """Show the runs below FOLDER in a browser, live.

    FOLDER is runs by default, and is then made if missing. The printed address holds a secret token: whoever
    has it sees these runs. The window listens on 127.0.0.1 alone; from another machine, reach it through `ssh
    -L`, or let it listen there with a password and TLS. It ends with Ctrl-C; runs are not affected.
    """
    from swarmwright.runs.folders import RUNS
    from swarmwright.ui.server import Settings, serve

    output = Output()
    if folder is None:
        folder = RUNS
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            reason = error.strerror or str(error)
            raise InputError(
                f"{folder}: the folder for runs cannot be made ({reason}); name another"
            ) from error
    stack = contextlib.ExitStack()

    def on_ready(address: str) -> None:
        output.text(f"Runs below {folder}: {address}")
        if not no_browser and has_display():
            private = stack.enter_context(tempfile.TemporaryDirectory(prefix="swarmwright-ui-"))
            open_in_browser(write_opening_page(Path(private), address))

    settings = Settings(
        host=host,
        port=port,
        hosts=hosts,
        read_only=read_only,
        broker=broker,
        prefix=prefix,
        certificate=certificate,
        key=key,
        password_file=password_file,
    )
    with stack:
        serve(folder, settings, on_ready=on_ready)


def write_opening_page(folder: Path, address: str) -> Path:
    """Write a page that leads to an address, and return its path.

    All users of the machine can read the command lines of others, so no browser is started with the address,
    which has the token.

    folder: that only this user can read.
    """
    from swarmwright.ui.guard import forwarding_page

    page = folder / "open.html"
    page.write_text(forwarding_page(address), encoding="utf-8")
    return page
