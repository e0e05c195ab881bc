"""Servers on other machines through SSH, with asyncssh (https://asyncssh.readthedocs.io)."""

import asyncio
import threading
from collections.abc import Coroutine, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import BeforeValidator, Field

from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.problems import format_value
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError
from swarmwright.servers.launchers._remote import RemoteOptions
from swarmwright.servers.launchers._specification import Specification
from swarmwright.servers.launchers._ssh_hosts import GRACE_S, Hosts

Result = TypeVar("Result")


class Host(Options):
    """A machine."""

    host: str = Field(min_length=1)
    """Name, address, or Host of the SSH configuration."""
    user: str | None = None
    """User on the machine. Default: the option `user`."""
    port: int | None = Field(default=None, ge=1, le=65535)
    """Port of sshd. Default: the option `port`."""
    slots: int | None = Field(default=None, ge=1, le=1024)
    """Maximum number of servers at once. Default: one per processor."""


def _parse_host(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    """Parse `user@host:port slots=4`, as written in lists and files."""
    if not isinstance(value, str):
        return value
    words = value.split()
    if not words:
        raise ValueError("must not be empty")
    user, at, location = words[0].rpartition("@")
    name, colon, port = (
        location.partition(":") if location.count(":") == 1 else (location.strip("[]"), "", "")
    )
    fields: dict[str, Any] = {"host": name}
    if at:
        fields["user"] = user
    for word in [*([f"port={port}"] if colon else []), *words[1:]]:
        key, _, number = word.partition("=")
        if key not in {"port", "slots"} or not number.isdecimal():
            raise ValueError(f"must be like ada@robot1:2222 slots=4, not {format_value(value)}")
        fields[key] = int(number)
    return fields


def _parse_hosts(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, str | Mapping | Host):
        value = [value]
    return [_parse_host(host) for host in value] if isinstance(value, list | tuple) else value


class SshOptions(RemoteOptions):
    """Machines reached through SSH."""

    launcher: Literal["ssh"] = "ssh"
    hosts: Annotated[list[Host], BeforeValidator(_parse_hosts, json_schema_input_type=list[str | Host])] = (
        Field(default=[])
    )
    """The machines: names, texts such as `ada@robot1:2222 slots=4`, or {host: robot1, user: ada, port: 2222,
    slots: 4}. The SSH configuration applies, including jump hosts (ProxyJump)."""
    host_file: str | None = Field(default=None, min_length=1)
    """File with further machines, one per line, as in `hosts`; # begins a comment."""
    user: str | None = Field(default=None, min_length=1)
    """Default user. Default: that of the SSH configuration, or the local user."""
    port: int | None = Field(default=None, ge=1, le=65535)
    """Default port. Default: that of the SSH configuration, or 22."""
    key: str | None = Field(default=None, min_length=1)
    """Private key file. Default: the SSH agent's keys and those in ~/.ssh."""
    known_hosts: str | None = Field(default=None, min_length=1)
    """File with the machines' host keys. Default: ~/.ssh/known_hosts."""
    config: str | None = Field(default=None, min_length=1)
    """SSH configuration file. Default: ~/.ssh/config."""
    folder: str = Field(default=".cache/swarmwright", min_length=1)
    """Folder on the machines for copied code, relative to the home folder; it is not deleted."""

    paths: ClassVar[tuple[str, ...]] = (*RemoteOptions.paths, "host_file", "key", "known_hosts", "config")


class Ssh(Launcher):
    """Launcher of servers on machines reached through SSH, as many as these have slots.

    Code is copied by SFTP, once per version. A server ends with its connection. Unreachable machines are
    retried.
    """

    kind: ClassVar[str] = "ssh"
    options_model = SshOptions
    options: SshOptions

    def __init__(self, options: SshOptions, specification: Specification) -> None:
        super().__init__(options, specification)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._parse_hosts: Hosts | None = None

    def open(self) -> None:
        """Connect to all machines.

        Raises:
            InputError: there are no machines, or asyncssh is not installed.
            LauncherError: no machine can be used.
        """
        try:
            import asyncssh  # noqa: F401, PLC0415 - optional
        except ImportError as error:
            raise InputError(
                "servers: ssh needs the package asyncssh: pip install 'swarmwright[ssh]'"
            ) from error
        hosts = [*self.options.hosts, *self._read_host_file()]
        if not hosts:
            raise InputError(
                "servers.hosts: is missing; ssh needs machines, such as hosts: [robot1, ada@robot2 slots=4]"
            )
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True, name="ssh")
        self._thread.start()
        self._parse_hosts = Hosts(hosts, self.options, self.specification)
        problems = self._run(self._parse_hosts.open())
        if len(problems) == len(hosts):
            raise LauncherError("\n".join(["no machine can be used:", *problems]))

    def start(self, servers: Sequence[int]) -> None:
        """Assign servers to free slots, for which they wait if necessary."""
        self._run(self._require_hosts().start(servers))

    def health(self) -> Mapping[int, Health]:
        """Return the states of all servers."""
        return self._run(self._require_hosts().health())

    def stop(self, servers: Sequence[int]) -> None:
        """End servers."""
        self._run(self._require_hosts().stop(servers))

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:
        """Return the last lines of a server."""
        return self._run(self._require_hosts().logs(server))[-lines:]

    def close(self) -> None:
        """End all servers and all connections."""
        loop, self._loop = self._loop, None
        if loop is None or self._thread is None:
            return
        if self._parse_hosts is not None:
            asyncio.run_coroutine_threadsafe(self._parse_hosts.close(), loop).result(3 * GRACE_S)
        loop.call_soon_threadsafe(loop.stop)
        self._thread.join()
        loop.close()

    def _require_hosts(self) -> Hosts:
        assert self._parse_hosts is not None
        return self._parse_hosts

    def _run(self, work: Coroutine[Any, Any, Result]) -> Result:
        if self._loop is None:
            work.close()
            raise LauncherError("the connections are closed")
        try:
            return asyncio.run_coroutine_threadsafe(work, self._loop).result(self.options.start_timeout)
        except TimeoutError as error:
            raise LauncherError(f"no answer within {self.options.start_timeout:g} s") from error

    def _read_host_file(self) -> list[Host]:
        if self.options.host_file is None:
            return []
        file = Path(self.options.host_file)
        hosts = []
        try:
            for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
                text = line.partition("#")[0].strip()
                if text:
                    try:
                        hosts.append(Host.model_validate(_parse_host(text)))
                    except ValueError as error:
                        raise InputError(f"{file}:{number}: must be like ada@robot1:2222 slots=4") from error
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"servers.host_file: {file} cannot be read: {error}") from error
        return hosts
