"""What launchers on other machines share: how Swarmwright is called there."""

import shlex
from collections.abc import Mapping

from pydantic import Field

from swarmwright.launchers._base import LauncherOptions
from swarmwright.launchers._specification import Specification


class RemoteOptions(LauncherOptions):
    """Options of launchers on other machines."""

    command: str = Field(default="swarmwright", min_length=1)
    """The program there, such as /opt/venv/bin/swarmwright."""
    setup: str | None = Field(default=None, min_length=1)
    """Lines of shell that are run before it, such as `module load swarmwright`."""


def prepared(options: RemoteOptions, variables: Mapping[str, str], folder: str) -> list[str]:
    """Return lines of shell that set what the program needs; `folder` becomes the working folder."""
    lines = [f"export {name}={shlex.quote(value)}" for name, value in sorted(variables.items())]
    setup = [] if options.setup is None else [options.setup]
    # Of another account, or another broker, where the environment is passed on.
    others = "unset SWARMWRIGHT_BROKER SWARMWRIGHT_USERNAME SWARMWRIGHT_PASSWORD SWARMWRIGHT_PASSWORD_FILE"
    return [*setup, f"{others} SWARMWRIGHT_CA_FILE", *lines, f"cd {shlex.quote(folder)} || exit 1"]


def called(options: RemoteOptions, specification: Specification, server: int) -> str:
    """Return the command that serves, as shell takes it."""
    return f"{options.command} {shlex.join(specification.arguments(server))}"
