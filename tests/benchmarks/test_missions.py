"""One mission, many simulators: what is measured, what is skipped, and the page with the figures."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from benchmarks.kept import read
from benchmarks.missions import CONTROLLERS, FIRST_SEED, Cell, paired, speeds, table
from benchmarks.places import PLACES
from swarmwright import Run, post_evaluate

SIMULATORS = "arena,Enki,MuJoCo,Stage,ARGoS"
"""All but Gazebo, which takes minutes."""


def run(root: Path, module: str, *arguments: str | Path) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", f"benchmarks.{module}", *map(str, arguments)]
    return subprocess.run(command, cwd=root, check=True, capture_output=True, text=True)


@pytest.mark.timeout(400)
def test_controllers_are_designed_once_and_evaluated_in_all_simulators(root: Path, tmp_path: Path) -> None:
    done = run(
        root, "missions", tmp_path, "--budget", "1000", "--seeds", "3", "--missions", "homing",
        "--simulators", SIMULATORS,
    )  # fmt: skip
    cells = list(read(tmp_path / "missions.json", Cell))
    here = [place.name for place in PLACES if place.name in SIMULATORS.split(",") and place.missing() is None]
    assert [(cell.simulator, cell.controller) for cell in cells] == [
        (name, controller) for name in here for controller in CONTROLLERS
    ]
    for place in PLACES:
        skipped = f"{place.name} is skipped: " in done.stderr
        assert skipped == (place.name in SIMULATORS.split(",") and place.name not in here)
    for cell in cells:
        assert len(cell.fitness) == 3
        assert all(0 <= one <= 20 and one == int(one) for one in cell.fitness), "robots on the spot"
    # The arena's are what it gives to anybody.
    designed = Run.open(tmp_path / "homing-evostick-1000")
    again = post_evaluate(designed, episodes=3, seed=FIRST_SEED)
    assert tuple(again.episodes.tolist()) == cells[0].fitness
    drawn = run(root, "missions", tmp_path, "--draw", tmp_path / "missions.json")
    assert drawn.stdout == done.stdout
    assert re.search(r"^\| `homing` \| EvoStick \| ", done.stdout, re.MULTILINE)
    assert (tmp_path / "missions.png").stat().st_size > 10_000


@pytest.mark.timeout(200)
def test_an_episode_is_drawn_side_by_side(root: Path, tmp_path: Path) -> None:
    arguments = ["--budget", "1000", "--simulators", "arena,Enki,MuJoCo", "--times", "0,10,30,60"]
    done = run(root, "pictures", tmp_path, *arguments)
    designed = Run.open(tmp_path / "emergency_exit-evostick-1000")
    expected = post_evaluate(designed, episodes=1, seed=FIRST_SEED).episodes[0]
    assert f"arena: fitness {expected:.4g}\n" in done.stdout
    here = [place.name for place in PLACES[:3] if place.missing() is None]
    assert [line.split(":")[0] for line in done.stdout.splitlines()] == here
    with Image.open(tmp_path / "simulators.png") as picture:
        width, height = picture.size
    assert 1.5 < width / (height / len(here)) / 2.5 < 4, "a row of four pictures for each"


def test_unknown_names_are_refused(root: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.missions", str(tmp_path), "--simulators", "arena,Stge"]
    refused = subprocess.run(command, cwd=root, check=False, capture_output=True, text=True)
    assert refused.returncode == 1
    assert "unknown simulator 'Stge'; available: arena, Enki, MuJoCo, " in refused.stderr


def test_the_page_has_what_was_measured(root: Path) -> None:
    cells = list(read(root / "benchmarks" / "data" / "missions.json", Cell))
    page = (root / "docs" / "studies" / "one-mission.md").read_text("utf-8")
    assert {cell.simulator for cell in cells} == {place.name for place in PLACES}
    for line in (*speeds(cells), *table(cells)):
        assert line in page


def test_differences_are_paired_by_seed_and_corrected_for_all_comparisons() -> None:
    arena = (1.0, 5.0, 2.0, 9.0, 4.0, 7.0)

    def cells(shift: float, comparisons: int) -> list[Cell]:
        there = tuple(one + shift + (0.01 if place % 2 else -0.01) for place, one in enumerate(arena))
        found = [Cell("homing", "EvoStick", "arena", arena, 1.0, 1.0)]
        found += [
            Cell("homing", "EvoStick", f"s{place}", there[:4] if place else there, 1.0, 1.0)
            for place in range(comparisons)
        ]
        return found

    first, *others = paired(cells(-0.02, 9))
    assert first.mean == pytest.approx(-0.02)
    assert first.p == pytest.approx(0.00657, rel=0.01), "fitness varies far more than differences"
    assert others[0].p == pytest.approx(0.0405, rel=0.01), "the seeds that both have"
    row = [*table(cells(-0.02, 1))][2]
    assert row == "| `homing` | EvoStick | 4.667 ± 3.2 | **-0.020 ± 0.011** |"
    assert "**" not in [*table(cells(-0.02, 9))][2], "Holm: 9 tests"
    assert [*table(cells(0.001, 1))][2].endswith("| +0.001 ± 0.011 |")
