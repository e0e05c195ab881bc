"""`swarmwright broker`: an MQTT broker, or the configuration of one."""

import ipaddress
import logging
import os
import re
import shlex
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, NoReturn

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._observing import Log, log_options
from swarmwright.cli._options import ExistingPath, WholeNumber, json_option, topic_prefix
from swarmwright.cli._output import Output
from swarmwright.common.errors import InputError
from swarmwright.common.processes import allow_more_open_files
from swarmwright.experiment.broker_address import PREFIX_VARIABLE

if TYPE_CHECKING:
    from types import FrameType

    from swarmwright import _engine
    from swarmwright.servers.broker.private import Account


_LOGGER = logging.getLogger("swarmwright.servers.broker")
_HEAD = "# Account of `swarmwright broker`, valid while it runs.\n"
"""First line of a file of --account."""


class UserAccount:
    """The account of the user who starts a broker, and its file.

    Attributes:
        file: file with shell variables for programs that do not find the account themselves, or None.

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
        """Print who is admitted."""
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
                raise InputError(f"--account: {file} was not written by --account; choose another file")
            with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False, encoding="utf-8") as draft:
                draft.write(_HEAD + text)  # mode 0600
            Path(draft.name).replace(file)
        except OSError as error:
            raise InputError(f"--account: {file}: cannot be written: {error.strerror}") from error


@contextmanager
def hangups() -> Iterator[threading.Event]:
    """Yield an event that every SIGHUP sets.

    A SIGHUP from a closed terminal ends the broker instead, because Ctrl-C could no longer stop it.
    """
    arrived = threading.Event()
    had_terminal = _has_terminal()
    before = signal.getsignal(signal.SIGHUP)

    def note(number: int, frame: "FrameType | None") -> None:
        if had_terminal and not _has_terminal() and callable(before):
            before(number, frame)
        else:
            arrived.set()

    if threading.current_thread() is not threading.main_thread():
        yield arrived
        return
    signal.signal(signal.SIGHUP, note)
    try:
        yield arrived
    finally:
        signal.signal(signal.SIGHUP, before)


def _has_terminal() -> bool:
    try:
        os.close(os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY))
    except OSError:
        return False
    return True


def reload(broker: "_engine.Broker", output: Output, lines: Log) -> None:
    """Let the broker reload its files; an invalid file is reported and changes nothing."""
    from swarmwright import _engine

    try:
        broker.reload()
    except _engine.EngineError as error:
        _LOGGER.warning("reload failed, the old settings stay in use: %s", error)
        output.json({"event": "reload_failed", "message": str(error)})
    else:
        output.text("Reloaded passwords, access rules and certificate")
        output.json({"event": "reloaded"})
        lines.write("info", "reloaded")


Port = WholeNumber(0, 65535)


def _mode(value: str) -> int:
    """Parse the permissions of a file in octal digits, as for chmod."""
    if not re.fullmatch("0?[0-7]{3}", value):
        raise click.BadParameter(f"'{value}' is not a mode; write three octal digits, such as 660.")
    return int(value, 8)


LOG_SIZE = 64
"""Default size of a log file in MiB: every client that reaches the broker can cause log lines."""

EXAMPLE = """\
swarmwright broker --port 1883
swarmwright broker --socket /run/user/1000/swarmwright.sock
swarmwright broker --init lab --host broker.example.org
swarmwright broker --add-user users.txt ada
swarmwright broker --host 0.0.0.0 --users users.txt --certificate chain.pem --key key.pem"""


_SERVING = (
    *("--socket", "--socket-mode", "--websocket-port", "--origin", "--users", "--anonymous", "--account"),
    *("--access", "--certificate", "--key", "--client-ca"),
)
"""Options of a broker that runs."""


@click.command("broker", cls=Command, example=EXAMPLE)
@click.option(
    "--port",
    type=Port,
    metavar="PORT",
    help="TCP port; 0 takes a free one.  [default: 1883, or 8883 with TLS]",
)
@click.option(
    "--host",
    "hosts",
    multiple=True,
    metavar="HOST",
    help="Address to listen on (default: 127.0.0.1). With --init: a name or address of the broker for "
    "clients (default: this machine's name), repeatable.",
)
@click.option(
    "--socket",
    "socket_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Listen on a Unix socket (unix:///PATH), and on TCP only with --port or --host.",
)
@click.option(
    "--socket-mode",
    type=_mode,
    metavar="MODE",
    help="Permissions of the socket; users who may write to it may connect.  [default: 600]",
)
@click.option("--websocket-port", type=Port, metavar="PORT", help="Also listen for MQTT over websockets.")
@click.option(
    "--origin",
    "origins",
    multiple=True,
    metavar="URL",
    help="Allow websocket connections from web pages of this origin, such as https://dash.example.org, or "
    "* for all. Pages of the broker's host are always allowed. Repeatable.",
)
@click.option("--users", type=ExistingPath(), help="Password file; only its users may connect.")
@click.option(
    "--anonymous",
    is_flag=True,
    help="Admit every client without an account. Every user of this machine can then read and change runs "
    "on this broker.",
)
@click.option(
    "--account",
    "account_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the account to a file of shell variables (mode 0600), for peers not made with "
    "Swarmwright: `. FILE` before they start. Removed when the broker ends.",
)
@click.option(
    "--access", type=ExistingPath(), help="Access rules for topics, in the format of Mosquitto's acl_file."
)
@click.option("--certificate", type=ExistingPath(), help="Listen with TLS; certificate chain, PEM.")
@click.option("--key", type=ExistingPath(), help="Private key of the certificate, PEM.")
@click.option(
    "--client-ca",
    type=ExistingPath(),
    help="Require client certificates signed by an authority in this file, PEM (mutual TLS).",
)
@click.option(
    "--add-user",
    nargs=2,
    metavar="FILE NAME",
    help="Add a user to a password file or change the password, and exit. The password is prompted for, "
    "or read from the first line of standard input.",
)
@click.option(
    "--init",
    "folder",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Write a Mosquitto configuration with TLS, passwords and access rules to a folder, and exit. "
    "With --prefix, add accounts to an existing one.",
)
@click.option(
    "--prefix",
    "prefixes",
    type=topic_prefix,
    multiple=True,
    metavar="P",
    help="With --init: topic prefix with separate accounts. Repeatable.",
)
@click.option(
    "--iterations",
    type=WholeNumber(min=1000, max=10_000_000),
    help="With --init: PBKDF2 rounds per password.  [default: 210000, as OWASP advises]",
)
@click.option(
    "--rate",
    type=WholeNumber(min=1, max=2**32 - 1),
    default=500_000,
    show_default=True,
    help="Packets accepted from one client per second; a faster client is slowed down.",
)
@click.option(
    "--memory",
    type=WholeNumber(min=16, max=2**24),
    metavar="MIB",
    help="Memory limit in MiB; beyond it, the client that holds most is disconnected. Default: a quarter "
    "of the machine's, at least 256.",
)
@log_options
@json_option
def command(
    port: int | None,
    hosts: tuple[str, ...],
    socket_file: Path | None,
    socket_mode: int | None,
    websocket_port: int | None,
    origins: tuple[str, ...],
    users: Path | None,
    anonymous: bool,
    account_file: Path | None,
    access: Path | None,
    certificate: Path | None,
    key: Path | None,
    client_ca: Path | None,
    add_user: tuple[str, str] | None,
    folder: Path | None,
    prefixes: tuple[str, ...],
    iterations: int | None,
    rate: int,
    memory: int | None,
    log: Path | None,
    log_level: str,
    log_size: int | None,
    output: Output,
) -> int:
    """Run an MQTT broker, or write the configuration of one.

    It runs until Ctrl-C. By default, it listens on this machine and admits only programs of the user who
    starts it: Swarmwright's commands and servers in C++ and Python find the account by themselves, others
    take it from the environment (--account). A Unix socket admits users who may write to its file. Other
    machines are admitted only with TLS and a password file or client certificates. On SIGHUP the broker
    reloads its files.
    """
    for option in ("--init", "--add-user"):
        options.exclude(option, *_SERVING)
    options.exclude("--init", "--add-user")
    if folder is not None:
        return _init(output, folder, hosts, port, prefixes, iterations)
    if add_user is not None:
        return _add_user(output, Path(add_user[0]), add_user[1])
    options.need("--prefix", "--init")
    options.need("--iterations", "--init")
    if len(hosts) > 1:
        raise click.UsageError("The broker listens on one address; --host was given more than once.")
    host = hosts[0] if hosts else "127.0.0.1"
    options.need("--certificate", "--key")
    options.need("--key", "--certificate")
    options.need("--client-ca", "--certificate")
    options.need("--access", "--users")
    options.need("--origin", "--websocket-port")
    options.need("--socket-mode", "--socket")
    options.exclude("--anonymous", "--users", "--client-ca")
    options.exclude("--account", "--anonymous", "--users", "--client-ca")
    if socket_file is not None and port is None and not hosts:
        if websocket_port is None:
            options.need("--certificate", "--port")
            options.need("--account", "--port")
    elif port is None:
        port = 8883 if certificate else 1883
    _check_exposure(host, users=users, certificate=certificate, client_ca=client_ca)
    account = None
    if (port is not None or websocket_port is not None) and not (anonymous or users or client_ca):
        from swarmwright.servers.broker.private import create_account

        account = UserAccount(create_account(), account_file)
    from swarmwright import _engine

    allow_more_open_files()
    with Log(log, log_level, size=log_size or LOG_SIZE) as lines, hangups() as hung_up:
        broker = _engine.Broker(
            host,
            port,
            socket=str(socket_file) if socket_file else None,
            socket_mode=0o600 if socket_mode is None else socket_mode,
            websocket_port=websocket_port,
            users=str(users) if users else None,
            accounts=None if account is None else [account.pair],
            access=str(access) if access else None,
            certificate=str(certificate) if certificate else None,
            key=str(key) if key else None,
            client_ca=str(client_ca) if client_ca else None,
            origins=list(origins),
            rate=rate,
            memory=None if memory is None else memory << 20,
        )
        _check_certificate(certificate)
        try:
            _announce(output, broker, host, account, anonymous=anonymous)
            lines.write("info", "listening", url=broker.url)
            _wait(broker, hung_up, output, lines)
        except KeyboardInterrupt:  # Ctrl-C or SIGTERM is how it is asked to end
            lines.write("info", "stopped")
        finally:
            broker.stop()
            if account is not None:
                account.remove()
    return 0


def _wait(broker: "_engine.Broker", hung_up: Event, output: Output, lines: Log) -> NoReturn:
    """Reload the files on each SIGHUP, until Ctrl-C."""
    # With a time-out: a signal just before an endless wait would never be noticed.
    while True:
        if hung_up.wait(0.5):
            hung_up.clear()
            reload(broker, output, lines)


def _announce(
    output: Output, broker: "_engine.Broker", host: str, account: UserAccount | None, *, anonymous: bool
) -> None:
    """Publish the account of a broker, then print where it listens and which clients it admits."""
    if account is not None:
        account.publish(broker)
    where = dict.fromkeys(url for url in (broker.url, broker.socket_url) if url)
    scope = "all addresses of this machine, here " if _is_any(host) and broker.url else ""
    output.text(f"The broker listens on {scope}{' and '.join(where)} (Ctrl-C stops it)")
    listening = {"event": "listening", "url": broker.url, "port": broker.port or None}
    if account is not None:
        account.announce(output)
    elif anonymous:
        output.text("Every user of this machine may connect, and read and change runs (--anonymous)")
    output.json(
        {
            **listening,
            **({"socket": broker.socket_url} if broker.socket_url else {}),
            **({"account": account.file} if account is not None else {}),
        }
    )


def _check_exposure(
    host: str, *, users: Path | None, certificate: Path | None, client_ca: Path | None
) -> None:
    """Refuse an address that other machines can reach without TLS and passwords or client certificates."""
    if ((users or client_ca) and certificate) or _loopback(host):
        return
    reasons = []
    if users is None and client_ca is None:
        reasons.append(
            "Without a password every client there could use the broker: give --users FILE, see --add-user, "
            "or --client-ca FILE."
        )
    if certificate is None:
        reasons.append(
            "Without TLS the traffic could be read on the network path: give --certificate FILE and "
            "--key FILE, such as --init makes them."
        )
    raise click.UsageError(
        f"'{host}' can be reached from other machines. {' '.join(reasons)} Or listen on 127.0.0.1."
    )


def _check_certificate(file: Path | None) -> None:
    """Warn about a certificate that clients refuse."""
    from swarmwright.servers.broker.mosquitto import is_authority_certificate

    if file is not None and is_authority_certificate(file):
        _LOGGER.warning(
            "%s is the certificate of an authority (CA:TRUE), as 'openssl req -x509' makes it, which "
            "Swarmwright's clients refuse; use one that an authority signs, such as --init makes",
            file,
        )


def _is_any(host: str) -> bool:
    """Return whether a host means all addresses of this machine."""
    try:
        return ipaddress.ip_address(host or "0.0.0.0").is_unspecified  # noqa: S104 - nothing is bound
    except ValueError:
        return False


def _loopback(host: str) -> bool:
    """Return whether every address of the host belongs to this machine alone."""
    try:
        addresses = socket.getaddrinfo(host or None, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        raise click.UsageError(
            f"'{host}' is not an address of this machine ({error}); try 127.0.0.1."
        ) from None
    return all(ipaddress.ip_address(str(address[4][0]).split("%")[0]).is_loopback for address in addresses)


def _add_user(output: Output, file: Path, name: str) -> int:
    from swarmwright.servers.broker.mosquitto import check_user, set_password

    check_user(name)
    if sys.stdin.isatty():
        password = click.prompt(f"Password of {name}", hide_input=True, confirmation_prompt=True, err=True)
    else:
        password = sys.stdin.readline().rstrip("\r\n")
        if not password:
            raise click.UsageError("The password is missing; pass it as the first line of standard input.")
    new = set_password(file, name, password)
    if file.stat().st_mode & 0o004:
        _LOGGER.warning(
            "%s can be read by every user of this machine, who can try to guess its passwords; "
            "restrict it with chmod 600",
            file,
        )
    output.text(f"{file}: {name} {'added' if new else 'has a new password'}")
    output.json({"event": "user", "file": str(file), "user": name, "new": new})
    return 0


def _init(
    output: Output,
    folder: Path,
    hosts: tuple[str, ...],
    port: int | None,
    prefixes: tuple[str, ...],
    iterations: int | None,
) -> int:
    from swarmwright.servers.broker.mosquitto import add_accounts, can_add, write_configuration

    if prefixes and not hosts and port is None and can_add(folder):
        added = add_accounts(folder, prefixes, iterations)
        users = [account.user for account in added]
        output.json({"event": "added", "folder": str(folder), "users": users})
        output.text(f"{folder}: the users {', '.join(users)} were added")
        output.text("Send SIGHUP to the broker to load them:")
        output.text("  kill -HUP $(pidof mosquitto)")
        return 0
    if port == 0:
        raise click.UsageError("--init writes the port into the configuration; name one, such as 8883.")
    accounts = write_configuration(
        folder, hosts=hosts, port=port or 8883, prefixes=prefixes, iterations=iterations
    )
    output.json({"event": "written", "folder": str(folder), "users": [account.user for account in accounts]})

    def variables(role: str) -> str:
        first = next(account for account in accounts if account.role == role)
        return f". {shlex.quote(str(folder / f'{first.user}.env'))}"

    output.text(
        f"{folder}: a Mosquitto configuration with the users "
        f"{', '.join(account.user for account in accounts)}"
    )
    output.text("Now, each in another terminal:")
    output.text(f"  mosquitto -c {shlex.quote(str(folder / 'mosquitto.conf'))}")
    output.text(f"  {variables('server')} && swarmwright serve minisim")
    output.text(f"  {variables('tool')} && swarmwright optimize EXPERIMENT.yaml")
    if accounts[0].prefix:
        output.text(
            f"The files set {PREFIX_VARIABLE} too; --prefix, or `prefix` in an experiment, has priority."
        )
    output.text(
        "Copy ca.pem and the .password file of its role to another machine by a secure channel. ca-key.pem "
        "is needed only to renew the certificate; store it elsewhere."
    )
    return 0
