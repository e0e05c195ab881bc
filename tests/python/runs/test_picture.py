"""Plots of runs, drawn by a process beside the tool."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from swarmwright import Run, optimize
from swarmwright.runs import picture
from tests.python.records import EXPERIMENT

pytestmark = pytest.mark.usefixtures("plots")


@pytest.mark.slow
def test_plots_of_many_runs_are_drawn_before_the_process_ends(tmp_path: Path) -> None:
    program = (
        "import sys; from swarmwright import Experiment, optimize\n"
        f"experiment = Experiment.from_mapping({EXPERIMENT.to_mapping()!r})\n"
        "for number in range(5): optimize(experiment, out=f'{sys.argv[1]}/{number}')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stderr == ""
    for number in range(5):
        with Image.open(tmp_path / str(number) / picture.FILE) as image:
            assert image.size == (1080, 624)
            assert len(set(image.convert("RGB").get_flattened_data())) > 20


def test_no_plot_where_none_is_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SWARMWRIGHT_PLOT", "0")
    run = optimize(EXPERIMENT, out=tmp_path / "run")
    picture.wait()
    assert sorted(file.name for file in run.path.iterdir()) == ["best.json", "experiment.yaml", "run.sqlite"]


@pytest.mark.slow
def test_a_run_that_is_deleted_meanwhile_is_no_error(
    finished: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name in ("gone", "store", "file"):
        shutil.copytree(finished.path, tmp_path / name)
    shutil.rmtree(tmp_path / "gone")
    (tmp_path / "store" / "run.sqlite").unlink()  # as `shutil.rmtree` may have come so far
    shutil.rmtree(tmp_path / "file")
    (tmp_path / "file").write_text("another's")
    for name in ("gone", "store", "file"):
        picture.draw_later(tmp_path / name)
    picture.wait()
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_what_cannot_be_drawn_is_said(
    finished: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(finished.path, tmp_path / "run")
    (tmp_path / "run" / picture.FILE).unlink(missing_ok=True)
    (tmp_path / "run" / picture.FILE).mkdir()
    gone = optimize(EXPERIMENT, out=tmp_path / "gone")
    shutil.rmtree(gone.path)
    picture.draw_later(tmp_path / "run")
    picture.wait()
    said = capfd.readouterr().err
    assert said == f"swarmwright: {tmp_path / 'run' / picture.FILE}: cannot be written: Is a directory\n"
