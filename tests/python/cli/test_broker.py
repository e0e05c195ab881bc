"""`swarmwright broker`: who is let in, and the files that it writes."""

import os
import pty
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import PROGRAM, environment
from tests.python.cli.test_services import events


def add_user(folder: Path, file: str, name: str, password: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [*PROGRAM, "broker", "--add-user", file, name],
        cwd=folder,
        env=environment(),
        input=password,
        text=True,
        capture_output=True,
        timeout=20,
        check=False,
    )


def test_only_those_with_the_password_are_let_in(start: Any, program: Any, tmp_path: Path) -> None:
    added = add_user(tmp_path, "users.txt", "lab", "correct horse\n")
    assert (added.returncode, added.stdout) == (0, "users.txt: lab added\n")
    (tmp_path / "secret").write_text("correct horse\n")
    (listening,) = events(start("broker", "--port", "0", "--users", "users.txt", "--json"), "listening")
    url = listening["url"]
    without = program("servers", "--broker", url)
    assert without.returncode == 1
    assert "SWARMWRIGHT_PASSWORD" in without.stderr
    lab = {"SWARMWRIGHT_USERNAME": "lab"}
    wrong = program("servers", "--broker", url, env={**lab, "SWARMWRIGHT_PASSWORD": "battery"})
    assert wrong.returncode == 1
    assert "battery" not in wrong.stderr
    right = {**lab, "SWARMWRIGHT_PASSWORD_FILE": str(tmp_path / "secret")}
    assert program("servers", "--broker", url, env=right).returncode == 0


def test_a_password_that_can_be_read_is_refused(program: Any, tmp_path: Path) -> None:
    (tmp_path / "users.txt").write_text("# ours\nlab:correct horse\n")
    result = program("broker", "--port", "0", "--users", "users.txt")
    assert result.returncode == 1
    for word in ("users.txt", "line 2", "--add-user"):
        assert word in result.stderr
    assert "correct horse" not in result.stderr


def test_a_password_typed_on_a_terminal_is_not_shown(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [*PROGRAM, "broker", "--add-user", "users.txt", "ada"]
    process = subprocess.Popen(
        command,
        cwd=tmp_path,
        env=environment(),
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
    )
    os.close(theirs)
    shown = b""
    for prompt in (b"Password of ada", b"Repeat"):
        deadline = time.monotonic() + 20
        while prompt not in shown and time.monotonic() < deadline:
            shown += os.read(ours, 1024)
        time.sleep(0.1)
        os.write(ours, b"correct horse\n")
    while b"added" not in shown:
        shown += os.read(ours, 1024)
    assert process.wait(20) == 0
    os.close(ours)
    assert b"correct horse" not in shown
    assert (tmp_path / "users.txt").read_text().startswith("ada:$argon2id$")


@pytest.mark.parametrize("password", ["", "\n"])
def test_no_password_is_none(tmp_path: Path, password: str) -> None:
    result = add_user(tmp_path, "users.txt", "ada", password)
    assert result.returncode == 2
    assert "standard input" in result.stderr
    assert not list(tmp_path.iterdir())


def test_what_to_do_next_are_three_commands(program: Any, tmp_path: Path) -> None:
    made = program("broker", "--init", "my lab", "--host", "broker.example", "--prefix", "a/b")
    assert made.returncode == 0
    commands = [line for line in made.stdout.splitlines() if line.startswith("  ")]
    assert commands == [
        "  mosquitto -c 'my lab/mosquitto.conf'",
        "  . 'my lab/a-b-server.env' && swarmwright serve minisim --prefix a/b",
        "  . 'my lab/a-b-tool.env' && swarmwright optimize EXPERIMENT.yaml",
    ]
    again = program("broker", "--init", "my lab", "--host", "broker.example", "--prefix", "a/b")
    assert again.returncode != 0
    assert "nothing is overwritten" in again.stderr
    for path in (tmp_path / "my lab").glob("*.password"):
        assert path.read_text().strip() not in made.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--host", "0.0.0.0", "--users", "f"], ["--certificate", "read along"]),
        (["--host", "0.0.0.0", "--certificate", "f", "--key", "f"], ["--users", "without a password"]),
        (["--access", "f"], ["--users"]),
        (["--prefix", "a"], ["--init"]),
        (["--host", "127.0.0.1", "--host", "127.0.0.2"], ["one address"]),
        (["--init", "x", "--users", "f"], ["starts no broker", "--users"]),
        (["--init", "x", "--add-user", "f", "ada"], ["--add-user"]),
        (["--init", "x", "--port", "0"], ["8883"]),
        (["--add-user", "f", "ada", "--key", "f"], ["--key"]),
    ],
)
def test_what_does_not_go_together(
    program: Any, tmp_path: Path, arguments: list[str], words: list[str]
) -> None:
    (tmp_path / "f").write_text("")
    result = program("broker", *arguments)
    assert result.returncode == 2
    for word in words:
        assert word.lower() in result.stderr.lower()
    assert [path.name for path in tmp_path.iterdir()] == ["f"]
