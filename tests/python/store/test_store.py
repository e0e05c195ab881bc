"""The store of a run: what goes wrong with files, and what is said then."""

import os
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from swarmwright import InputError, Run, RunError, optimize, resume
from swarmwright._store import FILE, StoreWriter
from tests.python.records import EXPERIMENT


def test_it_is_a_plain_sqlite_file_for_any_program(finished: Run) -> None:
    store = sqlite3.connect(finished.path / FILE)
    rows = store.execute("SELECT generation, candidate, fitness, genome FROM evaluation").fetchall()
    store.close()
    assert [row[2] for row in rows] == finished.record.fitness.tolist()
    assert np.frombuffer(rows[3][3], dtype="<f4").tolist() == finished.record.genomes[3].tolist()


def test_a_finished_run_is_one_file_that_can_be_copied(finished: Run) -> None:
    assert sorted(entry.name for entry in finished.path.glob("run.sqlite*")) == [FILE]


def test_a_run_can_be_read_while_it_goes_on(tmp_path: Path) -> None:
    seen: list[tuple[str, int, int]] = []

    def look(_: object) -> None:
        run = Run.open(tmp_path / "run")
        seen.append((run.state, run.generations, len(run.record.fitness)))

    run = optimize(EXPERIMENT, look, out=tmp_path / "run")
    assert [state for state, _, _ in seen] == ["running"] * 4
    assert [generations for _, generations, _ in seen] == [1, 2, 3, 4]
    assert [evaluations for _, _, evaluations in seen] == [one.evaluations for one in run.history]
    assert Run.open(tmp_path / "run").state == "done"


def test_two_processes_never_write_one_run(copy: Path) -> None:
    with StoreWriter.resume(copy):
        with pytest.raises(InputError, match="another process works on this run"):
            resume(copy, generations=9)
        assert Run.open(copy).evaluations == 33


def test_missing_files_are_named(copy: Path) -> None:
    (copy / FILE).unlink()
    with pytest.raises(InputError, match=r"is no run folder: run.sqlite is missing"):
        resume(copy, generations=5)
    with pytest.raises(InputError, match="there is no such folder"):
        Run.open(copy / "none")


def test_a_deleted_experiment_is_written_anew(copy: Path) -> None:
    text = (copy / "experiment.yaml").read_text()
    (copy / "experiment.yaml").unlink()
    resume(copy)
    assert (copy / "experiment.yaml").read_text() == text


def test_a_damaged_store_is_not_touched(copy: Path) -> None:
    store = copy / FILE
    for damage in (
        b"",
        b"generation,candidate,fitness\n0,0,1.5\n" * 100,
        store.read_bytes()[:5000],
        store.read_bytes()[:4096] + os.urandom(store.stat().st_size - 4096),
    ):
        store.write_bytes(damage)
        for attempt in (Run.open, lambda path: resume(path, generations=9)):
            with pytest.raises(InputError, match=r"run\.sqlite: (is damaged|is no store)"):
                attempt(copy)
        assert store.read_bytes() == damage


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("UPDATE fact SET value = '{' WHERE name = 'experiment'", r"run\.sqlite: is damaged"),
        (
            """UPDATE fact SET value = '{"simulation": "minisim", "sede": 1}' WHERE name = 'experiment'""",
            r"copy: the experiment in run\.sqlite cannot be used: sede: unknown key; did you mean 'seed'",
        ),
        ("UPDATE fact SET value = 'x' WHERE name = 'metrics'", r"run\.sqlite: is damaged"),
        ("UPDATE generation SET seeds = 'x'", r"run\.sqlite: is damaged"),
        ("UPDATE evaluation SET genome = x'00'", r"run\.sqlite: is damaged"),
    ],
)
def test_damaged_values_are_named(copy: Path, change: str, words: str) -> None:
    with sqlite3.connect(copy / FILE) as store:
        store.execute(change)
    store.close()
    with pytest.raises(InputError, match=words):
        resume(copy, generations=9)


