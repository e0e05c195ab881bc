"""A real Mosquitto with the configuration that `swarmwright broker --init` makes."""

import datetime as dt
import os
import shutil
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from tests.conftest import PROGRAM, environment, free_port
from tests.system.brokers import reachable

DAY = dt.timedelta(days=1)


class ReadyMade:
    """The folder, and a broker that uses it: `mosquitto`, or the embedded one with the same files.

    mutual: clients need a certificate of the broker's authority, too.
    """

    def __init__(
        self, folder: Path, kind: str = "mosquitto", prefixes: Sequence[str] = (), *, mutual: bool = False
    ) -> None:
        self.folder = folder
        self.kind = kind
        self.port = free_port()
        self.log = folder.parent / f"{folder.name}.log"
        options = ["--init", folder, "--host", "localhost", "--port", self.port]
        options += [part for prefix in prefixes for part in ("--prefix", prefix)]
        subprocess.run(
            [*PROGRAM, "broker", *map(str, options)], check=True, capture_output=True, env=environment()
        )
        if os.getuid() == 0:  # it could not read this folder as anybody else
            with (folder / "mosquitto.conf").open("a") as file:
                file.write("user root\n")
        if mutual:
            with (folder / "mosquitto.conf").open("a") as file:
                file.write("require_certificate true\n")
        self._mutual = mutual
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> "ReadyMade":
        """Start the broker and wait until it listens."""
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                self._command(), stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment()
            )
        deadline = time.monotonic() + 15
        while not reachable(self.port):
            assert self._process.poll() is None, self.log.read_text()
            assert time.monotonic() < deadline, self.log.read_text()
            time.sleep(0.02)
        return self

    def stop(self) -> None:
        """End it."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait(10)
            self._process = None

    def _command(self) -> list[str]:
        if self.kind == "mosquitto":
            binary = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
            assert binary, "mosquitto is missing; `make test` installs it"
            return [binary, "-v", "-c", str(self.folder / "mosquitto.conf")]
        files = {"users": "passwords", "access": "acl", "certificate": "broker.pem", "key": "broker-key.pem"}
        if self._mutual:
            files["client-ca"] = "ca.pem"
        options = [
            part for option, name in files.items() for part in (f"--{option}", str(self.folder / name))
        ]
        return [*PROGRAM, "broker", "--port", str(self.port), *options]

    @property
    def authority(self) -> Path:
        return self.folder / "ca.pem"

    def url(self, host: str = "localhost") -> str:
        return f"mqtts://{host}:{self.port}"

    def password(self, user: str) -> str:
        return (self.folder / f"{user}.password").read_text().strip()

    def variables(self, user: str) -> Mapping[str, str]:
        """What the user's file of shell variables sets, as a shell understands it."""
        shown = subprocess.run(
            ["bash", "-c", f". '{self.folder}/{user}.env' && env -0"],
            check=True,
            capture_output=True,
            text=True,
        )
        pairs = (pair.partition("=") for pair in shown.stdout.split("\0"))
        return {name: value for name, _, value in pairs if name.startswith("SWARMWRIGHT_")}

    def certify(self, *hosts: str, begins: dt.timedelta = -DAY, ends: dt.timedelta = DAY) -> None:
        """Exchange the broker's certificate for another of the same authority; the term counts from now."""
        key = serialization.load_pem_private_key((self.folder / "broker-key.pem").read_bytes(), None)
        assert isinstance(key, ec.EllipticCurvePrivateKey)
        self._sign("broker.pem", key, hosts, begins, ends)

    def client(self, name: str, *, begins: dt.timedelta = -DAY, ends: dt.timedelta = DAY) -> dict[str, str]:
        """Make a certificate for a client; the variables that name it and its key."""
        key = ec.generate_private_key(ec.SECP256R1())
        private = key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
        (self.folder / f"{name}-client-key.pem").write_bytes(private)
        self._sign(f"{name}-client.pem", key, (name,), begins, ends)
        return {
            "SWARMWRIGHT_CERTIFICATE_FILE": str(self.folder / f"{name}-client.pem"),
            "SWARMWRIGHT_KEY_FILE": str(self.folder / f"{name}-client-key.pem"),
        }

    def _sign(
        self,
        file: str,
        key: ec.EllipticCurvePrivateKey,
        names: Sequence[str],
        begins: dt.timedelta,
        ends: dt.timedelta,
    ) -> None:
        now = dt.datetime.now(dt.UTC)
        signer = serialization.load_pem_private_key((self.folder / "ca-key.pem").read_bytes(), None)
        assert isinstance(signer, ec.EllipticCurvePrivateKey)
        made = (
            x509.CertificateBuilder()
            .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, names[0])]))
            .issuer_name(x509.load_pem_x509_certificate(self.authority.read_bytes()).subject)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now + begins)
            .not_valid_after(now + ends)
            .add_extension(
                x509.SubjectAlternativeName([x509.DNSName(name) for name in names]), critical=False
            )
            .sign(signer, hashes.SHA256())
        )
        (self.folder / file).write_bytes(made.public_bytes(serialization.Encoding.PEM))
