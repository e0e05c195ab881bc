"""Shell commands that start servers on other machines."""

import shlex
from collections.abc import Mapping

from pydantic import Field

from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.servers.broker.credentials import CREDENTIALS
from swarmwright.servers.launchers._base import Specification


class RemoteOptions(LauncherOptions):
    """Options of launchers on other machines."""

    command: str = Field(default="swarmwright", min_length=1)
    """Program on the servers' machines, such as /opt/venv/bin/swarmwright."""
    setup: str | None = Field(default=None, min_length=1)
    """Shell commands to run before it, such as `module load swarmwright`."""


def format_setup(
    options: RemoteOptions, variables: Mapping[str, str], folder: str, code: str | None = None
) -> list[str]:
    """Return shell lines that set up the environment of the program.

    Args:
        options: options of the launcher.
        variables: variables of the environment, without the code.
        folder: the working folder, quoted for the shell.
        code: first folder of PYTHONPATH, quoted for the shell. The folders of the option `environment`
            follow, else those set by the setup or the image.
    """
    python_path = variables.get("PYTHONPATH")
    lines = [f"export {name}={shlex.quote(value)}" for name, value in sorted(variables.items())]
    if code is not None and python_path:
        lines.append(f"export PYTHONPATH={code}:{shlex.quote(python_path)}")
    elif code is not None:
        lines.append(f'export PYTHONPATH={code}"${{PYTHONPATH:+:$PYTHONPATH}}"')
    setup = [] if options.setup is None else [options.setup]
    # An inherited environment may name another account or broker.
    unset = shlex.join(["unset", "SWARMWRIGHT_BROKER", *CREDENTIALS])
    return [*setup, unset, *lines, f"cd {folder} || exit 1"]


def format_unpack(archive: str, sha256: str, folder: str) -> list[str]:
    """Return shell lines that unpack code into the folder of a server.

    The server ends if the archive, which machines and jobs share, has changed.

    Args:
        archive: file with the code, quoted for the shell.
        sha256: SHA-256 of the archive, in hexadecimal.
        folder: quoted for the shell; it exists if a job was restarted.
    """
    return [
        f"digest=$({sha256_of(archive)})",
        f'if [ "${{digest:-{sha256}}}" != {sha256} ]; then',
        f"  echo {archive}: has SHA-256 $digest instead of {sha256}, so it is not unpacked >&2",
        "  exit 1",
        "fi",
        f"rm -rf {folder} && mkdir -p {folder} && tar -xzof {archive} -C {folder} || exit 1",
    ]


def sha256_of(file: str) -> str:
    """Return the command that prints the SHA-256 of a file, or nothing without a program for it.

    file: quoted for the shell.
    """
    return f"{{ sha256sum || shasum -a 256; }} 2> /dev/null < {file} | cut -c -64"


def format_command(options: RemoteOptions, specification: Specification, server: int) -> str:
    """Return the shell command that starts a server."""
    return f"{options.command} {shlex.join(specification.arguments(server))}"
