"""Disks that are full, fail, or may not be written: what is said, what is kept, how it goes on."""

import errno
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from swarmwright import Generation, InputError, Run, RunError, optimize, resume
from swarmwright.runs.store import StoreReader, StoreWriter
from tests.python.records import EXPERIMENT

FAILING = Path(__file__).with_name("failing_disk.c")
FILLING = """
import os, signal, sys
from pathlib import Path
from swarmwright import cli
from swarmwright.runs.optimization.account import Account

folder, at, number = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
report = Account.report

def filled(account, summary, waiting_for):  # called when a generation is committed
    if summary.generation == at:
        with (folder / "rest").open("wb", buffering=0) as file:
            try:
                while file.write(bytes(4096)):
                    pass
            except OSError:
                pass
        if number:
            os.kill(os.getpid(), number)
    return report(account, summary, waiting_for)

Account.report = filled
sys.exit(cli.run(sys.argv[4:]))
"""


@contextmanager
def disk(place: Path, size: str = "8m") -> Iterator[Path]:
    """A small disk of its own."""
    place.mkdir()
    options = ["-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    if subprocess.run(["mount", *options], capture_output=True, check=False).returncode:
        pytest.skip("mounting a disk is not allowed here")
    try:
        yield place
    finally:
        # Lazily, since a file that is still open would keep it, and pytest cannot remove what is mounted.
        subprocess.run(["umount", "--lazy", str(place)], check=True)


@pytest.mark.slow
def test_a_read_only_folder_can_be_read(copy: Path, tmp_path: Path) -> None:
    with disk(tmp_path / "disk") as place:
        shutil.copytree(copy, place / "run")
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        run = Run.open(place / "run")
        assert run.record.fitness.max() == run.best.fitness
        assert run.state == "done"
        with pytest.raises(InputError, match="is not writable by this user"):
            resume(run, generations=9)
        with pytest.raises(InputError, match=r"cannot be created: .* is not writable by this user"):
            optimize(EXPERIMENT, out=place / "another")


@pytest.mark.slow
def test_resuming_what_is_read_only_is_refused_before_anything_is_printed(
    copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from swarmwright.cli import run

    with disk(tmp_path / "disk") as place:
        shutil.copytree(copy, place / "run")
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        assert run(["resume", str(place / "run")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert f"{place / 'run'}: is not writable by this user" in printed.err


@pytest.mark.slow
def test_a_store_that_cannot_be_read_while_the_disk_is_full(finished: Run, tmp_path: Path) -> None:
    with disk(tmp_path / "disk", "1m") as place:
        with StoreWriter.create(tmp_path / "run", finished.experiment, finished.metrics) as store:
            store.begin("here")
            store.keep()
            store.commit(next(iter(finished._store.generations())))
            store.keep()
            (place / "run").mkdir()
            for name in ("run.sqlite", "run.sqlite-wal"):
                shutil.copy(tmp_path / "run" / name, place / "run" / name)
        with (place / "rest").open("wb", buffering=0) as file, suppress(OSError):
            while file.write(bytes(4096)):
                pass
        with pytest.raises(InputError, match=r"run\.sqlite: cannot be read while the disk is full"):
            Run.open(place / "run")
        (place / "rest").unlink()
        assert Run.open(place / "run").generations == 1


def test_what_is_kept_is_said_where_it_cannot_be_read_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable(*_: object) -> StoreReader:
        raise InputError("the disk is full")

    def fail(now: Generation) -> None:
        if now.generation == 1:
            raise RunError("a failure")

    folder = tmp_path / "run"
    monkeypatch.setattr(sys.modules["swarmwright.runs.optimization.optimize"], "StoreReader", unreadable)
    with pytest.raises(
        RunError, match=r"a failure; finished generations are kept; `swarmwright resume .*/run`"
    ):
        optimize(EXPERIMENT.replace(servers="in-process"), fail, out=folder)
    assert Run.open(folder).generations == 2


def test_a_path_that_is_too_long_for_a_store_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path
    while len(str(folder)) < 491:
        folder /= "x" * min(100, 491 - len(str(folder)))
    with pytest.raises(InputError, match=r"the path is too long: .* SQLite supports at most 504"):
        optimize(EXPERIMENT, out=folder)
    assert list(tmp_path.iterdir()) == []


def test_the_longest_path_holds_a_run(finished: Run, tmp_path: Path) -> None:
    left = 504 - len(os.fsencode(tmp_path / "run.sqlite.new"))
    folder = tmp_path
    while left > 0:
        name = min(left - 1, 200) if left - 201 != 1 else 199
        folder, left = folder / ("x" * name), left - name - 1
    with StoreWriter.create(folder, finished.experiment, finished.metrics) as store:
        store.begin("here")
        store.keep()
        store.commit(next(iter(finished._store.generations())))
    assert Run.open(folder).generations == 1


@pytest.mark.slow
def test_pictures_for_a_read_only_folder_are_refused_in_the_same_words(
    copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from swarmwright.cli import run

    with disk(tmp_path / "disk") as place:
        shutil.copytree(copy, place / "run")
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        for command, name in (("plot", "plot.png"), ("draw", "controller.png"), ("replay", "x.gif")):
            file = str(place / "run" / name)
            options = ["--save", file] if command == "replay" else []
            assert run([command, str(place / "run"), *options]) == 2
            assert f"{file}: cannot be written: Read-only file system" in capsys.readouterr().err


@pytest.mark.slow
def test_a_full_disk_keeps_what_was_written(tmp_path: Path) -> None:
    experiment = EXPERIMENT.replace(
        controller={"kind": "layered", "hidden": [64]}, method={"generations": 1000}
    )
    with disk(tmp_path / "disk", "600k") as place:
        with pytest.raises(RunError, match=r"the disk is full; all earlier results are kept"):
            optimize(experiment, out=place / "run")
        shutil.copytree(place / "run", tmp_path / "copy")
    run = Run.open(tmp_path / "copy")
    assert run.generations > 3
    assert run.state in {"failed", "killed"}
    longer = resume(run.path, lambda generation: generation.generation < run.generations)
    assert longer.generations == run.generations + 1
    undisturbed = optimize(experiment, lambda now: now.generation < run.generations, out=tmp_path / "whole")
    assert longer.digest == undisturbed.digest


@pytest.mark.slow
def test_a_limit_on_the_size_of_files_is_named(tmp_path: Path) -> None:
    """SQLite calls it an error of the disk."""
    folder = tmp_path / "run"
    experiment = EXPERIMENT.replace(method={"population": 100, "generations": 1000}, servers="in-process")
    experiment.save(tmp_path / "run.yaml")
    words = f"ulimit -f 600; exec {sys.executable} -m swarmwright optimize run.yaml --out run"
    done = subprocess.run(
        ["/bin/bash", "-c", words], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 1, done.stderr
    assert "exceeds the largest file size of this process (600 KiB)" in done.stderr
    assert "swarmwright resume" in done.stderr
    assert Run.open(folder).generations


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("at", [3, 1])
def test_a_disk_that_is_full_at_the_end_is_told_of(
    finished: Run, tmp_path: Path, at: int, number: int
) -> None:
    """After the last generation; and while an interrupt is handled."""
    finished.experiment.save(tmp_path / "x.yaml")
    with disk(tmp_path / "disk", "4m") as place:
        folder = place / "run"
        command = ["optimize", str(tmp_path / "x.yaml"), "--out", str(folder)]
        result = subprocess.run(
            [sys.executable, "-c", FILLING, str(place), str(at), str(int(number)), *command],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        assert result.returncode == 1
        assert "Interrupted" not in result.stdout
        (line,) = result.stderr.splitlines()
        assert line.startswith(f"swarmwright: {folder}/")
        assert "the disk is full" in line or "No space left on device" in line
        assert f"the results of {at + 1} generations are kept" in line
        assert f"`swarmwright resume {folder}` continues from there" in line
        assert Run.open(folder).generations == at + 1, "it can be read while the disk is full"
        (place / "rest").unlink()
        run = resume(folder)
        assert (run.state, run.digest) == ("done", finished.digest)


@pytest.fixture(scope="module")
def failing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library that lets what is written to stores fail."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("needs a C compiler")
    library = tmp_path_factory.mktemp("failing") / "failing.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, FAILING, "-ldl"], check=True)
    return library


def optimized(folder: Path, environment: Mapping[str, str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "swarmwright", "optimize", "x.yaml", "--out", folder.name],
        cwd=folder.parent,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_a_disk_error_at_any_of_the_last_writes_is_told_of(
    finished: Run, failing: Path, tmp_path: Path
) -> None:
    """When the last generation and the end are committed, and when one file is made of the store."""
    finished.experiment.save(tmp_path / "x.yaml")
    counted = {"LD_PRELOAD": str(failing), "FAIL_LOG": str(tmp_path / "count")}
    assert optimized(tmp_path / "counted", counted).returncode == 0
    writes = int((tmp_path / "count").read_text())
    assert writes > 20
    failed = 0
    for at in (*range(writes - 18, writes - 11), writes - 6, writes - 5, writes - 1):
        times, number = (("1", errno.ENOSPC), ("1000000", errno.EIO))[at % 2]  # for a moment, and for good
        folder = tmp_path / f"run{at}"
        failure = {"FAIL_AT": str(at), "FAIL_TIMES": times, "FAIL_ERRNO": str(int(number))}
        result = optimized(folder, {"LD_PRELOAD": str(failing), **failure})
        assert "Traceback" not in result.stderr
        if result.returncode:
            failed += 1
            assert result.returncode == 1, (at, result)
            assert f"{folder.name}/run.sqlite: the disk " in result.stderr
            assert f"`swarmwright resume {folder.name}` continues from there" in result.stderr
        else:  # nothing was lost by it
            assert Run.open(folder).state == "done", (at, result)
        run = resume(folder)
        assert (run.state, run.digest) == ("done", finished.digest)
    assert failed >= 9  # SQLite does without the very last ones
