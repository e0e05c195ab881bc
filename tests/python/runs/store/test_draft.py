"""A new store is a draft at first: who can read it when, and what the end of the process leaves."""

import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from pathlib import Path

import pytest

from swarmwright import Experiment, InputError, Run, optimize, resume
from swarmwright.runs.store import FILE, StoreReader, StoreWriter, database, open_store, reader, writer
from swarmwright.runs.store.database import NEW
from tests.python.records import EXPERIMENT, same_record

ENDLESS = EXPERIMENT.replace(method={"generations": 100_000}, servers="in-process")
PRAGMAS = ("page_size", "application_id", "user_version", "encoding", "auto_vacuum")
SLOW = """
import time
from swarmwright import Simulation


class Slow(Simulation):
    sensors = actuators = 1

    def reset(self, parameters, seed):
        return [[0.0]]

    def step(self, actions):
        time.sleep(1)
        return [[0.0]]

    def done(self):
        return False

    def fitness(self):
        return 0.0
"""
RUNNING = """
import sys
from swarmwright import optimize
optimize(sys.argv[1], out=sys.argv[2])
"""


@contextmanager
def running(folder: Path, experiment: Experiment, until: str) -> Iterator[None]:
    """A process that optimizes unwatched, from when this file is in its folder until it is killed."""
    file = folder.with_suffix(".yaml")
    experiment.save(file)
    with subprocess.Popen([sys.executable, "-c", RUNNING, str(file), str(folder)]) as process:
        try:
            deadline = time.monotonic() + 30
            while not (folder / until).exists():
                assert time.monotonic() < deadline
                assert process.poll() is None
                time.sleep(0.001)
            yield
        finally:
            process.kill()


def test_a_short_run_writes_its_store_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, seen = tmp_path / "run", []
    commit = StoreWriter.commit

    def look(store: StoreWriter, *rest: object) -> None:
        commit(store, *rest)  # type: ignore[arg-type] # as it was called
        history = store.reader().history()
        seen.append((len(history), (folder / FILE).exists(), (folder / NEW).exists()))

    monkeypatch.setattr(StoreWriter, "commit", look)
    run = optimize(EXPERIMENT, out=folder)
    assert seen == [(count, False, True) for count in (1, 2, 3, 4)]
    assert sorted(path.name for path in folder.glob("run.*")) == [FILE]
    assert Run.open(folder).history == run.history


def test_generations_are_written_while_others_are_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many as are worth a transaction."""
    run = optimize(EXPERIMENT.replace(method={"generations": 33}), out=tmp_path / "run")
    monkeypatch.setattr(writer, "_COMMIT_INTERVAL_S", 1e9)
    written = []
    with StoreWriter.create(tmp_path / "again", run.experiment, run.metrics) as store:
        store.begin("here")
        for evaluated in run._store.generations():
            store.commit(evaluated)
            store.use_idle_time()
            written.append(len(StoreReader(tmp_path / "again", NEW).history()))
    assert written == [0] * 31 + [32, 32]
    assert Run.open(tmp_path / "again").digest == run.digest


def test_facts_are_written_with_what_comes_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = optimize(EXPERIMENT, out=tmp_path / "run")
    with StoreWriter.create(tmp_path / "again", run.experiment, run.metrics) as store:
        store.begin("here")
        store.note_ended("target")
        store.note_validation({"state": "due"})
        assert StoreReader(tmp_path / "again", NEW).validation() is None
        read = store.reader()
        assert (read.find_end_reason(), read.validation()) == ("target", {"state": "due"})
        # A validation may take long: when the second of the draft is over, it ends.
        monkeypatch.setattr(writer, "_DRAFT_S", 0.0)
        store.note_validation({"state": "none"})
        assert StoreReader(tmp_path / "again").validation() == {"state": "none"}
        assert read.validation() == {"state": "none"}
        store.note_validation({"state": "same"})
        assert StoreReader(tmp_path / "again").validation() == {"state": "same"}


def test_an_opened_reader_has_one_connection_until_it_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = optimize(EXPERIMENT, out=tmp_path / "run")._store
    open_snapshot: list[Path] = []
    reading = database.reading

    def counted(file: Path) -> AbstractContextManager[sqlite3.Connection]:
        open_snapshot.append(file)
        return reading(file)

    monkeypatch.setattr(reader, "reading", counted)
    apart = store.history(), store.digest(), store.leading(2)[1].number
    assert len(open_snapshot) == 3
    with StoreReader.open_snapshot(tmp_path / "run") as other:
        assert (other.history(), other.digest(), other.leading(2)[1].number) == apart
    assert len(open_snapshot) == 4
    assert other.history() == apart[0]
    assert len(open_snapshot) == 5


@pytest.mark.slow
def test_the_end_of_the_process_waits_for_the_disk(tmp_path: Path) -> None:
    """A run is on the disk when its process has ended, also where that is slow."""
    mark = tmp_path / "flushed"
    slow = f"""
import time
from pathlib import Path
from swarmwright.runs.store import open_store

def flush(file):
    time.sleep(1)
    Path({str(mark)!r}).touch()

