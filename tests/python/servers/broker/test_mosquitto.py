"""The ready-made Mosquitto configuration; tests/system/test_security.py runs brokers with it."""

import errno
import os
import pwd
import re
import stat
import subprocess
from pathlib import Path

import pytest
from cryptography import x509

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.servers.broker import mosquitto
from swarmwright.servers.broker.mosquitto import (
    add_accounts,
    can_add,
    format_access_rules,
    is_authority_certificate,
    list_hosts,
    make_accounts,
    set_password,
    write_configuration,
)


def write(folder: Path, prefixes: tuple[str, ...] = ()) -> Path:
    write_configuration(folder, hosts=["broker.example", "10.0.0.7"], port=8883, prefixes=prefixes)
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


@pytest.mark.slow
def test_nothing_is_overwritten(tmp_path: Path) -> None:
    folder = write(tmp_path / "lab")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match=r"ca-key\.pem.*are not overwritten"):
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
        list_hosts([host])


def test_prefixes_have_accounts_of_their_own() -> None:
    made = make_accounts(["lab/a", "lab/b/", "lab/a"])
    assert [account.user for account in made][:4] == [
        "lab-a-tool", "lab-a-server", "lab-a-watcher", "lab-b-tool",
    ]  # fmt: skip
    assert "user lab-b-tool\ntopic write lab/b/discovery\n" in format_access_rules(made)
    assert [account.user for account in make_accounts([])] == ["tool", "server", "watcher"]


@pytest.mark.parametrize("prefixes", [["a/b", "a-b"], ["a\nuser tool"], [" a"]])
def test_prefixes_that_would_mix_accounts_up(prefixes: list[str]) -> None:
    with pytest.raises(InputError):
        make_accounts(prefixes)


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


@pytest.mark.parametrize(("is_there", "mode"), [(False, 0o711), (True, 0o775)])
def test_only_a_new_folder_is_opened_to_mosquitto(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_there: bool, mode: int
) -> None:
    """As root, whose files Mosquitto's user reads; a folder of the user's keeps its mode."""
    owned: list[str] = []
    monkeypatch.setattr(os, "getuid", lambda: 0)
    monkeypatch.setattr(os, "chown", lambda path, *_of: owned.append(Path(path).name))
    own = pwd.getpwuid(os.geteuid())
    monkeypatch.setattr(pwd, "getpwnam", lambda _name: own)
    folder = tmp_path / "lab"
    if is_there:
        folder.mkdir()
        folder.chmod(mode)
    write(folder)
    assert stat.S_IMODE(folder.stat().st_mode) == mode
    assert sorted(owned) == ["acl", "broker-key.pem", "passwords"]


@pytest.mark.slow
def test_a_folder_that_mosquitto_cannot_enter_is_warned_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    own = pwd.getpwuid(os.geteuid())
    other = pwd.struct_passwd(("mosquitto", "x", 54321, 54321, "", "/", "/bin/false"))
    monkeypatch.setattr(os, "getuid", lambda: 0)
    monkeypatch.setattr(os, "chown", lambda *_: None)
    monkeypatch.setattr(os, "getgrouplist", lambda *_: [54321])
    folder = tmp_path / "my lab"
    folder.mkdir(mode=0o700)
    monkeypatch.setattr(pwd, "getpwnam", lambda _name: own)
    write(folder)
    assert not caplog.messages
    monkeypatch.setattr(pwd, "getpwnam", lambda _name: other)
    for path in list(folder.iterdir()):
        path.unlink()
    write(folder)
    assert (
        f"{folder}: the user mosquitto cannot enter this folder; run chmod o+x '{folder}'" in caplog.messages
    )
    caplog.clear()
    folder.chmod(0o711)
    for path in list(folder.iterdir()):
        path.unlink()
    write(folder)
    assert not [message for message in caplog.messages if message.startswith(f"{folder}:")]


@pytest.mark.slow
@pytest.mark.parametrize(("prefix", "stem"), [("lab/1", "lab-1-"), ("", "")])
def test_the_variables_of_an_account_have_its_prefix(tmp_path: Path, prefix: str, stem: str) -> None:
    folder = write(tmp_path, (prefix,))
    for role in ("tool", "server", "watcher"):
        words = f'. ./{stem}{role}.env && printf %s "$SWARMWRIGHT_PREFIX"'
        environment = {"SWARMWRIGHT_PREFIX": "another"}
        said = subprocess.run(
            ["sh", "-c", words], cwd=folder, env=environment, capture_output=True, check=True
        )
        assert said.stdout.decode() == prefix


