"""The interface of launchers, which start, check and end simulation servers."""

import gzip
import hashlib
import io
import tarfile
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

from swarmwright import _engine
from swarmwright.common.errors import RunError
from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.servers.broker.credentials import CREDENTIALS

if TYPE_CHECKING:
    from swarmwright import _engine


@dataclass(frozen=True)
class Code:
    """Files of a simulation.

    Attributes:
        digest: SHA-256 of their names and contents, in hexadecimal.
        archive: the files as a gzip-compressed tar archive.
    """

    digest: str
    archive: bytes

    @classmethod
    def from_files(cls, files: Mapping[str, bytes], executable: Collection[str] = ()) -> Self:
        """Pack files, keyed by their path relative to a common folder; equal files give equal bytes.

        executable: paths of programs.
        """
        digest = hashlib.sha256()
        buffer = io.BytesIO()
        with (
            gzip.GzipFile(fileobj=buffer, mode="wb", mtime=0) as compressed,
            tarfile.open(fileobj=compressed, mode="w", format=tarfile.PAX_FORMAT) as archive,
        ):
            for name, data in sorted(files.items()):
                mode = 0o755 if name in executable else 0o644
                head = f"{name}\0{mode:o}\0{len(data)}\0"
                digest.update(head.encode() + data)
                entry = tarfile.TarInfo(name)
                entry.size, entry.mode = len(data), mode
                archive.addfile(entry, io.BytesIO(data))
        return cls(digest.hexdigest(), buffer.getvalue())

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the archive, in hexadecimal, to verify copies."""
        return hashlib.sha256(self.archive).hexdigest()

    def unpack(self, folder: Path) -> None:
        """Extract the files into a folder, which is created. Raises OSError."""
        folder.mkdir(parents=True, exist_ok=True)
        with tarfile.open(fileobj=io.BytesIO(self.archive)) as archive:
            # Python 3.11.2 (Debian 12) lacks the filters of `extractall`.
            for entry in archive:
                path = folder / entry.name
                content = archive.extractfile(entry)
                if content is None or not path.resolve().is_relative_to(folder.resolve()):
                    raise OSError(f"{entry.name}: not a file inside the folder")
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content.read())
                path.chmod(entry.mode & 0o755)


PASSWORD, AUTHORITY, CERTIFICATE, KEY = "password", "ca.pem", "client.pem", "client-key.pem"
"""Names of the servers' files."""
BROKER_TIMEOUT_S = 60.0
"""Seconds after which a server that cannot reach its broker ends."""


@dataclass(frozen=True)
class Specification:
    """Servers of one launcher.

    Attributes:
        simulation: as `swarmwright serve` takes it; a class in a file relative to the folder of the code.
        broker: address as seen from the servers.
        prefix: prefix of all topics.
        step_timeout: seconds, see `swarmwright serve`.
        username: username of their account on the broker; None without accounts.
        password: password of their account. Never put it into arguments of programs, which all users can
            list.
        authority: PEM text of the authority that signed the broker's certificate; None for the system's.
        certificate: PEM text of the client certificate, if the broker requires one.
        key: PEM text of its private key. Never put it into arguments of programs.
        code: code of a custom simulation; None if it is installed on the servers' machines.
        modules: names of the servers' Python behaviours and conditions, as `swarmwright serve` takes them;
            files as in `simulation`.
        sources: files on this machine, path -> SHA-256, which a local server must find unchanged.
        environment: further variables.
        label: name of jobs, such as `swarmwright-minisim`.
    """

    simulation: str
    broker: str
    prefix: str = ""
    step_timeout: float = _engine.TIMEOUTS["step"]
    username: str | None = None
    password: str | None = field(default=None, repr=False)
    authority: str | None = field(default=None, repr=False)
    certificate: str | None = field(default=None, repr=False)
    key: str | None = field(default=None, repr=False)
    code: Code | None = field(default=None, repr=False)
    modules: Sequence[str] = ()
    sources: Mapping[str, str] = field(default_factory=dict)
    environment: Mapping[str, str] = field(default_factory=dict)
    label: str = "swarmwright"

    def arguments(self, server: int) -> list[str]:
        """Return the arguments of the program `swarmwright` (or `python -m swarmwright`) for one server.

        Its working folder is that of the code.
        """
        return [
            "serve",
            self.simulation,
            *("--broker", self.broker),
            *("--id", str(server)),
            *("--step-timeout", f"{self.step_timeout:g}"),
            *("--wait", f"{BROKER_TIMEOUT_S:g}"),
            *("--broker-timeout", f"{BROKER_TIMEOUT_S:g}"),
            # Even if empty, as the environment may set another.
            *("--prefix", self.prefix),
            *(word for name in self.modules for word in ("--modules", name)),
        ]

    def variables(self, folder: str, code: str | None = None) -> dict[str, str]:
        """Return environment variables without secrets.

        folder: of `files` on the server's machine. code: folder of the code there, if any.
        """
        variables = dict(self.environment)
        if code is not None:
            existing = variables.get("PYTHONPATH")
            variables["PYTHONPATH"] = f"{code}:{existing}" if existing else code
        if self.username is not None:
            variables["SWARMWRIGHT_USERNAME"] = self.username
        if self.password is not None:
            variables["SWARMWRIGHT_PASSWORD_FILE"] = str(PurePosixPath(folder, PASSWORD))
        if self.authority is not None:
            variables["SWARMWRIGHT_CA_FILE"] = str(PurePosixPath(folder, AUTHORITY))
        if self.certificate is not None:
            variables["SWARMWRIGHT_CERTIFICATE_FILE"] = str(PurePosixPath(folder, CERTIFICATE))
        if self.key is not None:
            variables["SWARMWRIGHT_KEY_FILE"] = str(PurePosixPath(folder, KEY))
        return variables

    def child_variables(self, folder: str, code: str | None = None) -> dict[str, str]:
        """Return the variables for a process that inherits an environment, see `variables`.

        Unused credentials are empty, which counts as unset, because inherited ones belong to another client.
        """
        return {**dict.fromkeys(CREDENTIALS, ""), **self.variables(folder, code)}

    def files(self) -> dict[str, bytes]:
        """Return the files that servers need beside the code, by name, for mode 0600."""
        texts = {AUTHORITY: self.authority, CERTIFICATE: self.certificate, KEY: self.key}
        if self.password is not None:
            texts[PASSWORD] = f"{self.password}\n"
        return {name: text.encode() for name, text in texts.items() if text is not None}


