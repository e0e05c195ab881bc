"""`swarmwright transfer` as a program."""

import json
import os
import pty
import subprocess
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, Run, optimize
from tests.conftest import PROGRAM, environment

pytestmark = pytest.mark.slow

NOISY = Experiment.from_mapping(
    {
        "simulation": "minisim",
        "parameters": {"numAgents": 3, "numDefenders": 3, "placement": "random", "speedDefenders": 0.5},
        "method": {"kind": "random_search", "population": 20, "generations": 3},
        "servers": "local",
        "validate": False,
    }
)
SLOWER = ("--vary", "parameters.speedDefenders=0.1..0.3")


@pytest.fixture
def run(tmp_path: Path) -> str:
    optimize(NOISY, out=tmp_path / "run")
    return "run"


def test_it_prints_draws_and_writes_every_episode(program: Any, run: str, tmp_path: Path) -> None:
    (tmp_path / "faster.yaml").write_text("parameters: {speedDefenders: 0.9}\n")
    options = ("--to", "faster.yaml", *SLOWER, "--candidates", "5", "--random", "3", "--seeds", "20")
    result = program("transfer", run, *options, "--out", "loss.png", "--csv", "loss.csv")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.endswith("The table is in loss.csv\nThe figure is in loss.png\n")
    assert result.stdout.count("Rank correlation of the 8 candidates") == 2
    best = Run.open(tmp_path / run).best
    assert f"{best.generation}:{best.candidate}" in [
        line.split()[0] for line in result.stdout.splitlines() if line
    ]
    assert (tmp_path / "loss.png").stat().st_size > 10_000
    assert len((tmp_path / "loss.csv").read_text().splitlines()) == 1 + 2 * 8 * 20
    values = json.loads(program("transfer", run, *options, "--servers", "1", "--json").stdout)
    lost = {one["target"]: one["candidates"][0]["loss"]["mean"] for one in values["runs"]}
    assert lost["faster.yaml"] > 0 > lost["pseudo-reality"]
    for one in lost.values():
        assert f"{one:.4g}" in result.stdout


@pytest.mark.parametrize(
    "command", [("transfer", *SLOWER, "--candidates", "2", "--seeds", "20"), ("evaluate", "--episodes", "20")]
)
def test_a_terminal_shows_how_far_it_is(run: str, tmp_path: Path, command: tuple[str, ...]) -> None:
    ours, theirs = pty.openpty()
    arguments = [*PROGRAM, command[0], run, *command[1:]]
    terminal = {**environment(), "TERM": "xterm", "COLUMNS": "120"}
    process = subprocess.Popen(
        arguments, cwd=tmp_path, env=terminal, stdin=theirs, stdout=theirs, stderr=subprocess.PIPE
    )
    os.close(theirs)
    shown = b""
    try:
        while chunk := os.read(ours, 4096):
            shown += chunk
    except OSError:  # the other end is closed
        pass
    _, error = process.communicate(timeout=20)
    os.close(ours)
    assert (process.returncode, error) == (0, b"")
    assert b"episodes" in shown
    total = 20 if command[0] == "evaluate" else 2 * 2 * 20
    assert f"{total}/{total}".encode() in shown


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "nothing to transfer to: name simulations with --to, or parameters with --vary KEY=LOW..HIGH."),
        (("--vary", "speed"), "--vary speed: write KEY=VALUE"),
        (
            ("--vary", "parameters.speedDefender=0..1"),
            "--vary parameters.speedDefender=0..1: unknown parameter of minisim; did you mean",
        ),
        ((*SLOWER, "--out", "loss.jpg"), "loss.jpg: unknown suffix of a figure; use .png, .svg or .pdf"),
        ((*SLOWER, "--csv", "loss.txt"), "loss.txt: this table ends with .csv"),
        ((*SLOWER, "--out", "nowhere/loss.png"), "there is no folder 'nowhere'"),
        ((*SLOWER, "--csv", "nowhere/loss.csv"), "'nowhere/loss.csv': there is no folder 'nowhere'"),
        (
            (*SLOWER, "--vary", "parameters.speedDefenders=0.5..1"),
            "--vary parameters.speedDefenders=0.5..1: the parameter has two ranges; give one",
        ),
        ((*SLOWER, "--seeds", "1"), "1 is not in the range 2<=x"),
        (("--to", "gazebo"), "unknown simulation 'gazebo'"),
        (("--to", "faster.yml"), "faster.yml: there is no such file"),
        (("--to", "gazebo", "--broker", "mqtt://127.0.0.1:1"), "no broker answers at mqtt://127.0.0.1:1"),
    ],
)
def test_mistakes(program: Any, run: str, arguments: tuple[str, ...], said: str) -> None:
    result = program("transfer", run, *arguments)
    assert result.returncode in {1, 2}
    assert said in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
