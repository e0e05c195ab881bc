"""The window in a notebook: a frame that this process serves."""

import http.client
import re
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import swarmwright
from swarmwright import InputError, Run
from swarmwright.ui import NotebookWindow

pytestmark = pytest.mark.timeout(60)


def ask(address: str) -> tuple[int, str, str]:
    """Return status, policy and text."""
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=20)
    connection.request("GET", f"{parts.path}?{parts.query}")
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, answer.getheader("Content-Security-Policy") or "", text


def source(window: NotebookWindow) -> str:
    match = re.search('src="([^"]*)"', window._repr_html_())
    assert match is not None
    return match[1]


@pytest.mark.slow
def test_a_run_has_one_window_that_shows_it_and_changes_nothing(two_runs: Path) -> None:
    run = Run(two_runs / "run-1")
    window = run.ui()
    try:
        assert run.ui() is window
        assert source(window).endswith("/#/run/.")
        base = source(window).split("#")[0]
        status, policy, page = ask(base)
        assert (status, "Swarmwright" in page) == (200, True)
        assert policy.endswith("frame-ancestors http://localhost:* http://127.0.0.1:*")
        assert '"read_only": true' in ask(f"{base}api/window")[2]
        assert ask(window.address)[0] == 303, "the address for a tab has the token, too"
        assert ask(base.split("~")[0])[0] == 401
        assert str(two_runs) in repr(window)
    finally:
        window.close()
    assert repr(window).endswith("closed>")
    again = run.ui()
    try:
        assert again is not window
        assert source(again) != source(window), "each window has a token of its own"
    finally:
        again.close()


@pytest.mark.slow
def test_a_folder_is_shown_below_the_path_of_a_proxy(two_runs: Path) -> None:
    window = swarmwright.ui.show(
        two_runs, frame_ancestors="https://hub.example", base="/user/ada/proxy/{port}/", hosts=["hub.example"]
    )
    try:
        port = urlsplit(window.address).port
        assert re.fullmatch(f"/user/ada/proxy/{port}/~[A-Za-z0-9_-]+/", source(window))
        assert ask(window.address)[1].endswith("frame-ancestors 'self' https://hub.example")
    finally:
        window.close()


def test_wrong_arguments_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"folder: .* is not a folder"):
        swarmwright.ui.show(tmp_path / "missing")
    with pytest.raises(InputError, match="frame_ancestors: 'everybody' is not an origin"):
        swarmwright.ui.show(tmp_path, frame_ancestors="everybody")


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "starlette", None)
    with pytest.raises(InputError, match=r"install it with pip install 'swarmwright\[ui\]'"):
        swarmwright.ui.show(tmp_path)
