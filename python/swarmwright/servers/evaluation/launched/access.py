"""The embedded broker for servers on other machines, with TLS and an account per launcher."""

import ipaddress
import os
import socket
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

from swarmwright import _engine
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.processes import allow_more_open_files
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.servers.broker.mosquitto import Account, format_access_rules
from swarmwright.servers.broker.private import create_account, start_private

_CERTIFICATE_DAYS = 366
"""Validity of the certificate, which serves one run."""
TOOL = "tool"


@dataclass(frozen=True)
class Credentials:
    """Credentials of a client for a broker; None for what the broker does not require."""

    username: str | None = None
    password: str | None = field(default=None, repr=False)
    authority: str | None = field(default=None, repr=False)
    """PEM text."""
    certificate: str | None = field(default=None, repr=False)
    """The client's certificate as PEM text."""
    key: str | None = field(default=None, repr=False)
    """The client's private key as PEM text."""

    @classmethod
    def from_environment(cls, variables: "os._Environ[str] | dict[str, str]", label: str) -> Self:
        """Read the credentials in Swarmwright's variables. Raises InputError that begins with `what`."""

        def text(name: str) -> str | None:
            file = variables.get(name)
            if not file:
                return None
            try:
                return Path(file).read_text(encoding="utf-8")
            except (OSError, UnicodeDecodeError) as error:
                raise InputError(f"{label}: {name}: {file} cannot be read: {error}") from error

        password = variables.get("SWARMWRIGHT_PASSWORD") or None
        if password is None:
            lines = (text("SWARMWRIGHT_PASSWORD_FILE") or "").splitlines()
            password = lines[0] if lines else None
        username = variables.get("SWARMWRIGHT_USERNAME") or None
        return cls(
            username,
            password,
            text("SWARMWRIGHT_CA_FILE"),
            text("SWARMWRIGHT_CERTIFICATE_FILE"),
            text("SWARMWRIGHT_KEY_FILE"),
        )


@dataclass(frozen=True)
class Access:
    """A broker's address and credentials."""

    address: str
    """The address as seen from this process."""
    tool: Credentials | None = None
    """Credentials of this process; None to find them in the environment."""
    servers: dict[str, Credentials] = field(default_factory=dict)
    """Credentials of servers, by account."""
    authority_file: str | None = None

    def address_for(self, host: str | None) -> str:
        """Return the address for servers that reach this machine as `host`."""
        if host is None:
            return self.address
        parts = urlsplit(self.address)
        location = f"[{host}]" if ":" in host else host
        return f"{parts.scheme}://{location}:{parts.port}"

    @property
    def account(self) -> tuple[str, str, str] | None:
        """User name, password and CA file of this process; None to find them in the environment."""
        if self.tool is None:
            return None
        return self.tool.username or "", self.tool.password or "", self.authority_file or ""


def find_own_address() -> str:
    """Return the address of this machine's default route, or its host name without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # documentation address (RFC 5737); nothing is sent
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()


def is_loopback(host: str) -> bool:
    """Whether a host name or address refers to the local machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def start_embedded(
    stack: ExitStack, hosts: Sequence[str], accounts: Sequence[str], *, port: int | None, prefix: str
) -> Access:
    """Start the embedded broker, which ends with the stack.

    Args:
        stack: ends it.
        hosts: names by which servers reach this machine.
        accounts: a name for each launcher.
        port: None for any.
        prefix: prefix of all topics.

    Raises:
        RunError: the port is taken.
    """
    if all(map(is_loopback, hosts)):
        address, account = start_private(stack, port or 0)
        credentials = Credentials(account.username, account.password)
        return Access(address, servers=dict.fromkeys(accounts, credentials))
    return _start_with_accounts(stack, hosts, accounts, port=port, prefix=prefix)


def _start_with_accounts(
    stack: ExitStack, hosts: Sequence[str], accounts: Sequence[str], *, port: int | None, prefix: str
) -> Access:
    allow_more_open_files()
    folder = stack.enter_context(TemporaryFolder("broker"))
    names = list(dict.fromkeys([*hosts, "localhost", "127.0.0.1", "::1"]))
    with engine_errors("servers: broker_host: "):
        authority, _, certificate, key = _engine.certificates(names, _CERTIFICATE_DAYS)
    passwords = {name: create_account().password for name in (TOOL, *accounts)}
    root = prefix.removesuffix("/")
    rules = [Account(TOOL, "tool", root), *(Account(name, "server", root) for name in accounts)]
    files = {
        "access": format_access_rules(rules),
        "ca.pem": authority,
        "broker.pem": certificate,
        "broker-key.pem": key,
    }
    for name, text in files.items():
        (folder / name).touch(0o600)
        (folder / name).write_text(text, encoding="utf-8")
    with engine_errors():
        broker = _engine.Broker(
            "::" if any(":" in host for host in hosts) else "0.0.0.0",  # noqa: S104 - with TLS and passwords
            port or 0,
            accounts=list(passwords.items()),
            access=str(folder / "access"),
            certificate=str(folder / "broker.pem"),
            key=str(folder / "broker-key.pem"),
        )
    stack.callback(broker.stop)
    credentials = {name: Credentials(name, password, authority) for name, password in passwords.items()}
    tool = credentials.pop(TOOL)
    return Access(f"mqtts://127.0.0.1:{broker.port}", tool, credentials, str(folder / "ca.pem"))