State = Literal["waiting", "running", "ended"]


class LauncherError(RunError):
    """A launcher failed; the message quotes the system behind it."""


@dataclass(frozen=True)
class Health:
    """The state of one server, as known to its launcher."""

    state: State
    """"waiting" (queued or starting), "running" (its program was started) or "ended"."""
    reason: str = ""
    """The system's message, why the server waits or how it ended; may be empty."""


class Launcher(ABC):
    """Base class of launchers, which start, check and end simulation servers.

    An object belongs to one entry of an experiment's `servers` for the duration of a run. Servers are
    identified by ids that are unique on the broker. A server is `swarmwright serve` with
    `Specification.arguments`, `Specification.variables` as environment, and `Specification.files`. Methods
    are called by one thread at a time; none except `close` may take longer than `start_timeout`.

    Args:
        options: options of the entry.
        specification: specification of the servers.
    """

    kind: ClassVar[str]
    """Name of the launcher in experiments."""
    options_model: ClassVar[type[LauncherOptions]]
    """Model of its options; `launcher` is a Literal with the name as default."""
    is_here: ClassVar[bool] = False
    """Whether servers run on this machine and can use a broker on its loopback address."""
    interval: ClassVar[float] = 1.0
    """Seconds between two calls of `health`."""

    def __init__(self, options: Any, specification: Specification) -> None:  # noqa: ANN401 - each has its own
        self.options = options
        self.specification = specification

    def open(self) -> None:  # noqa: B027 - most need nothing
        """Prepare and check what is needed: programs, connections, accounts.

        Raises:
            LauncherError: the launcher cannot be used; with the system's message.
        """

    @abstractmethod
    def start(self, servers: Sequence[int]) -> None:
        """Begin to start servers with these new ids, and return without waiting.

        Raises:
            LauncherError: none of them could be started.
        """

    @abstractmethod
    def health(self) -> Mapping[int, Health]:
        """Return the state of each started server that was not stopped.

        Raises:
            LauncherError: the states are unknown at present; servers may still be running.
        """

    @abstractmethod
    def stop(self, servers: Sequence[int]) -> None:
        """End servers in any state; running ones get SIGTERM first.

        Raises:
            LauncherError: some could not be ended.
        """

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:  # noqa: ARG002 - for those that have logs
        """Return the last known output lines of a server, also after its end."""
        return ()

    def log_to(self, file: Path) -> None:  # noqa: B027 - most have their logs elsewhere
        """Write further output of servers to a file, created with the first line."""

    @abstractmethod
    def close(self) -> None:
        """End all servers and remove all processes, jobs and files. May be called repeatedly."""

    def attach(self, pool: "_engine.Pool | None", servers: Sequence[int]) -> None:  # noqa: B027 - see below
        """Report the ends of processes to a pool, on its thread; None to stop.

        Only for launchers that watch processes on this machine. servers: all ids that may be used.
        """
