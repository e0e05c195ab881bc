"""The comparison of designs in the arena, with designs that are much too short."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.designs import COMPARED, Design
from benchmarks.kept import read
from swarmwright import Run


@pytest.mark.timeout(300)
def test_designs_are_made_once_scored_and_drawn(root: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.designs", str(tmp_path)]
    made = [*command, "--budget", "1000", "--repetitions", "2", "--missions", "lcn"]
    scores = tmp_path / "designs-1000.json"
    first, again, shown = (
        subprocess.run(one, cwd=root, check=True, capture_output=True, text=True).stdout
        for one in (made, made, [*command, "--draw", str(scores)])
    )
    rows = [line for line in first.splitlines() if line.startswith("| `lcn`")]
    assert [row.split(" | ")[1] for row in rows] == ["EvoStick", "Chocolate"]
    assert "Design(" in first
    assert "Design(" not in again, "what is done is not repeated"
    assert again == shown
    assert again.splitlines()[2:] == rows
    designs = list(read(scores, Design))
    assert [one.key for one in designs] == [
        ("lcn", kind, repetition) for repetition in (1, 2) for kind in COMPARED
    ]
    assert (tmp_path / "designs-1000.png").stat().st_size > 10_000
    runs = [Run.open(path) for path in sorted(tmp_path.iterdir()) if path.is_dir()]
    assert len({run.digest for run in runs}) == len(runs) == 4
    for run in runs:
        assert run.validation is not None
        assert run.evaluations * run.experiment.ranking.episodes <= 1000
        scores_of_run = (run.validation.best.recorded, run.validation.best.fitness.mean)
        assert any((one.recorded, one.fitness) == pytest.approx(scores_of_run, rel=1e-5) for one in designs)