def test_a_folder_that_is_just_being_made_is_not_taken_for_something_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    said = []

    def interrupted(*_: object) -> None:
        for attempt in (Run.open, resume, lambda path: optimize(EXPERIMENT, out=path)):
            with pytest.raises(InputError) as error:
                attempt(folder)
            said.append(str(error.value))
        raise SystemExit  # as good as killed: nobody tidies up

    with monkeypatch.context() as patch:
        patch.setattr("swarmwright._store._writer.create", interrupted)
        with pytest.raises(SystemExit):
            optimize(EXPERIMENT, out=folder)
    assert said == [f"{folder}: another process is just creating this run; try again in a moment"] * 3
    with pytest.raises(InputError, match="ended before anything was computed; begin again"):
        Run.open(folder)
    assert optimize(EXPERIMENT, out=folder).state == "done", "nothing is lost by beginning anew"


def test_missing_rows_are_noticed(copy: Path) -> None:
    with sqlite3.connect(copy / FILE) as store:
        store.execute("DELETE FROM evaluation WHERE number = 13")
    store.close()
    with pytest.raises(InputError, match="is damaged: 1 evaluations of generation 1 are missing"):
        resume(copy, generations=9)


def test_a_store_of_a_newer_version_is_left_alone(copy: Path) -> None:
    with sqlite3.connect(copy / FILE) as store:
        store.execute("PRAGMA user_version = 99")
    store.close()
    before = (copy / FILE).read_bytes()
    for attempt in (Run.open, resume):
        with pytest.raises(InputError, match=r"has format 99; .* update it"):
            attempt(copy)
    assert (copy / FILE).read_bytes() == before


def test_a_store_changed_by_hand_does_not_go_on(copy: Path) -> None:
    with sqlite3.connect(copy / FILE) as store:
        store.execute("UPDATE evaluation SET fitness = fitness + 1 WHERE number = 13")
    store.close()
    with pytest.raises(RunError, match="generation 1 comes out differently here"):
        resume(copy, generations=9)


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
        subprocess.run(["umount", str(place)], check=True)


def test_a_read_only_folder_can_be_read(copy: Path, tmp_path: Path) -> None:
    with disk(tmp_path / "disk") as place:
        shutil.copytree(copy, place / "run")
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        run = Run.open(place / "run")
        assert run.record.fitness.max() == run.best.fitness
        assert run.state == "done"
        with pytest.raises(InputError, match="may not be written by this user"):
            resume(run, generations=9)
        with pytest.raises(InputError, match="no right to write"):
            optimize(EXPERIMENT, out=place / "another")


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


def test_a_full_disk_keeps_what_was_written(tmp_path: Path) -> None:
    experiment = EXPERIMENT.replace(
        controller={"kind": "layered", "hidden": [64]}, method={"generations": 1000}
    )
    with disk(tmp_path / "disk", "600k") as place:
        with pytest.raises(RunError, match=r"the disk is full; what was written before is kept"):
            optimize(experiment, out=place / "run")
        shutil.copytree(place / "run", tmp_path / "copy")
    run = Run.open(tmp_path / "copy")
    assert run.generations > 3
    assert run.state in {"failed", "killed"}
    longer = resume(run.path, lambda generation: generation.generation < run.generations)
    assert longer.generations == run.generations + 1
    undisturbed = optimize(experiment, lambda now: now.generation < run.generations, out=tmp_path / "whole")
    assert longer.digest == undisturbed.digest


def test_what_a_killed_process_left_of_a_store_is_in_nobody_s_way(copy: Path) -> None:
    folder = copy.parent / "broken"
    folder.mkdir()
    shutil.copy(copy / FILE, folder / "run.sqlite.new")
    shutil.copy(copy / "experiment.yaml", folder)
    assert optimize(EXPERIMENT, lambda _: False, out=folder).generations == 1


def test_text_where_a_number_should_stand_is_damage(copy: Path) -> None:
    store = sqlite3.connect(copy / FILE)
    store.execute("UPDATE generation SET best = CAST('' AS BLOB) WHERE generation = 1")
    store.commit()
    store.close()
    with pytest.raises(InputError, match="is damaged: could not convert"):
        _ = Run.open(copy).history
