"""Requests that must not reach the application do not."""

import re
from pathlib import Path

import pytest
from starlette.applications import Starlette
from starlette.routing import Mount

from swarmwright import InputError
from swarmwright.ui.app import create_app
from swarmwright.ui.guard import derive_pass
from tests.python.ui.client import HOST, call

TOKEN = "s3cret-token"
PASS = derive_pass(TOKEN, "swarmwright-8501")
COOKIE = {"cookie": f"swarmwright-8501={PASS}"}


@pytest.fixture
def app(tmp_path: Path) -> Starlette:
    return create_app(tmp_path, token=TOKEN, port=8501, hosts=["lab.example"])


@pytest.mark.parametrize(
    "target", ["/", "/api/window", "/api/run?run=a", "/api/events", "/player", "/static/main.js"]
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
    assert re.match(f"swarmwright-8501={PASS};", cookie)
    assert {"HttpOnly", "SameSite=strict"} <= set(cookie.split("; "))
    assert call(app, "/api/window", headers=COOKIE).status == 200
    assert call(app, "/api/window", headers={"authorization": f"Bearer {TOKEN}"}).status == 200


def test_the_cookie_which_all_ports_see_opens_nothing_else(app: Starlette) -> None:
    assert TOKEN not in call(app, "/", token=TOKEN).headers["set-cookie"]
    assert call(app, "/", token=PASS).status == 401
    assert call(app, f"/~{PASS}/").status == 401
    assert call(app, "/", headers={"authorization": f"Bearer {PASS}"}).status == 401
    assert call(app, "/", headers={"cookie": f"swarmwright-8501={TOKEN}"}).status == 401
    assert derive_pass(TOKEN, "swarmwright-8502") != PASS


def test_cookies_of_other_programs_do_no_harm(app: Starlette) -> None:
    cookies = f'a={{"b": [1, "c"]}}; é; {COOKIE["cookie"]}; d="'.encode().decode("latin-1")
    assert call(app, "/api/window", headers={"cookie": cookies}).status == 200


def test_after_a_link_of_another_site_a_page_goes_on_since_a_redirect_gets_no_cookie(app: Starlette) -> None:
    link = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}
    answer = call(app, "/", headers=link, token=TOKEN, filter='"><b>')
    assert (answer.status, "location" in answer.headers) == (200, False)
    assert answer.headers["set-cookie"].startswith(COOKIE["cookie"])
    assert b'content="0; url=./?filter=%22%3E%3Cb%3E"' in answer.body
    assert TOKEN.encode() not in answer.body


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


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("origin", "http://["),
        ("origin", "\xff"),
        ("cookie", "swarmwright-8501"),
        ("cookie", 'swarmwright-8501="\\777'),
        ("cookie", "=;=;,;" * 5000),
        ("authorization", "Bearer"),
        ("authorization", "Basic " + "A" * 50_000),
        ("content-length", "-1"),
        ("sec-fetch-site", "\x00"),
    ],
)
def test_malformed_headers_are_refused(app: Starlette, name: str, value: str) -> None:
    assert call(app, "/api/window", headers={name: value}).status in {401, 403}


@pytest.mark.parametrize("path", ["/static/\x00", "/\x00", "/static/a\x7f"])
def test_paths_with_control_characters_lead_nowhere(app: Starlette, path: str) -> None:
    assert call(app, path, headers=COOKIE).status == 404


def test_a_token_in_the_path_needs_no_cookie(app: Starlette) -> None:
    assert call(app, f"/~{TOKEN}/api/window").status == 200
    assert call(app, f"/~{TOKEN}/static/main.js").status == 200
    assert call(app, f"/~{TOKEN}/").status == 200
    for path in ("/~", "/~/", f"/~{TOKEN}", f"/~{TOKEN}x/api/window", "/~wrong/api/window", "/~wrong/"):
        assert call(app, path).status == 401
    evil = {"origin": "http://evil.example"}
    assert call(app, f"/~{TOKEN}/api/window", headers=evil).status == 403


def test_read_only_holds_for_paths_with_a_token(tmp_path: Path) -> None:
    app = create_app(tmp_path, token=TOKEN, read_only=True)
    assert call(app, f"/~{TOKEN}/api/start", method="POST").status == 405


def test_only_chosen_pages_show_it_in_a_frame(app: Starlette, tmp_path: Path) -> None:
    assert "frame-ancestors 'none'" in call(app, "/", headers=COOKIE).headers["content-security-policy"]
    framed = create_app(tmp_path, token=None, ancestors=["http://localhost:*", "https://hub.example"])
    policy = call(framed, "/").headers["content-security-policy"]
    assert policy.endswith("frame-ancestors http://localhost:* https://hub.example")
    replay = call(framed, "/player").headers["content-security-policy"]
    assert "frame-ancestors 'self' http://localhost:* https://hub.example" in replay
    assert "sandbox allow-scripts;" in replay


@pytest.mark.parametrize(
    "origin", ["*", "hub.example", "http://a; script-src *", "http://a b", "", "http://"]
)
def test_origins_that_are_none_are_refused(tmp_path: Path, origin: str) -> None:
    with pytest.raises(InputError, match="is not an origin"):
        create_app(tmp_path, token=None, ancestors=[origin])


def test_it_works_below_the_path_of_another_application(tmp_path: Path) -> None:
    app = Starlette(routes=[Mount("/swarm", create_app(tmp_path, token=TOKEN, port=8501, read_only=True))])
    answer = call(app, "/swarm/", token=TOKEN)
    assert (answer.status, answer.headers["location"]) == (303, "./")
    assert "path=" not in answer.headers["set-cookie"].lower(), "the browser takes that of the page"
    assert call(app, "/swarm/api/window", headers=COOKIE).status == 200
    assert call(app, f"/swarm/~{TOKEN}/api/window").status == 200
    assert call(app, "/swarm/api/window").status == 401
    assert call(app, "/swarm/api/start", method="POST", headers=COOKIE).status == 405
    page = call(app, "/swarm/", headers=COOKIE).body.decode()
    assert not re.search(r'(?:href|src)="/', page), "all addresses are relative"


@pytest.mark.parametrize(
    ("name", "host"),
    [
        ("LAB.example", "lab.example:8501"),
        ("münchen.example", "xn--mnchen-3ya.example"),
        ("10.0.0.1", "10.0.0.1:8501"),
        ("[2001:db8:0::1]", "[2001:db8::1]:8501"),
        ("my_host", "my_host"),
    ],
)
def test_names_are_those_that_browsers_send(tmp_path: Path, name: str, host: str) -> None:
    app = create_app(tmp_path, token=None, hosts=[name])
    assert call(app, "/api/window", headers={"host": host}).status == 200


@pytest.mark.parametrize(
    "name", ["", "https://lab.example", "lab.example:8501", "lab.example/swarm", "*", "a b", "a..b", "x\0"]
)
def test_names_that_would_never_be_sent_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"host name .* must be a name alone"):
        create_app(tmp_path, token=None, hosts=[name])


@pytest.mark.parametrize("host", ["10.0.0.1:8501", "[2001:db8::1]"])
def test_addresses_are_names_of_a_public_window(tmp_path: Path, host: str) -> None:
    app = create_app(tmp_path, token=None, is_public=True)
    assert call(app, "/api/window", headers={"host": host}).status == 200
    assert call(app, "/api/window", headers={"host": "evil.example"}).status == 403