def test_accounts_of_another_prefix_are_added(tmp_path: Path) -> None:
    folder = write(tmp_path / "lab", ("lab1",))
    (folder / "acl").write_text((folder / "acl").read_text().rstrip("\n"))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert can_add(folder)
    made = add_accounts(folder, ["lab2", "lab/3"], 1000)
    assert made == make_accounts(["lab2", "lab/3"])
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    changed = {name for name in before if after[name] != before[name]}
    assert changed == {"acl", "passwords"}
    assert all(after[name].startswith(before[name]) for name in changed)
    assert after["acl"].decode() == format_access_rules(make_accounts(["lab1", "lab2", "lab/3"]))
    users = [line.partition(":")[0] for line in after["passwords"].decode().splitlines()]
    assert users == [account.user for account in make_accounts(["lab1", "lab2", "lab/3"])]
    new = {f"{account.user}.{ending}" for account in made for ending in ("password", "env")}
    assert set(after) - set(before) == new
    assert stat.S_IMODE((folder / "lab2-tool.password").stat().st_mode) == 0o600
    assert after["lab2-tool.env"] == after["lab1-tool.env"].replace(b"lab1", b"lab2")


@pytest.mark.parametrize("prefixes", [["lab1"], ["lab2", "lab1"], [""]])
def test_accounts_that_are_there_are_not_added(tmp_path: Path, prefixes: list[str]) -> None:
    folder = write(tmp_path / "lab", ("lab1", ""))
    for path in folder.glob("lab1-*"):  # handed over, for example
        if path.suffix == ".password":
            path.unlink()
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match=r"tool.* are not overwritten"):
        add_accounts(folder, prefixes, 1000)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_nothing_is_added_where_a_file_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write(tmp_path / "lab", ("lab1",))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    monkeypatch.setattr(mosquitto, "_format_rules", lambda _: "\ud800")  # after the passwords
    with pytest.raises(InputError, match="accounts cannot be added"):
        add_accounts(folder, ["lab2"], 1000)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    for path in folder.glob("*.env"):
        path.unlink()
    with pytest.raises(InputError, match="address is unknown"):
        add_accounts(folder, ["lab2"], 1000)


def test_nothing_is_added_to_another_configuration(tmp_path: Path) -> None:
    assert not can_add(tmp_path)
    (tmp_path / "mosquitto.conf").write_text("listener 1883\n")
    assert not can_add(tmp_path)


def test_a_certificate_of_an_authority_is_told_from_one_that_it_signed(tmp_path: Path) -> None:
    authority, _, certificate, _ = _engine.certificates(["localhost"], 2)
    chain = tmp_path / "chain.pem"
    chain.write_text(certificate + authority)
    assert not is_authority_certificate(chain)
    chain.write_text(authority)
    assert is_authority_certificate(chain)


@pytest.mark.parametrize("content", [b"", b"-----BEGIN CERTIFICATE-----\nAAAA", b"\xff\xfe"])
def test_what_is_not_pem_is_not_judged(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "chain.pem"
    file.write_bytes(content)
    assert not is_authority_certificate(file)
    assert not is_authority_certificate(tmp_path / "none.pem")


def test_users_are_added_and_changed(tmp_path: Path) -> None:
    path = tmp_path / "users"
    assert set_password(path, "ada", "correct horse")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    path.write_text(path.read_text() + "# guests\nbob:$7$1$c2FsdA==$aGFzaA==")  # no line break at the end
    path.chmod(0o640)
    first = path.read_text()
    assert set_password(path, "eve", "battery staple")
    assert path.read_text().startswith(first + "\neve:$argon2id$v=19$m=19456,t=2,p=1$")
    assert not set_password(path, "ada", "battery staple")
    lines = path.read_text().splitlines()
    assert [line.split(":")[0] for line in lines] == ["ada", "# guests", "bob", "eve"]
    assert lines[0] != first.splitlines()[0]
    assert "correct" not in path.read_text()
    assert "battery" not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o640, "as its owner had set it"
    assert [file.name for file in tmp_path.iterdir()] == ["users"]


@pytest.mark.parametrize(
    ("user", "password"), [("", "x"), ("a:b", "x"), ("#a", "x"), ("a b", "x"), ("a\n", "x"), ("a", "")]
)
def test_what_cannot_stand_in_the_file(tmp_path: Path, user: str, password: str) -> None:
    with pytest.raises(InputError):
        set_password(tmp_path / "users", user, password)
    assert not list(tmp_path.iterdir())


def test_files_that_cannot_be_changed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        set_password(tmp_path / "nowhere" / "users", "ada", "x")
    (tmp_path / "users").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        set_password(tmp_path / "users", "ada", "x")
    assert (tmp_path / "users").read_bytes() == b"\xff\xfe"
