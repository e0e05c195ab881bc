"""`swarmwright ui` before it serves anything."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from swarmwright.cli import ui
from swarmwright.cli.ui import command
from swarmwright.ui import server

ADDRESS = "http://127.0.0.1:8501/?token=s3cret"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Return the pages that browsers are started with, while nothing is served."""
    pages: list[Path] = []

    def serve(_folder: Path, _settings: server.Settings, *, on_ready: Callable[[str], object]) -> None:
        on_ready(ADDRESS)
        for page in pages:
            assert page.stat().st_mode & 0o777 & ~0o700 == 0 or page.parent.stat().st_mode & 0o777 == 0o700
            assert f"url={ADDRESS}" in page.read_text()

    monkeypatch.setattr(server, "serve", serve)
    monkeypatch.setattr(ui, "open_in_browser", pages.append)
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setenv("DISPLAY", ":7")
    return pages


def test_the_command_line_of_the_browser_has_no_token(opened: list[Path], tmp_path: Path) -> None:
    result = CliRunner().invoke(command, [str(tmp_path)])
    assert (result.exit_code, ADDRESS in result.output) == (0, True)
    [page] = opened
    assert "s3cret" not in str(page)
    assert not page.parent.exists(), "it is deleted with the window"


@pytest.mark.parametrize("why", ["--no-browser", "no display", "CI"])
def test_no_browser_is_opened(
    why: str, opened: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if why == "no display":
        monkeypatch.delenv("DISPLAY")
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    if why == "CI":
        monkeypatch.setenv("CI", "true")
    result = CliRunner().invoke(command, [str(tmp_path), *[why][: why.startswith("--")]])
    assert (result.exit_code, ADDRESS in result.output, opened) == (0, True, [])


def test_the_default_folder_is_made(
    opened: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "Runs below runs: http" in CliRunner().invoke(command, ["--no-browser"]).output
    assert (tmp_path / "runs").is_dir()
    (tmp_path / "runs").rmdir()
    (tmp_path / "runs").write_text("")
    result = CliRunner().invoke(command, ["--no-browser"])
    assert "runs: the folder for runs cannot be made (File exists); name another" in str(result.exception)
    assert opened == []
