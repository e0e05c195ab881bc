"""Servers on other machines through SSH, with asyncssh (https://asyncssh.readthedocs.io)."""

import asyncio
import secrets
import shlex
import threading
from collections import deque
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import BeforeValidator, Field

from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.problems import format_value
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError, Specification
from swarmwright.servers.launchers._remote import (
    RemoteOptions,
    format_command,
    format_setup,
    format_unpack,
    sha256_of,
)

if TYPE_CHECKING:
    pass

GRACE_S = 10.0
"""Seconds for a server to end after SIGTERM."""
RETRY_S = 5.0
"""Seconds between attempts to reach a machine."""
CONNECT_S = 15.0
"""Time limit for connection and login, seconds."""
KEEPALIVE_S = 10.0
"""Seconds between keep-alive messages; the third unanswered one ends the connection."""
_JUMP_CLOSE_S = 0.1
"""Seconds for connections to jump hosts to close last."""
_KEPT_LINES = 200
"""Output lines kept of a server."""


_SCRIPT = "serve.sh"
"""File of the script that runs a server."""


class _Unusable(Exception):  # noqa: N818 - a state
    """A machine cannot be used; the message says why."""


@dataclass
class _Machine:
    """A machine and its connection."""

    number: int
    """Its index among the hosts of the options, from 0."""
    host: "Host"
    """Options of the machine."""
    name: str
    """Name in messages."""
    connection: Any = None
    """AsyncSSH's connection, or None."""
    slots: int = 0
    """Maximum number of servers at once."""
    home: str = ""
    """The user's home folder on the machine."""
    archive: str | None = None
    """File with the code on the machine."""
    used: set[int] = field(default_factory=set)
    """Ids of the servers in its slots."""
    problem: str | None = None
    """Why it cannot be used, or None."""
    retry_at: float = 0.0
    """Earliest time of the next connection, seconds of the event loop's clock."""


@dataclass
class _Remote:
    """A server."""

    health: Health = field(default_factory=lambda: Health("waiting", "for a free slot"))
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_KEPT_LINES))
    """Its last output lines."""
    task: "asyncio.Task[None] | None" = None
    """Task that runs it on a machine; None while it waits for a slot."""
    process: Any = None
    """AsyncSSH's process, None before the start."""
    stopped: bool = False
    """Whether the server was asked to end."""


