"""What a launcher starts: the program, its arguments, its environment and its files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath

from swarmwright import _engine
from swarmwright.servers.broker.credentials import CREDENTIALS
from swarmwright.servers.launchers._code import Code

PASSWORD, AUTHORITY, CERTIFICATE, KEY = "password", "ca.pem", "client.pem", "client-key.pem"
"""Names of files that servers read."""
BROKER_TIMEOUT_S = 60.0
"""Seconds after which a server ends that cannot reach its broker: what started it is gone."""


@dataclass(frozen=True)
class Specification:
    """Servers of one launcher.

    Attributes:
        simulation: as `swarmwright serve` takes it; a class in a file relative to the folder of the code.
        broker: address as the servers reach it.
        prefix: of all topics.
        step_timeout: seconds, see `swarmwright serve`.
        username: of their account on the broker; None: there are no accounts.
        password: of their account. Never put it into arguments of programs, which all users can list.
        authority: PEM text of the authority that signed the broker's certificate; None: the system's.
        certificate: PEM text of the client certificate that the broker requires; None: it requires none.
        key: PEM text of its private key. Never put it into arguments of programs.
        code: of a custom simulation; None for one that is installed where the servers are.
        modules: names of the behaviours and conditions in Python that the servers have, as
            `swarmwright serve` takes them; of classes in files as `simulation`.
        sources: files on this machine, path -> SHA-256, which a server that runs here must find unchanged.
        environment: further variables.
        label: what jobs are called, such as `swarmwright-minisim`.

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
            # Also where there is none: the environment there may name another.
            *("--prefix", self.prefix),
            *(word for name in self.modules for word in ("--modules", name)),
        ]

    def variables(self, folder: str, code: str | None = None) -> dict[str, str]:
        """Return environment variables; no secret is among them.

        folder: of `files` on the server's machine. code: folder of the code there, if there is any.
        """
        found = dict(self.environment)
        if code is not None:
            others = found.get("PYTHONPATH")
            found["PYTHONPATH"] = f"{code}:{others}" if others else code
        if self.username is not None:
            found["SWARMWRIGHT_USERNAME"] = self.username
        if self.password is not None:
            found["SWARMWRIGHT_PASSWORD_FILE"] = str(PurePosixPath(folder, PASSWORD))
        if self.authority is not None:
            found["SWARMWRIGHT_CA_FILE"] = str(PurePosixPath(folder, AUTHORITY))
        if self.certificate is not None:
            found["SWARMWRIGHT_CERTIFICATE_FILE"] = str(PurePosixPath(folder, CERTIFICATE))
        if self.key is not None:
            found["SWARMWRIGHT_KEY_FILE"] = str(PurePosixPath(folder, KEY))
        return found

    def child_variables(self, folder: str, code: str | None = None) -> dict[str, str]:
        """Return the variables for a process that inherits an environment, see `variables`.

        Credentials that the servers do not have are empty, which counts as unset: those that are inherited
        belong to another client, and a password in a variable has priority over one in a file.
        """
        return {**dict.fromkeys(CREDENTIALS, ""), **self.variables(folder, code)}

    def files(self) -> dict[str, bytes]:
        """Return the files that servers need beside the code, by name; for the user alone (mode 0600)."""
        texts = {AUTHORITY: self.authority, CERTIFICATE: self.certificate, KEY: self.key}
        if self.password is not None:
            texts[PASSWORD] = f"{self.password}\n"
        return {name: text.encode() for name, text in texts.items() if text is not None}
