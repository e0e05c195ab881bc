"""Evaluations, attempts and events are read in pieces: with little memory, in nobody's way."""

import sqlite3
import threading
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, optimize, resume
from swarmwright.runs.store import FILE, blocks, database, pieces
from tests.python.records import EXPERIMENT, change_numbers

LARGE = EXPERIMENT.replace(controller={"kind": "layered", "hidden": [100, 300]})


def _run(folder: Path, kind: str, experiment: Experiment = EXPERIMENT, **method: int) -> Run:
    method = {"population": 12, "generations": 4, **method}
    return optimize(experiment.replace(method={"kind": kind, **method}, validate=False), out=folder)


@pytest.mark.parametrize(("block", "population"), [(1 << 22, 8), (1 << 17, 192)])
def test_memory_does_not_grow_with_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, population: int
) -> None:
    monkeypatch.setattr(blocks, "_BLOCK_BYTES", block)
    monkeypatch.setattr(pieces, "_PIECE_BYTES", 1 << 20)
    run = _run(tmp_path / "run", "nnga", LARGE, population=population, generations=192 // population)
    whole = run.record.genomes.nbytes
    assert whole > 12 << 20
    del run.__dict__["record"]
    tracemalloc.start()
    try:
        assert sum(len(part.fitness) for part in run._store.rows()) == run.evaluations
        assert tracemalloc.get_traced_memory()[1] < 6 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("kind", ["nnga", "random_search"])
@pytest.mark.parametrize("held", [0, 3000, 1 << 24])
def test_the_pieces_are_the_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, held: int
) -> None:
    monkeypatch.setattr(blocks, "_BLOCK_BYTES", 500)
    monkeypatch.setattr(pieces, "_PIECE_BYTES", held)
    run = _run(tmp_path / "run", kind)
    parts = list(run._store.rows())
    for name in ("generation", "candidate", "fitness", "episodes", "genomes"):
        together = np.concatenate([getattr(part, name) for part in parts])
        assert together.tobytes() == getattr(run.record, name).tobytes(), name
    change_numbers(run.path, "fitness", slice(1), 5.0, generation=2)
    read: list[int] = []
    with pytest.raises(InputError, match="generation 2: the table"):
        read.extend(int(part.generation[-1]) for part in Run.open(run.path)._store.rows())
    assert set(read) <= {0, 1}


@pytest.mark.parametrize("kind", ["nnga", "random_search"])
def test_a_large_generation_that_is_read_keeps_no_process_from_going_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.setattr(blocks, "_BLOCK_BYTES", 500)
    monkeypatch.setattr(pieces, "_PIECE_BYTES", 0)
    monkeypatch.setattr(database, "_PATIENCE_S", 0.0)
    run = _run(tmp_path / "run", kind)
    rows = run._store.rows()
    parts = [next(rows), next(rows)]
    assert len(parts[0].fitness) < run.history[0].evaluations
    resume(run, generations=6)
    parts += rows
    assert sum(len(part.fitness) for part in parts) == run.evaluations


READERS: dict[str, Callable[[Run], int]] = {
    "rows": lambda run: len(list(run._store.rows())),
    "generations": lambda run: len(list(run._store.generations())),
    "attempts": lambda run: len(list(run.attempts())),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_the_log_of_a_killed_process_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(blocks, "_BLOCK_BYTES", 500)
    monkeypatch.setattr(pieces, "_PIECE_BYTES", 0)
    monkeypatch.setattr("swarmwright.runs.store.journal._PIECE_ROWS", 2)
    run = optimize(EXPERIMENT, out=tmp_path / "run", servers=1)
    connections = []

    def connect(*arguments: object, **options: object) -> sqlite3.Connection:
        connections.append(arguments)
        return open_snapshot(*arguments, **options)  # type: ignore[call-overload, no-any-return] # as it was called

    open_snapshot = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", connect)
    assert READERS[name](run) > 3
    assert len(connections) == 1


def test_an_iterator_can_be_used_up_in_another_thread(finished: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "_PIECE_BYTES", 0)
    rows = finished._store.rows()
    count = [len(next(rows).fitness)]
    thread = threading.Thread(target=lambda: count.extend(len(part.fitness) for part in rows))
    thread.start()
    thread.join()
    assert sum(count) == finished.evaluations
    assert not list(finished.path.glob(f"{FILE}-*"))
