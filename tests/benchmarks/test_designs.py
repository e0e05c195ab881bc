"""The comparison of designs in the arena, with designs that are much too short."""

import subprocess
import sys
from pathlib import Path

import pytest

from swarmwright import Run


@pytest.mark.timeout(300)
def test_designs_are_made_once_scored_and_drawn(root: Path, tmp_path: Path) -> None:
    command = [
        sys.executable, "-m", "benchmarks.designs", str(tmp_path), "--budget", "1000", "--repetitions", "2",
        "--missions", "lcn",
    ]  # fmt: skip
    first, again = (
        subprocess.run(command, cwd=root, check=True, capture_output=True, text=True).stdout for _ in range(2)
    )
    rows = [line for line in first.splitlines() if line.startswith("| `lcn`")]
    assert [row.split(" | ")[1] for row in rows] == ["EvoStick", "Chocolate"]
    assert [line for line in again.splitlines() if line.startswith("|")][2:] == rows
    assert (tmp_path / "designs-1000.png").stat().st_size > 10_000
    runs = [Run.open(path) for path in sorted(tmp_path.iterdir()) if path.is_dir()]
    assert len({run.digest for run in runs}) == len(runs) == 4
    for run in runs:
        assert run.validation is not None
        assert run.evaluations * run.experiment.ranking.episodes <= 1000
        assert f"fitness={run.validation.best.fitness.mean}" in first
