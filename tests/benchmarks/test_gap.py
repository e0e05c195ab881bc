"""What designs lose in other simulators: what is measured, and the page with the figures."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.designs import DESIGNS
from benchmarks.gap import ELSEWHERE, Loss, table
from benchmarks.kept import read
from swarmwright import Run, post_evaluate


def run(root: Path, *arguments: str | Path) -> str:
    command = [sys.executable, "-m", "benchmarks.gap", *map(str, arguments)]
    return subprocess.run(command, cwd=root, check=True, capture_output=True, text=True).stdout


@pytest.mark.timeout(400)
def test_designs_are_made_once_and_evaluated_in_the_arena_and_elsewhere(root: Path, tmp_path: Path) -> None:
    enki = next(place for place in ELSEWHERE if place.name == "Enki")
    why = enki.missing()
    if why is not None:
        pytest.skip(f"Enki: {why}")
    asked = ["--budget", "1000", "--repetitions", "1", "--missions", "lcn", "--simulators", "Enki"]
    first = run(root, tmp_path, *asked, "--seeds", "2")
    losses = list(read(tmp_path / "gap.json", Loss))
    assert [(one.mission, one.design, one.repetition, one.simulator, one.seeds) for one in losses] == [
        ("lcn", design, 1, "Enki", 2) for design in DESIGNS
    ]
    for one in losses:
        design = Run.open(tmp_path / f"lcn-{one.design.lower()}-1000-{one.repetition}")
        assert design.evaluations * design.experiment.ranking.episodes <= 1000
        here = post_evaluate(design, episodes=2)
        assert one.arena == pytest.approx(here.fitness.mean, rel=1e-5)
        assert math.isfinite(one.there)
    again = run(root, tmp_path, *asked, "--seeds", "2")
    assert "Loss(" in first
    assert "Loss(" not in again, "what is done is not repeated"
    assert again.splitlines() == [line for line in first.splitlines() if line.startswith("|")]
    assert run(root, tmp_path, "--draw", tmp_path / "gap.json") == again
    assert (tmp_path / "gap.png").stat().st_size > 10_000


def test_the_table_has_medians_of_fitness_and_of_what_is_lost() -> None:
    losses = [
        Loss("aac", design, repetition, simulator, 10, 100 + repetition, 100 + (1 - lost) * repetition)
        for design, lost in (("EvoStick", 20), ("Chocolate", 1))
        for simulator in ("Enki", "Stage")
        for repetition in (1, 2, 3)
    ]
    lines = list(table(losses))
    assert lines[0] == "| mission | design | arena | Enki | Stage |"
    assert lines[2] == "| `aac` | EvoStick | 102 | 62 (40) | 62 (40) |"
    assert lines[3] == "| `aac` | Chocolate | 102 | 100 (2) | 100 (2) |"
    assert lines[4] == "| `aac` | p | | 0.05 | 0.05 |"


def test_the_page_has_what_was_measured(root: Path) -> None:
    losses = list(read(root / "benchmarks" / "data" / "gap.json", Loss))
    page = (root / "docs" / "studies" / "designs.md").read_text("utf-8")
    assert {one.design for one in losses} == set(DESIGNS)
    for line in table(losses):
        assert line in page
