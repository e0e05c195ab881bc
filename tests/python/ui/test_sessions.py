"""The password: who is let in, how often it is tried, and which files are trusted with it."""

from pathlib import Path
from urllib.parse import urlencode

import pytest
from starlette.applications import Starlette

from swarmwright import InputError
from swarmwright.ui.app import create_app
from swarmwright.ui.sessions import (
    ALL_ATTEMPTS,
    CLIENT_ATTEMPTS,
    CLIENT_PAUSE_S,
    MOST_CLIENTS,
    MOST_SESSIONS,
    SESSION_S,
    Sessions,
    TooManyAttemptsError,
    network_of,
    read_password_file,
)
from tests.python.ui.client import HOST, Answer, call

PASSWORD = "correct hörse"


class Clock:
    now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def sessions(clock: Clock) -> Sessions:
    return Sessions(PASSWORD, clock)


def test_a_session_ends_after_a_week(sessions: Sessions, clock: Clock) -> None:
    session = sessions.open("10.0.0.1", PASSWORD)
    assert session is not None
    assert sessions.is_open(session)
    assert not sessions.is_open(session[:-1])
    assert not sessions.is_open("")
    clock.now += SESSION_S
    assert not sessions.is_open(session)


def test_an_address_that_guesses_is_slowed_down_and_others_are_not(sessions: Sessions, clock: Clock) -> None:
    for _ in range(CLIENT_ATTEMPTS):
        assert sessions.open("10.0.0.1", "wrong") is None
    with pytest.raises(TooManyAttemptsError) as refusal:
        sessions.open("10.0.0.1", PASSWORD)
    assert 1 <= refusal.value.seconds <= CLIENT_PAUSE_S
    assert sessions.open("10.0.0.2", PASSWORD) is not None
    clock.now += refusal.value.seconds
    assert sessions.open("10.0.0.1", PASSWORD) is not None


def test_many_addresses_together_are_slowed_down_too(sessions: Sessions, clock: Clock) -> None:
    for number in range(ALL_ATTEMPTS):
        assert sessions.open(f"10.0.0.{number}", "wrong") is None
    with pytest.raises(TooManyAttemptsError):
        sessions.open("10.0.1.1", "wrong")
    a_day = 0
    for _ in range(24 * 60):
        clock.now += 60.0
        for number in range(20):
            try:
                sessions.open(f"10.1.{number}.1", "wrong")
                a_day += 1
            except TooManyAttemptsError:
                pass
    assert a_day < 15_000
    assert len(sessions._clients) <= MOST_CLIENTS


def test_memory_is_bounded(sessions: Sessions) -> None:
    first = sessions.open("10.0.0.1", PASSWORD)
    for _ in range(MOST_SESSIONS):
        sessions.open("10.0.0.1", PASSWORD)
    assert len(sessions._opened) == MOST_SESSIONS
    assert first is not None
    assert not sessions.is_open(first)


def test_a_person_with_a_network_of_ipv6_has_one_address() -> None:
    assert network_of("2001:db8::1") == network_of("2001:db8:0:0:ffff::2")
    assert network_of("2001:db8::1") != network_of("2001:db8:0:1::1")
    assert network_of("::ffff:10.0.0.1") != network_of("::ffff:10.0.0.2")
    assert network_of("testclient") == "testclient"


@pytest.mark.parametrize(
    ("content", "mode", "message"),
    [
        (b"correct horse\n", 0o640, "other users can read or change it; restrict it with chmod 600"),
        (b"correct horse\n", 0o604, "other users can read or change it"),
        (b"short\n", 0o600, "at least 8 characters"),
        (b"\nlonger password\n", 0o600, "at least 8 characters"),
        (b"\xff" * 20, 0o600, "is not UTF-8 text"),
    ],
)
def test_files_that_cannot_be_trusted_are_refused(
    tmp_path: Path, content: bytes, mode: int, message: str
) -> None:
    file = tmp_path / "password"
    file.write_bytes(content)
    file.chmod(mode)
    with pytest.raises(InputError, match=message):
        read_password_file(file)


def test_the_first_line_of_a_private_file_is_the_password(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_text(f"{PASSWORD}\r\nmore\n")
    file.chmod(0o600)
    assert read_password_file(file) == PASSWORD
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_password_file(tmp_path / "missing")
    with pytest.raises(InputError, match="is not a regular file"):
        read_password_file(Path("/dev/zero"))


@pytest.fixture
def app(tmp_path: Path, sessions: Sessions) -> Starlette:
    return create_app(tmp_path, token=None, sessions=sessions, port=8501, read_only=True)


def log_in(app: Starlette, password: str, **headers: str) -> Answer:
    body = urlencode({"password": password}).encode()
    return call(app, "/login", method="POST", body=body, headers=headers)


def test_the_password_opens_the_window(app: Starlette) -> None:
    page = call(app, "/")
    assert page.status == 401
    assert b'type="password"' in page.body
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script" not in policy
    assert "frame-ancestors 'none'" in policy
    assert call(app, "/api/window").status == 401
    assert call(app, "/?token=").status == 401
    wrong = log_in(app, "battery <b>")
    assert (wrong.status, "set-cookie" in wrong.headers) == (401, False)
    right = log_in(app, PASSWORD)
    assert (right.status, right.headers["location"]) == (303, "./")
    name, *attributes = right.headers["set-cookie"].split("; ")
    assert {"HttpOnly", "SameSite=strict"} <= set(attributes)
    assert not any(attribute.lower().startswith("path") for attribute in attributes)
    assert call(app, "/api/window", headers={"cookie": name}).status == 200
    assert call(app, "/login", headers={"cookie": name}).headers["location"] == "./"


def test_guesses_are_refused_with_the_time_to_wait(app: Starlette) -> None:
    for _ in range(CLIENT_ATTEMPTS):
        assert log_in(app, "wrong password").status == 401
    refused = log_in(app, PASSWORD)
    assert refused.status == 429
    assert int(refused.headers["retry-after"]) > 0
    assert "set-cookie" not in refused.headers


@pytest.mark.parametrize(
    "body", [b"", b"password", b"password=a&password=b", b"x" * 100_000, b"\xff", b"a=1&b=2&c=3&d=4"]
)
def test_forms_that_are_none_open_nothing(app: Starlette, body: bytes) -> None:
    answer = call(app, "/login", method="POST", body=body)
    assert answer.status in {400, 401}
    assert "set-cookie" not in answer.headers


def test_a_form_of_another_site_opens_nothing(app: Starlette) -> None:
    assert log_in(app, PASSWORD, origin="https://evil.example").status == 403
    assert log_in(app, PASSWORD, **{"sec-fetch-site": "cross-site"}).status == 403
    assert log_in(app, PASSWORD, origin=f"http://{HOST}").status == 303
