"""`--open`: a saved page in a browser, where there is a display."""

import os
import shlex
import signal
import time
from pathlib import Path

import pytest

from swarmwright.cli import _pictures
from swarmwright.cli._main import run as command

EXPERIMENT = "simulation: minisim\nparameters: {maxSteps: 3, stepSize: 20}\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an experiment, on a machine with a display and no browsers but that of `browser`."""
    place = tmp_path / "a folder"
    place.mkdir()
    (place / "x.yaml").write_text(EXPERIMENT)
    monkeypatch.chdir(place)
    monkeypatch.setenv("DISPLAY", ":97")
    monkeypatch.setenv("PATH", str(place))
    for name in ("WAYLAND_DISPLAY", "CI", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    return place


def browser(folder: Path, monkeypatch: pytest.MonkeyPatch, does: str) -> None:
    program = folder / "browser"
    program.write_text(f"#!/bin/sh\necho noise; echo noise >&2\n{does}\n")
    program.chmod(0o700)
    monkeypatch.setenv("BROWSER", f"{shlex.quote(str(program))} %s")


def saved(*more: str) -> int:
    return command(["simulate", "x.yaml", "--save", "x.html", "--open", *more])


def address(folder: Path) -> str:
    return (folder / "x.html").as_uri()


@pytest.mark.slow
def test_a_browser_is_started_without_its_noise(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    browser(folder, monkeypatch, 'echo "$1" > address; echo "TERM=$TERM" > terminal')
    assert saved() == 0
    said = capfd.readouterr()
    assert said.err == ""
    assert said.out.splitlines()[-1] == (
        f"Opening it in the browser. If no window appears: {address(folder)}"
    )
    assert "noise" not in said.out
    assert (folder / "address").read_text() == f"{address(folder)}\n"
    assert (folder / "terminal").read_text() == "TERM=\n", "browsers for text do not take the terminal"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("display", "also", "wanted"),
    [
        ("DISPLAY", {}, True),
        ("WAYLAND_DISPLAY", {"CI": "false"}, True),
        ("DISPLAY", {"CI": "true"}, False),
        ("SSH_CONNECTION", {}, False),
    ],
)
def test_a_browser_needs_a_display_and_a_person(
    display: str,
    also: dict[str, str],
    wanted: bool,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    browser(folder, monkeypatch, ": > started")
    monkeypatch.delenv("DISPLAY")
    for name, value in {display: ":97", **also}.items():
        monkeypatch.setenv(name, value)
    assert saved() == 0
    assert (folder / "started").exists() is wanted
    if not wanted:
        last = capfd.readouterr().out.splitlines()[-1]
        assert last == f"Open it in a browser: {address(folder)}"


@pytest.mark.slow
@pytest.mark.parametrize("does", ["exit 1", None])
def test_no_browser_is_no_failure(
    does: str | None, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    if does:
        browser(folder, monkeypatch, does)
    assert saved() == 0
    said = capfd.readouterr()
    assert said.err == ""
    assert said.out.splitlines()[-1].startswith("Open it in a browser: file:///")


@pytest.mark.slow
def test_a_browser_that_stays_in_the_foreground_is_not_waited_for(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    browser(folder, monkeypatch, "echo $$ > pid; exec /bin/sleep 60")
    monkeypatch.setattr(_pictures, "PATIENCE_S", 1.0)
    begin = time.monotonic()
    assert saved() == 0
    assert time.monotonic() - begin < 30
    assert "Opening it in the browser." in capfd.readouterr().out
    os.kill(int((folder / "pid").read_text()), signal.SIGKILL)


@pytest.mark.usefixtures("folder")
def test_open_is_refused_without_a_file(capfd: pytest.CaptureFixture[str]) -> None:
    assert command(["simulate", "x.yaml", "--open"]) == 2
    assert "--open needs --save; add it" in capfd.readouterr().err


@pytest.mark.slow
def test_json_stays_json(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    browser(folder, monkeypatch, ": > started")
    assert saved("--json") == 0
    assert len(capfd.readouterr().out.splitlines()) == 1
    assert (folder / "started").exists()
