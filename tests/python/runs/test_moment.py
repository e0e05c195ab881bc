"""A run folder that goes on after it was opened, and readers that are in no writer's way."""

import pickle
import sqlite3
from pathlib import Path
from threading import Timer

import pytest

from swarmwright import InputError, Run, compare, optimize, repeat, resume
from swarmwright.runs.store import FILE, StoreWriter, database
from tests.python.records import EXPERIMENT


def test_the_state_is_that_of_now_until_the_run_has_ended(copy: Path) -> None:
    for outcome in ("done", "interrupted", "stopped"):
        with StoreWriter.resume(copy) as store:
            store.begin("here")
            run = Run.open(copy)
            assert (run.state, run.interrupted) == ("running", True)
            store.conclude(outcome)
            store.note_ended("generations" if outcome == "done" else None)
        assert (run.state, run.interrupted) == (outcome, outcome == "interrupted")
        assert run.ended == ("generations" if outcome == "done" else None)
        assert run.sessions[-1].outcome is None, "it is as it was when it was opened"
        assert Run.open(copy).sessions[-1].outcome == outcome


@pytest.mark.parametrize("outcome", ["done", "interrupted"])
def test_what_ended_a_session_before_is_not_what_ended_the_run(copy: Path, outcome: str) -> None:
    with StoreWriter.resume(copy) as store:
        store.begin("here")
        store.conclude("done")
        store.note_ended("generations")
    ended = Run.open(copy)
    with StoreWriter.resume(copy) as store:
        store.begin("here")
        run = Run.open(copy)
        store.conclude(outcome)
        if outcome == "done":
            store.note_ended("evaluations")
    assert run.ended == Run.open(copy).ended == ("evaluations" if outcome == "done" else None)
    assert ended.ended == "generations"


def test_a_run_that_is_killed_and_resumed_is_followed(copy: Path) -> None:
    with StoreWriter.resume(copy) as store:
        store.begin("here")
        run = Run.open(copy)
    states: list[str] = [run.state]
    with StoreWriter.resume(copy) as store:
        store.begin("here")
        states.append(run.state)
        store.conclude("done")
    assert [*states, run.state] == ["killed", "running", "done"]


@pytest.mark.parametrize("read_before", [False, True])
@pytest.mark.parametrize("method", ["nnga", "nsga2", "random_search"])
def test_all_of_a_run_is_of_the_moment_when_it_was_opened(
    tmp_path: Path, method: str, read_before: bool
) -> None:
    changes = {"kind": method, "population": 6, "generations": 3}
    if method == "nsga2":
        changes["objectives"] = {"distance": "minimize"}
    experiment = EXPERIMENT.replace(method=changes, validate=False)
    first = optimize(experiment, out=tmp_path / "run")
    expected = _all(Run.open(first.path))
    old = Run.open(first.path)
    lazy = pickle.loads(pickle.dumps(Run(first.path)))
    assert not read_before or _all(old) == expected
    new = resume(old, generations=9)
    assert new.generations == 9
    for run in (first, old, lazy):
        assert _all(run) == expected
        assert run.experiment.method.generations == 3
        assert (run.state, run.ended, len(run.sessions)) == ("done", "generations", 1)
        with pytest.raises(InputError, match="has generations 0 to 2, but no generation 3"):
            run.evaluation(generation=3)
        with pytest.raises(InputError, match=f"has evaluations 0 to {run.evaluations - 1}"):
            run.evaluation(run.evaluations)
        assert repeat(run).generation < 3
    old.export(tmp_path / "table.csv")
    assert len((tmp_path / "table.csv").read_text().splitlines()) == 1 + old.evaluations
    assert compare([old]).groups[0].final == (old.best.fitness,)
    assert _all(Run.open(old.path)) != expected


def _all(run: Run) -> list[object]:
    record, best = run.record, run.best
    leading = [one.number for one in run._store.leading(5)]
    by_instance = [one.number for one in run._store.leading(5, by_instance=True)]
    return [
        *(run.generations, run.evaluations, run.history, run.digest, best, run.seconds, run.sessions),
        *(record.fitness.tobytes(), record.genomes.tobytes(), run.evaluation().number),
        *(leading, by_instance, run._store.collect_seeds(), run._store.session_of(run.generations - 1)),
        *(list(run.attempts()), list(run.events()), run._store.servers(), run._store.failures()),
    ]


@pytest.mark.slow
def test_attempts_and_events_are_of_the_moment_too(tmp_path: Path) -> None:
    run = optimize(EXPERIMENT, out=tmp_path / "run", servers=1)
    attempts = list(run.attempts())
    assert attempts
    new = resume(run, generations=6, servers=1)
    assert list(run.attempts()) == attempts == list(new.attempts())[: len(attempts)]
    assert len(list(new.attempts())) > len(attempts)
    assert sum(one.evaluations for one in run._store.servers()) == 2 * run.evaluations
    with StoreWriter.resume(run.path) as store:
        store.begin("here")
        store.incidents({"retries": 1})
    assert list(new.events()) == []
    assert len(list(Run(run.path).events())) == 1


@pytest.mark.slow
def test_iterators_that_are_not_used_up_keep_no_process_from_going_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmwright.runs.store.journal._PIECE_ROWS", 2)
    monkeypatch.setattr(database, "_PATIENCE_S", 0.0)
    run = optimize(EXPERIMENT, out=tmp_path / "run", servers=1)
    attempts, rows = run.attempts(), run._store.rows()
    begun = [next(attempts), next(attempts), next(attempts)]
    part = next(rows)
    assert resume(run, generations=6).generations == 6
    assert [*begun, *attempts] == list(run.attempts())
    assert len(part.fitness) + sum(len(one.fitness) for one in rows) == run.evaluations


def test_who_goes_on_waits_for_a_program_that_reads(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "_PATIENCE_S", 0.0)
    reader = sqlite3.connect(copy / FILE, isolation_level=None, check_same_thread=False)
    reader.execute("BEGIN")
    reader.execute("SELECT count(*) FROM fact").fetchone()
    with pytest.raises(
        InputError, match="is locked by an SQLite transaction of another program, or of another part of"
    ):
        StoreWriter.resume(copy)
    monkeypatch.setattr(database, "_PATIENCE_S", 60.0)
    end = Timer(0.3, reader.close)
    end.start()
    with StoreWriter.resume(copy):
        pass
    end.join()
