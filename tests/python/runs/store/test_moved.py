"""A run whose folder is moved, replaced or deleted while it is written: what is said, and what stays."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmwright import Generation, Run, RunError, optimize, resume
from swarmwright.runs.store import FILE, StoreWriter, writer
from tests.python.records import EXPERIMENT

PAUSING = """
import sys
from swarmwright import RunError, optimize


def pause(generation):
    if generation.generation == 1:
        print("evolving", flush=True)
        sys.stdin.readline()


try:
    optimize(sys.argv[1], pause, out=sys.argv[2])
except RunError as error:
    sys.exit(str(error))
"""
IN_PROCESS = EXPERIMENT.replace(servers="in-process")


def after(generation: int, act: Callable[[], object]) -> Callable[[Generation], None]:
    """A callback that does something once."""

    def callback(now: Generation) -> None:
        if now.generation == generation:
            act()

    return callback


@pytest.mark.slow
def test_a_run_that_takes_the_name_of_a_moved_one_is_left_alone(finished: Run, tmp_path: Path) -> None:
    folder, moved = tmp_path / "run", tmp_path / "moved"
    file = tmp_path / "x.yaml"
    finished.experiment.save(file)
    command = [sys.executable, "-c", PAUSING, str(file), str(folder)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "evolving\n"
        folder.rename(moved)
        with StoreWriter.create(folder, finished.experiment, finished.metrics) as store:
            store.begin("here")
            store.keep()
            store.commit(next(iter(finished._store.generations())))
            store.keep()
            before = sorted(path.name for path in folder.iterdir())
            assert f"{FILE}-wal" in before
            _, errors = process.communicate("\n", timeout=60)
            assert sorted(path.name for path in folder.iterdir()) == before
        assert process.returncode == 1
    assert f"{folder}: the folder was moved to {moved} during the run" in errors
    assert f"continue with `swarmwright resume {moved}`" in errors
    assert errors.count(str(folder)) == 1
    assert Run.open(folder).generations == 1
    assert Run.open(moved).generations == 2
    assert resume(moved).digest == finished.digest


def test_a_moved_run_goes_on_in_the_same_process(tmp_path: Path) -> None:
    whole = optimize(IN_PROCESS, out=tmp_path / "whole")
    folder, moved = tmp_path / "run", tmp_path / "moved"
    with pytest.raises(RunError, match=f"{folder}: the folder was moved to {moved} during"):
        optimize(IN_PROCESS, after(1, lambda: folder.rename(moved)), out=folder)
    assert not folder.exists()
    again = resume(moved)
    assert again.digest == whole.digest
    assert (moved / "best.json").read_text() == (whole.path / "best.json").read_text()


@pytest.mark.parametrize("written", [True, False])
def test_a_run_that_is_moved_in_its_first_second_can_be_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: bool
) -> None:
    if not written:
        monkeypatch.setattr(writer, "_COMMIT_INTERVAL_S", 600.0)
    whole = optimize(IN_PROCESS, out=tmp_path / "whole")
    folder, moved = tmp_path / "run", tmp_path / "moved"
    store = StoreWriter.create(folder, whole.experiment, whole.metrics)
    store.begin("here")
    for evaluated in list(whole._store.generations())[:2]:
        store.commit(evaluated)
    if written:
        store.reader()
    folder.rename(moved)
    with pytest.raises(RunError, match=f"{folder}: the folder was moved to {moved} during"), store:
        pass
    assert not folder.exists()
    assert Run.open(moved).generations == 2
    assert resume(moved).digest == whole.digest


def test_a_deleted_run_says_so(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with pytest.raises(RunError, match=f"{folder}: the folder was deleted during"):
        optimize(IN_PROCESS, after(1, lambda: shutil.rmtree(folder)), out=folder)
    assert not folder.exists()
