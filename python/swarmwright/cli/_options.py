"""Options and arguments that several commands share."""

import difflib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import click

DEFAULT_BROKER = "mqtt://localhost:1883"
BROKER_VARIABLE = "SWARMWRIGHT_BROKER"

CREDENTIALS = (
    "Credentials come from the environment: SWARMWRIGHT_USERNAME, and SWARMWRIGHT_PASSWORD or the path of "
    "a file in SWARMWRIGHT_PASSWORD_FILE."
)

Decorator = Callable[[Any], Any]


class BrokerUrl(click.ParamType[str]):
    """Address of a broker. The engine checks it; here only a password is turned away."""

    name = "url"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Refuse user and password, which every user of the machine could read in the list of processes."""
        try:
            parts = urlsplit(value)
            _ = parts.port
        except ValueError as error:
            self.fail(f"'{value}' is no URL of a broker ({error}); an example: {DEFAULT_BROKER}.", param, ctx)
        if parts.username is not None or parts.password is not None:
            self.fail(f"user and password do not belong into the URL. {CREDENTIALS}", param, ctx)
        return value


class ExistingPath(click.ParamType[Path]):
    """A file or folder that is there; a mistyped one is answered with its nearest neighbour.

    folder: whether a folder is wanted rather than a file; None takes either.
    """

    name = "path"

    def __init__(self, *, folder: bool | None = False) -> None:
        self.folder = folder

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path, if it is there and of the right kind."""
        path = Path(value)
        if not path.exists():
            self.fail(f"'{path}' does not exist{_nearest(path)}.", param, ctx)
        if self.folder is True and not path.is_dir():
            self.fail(f"'{path}' is a file where a folder is expected.", param, ctx)
        if self.folder is False and path.is_dir():
            self.fail(f"'{path}' is a folder where a file is expected.", param, ctx)
        if not os.access(path, os.R_OK):
            self.fail(f"'{path}' may not be read by this user.", param, ctx)
        return path


def _nearest(path: Path) -> str:
    try:
        neighbours = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return f" (nor does its folder '{path.parent}')" if not path.parent.exists() else ""
    near = difflib.get_close_matches(path.name, neighbours, n=1)
    return f"; did you mean '{path.parent / near[0]}'?" if near else ""


class ServerCount(click.ParamType[str | int]):
    """`auto`, `local` or a number of servers."""

    name = "auto|local|K"

    def convert(
        self, value: str | int, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | int:
        """The word or the number."""
        if value in ("auto", "local"):
            return value
        try:
            number = int(value)
        except ValueError:
            self.fail(f"'{value}' is neither a number of servers nor 'auto' nor 'local'.", param, ctx)
        if not 1 <= number <= 1024:
            self.fail(f"{number} is not in the range 1..1024.", param, ctx)
        return number


def broker_option(*, default: str | None, text: str) -> Decorator:
    """`--broker URL`. With a default the environment's SWARMWRIGHT_BROKER comes before it."""
    return click.option(
        "--broker",
        type=BrokerUrl(),
        metavar="URL",
        default=default,
        envvar=BROKER_VARIABLE if default else None,
        show_envvar=bool(default),
        show_default=bool(default),
        help=text,
    )


json_option: Decorator = click.option("--json", "as_json", is_flag=True, help="Print one JSON object a line.")

prefix_option: Decorator = click.option(
    "--prefix",
    default="",
    metavar="PREFIX",
    help="Topics stand under this prefix, such as 'lab/'. Default: none.",
)


def experiment_broker(broker: str | None, of_experiment: str | None, servers: object) -> str | None:
    """The broker of an experiment: the option, then the experiment file, then the environment.

    None when none is named or the experiment is evaluated in this process: then nothing is connected to.
    """
    if broker is not None or of_experiment is not None or servers == "local":
        return broker
    from_environment = os.environ.get(BROKER_VARIABLE)
    if not from_environment:
        return None
    return BrokerUrl().convert(from_environment, None, None)