class Hosts:
    """All machines and their servers."""

    def __init__(self, hosts: Sequence["Host"], options: "SshOptions", specification: Specification) -> None:
        self._options, self._specification = options, specification
        self._machines = [_Machine(number, host, host.host) for number, host in enumerate(hosts)]
        self._servers: dict[int, _Remote] = {}
        self._ended: dict[int, list[str]] = {}
        self._token = secrets.token_hex(4)

    async def open(self) -> list[str]:
        """Connect to all machines; return the problems of those that cannot be used."""
        await asyncio.gather(*(self._connect(machine) for machine in self._machines))
        return [f"{host.name}: {host.problem}" for host in self._machines if host.problem is not None]

    async def start(self, servers: Sequence[int]) -> None:
        """Assign servers to free slots."""
        for server in servers:
            self._servers[server] = _Remote()
        self._assign()

    async def health(self) -> Mapping[int, Health]:
        """Return the states of all servers, and retry unreachable machines."""
        now = asyncio.get_running_loop().time()
        due = [host for host in self._machines if host.problem is not None and host.retry_at <= now]
        await asyncio.gather(*(self._connect(machine) for machine in due))
        self._assign()
        return {server: remote.health for server, remote in self._servers.items()}

    async def logs(self, server: int) -> list[str]:
        """Return the last output lines of a server."""
        remote = self._servers.get(server)
        return list(remote.lines) if remote is not None else self._ended.get(server, [])

    async def stop(self, servers: Sequence[int]) -> None:
        """End servers."""
        leaving = [(server, self._servers.pop(server)) for server in servers if server in self._servers]
        for server, remote in leaving:
            self._ended[server] = list(remote.lines)
        await asyncio.gather(*(self._end(remote) for _, remote in leaving))

    async def close(self) -> None:
        """End all servers, and all connections."""
        await self.stop(list(self._servers))
        for machine in self._machines:
            if machine.connection is not None:
                machine.connection.close()
        await asyncio.gather(
            *(_wait_until_closed(host.connection) for host in self._machines if host.connection is not None)
        )
        await asyncio.sleep(_JUMP_CLOSE_S)

    async def _end(self, server: _Remote) -> None:
        server.stopped = True
        if server.task is None:
            return
        with suppress(Exception):  # the connection may be gone
            if server.process is not None:
                server.process.stdin.write_eof()  # makes the script on the machine end the server
        _, unfinished = await asyncio.wait([server.task], timeout=GRACE_S + 2.0)
        for task in unfinished:
            task.cancel()

    async def _connect(self, machine: _Machine) -> None:
        import asyncssh  # noqa: PLC0415 - optional

        machine.retry_at = asyncio.get_running_loop().time() + RETRY_S
        if machine.connection is not None:
            machine.connection.abort()
        try:
            machine.connection = await asyncio.wait_for(
                asyncssh.connect(machine.host.host, **self._arguments(machine.host)), CONNECT_S
            )
            machine.home = (await self._run(machine, 'printf "%s" "$HOME"')).strip()
            machine.slots = machine.host.slots or int(await self._run(machine, "nproc"))
            await self._run(
                machine,
                f"command -v {shlex.split(self._options.command)[0]}",
                self._explain_missing_program(),
            )
            machine.archive = await self._copy_code(machine)
        except _Unusable as error:
            machine.problem = str(error)
        except TimeoutError:
            machine.problem = f"no answer within {CONNECT_S:g} s"
        except asyncssh.HostKeyNotVerifiable as error:
            machine.problem = (
                f"its host key is not trusted ({error.reason}); log in once with ssh and verify it, or set "
                "the option known_hosts to the file that contains it"
            )
        except asyncssh.PermissionDenied as error:
            machine.problem = f"login refused ({error.reason}); check the options user and key"
        except (OSError, asyncssh.Error, ValueError) as error:
            machine.problem = getattr(error, "reason", "") or str(error) or type(error).__name__
        else:
            machine.problem = None

    def _explain_missing_program(self) -> str:
        return (
            f"the program {self._options.command} was not found; set the option command to its path, such as "
            "/opt/venv/bin/swarmwright"
        )

    def _arguments(self, host: "Host") -> dict[str, Any]:
        options = self._options
        arguments = {
            "username": host.user or options.user,
            "port": host.port or options.port,
            "client_keys": None if options.key is None else [options.key],
            "known_hosts": options.known_hosts,
            "config": None if options.config is None else [options.config],
        }
        present = {name: value for name, value in arguments.items() if value is not None}
        return {**present, "keepalive_interval": KEEPALIVE_S, "login_timeout": CONNECT_S}

    async def _run(self, machine: _Machine, command: str, problem: str | None = None) -> str:
        setup = f"{self._options.setup}\n" if self._options.setup else ""
        result = await machine.connection.run(f"sh -c {shlex.quote(setup + command)}", check=False)
        if result.exit_status != 0:
            words = (result.stderr or "").strip()
            raise _Unusable(problem or f"`{command}` ended with status {result.exit_status}: {words}")
        return str(result.stdout)

    async def _copy_code(self, machine: _Machine) -> str | None:
        """Copy the code if it is missing or was changed; return its file, which machines may share."""
        code = self._specification.code
        if code is None:
            return None
        base = str(PurePosixPath(machine.home, self._options.folder, "code"))
        file, part = f"{base}/{code.sha256}.tar.gz", f"{base}/{secrets.token_hex(8)}.part"
        if await self._read_digest(machine, file) == code.sha256:
            return file
        async with _open_sftp(machine) as files:
            await files.makedirs(base, exist_ok=True)
            async with files.open(part, "wb") as archive:
                await archive.write(code.archive)
        await self._run(machine, f"mv -f {shlex.quote(part)} {shlex.quote(file)}")
        return file

    async def _read_digest(self, machine: _Machine, file: str) -> str:
        """Return the SHA-256 of a file; empty without a file or a program that computes it."""
        output = await self._run(machine, f"( {sha256_of(shlex.quote(file))} ) 2> /dev/null || true")
        return next(iter(output.split("\n")[-2:]), "")

    def _assign(self) -> None:
        """Assign waiting servers to free slots."""
        down = [f"{host.name}: {host.problem}" for host in self._machines if host.problem is not None]
        for server, remote in self._servers.items():
            if remote.task is not None:
                continue
            able = [
                machine
                for machine in self._machines
                if machine.problem is None and len(machine.used) < machine.slots
            ]
            if not able:
                slots = sum(machine.slots for machine in self._machines if machine.problem is None)
                remote.health = Health("waiting", "; ".join([f"for one of {slots} slots", *down]))
                continue
            machine = min(able, key=lambda machine: len(machine.used) / machine.slots)
            machine.used.add(server)
            remote.health = Health("running")
            remote.task = asyncio.get_running_loop().create_task(self._serve(machine, server, remote))

    async def _serve(self, machine: _Machine, server: int, remote: _Remote) -> None:
        """Run a server until it ends."""
        import asyncssh  # noqa: PLC0415 - optional

        try:
            machine.archive = await self._copy_code(machine)  # the copy may have been changed
            folder = await self._copy_files(machine, server)
            remote.process = await machine.connection.create_process(
                f"sh {shlex.quote(f'{folder}/{_SCRIPT}')}", stderr=asyncssh.STDOUT, errors="replace"
            )
            async for line in remote.process.stdout:
                remote.lines.append(line.rstrip("\n"))
            await remote.process.wait(check=False)
            status = remote.process.exit_status
            how = f"ended with status {status}" if status is not None else "ended with its connection"
            remote.health = Health("ended", f"{how} on {machine.name}")
            if status is None:
                self._mark_unusable(machine, "the connection ended")
        except (OSError, asyncssh.Error, _Unusable) as error:
            words = getattr(error, "reason", "") or str(error)
            remote.health = Health("ended", f"on {machine.name}: {words}")
            self._mark_unusable(machine, words)
        finally:
            machine.used.discard(server)

    def _mark_unusable(self, machine: _Machine, words: str) -> None:
        machine.problem = words
        machine.retry_at = asyncio.get_running_loop().time() + RETRY_S

    async def _copy_files(self, machine: _Machine, server: int) -> str:
        """Copy secrets and the script; as arguments, all users could read its variables."""
        import asyncssh  # noqa: PLC0415 - optional

        folder = str(PurePosixPath(machine.home, self._options.folder, "run", f"{self._token}-{server}"))
        private = asyncssh.SFTPAttrs(permissions=0o600)
        async with _open_sftp(machine) as files:
            await files.makedirs(folder, asyncssh.SFTPAttrs(permissions=0o700), exist_ok=True)
            script = self._format_script(machine, server, folder).encode()
            for name, data in {**self._specification.files(), _SCRIPT: script}.items():
                async with files.open(f"{folder}/{name}", "wb", private) as file:
                    await file.write(data)
        return folder

    def _format_script(self, machine: _Machine, server: int, folder: str) -> str:
        """Format the script that runs a server until it ends or its standard input closes."""
        quoted, option = shlex.quote(folder), self._options.code
        code = None if option is None else shlex.quote(option)
        unpack = []
        if machine.archive is not None:
            # A folder per server, as the simulation may write into it.
            code = f"{quoted}/code"
            assert self._specification.code is not None
            unpack = format_unpack(shlex.quote(machine.archive), self._specification.code.sha256, code)
        return "\n".join(
            [
                f"trap 'rm -rf {quoted}' EXIT",
                "trap '' HUP",
                *unpack,
                *format_setup(self._options, self._specification.variables(folder), code or quoted, code),
                "exec 3<&0",
                f"{format_command(self._options, self._specification, server)} < /dev/null 3<&- &",
                "server=$!",
                "(",
                "  cat <&3",
                "  kill -TERM $server",
                f"  left={10 * GRACE_S:g}",
                "  while kill -0 $server && [ $left -gt 0 ]; do sleep 0.1; left=$((left - 1)); done",
                "  kill -KILL $server",
                ") > /dev/null 2>&1 &",
                "watcher=$!",
                "exec 3<&-",
                "wait $server",
                "status=$?",
                "kill $watcher 2> /dev/null",
                "exit $status",
            ]
        )


async def _wait_until_closed(connection: Any) -> None:  # noqa: ANN401 - of asyncssh
    """Wait until a connection is closed; abort it after a time limit."""
    try:
        await asyncio.wait_for(connection.wait_closed(), GRACE_S)
    except Exception:  # noqa: BLE001 - it may have broken in any way
        connection.abort()


@asynccontextmanager
async def _open_sftp(machine: "_Machine") -> AsyncIterator[Any]:
    """Yield an SFTP client. Raises OSError if the machine has no SFTP."""
    import asyncssh  # noqa: PLC0415 - optional

    try:
        client = await machine.connection.start_sftp_client()
    except (asyncssh.ChannelOpenError, asyncssh.SFTPError) as error:
        raise OSError(
            f"it refuses SFTP, which is needed to copy files ({error.reason}); add 'Subsystem sftp "
            "internal-sftp' to its sshd_config"
        ) from error
    async with client as files:
        yield files


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
