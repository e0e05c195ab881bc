"""The comparison of losses of messages, with runs that are much too short."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.timeout(300)
def test_losses_are_compared_and_drawn(root: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.radio", str(tmp_path / "runs"), "--repetitions", "2"]
    command += ["--generations", "1", "--picture", str(tmp_path / "radio.png")]
    done = subprocess.run(
        command,
        cwd=root,
        check=False,
        env={**os.environ, "SWARMWRIGHT_PLOT": "0"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["0.0", "0.3", "0.6", "0.8", "0.9"]
    assert (tmp_path / "radio.png").stat().st_size > 10_000
