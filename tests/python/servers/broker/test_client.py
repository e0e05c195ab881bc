"""What the client says about credentials that cannot be used."""

import subprocess
from pathlib import Path

import pytest

from swarmwright.common.errors import InputError
from swarmwright.servers.broker.client import Client

pytestmark = pytest.mark.slow

CERTIFICATE, KEY = "SWARMWRIGHT_CERTIFICATE_FILE", "SWARMWRIGHT_KEY_FILE"


def made(folder: Path, name: str) -> dict[str, str]:
    """Make a certificate that is signed by its own key; the variables that name both."""
    own = {CERTIFICATE: str(folder / f"{name}.pem"), KEY: str(folder / f"{name}-key.pem")}
    algorithm = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-noenc")
    files = ("-keyout", own[KEY], "-out", own[CERTIFICATE])
    command = ["openssl", "req", "-x509", *algorithm, "-subj", f"/CN={name}", "-days", "2", *files]
    subprocess.run(command, check=True, capture_output=True)
    return own


def hidden(own: dict[str, str]) -> dict[str, str]:
    """Encrypt the key."""
    file = f"{own[KEY]}.hidden"
    command = ["openssl", "pkcs8", "-topk8", "-in", own[KEY], "-out", file, "-passout", "pass:word"]
    subprocess.run(command, check=True, capture_output=True)
    return {**own, KEY: file}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("no key", (f"{CERTIFICATE} is set but {KEY} is not", "needs both")),
        ("no certificate", (f"{KEY} is set but {CERTIFICATE} is not", "needs both")),
        ("a passphrase", (KEY, "own-key.pem.hidden", "has a passphrase", "openssl pkey")),
        ("another key", (f"{CERTIFICATE} ", f"{KEY} ", "other-key.pem", "mismatch")),
        ("no file", (CERTIFICATE, "none.pem", "No such file")),
    ],
)
def test_client_certificates_that_cannot_be_used_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: str, words: tuple[str, ...]
) -> None:
    own = made(tmp_path, "own")
    given = {
        "no key": lambda: {CERTIFICATE: own[CERTIFICATE]},
        "no certificate": lambda: {KEY: own[KEY]},
        "a passphrase": lambda: hidden(own),
        "another key": lambda: {**own, KEY: made(tmp_path, "other")[KEY]},
        "no file": lambda: {**own, CERTIFICATE: "none.pem"},
    }[wrong]()
    for name in ("SWARMWRIGHT_CA_FILE", CERTIFICATE, KEY):
        monkeypatch.setenv(name, given.get(name, ""))
    with pytest.raises(InputError) as refused:
        Client("mqtts://localhost:1", "", ())
    for word in words:
        assert word in str(refused.value)
