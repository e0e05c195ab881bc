"""Requests that must not reach the application do not."""

import re
from pathlib import Path

import pytest
from starlette.applications import Starlette

from swarmwright.ui.app import create_app
from tests.python.ui.client import HOST, call

TOKEN = "s3cret-token"
COOKIE = {"cookie": f"swarmwright-8501={TOKEN}"}


@pytest.fixture
def app(tmp_path: Path) -> Starlette:
    return create_app(tmp_path, token=TOKEN, port=8501, hosts=["lab.example"])


@pytest.mark.parametrize(
    "target", ["/", "/api/window", "/api/run?run=a", "/api/events", "/replay", "/static/main.js"]
)
def test_nothing_is_shown_without_the_token(app: Starlette, target: str) -> None:
    answer = call(app, target)
    assert answer.status == 401
    assert b"token" in answer.body
    assert "default-src 'none'" in answer.headers["content-security-policy"]


@pytest.mark.parametrize("token", ["", "wrong", TOKEN + "x", TOKEN[:-1], "é" * 9, "x" * 100_000])
def test_other_tokens_are_refused(app: Starlette, token: str) -> None:
    assert call(app, "/", token=token).status == 401
    assert (
        call(app, "/", headers={"authorization": f"Bearer {token}"} if token.isascii() else {}).status == 401
    )
    assert (
        call(app, "/", headers={"cookie": f"swarmwright-8501={token}"} if token.isascii() else {}).status
        == 401
    )


def test_the_printed_address_gives_a_cookie_and_loses_its_token(app: Starlette) -> None:
    answer = call(app, "/", token=TOKEN, filter="a b")
    assert (answer.status, answer.headers["location"]) == (303, "./?filter=a+b")
    cookie = answer.headers["set-cookie"]
    assert re.match(f"swarmwright-8501={TOKEN};", cookie)
    assert {"HttpOnly", "SameSite=strict"} <= set(cookie.split("; "))
    assert call(app, "/api/window", headers=COOKIE).status == 200
    assert call(app, "/api/window", headers={"authorization": f"Bearer {TOKEN}"}).status == 200


@pytest.mark.parametrize(
    "host",
    ["evil.example:8501", "127.0.0.1.evil.example", "", "[::1", "10.0.0.1:8501", "localhost.evil", "\xe9"],
)
def test_other_host_names_are_refused(app: Starlette, host: str) -> None:
    assert call(app, "/api/window", headers={**COOKIE, "host": host}).status == 403


@pytest.mark.parametrize(
    "host", [HOST, "localhost:1", "[::1]:8501", "127.1.2.3", "lab.example", "LAB.example:80"]
)
def test_names_of_its_own_are_not(app: Starlette, host: str) -> None:
    assert call(app, "/api/window", headers={**COOKIE, "host": host}).status == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:8502"},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site", "sec-fetch-mode": "cors"},
    ],
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_pages_of_other_sites_are_refused(app: Starlette, headers: dict[str, str], method: str) -> None:
    assert call(app, "/api/window", method=method, headers={**COOKIE, **headers}).status == 403


def test_a_link_elsewhere_opens_it_but_changes_nothing(app: Starlette) -> None:
    link = {**COOKIE, "sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}
    assert call(app, "/", headers=link).status == 200
    assert call(app, "/api/window", method="POST", headers=link).status == 403


def test_a_read_only_window_refuses_what_changes_something(tmp_path: Path) -> None:
    app = create_app(tmp_path, token=None, read_only=True)
    assert call(app, "/api/window").status == 200
    answer = call(app, "/api/window", method="POST")
    assert answer.status == 405
    assert b"--read-only" in answer.body


@pytest.mark.parametrize(
    "target",
    ["/static/../app.py", "/static/%2e%2e/app.py", "/static//etc/passwd", "/static/vendor", "/api/other"],
)
def test_files_elsewhere_are_not_served(app: Starlette, target: str) -> None:
    assert call(app, target, headers=COOKIE).status == 404
