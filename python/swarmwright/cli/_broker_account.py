"""The account of `swarmwright broker`: it admits only programs of its user, unless it is told otherwise."""

import logging
import shlex
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli._output import Output
from swarmwright.common.errors import InputError

if TYPE_CHECKING:
    from swarmwright import _engine
    from swarmwright.servers.broker.private import Account

_LOGGER = logging.getLogger("swarmwright.servers.broker")
_HEAD = "# Account of `swarmwright broker`, valid while that runs.\n"
"""First line of a file of --account."""


def account_for(others: Mapping[str, object], file: Path | None, *, has_port: bool) -> "UserAccount | None":
    """Return the account that a broker admits; None where it admits others, or listens on a Unix socket only.

    Args:
        others: options that say which clients are admitted instead, None for those that are not given.
        file: of --account.
        has_port: whether it listens on a port.

    Raises:
        click.UsageError: options exclude each other.
    """
    given = [option for option, value in others.items() if value is not None]
    if "--anonymous" in given and len(given) > 1:
        raise click.UsageError(f"--anonymous admits every client, {given[1]} does not; leave one out.")
    if file is not None and given:
        raise click.UsageError(f"--account is for brokers without {given[0]}; leave one out.")
    if file is not None and not has_port:
        raise click.UsageError("--account is for a port, add --port PORT; clients of a socket need none.")
    if given or not has_port:
        return None
    from swarmwright.servers.broker.private import new_account

    return UserAccount(new_account(), file)


class UserAccount:
    """The account of the user who starts a broker, and where programs find it.

    Attributes:
        file: variables for programs that do not look for the account themselves; None where there are none.

    """

    def __init__(self, account: "Account", file: Path | None) -> None:
        self._account = account
        self._own_file = file
        self._problem: str | None = None
        self.file = None if file is None else str(file)

    @property
    def pair(self) -> tuple[str, str]:
        """User name and password."""
        return self._account.username, self._account.password

    def publish(self, broker: "_engine.Broker") -> None:
        """Let the user's programs find the account."""
        files, self._problem = broker.publish(*self.pair)
        if self._own_file is not None:
            self._write(self._own_file, broker.url)
        elif files:
            self.file = str(files[0])

    def announce(self, output: Output) -> None:
        """Say who is admitted."""
        output.text("Only programs of this user may connect (--anonymous admits all users of this machine)")
        if self.file is not None:
            output.text(f"Programs without Swarmwright get the account with: . {shlex.quote(self.file)}")
        if self._problem is not None:
            remedy = "start them after that" if self._own_file else "write it into a file with --account FILE"
            _LOGGER.warning(
                "other programs do not find this account by themselves (%s); %s", self._problem, remedy
            )

    def remove(self) -> None:
        """Remove the file of --account, unless another broker has written its own."""
        if self._own_file is not None:
            with suppress(OSError):
                if self._account.password in self._own_file.read_text(encoding="utf-8"):
                    self._own_file.unlink()

    def _write(self, file: Path, url: str) -> None:
        variables = {
            "SWARMWRIGHT_BROKER": url,
            "SWARMWRIGHT_USERNAME": self._account.username,
            "SWARMWRIGHT_PASSWORD": self._account.password,
        }
        text = "".join(f"export {name}={shlex.quote(value)}\n" for name, value in variables.items())
        try:
            if file.exists() and not (file.is_file() and file.read_bytes().startswith(_HEAD.encode())):
                raise InputError(f"--account: {file} is another file; name one that does not exist")
            with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False, encoding="utf-8") as draft:
                draft.write(_HEAD + text)  # mode 0600
            Path(draft.name).replace(file)
        except OSError as error:
            raise InputError(f"--account: {file}: cannot be written: {error.strerror}") from error
