"""The server of the window under attack, and beyond loopback."""

import contextlib
import errno
import http.client
import os
import socket
import ssl
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import swarmwright
from swarmwright import InputError, _engine
from swarmwright.ui import protocol, server
from swarmwright.ui.server import Settings, Window, check_exposure, listen, read_token
from tests.python.records import EXPERIMENT
from tests.python.ui.client import call

TOKEN = "s3cret-token"
PASSWORD = "correct horse"


@contextlib.contextmanager
def serving(folder: Path, **options: object) -> Iterator[Window]:
    window = Window(folder, Settings(port=0, token=TOKEN, **options))  # type: ignore[arg-type]
    thread = threading.Thread(target=window.run)
    thread.start()
    try:
        yield window
    finally:
        window.end()
        thread.join(45)
        assert not thread.is_alive()


def ask(window: Window, path: str, headers: dict[str, str] | None = None) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", window.port, timeout=20)
    try:
        connection.request("GET", path, headers=headers or {})
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    authority, _, certificate, key = _engine.certificates(["localhost", "127.0.0.1"], 2)
    names = {"ca": authority, "certificate": certificate, "key": key, "password": f"{PASSWORD}\n"}
    for name, text in names.items():
        (tmp_path / name).touch(0o600)
        (tmp_path / name).write_text(text)
    return {name: tmp_path / name for name in names}


def test_other_machines_need_a_password_and_tls(files: dict[str, Path]) -> None:
    with pytest.raises(InputError, match="--password-file FILE and --certificate FILE and --key FILE"):
        check_exposure(Settings(host="0.0.0.0"))
    with pytest.raises(InputError, match=r"add --certificate FILE and --key FILE, or leave --host out"):
        check_exposure(Settings(host="::", password_file=files["password"]))
    with pytest.raises(InputError, match="--password-file"):
        check_exposure(Settings(host="lab", certificate=files["certificate"], key=files["key"]))
    with pytest.raises(InputError, match="--key FILE is missing"):
        check_exposure(Settings(certificate=files["certificate"]))
    with pytest.raises(InputError, match="cannot be used"):
        check_exposure(Settings(certificate=files["key"], key=files["certificate"]))
    for host in ("127.0.0.1", "127.0.0.2", "::1", "localhost"):
        check_exposure(Settings(host=host))
    check_exposure(
        Settings(
            host="0.0.0.0",
            password_file=files["password"],
            certificate=files["certificate"],
            key=files["key"],
        )
    )


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "localhost", "::1", "0.0.0.0", "::", ""])
@pytest.mark.parametrize("names", [(), ("lab.example",)])
def test_the_printed_address_is_one_that_is_answered(
    tmp_path: Path, files: dict[str, Path], host: str, names: tuple[str, ...]
) -> None:
    secure = {"password_file": files["password"], "certificate": files["certificate"], "key": files["key"]}
    window = Window(tmp_path, Settings(host=host, port=0, hosts=names, **secure))  # type: ignore[arg-type]
    window._listener.close()
    netloc = urlsplit(window.address).netloc
    answer = call(window._server.config.app, "/", headers={"host": netloc})  # type: ignore[arg-type]
    assert (answer.status, b'type="password"' in answer.body) == (401, True), netloc
    if names and host in {"0.0.0.0", "::", ""}:
        assert netloc == f"lab.example:{window.port}"


def test_the_token_is_kept_for_this_user_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "new" / "state"))
    token = read_token()
    assert read_token() == token
    file = tmp_path / "new" / "state" / "swarmwright" / "ui-token"
    for path, mode in ((file, 0o600), *((parent, 0o700) for parent in file.parents[:3])):
        assert stat.S_IMODE(path.stat().st_mode) == mode, path
    assert [*file.parent.iterdir()] == [file]


@pytest.mark.parametrize("fault", ["empty", "short", "wrong", "readable", "foreign", "link", "pipe"])
def test_a_token_that_others_may_know_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    former = read_token()
    file = tmp_path / "swarmwright" / "ui-token"
    user = os.getuid()
    if fault in {"link", "pipe"}:
        file.rename(tmp_path / "elsewhere")
        file.symlink_to(tmp_path / "elsewhere") if fault == "link" else os.mkfifo(file, 0o600)
    elif fault == "readable":
        file.chmod(0o640)
    elif fault == "foreign":
        monkeypatch.setattr("os.getuid", lambda: user + 1)
    else:
        file.write_text({"empty": "", "short": "abc", "wrong": "a/b?" * 10}[fault])
    token = read_token()
    assert token != former
    assert len(token) == len(former)
    monkeypatch.setattr("os.getuid", lambda: user)
    assert (read_token(), stat.S_IMODE(file.lstat().st_mode)) == (token, 0o600)


def test_a_token_that_cannot_be_kept_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "swarmwright" / "ui-token").mkdir(parents=True)
    assert read_token() != read_token()
    assert "ui-token: cannot be written: Is a directory; this address is valid until" in caplog.text


