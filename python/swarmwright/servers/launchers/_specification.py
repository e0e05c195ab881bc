"""Specification of the servers of a launcher: arguments, environment and files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath

from swarmwright import _engine
from swarmwright.servers.broker.credentials import CREDENTIALS
from swarmwright.servers.launchers._code import Code

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