open_store._flush = flush
"""
    code = slow + RUNNING.replace("sys.argv[1]", repr(str(tmp_path / "run.yaml"))).replace(
        "sys.argv[2]", repr(str(tmp_path / "run"))
    )
    EXPERIMENT.save(tmp_path / "run.yaml")
    # The plot would keep the process, too.
    environment = {**os.environ, "SWARMWRIGHT_PLOT": "0"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
    assert mark.exists()


def test_a_file_is_flushed_where_no_thread_can_be_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The end of the process then has nothing to wait for."""

    def refused(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    flushed: list[Path] = []
    monkeypatch.setattr("_thread.start_new_thread", refused)
    monkeypatch.setattr(open_store, "_flush", flushed.append)
    earlier = set(open_store._unfinished)  # files of other tests that the disk has not taken yet
    open_store._flush_later(tmp_path / "run.sqlite")
    assert flushed == [tmp_path / "run.sqlite"]
    assert open_store._unfinished <= earlier


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_wait_for_the_disk(number: signal.Signals) -> None:
    """The program ignores both while it ends, and exits with the status that it has."""
    code = """
import signal, sys, time
from pathlib import Path
from swarmwright.runs.store import open_store

def flush(file):
    print("flushing", flush=True)
    time.sleep(1000)

open_store._flush = flush
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, signal.SIG_IGN)
open_store._flush_later(Path("x"))
sys.exit(3)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        deadline = time.monotonic() + 30
        while process.poll() is None and time.monotonic() < deadline:
            process.send_signal(number)  # the first may come before the wait
            time.sleep(0.05)
        assert process.poll() == 3
        process.kill()


def test_what_is_reported_is_in_the_store(tmp_path: Path) -> None:
    folder, kept = tmp_path / "run", []
    run = optimize(EXPERIMENT, lambda _: kept.append(Run.open(folder).generations), out=folder)
    assert kept == [1, 2, 3, 4]
    same_record(run, optimize(EXPERIMENT, out=tmp_path / "draft"))


@pytest.mark.slow
@pytest.mark.parametrize("after", [0.0, 0.4])
def test_killed_after_its_first_second(after: float, tmp_path: Path) -> None:
    """kill -9 of a run that nobody watches; it goes on with what it had committed."""
    folder = tmp_path / "run"
    steady = ENDLESS.replace(
        method={"population": 100}
    )  # what is watched has a transaction for each generation
    with running(folder, steady, FILE):
        time.sleep(after)
    run = Run.open(folder)
    assert run.state == "killed"
    assert run.generations > 10
    until = run.generations + 5
    gone_on = resume(folder, lambda now: now.generation + 1 < until)
    same_record(gone_on, optimize(steady, lambda now: now.generation + 1 < until, out=tmp_path / "whole"))


@pytest.mark.slow
def test_killed_in_a_first_generation_that_takes_long(tmp_path: Path) -> None:
    """Nothing was computed to the end, but the run is there, and goes on."""
    (tmp_path / "slow.py").write_text(SLOW)
    experiment = EXPERIMENT.replace(simulation=f"{tmp_path / 'slow.py'}:Slow", parameters={})
    folder = tmp_path / "run"
    with running(folder, experiment, FILE):
        assert Run.open(folder).state == "running"
    run = Run.open(folder)
    assert (run.state, run.generations) == ("killed", 0)


@pytest.mark.journey
def test_killed_in_its_first_second(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with running(folder, ENDLESS, NEW):
        pass
    with pytest.raises(
        InputError, match=r"ended within the first second, before anything was stored; start again"
    ):
        Run.open(folder)
    run = optimize(EXPERIMENT, out=folder)  # what is left there is in nobody's way
    assert run.state == "done"


def test_the_last_generation_is_kept_when_the_next_one_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is handed to the store during the evaluation of the next one, or else at the end."""
    from swarmwright.servers.evaluation.in_process import InProcessBackend

    # Of a method that the engine does not evolve by itself.
    experiment = EXPERIMENT.replace(method={"kind": "random_search", "population": 8, "generations": 4})
    whole = optimize(experiment, out=tmp_path / "whole")
    compute, calls = InProcessBackend.compute, []

    def interrupted(*arguments: object) -> object:
        calls.append(arguments)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return compute(*arguments)  # type: ignore[arg-type] # as it was called

    monkeypatch.setattr(InProcessBackend, "compute", interrupted)
    run = optimize(experiment.replace(servers="in-process"), out=tmp_path / "run")
    assert (run.interrupted, run.generations) == (True, 2)
    monkeypatch.undo()
    same_record(resume(run), whole)


@pytest.mark.parametrize("at", ["_flush", "connect"])
def test_an_interrupt_while_the_draft_is_published_loses_nothing(
    at: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = getattr(open_store, at)

    def interrupted(*arguments: object) -> None:
        monkeypatch.undo()  # only the first time
        done(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(open_store, at, interrupted)
    run = optimize(EXPERIMENT, lambda _: None, out=tmp_path / "run")
    assert (run.state, run.generations) == ("interrupted", 1)
    same_record(resume(run), optimize(EXPERIMENT, out=tmp_path / "whole"))


@pytest.mark.parametrize("generation", [0, 1 << 20])
def test_a_store_is_the_same_where_sqlite_cannot_serialize(
    generation: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stores = []
    for can in (True, False):
        monkeypatch.setattr(database, "_CAN_SERIALIZE", can)
        connection = database.create(tmp_path / f"{can}.sqlite", {"name": "value"}, generation)
        with closing(connection):
            pragmas = [connection.execute(f"PRAGMA {name}").fetchone() for name in PRAGMAS]
            stores.append((pragmas, list(connection.iterdump())))
    assert stores[0] == stores[1]
