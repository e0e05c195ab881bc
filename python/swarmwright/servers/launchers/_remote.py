"""What launchers on other machines share: how Swarmwright is called there."""

import shlex
from collections.abc import Mapping

from pydantic import Field

from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.servers.broker.credentials import CREDENTIALS
from swarmwright.servers.launchers._specification import Specification


class RemoteOptions(LauncherOptions):
    """Options of launchers on other machines."""

    command: str = Field(default="swarmwright", min_length=1)
    """The program there, such as /opt/venv/bin/swarmwright."""
    setup: str | None = Field(default=None, min_length=1)
    """Lines of shell that are run before it, such as `module load swarmwright`."""


def prepared(
    options: RemoteOptions, variables: Mapping[str, str], folder: str, code: str | None = None
) -> list[str]:
    """Return lines of shell that set what the program needs.

    Args:
        options: of the launcher.
        variables: of the environment, without the code.
        folder: becomes the working folder; a word of shell.
        code: where modules are looked for first; a word of shell. After it come the folders that the option
            `environment` names, else those that the setup, or the image, has set.
    """
    given = variables.get("PYTHONPATH")
    lines = [f"export {name}={shlex.quote(value)}" for name, value in sorted(variables.items())]
    if code is not None and given:
        lines.append(f"export PYTHONPATH={code}:{shlex.quote(given)}")
    elif code is not None:
        lines.append(f'export PYTHONPATH={code}"${{PYTHONPATH:+:$PYTHONPATH}}"')
    setup = [] if options.setup is None else [options.setup]
    # Of another account, or another broker, where the environment is passed on.
    unset = shlex.join(["unset", "SWARMWRIGHT_BROKER", *CREDENTIALS])
    return [*setup, unset, *lines, f"cd {folder} || exit 1"]


def unpacked(archive: str, sha256: str, folder: str) -> list[str]:
    """Return the lines of shell that unpack code into a folder of one server.

    The server ends where the archive is another one: machines and jobs share it, and keep it for long.

    Args:
        archive: file with the code; a word of shell.
        sha256: of the archive, in hexadecimal.
        folder: a word of shell. Of a job that was begun again, it is there.
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
    """Return the command that prints the SHA-256 of a file, or nothing where no program computes it.

    file: a word of shell.
    """
    return f"{{ sha256sum || shasum -a 256; }} 2> /dev/null < {file} | cut -c -64"


def called(options: RemoteOptions, specification: Specification, server: int) -> str:
    """Return the command that serves, as shell takes it."""
    return f"{options.command} {shlex.join(specification.arguments(server))}"
