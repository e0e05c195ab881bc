"""`swarmwright ui` before it serves anything."""

import webbrowser
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from click.testing import CliRunner

from swarmwright.cli.ui import command
from swarmwright.ui import server

ADDRESS = "http://127.0.0.1:8501/?token=s3cret"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return what browsers are started with, while nothing is served."""
    addresses: list[str] = []

    def serve(_folder: Path, _settings: server.Settings, *, on_ready: Callable[[str], object]) -> None:
        on_ready(ADDRESS)
        for address in addresses:
            page = Path(unquote(urlsplit(address).path))
            assert page.stat().st_mode & 0o777 & ~0o700 == 0 or page.parent.stat().st_mode & 0o777 == 0o700
            assert f"url={ADDRESS}" in page.read_text()

    monkeypatch.setattr(server, "serve", serve)
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    return addresses


def test_the_command_line_of_the_browser_has_no_token(opened: list[str], tmp_path: Path) -> None:
    result = CliRunner().invoke(command, [str(tmp_path), "--open"])
    assert (result.exit_code, ADDRESS in result.output) == (0, True)
    [address] = opened
    assert address.startswith("file:///")
    assert "s3cret" not in address
    assert not Path(unquote(urlsplit(address).path)).parent.exists(), "it is deleted with the window"


def test_a_browser_is_opened_only_on_demand(
    opened: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    assert "Runs below runs: http" in CliRunner().invoke(command, []).output
    assert opened == []


def test_a_missing_folder_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "there is no such folder here" in str(CliRunner().invoke(command, []).exception)