def test_why_it_cannot_listen_is_told_with_the_option_that_helps(monkeypatch: pytest.MonkeyPatch) -> None:
    with listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"--port {port}: is taken; choose another port"):
            listen("127.0.0.1", port)
        monkeypatch.setattr(server, "PORT", port)
        with listen("127.0.0.1", None) as following:
            assert port < following.getsockname()[1] < port + server.ATTEMPTS
        monkeypatch.setattr(server, "ATTEMPTS", 1)
        with pytest.raises(InputError, match=r"ports .* are taken; choose another port with --port"):
            listen("127.0.0.1", None)
    with pytest.raises(InputError, match=r"--host 192\.0\.2\.1: is not an address of this machine"):
        listen("192.0.2.1", None)
    for name in ("nowhere.invalid", "localhost:8501", "a..b", "x" * 300):
        with pytest.raises(InputError, match=r"--host '.*: is not known"):
            listen(name, 0)
    denied = PermissionError(errno.EACCES, "Permission denied")
    monkeypatch.setattr("socket.socket.bind", lambda *_: (_ for _ in ()).throw(denied))
    with pytest.raises(InputError, match="--port 80: this user may not listen there; choose one from 1024"):
        listen("127.0.0.1", 80)


@pytest.mark.slow
def test_the_password_is_asked_for_by_tls_and_its_cookie_is_secure(
    tmp_path: Path, files: dict[str, Path]
) -> None:
    options = {
        "host": "0.0.0.0",
        "password_file": files["password"],
        "certificate": files["certificate"],
        "key": files["key"],
    }
    with serving(tmp_path, **options) as window:
        assert window.address.startswith("https://")
        assert "token" not in window.address
        context = ssl.create_default_context(cafile=str(files["ca"]))
        connection = http.client.HTTPSConnection("localhost", window.port, timeout=20, context=context)
        connection.request("GET", "/")
        answer = connection.getresponse()
        assert (answer.status, b'type="password"' in answer.read()) == (401, True)
        form = {"Content-Type": "application/x-www-form-urlencoded"}
        connection.request("POST", "/login", f"password={PASSWORD.replace(' ', '+')}", form)
        answer = connection.getresponse()
        answer.read()
        cookie = answer.getheader("Set-Cookie") or ""
        assert {"HttpOnly", "SameSite=strict", "Secure"} <= set(cookie.split("; "))
        connection.request("GET", "/api/window", headers={"Cookie": cookie.split(";")[0]})
        assert connection.getresponse().status == 200
        connection.close()


@pytest.mark.slow
def test_connections_that_ask_nothing_do_not_keep_others_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(protocol, "PATIENCE_S", 0.5)
    with serving(tmp_path) as window, contextlib.ExitStack() as stack:
        idle = [stack.enter_context(socket.create_connection(("127.0.0.1", window.port))) for _ in range(200)]
        for connection in idle[::2]:
            connection.sendall(b"GET / HTTP/1.1\r\nHost: local")
        assert ask(window, f"/~{TOKEN}/api/window")[0] == 200
        for connection in idle:
            connection.settimeout(20)
            assert connection.recv(1) == b"", "they are closed"


@pytest.mark.slow
def test_a_client_that_reads_nothing_costs_no_memory(tmp_path: Path) -> None:
    swarmwright.optimize(EXPERIMENT, servers="in-process", seed=1, out=tmp_path / "run")
    request = f"GET /~{TOKEN}/static/vendor/uPlot.esm.js HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
    events = f"GET /~{TOKEN}/api/events HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
    with serving(tmp_path) as window, contextlib.ExitStack() as stack:
        assert ask(window, f"/~{TOKEN}/api/window")[0] == 200
        before = resident_bytes()
        for number in range(60):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", window.port)))
            connection.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                for _ in range(2000):  # one after the other, none of whose answers is read
                    connection.sendall(events if number % 2 else request)
        time.sleep(1.0)  # the server may take what it likes
        assert ask(window, f"/~{TOKEN}/api/window")[0] == 200
        assert resident_bytes() - before < 100 << 20


@pytest.mark.slow
@pytest.mark.parametrize(
    "request_bytes",
    [
        b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 1_000_000,
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 100_000,
        b"GET / HTTP/9.9\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\x00" * 100,
        b"GET /\xff\xfe HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        b"POST /api/start HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: upgrade\r\nUpgrade: websocket\r\n\r\n",
        b"POST /api/start HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999999\r\n\r\n"
        + b"x" * 1_000_000,
    ],
)
def test_requests_that_are_none_are_refused(tmp_path: Path, request_bytes: bytes) -> None:
    with serving(tmp_path) as window:
        with socket.create_connection(("127.0.0.1", window.port), timeout=20) as connection:
            with contextlib.suppress(OSError):  # it may hang up in the middle
                connection.sendall(request_bytes)
            with contextlib.suppress(OSError):
                assert connection.recv(100).split()[1:2] in ([b"400"], [b"401"], [b"403"], [b"431"], [])
        assert ask(window, f"/~{TOKEN}/api/window")[0] == 200
