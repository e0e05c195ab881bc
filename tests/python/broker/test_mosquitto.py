"""The ready-made Mosquitto configuration; tests/system/test_security.py runs brokers with it."""

import errno
import os
import re
import stat
from pathlib import Path

import pytest
from cryptography import x509

from swarmwright.broker import mosquitto
from swarmwright.broker.mosquitto import access_rules, accounts, hosts, write_configuration
from swarmwright.core.errors import InputError


def write(folder: Path, prefixes: tuple[str, ...] = ()) -> Path:
    write_configuration(folder, given=["broker.example", "10.0.0.7"], port=8883, prefixes=prefixes)
    return folder


def test_what_is_secret_is_the_owners_alone(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = write(tmp_path / "deep" / "lab")
    finally:
        os.umask(before)
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()}
    public = {"mosquitto.conf", "ca.pem", "broker.pem", "tool.env", "server.env", "watcher.env"}
    secret = {"acl", "passwords", "broker-key.pem", "ca-key.pem"}
    secret |= {f"{role}.password" for role in ("tool", "server", "watcher")}
    assert modes == {**dict.fromkeys(public, 0o644), **dict.fromkeys(secret, 0o600)}
    assert stat.S_IMODE(folder.stat().st_mode) & 0o066 == 0
    words = {path.read_text() for path in folder.glob("*.password")}
    assert len(words) == 3
    assert all(re.fullmatch(r"[\w-]{32}\n", word) for word in words)
    elsewhere = "".join(path.read_text() for path in folder.iterdir() if path.suffix != ".password")
    assert not any(word.strip() in elsewhere for word in words)


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    folder = write(tmp_path / "lab")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match=r"ca-key\.pem.*nothing is overwritten"):
        write(folder)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "acl").write_text("mine\n")
    with pytest.raises(InputError, match="acl"):
        write(tmp_path / "other")
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    assert [path.name for path in (tmp_path / "other").iterdir()] == ["acl"]


def test_the_certificate_is_for_the_hosts_that_were_given_and_loopback(tmp_path: Path) -> None:
    folder = write(tmp_path)
    authority, certificate = (
        x509.load_pem_x509_certificate((folder / name).read_bytes()) for name in ("ca.pem", "broker.pem")
    )
    certificate.verify_directly_issued_by(authority)
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["broker.example", "localhost"]
    addresses = [str(address) for address in names.get_values_for_type(x509.IPAddress)]
    assert addresses == ["10.0.0.7", "127.0.0.1", "::1"]
    assert certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value != []
    constraints = authority.extensions.get_extension_for_class(x509.BasicConstraints).value
    assert constraints.ca
    assert constraints.path_length == 0
    assert 729 <= (certificate.not_valid_after_utc - certificate.not_valid_before_utc).days <= 730


@pytest.mark.parametrize("host", ["", "0.0.0.0", "::", "a b", "mqtts://x", "x:8883", "-x", "a..b"])
def test_hosts_that_are_none(host: str) -> None:
    with pytest.raises(InputError):
        hosts([host])


def test_prefixes_have_accounts_of_their_own() -> None:
    made = accounts(["lab/a", "lab/b/", "lab/a"])
    assert [account.user for account in made][:4] == [
        "lab-a-tool", "lab-a-server", "lab-a-watcher", "lab-b-tool",
    ]  # fmt: skip
    assert "user lab-b-tool\ntopic write lab/b/discovery\n" in access_rules(made)
    assert [account.user for account in accounts([])] == ["tool", "server", "watcher"]


@pytest.mark.parametrize("prefixes", [["a/b", "a-b"], ["a\nuser tool"], [" a"]])
def test_prefixes_that_would_mix_accounts_up(prefixes: list[str]) -> None:
    with pytest.raises(InputError):
        accounts(prefixes)


def test_nothing_is_left_of_one_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.txt").write_text("kept")
    written: list[Path] = []
    original = mosquitto._write

    def write_some(path: Path, text: str, mode: int) -> None:
        if len(written) == 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        written.append(path)
        original(path, text, mode)

    monkeypatch.setattr(mosquitto, "_write", write_some)
    with pytest.raises(InputError, match="cannot be written: No space left on device"):
        write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    monkeypatch.undo()
    write(tmp_path)


def test_the_longest_message_of_the_protocol_fits_and_the_limit_is_announced(tmp_path: Path) -> None:
    """`message_size_limit` would drop larger messages without telling anybody."""
    lines = (write(tmp_path) / "mosquitto.conf").read_text().splitlines()
    (limit,) = (int(line.split()[1]) for line in lines if line.startswith("max_packet_size "))
    assert limit >= (64 << 20) + (1 << 16)
    assert not any(line.startswith("message_size_limit") for line in lines)
