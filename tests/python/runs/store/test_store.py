"""The store of a run: what goes wrong with files, and what is said then."""

import errno
import os
import shutil
import signal
import sqlite3
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from swarmwright import InputError, Run, RunError, optimize, resume
from swarmwright.cli import run
from swarmwright.cli._commands import program
from swarmwright.runs.store import FILE, StoreReader, StoreWriter
from swarmwright.runs.store.database import connect_to_read, reading, reopen
from swarmwright.runs.store.lock import LOCK, Lock, _open_lock_file, is_locked
from swarmwright.servers.rows import Journal, WarningEntry
from tests.python.records import EXPERIMENT, change, change_numbers, seal


def test_it_is_a_plain_sqlite_file_for_any_program(finished: Run) -> None:
    store = sqlite3.connect(finished.path / FILE)
    rows = store.execute("SELECT evaluations, fitness, genomes FROM block ORDER BY first").fetchall()
    store.close()
    fitness = np.frombuffer(b"".join(row[1] for row in rows), dtype="<f8")
    assert fitness.tolist() == finished.record.fitness.tolist()
    genomes = np.frombuffer(rows[1][2], dtype="<f4").reshape(rows[1][0], -1)
    assert genomes[0].tolist() == finished.record.genomes[rows[0][0]].tolist()


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
        with pytest.raises(InputError, match="another part of this process is writing this run"):
            resume(copy, generations=9)
        assert Run.open(copy).evaluations == 33


def test_an_editor_that_replaces_the_experiment_opens_no_way_in(copy: Path) -> None:
    with StoreWriter.resume(copy):
        saved = copy / "experiment.yaml~"  # as editors save: a new file, then its name
        saved.write_text((copy / "experiment.yaml").read_text())
        saved.replace(copy / "experiment.yaml")
        assert is_locked(copy)
        with pytest.raises(
            InputError, match="another part of this process is writing this run; wait for it, or stop it"
        ):
            resume(copy, generations=9)
    assert not is_locked(copy)
    assert resume(copy, generations=5).generations == 5
    assert not (copy / LOCK).exists(), "it goes with the process"


def test_a_lock_that_a_killed_process_left_is_in_nobody_s_way(copy: Path) -> None:
    (copy / LOCK).touch()
    assert not is_locked(copy)
    assert resume(copy, generations=5).generations == 5


def test_who_asks_whether_a_run_is_locked_keeps_nobody_out(copy: Path) -> None:
    over = threading.Event()

    def ask() -> None:
        while not over.is_set():
            is_locked(copy)

    asking = [threading.Thread(target=ask) for _ in range(3)]
    for thread in asking:
        thread.start()
    try:
        for _ in range(50):
            lock = Lock(copy)
            assert is_locked(copy)
            lock.close()
    finally:
        over.set()
        for thread in asking:
            thread.join()


def test_a_lock_that_goes_while_it_is_taken_is_not_held_by_two(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Lock(copy)

    def open_snapshot(folder: Path, path: Path) -> Any:
        file = _open_lock_file(folder, path)
        first.close()  # deletes the file that is open here
        return file

    with monkeypatch.context() as patch:
        patch.setattr("swarmwright.runs.store.lock._open_lock_file", open_snapshot)
        second = Lock(copy)
    with pytest.raises(InputError, match="another part of this process is writing this run"):
        Lock(copy)
    second.close()


def test_a_folder_that_cannot_be_opened_is_not_said_to_be_locked(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as patch:
        patch.setattr("swarmwright.runs.store.lock.os.open", refuse)
        with pytest.raises(InputError, match=r"cannot be opened: Too many open files; .* \(ulimit -n\)"):
            Lock(copy)
    Lock(copy).close()
    assert not (copy / LOCK).exists()


def test_without_a_lock_the_first_writer_is_told_of_the_second(copy: Path) -> None:
    def write() -> None:
        with StoreWriter.resume(copy) as store:
            store.begin("first", ())
            (copy / LOCK).unlink()
            assert resume(copy, generations=5).generations == 5
            store.note(9, Journal())

    with pytest.raises(RunError, match="another process continues this run"):
        write()
    run = Run.open(copy)
    assert (run.generations, run.state) == (5, "done")


def test_missing_files_are_named(copy: Path) -> None:
    (copy / FILE).unlink()
    with pytest.raises(InputError, match=r"is not a run folder: run.sqlite is missing"):
        resume(copy, generations=5)
    with pytest.raises(InputError, match="does not exist"):
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
            with pytest.raises(InputError, match=r"run\.sqlite: (is damaged|is not a Swarmwright run store)"):
                attempt(copy)
        assert store.read_bytes() == damage


@pytest.mark.parametrize("opening", [reopen, connect_to_read])
def test_definitions_of_tables_that_are_no_text_are_damage(
    copy: Path, opening: Callable[[Path], Any]
) -> None:
    """SQLite quotes them in a message, which Python cannot decode."""
    store = copy / FILE
    store.write_bytes(store.read_bytes().replace(b"CREATE TABLE event", b"CREATE \xffABLE event"))
    with pytest.raises(InputError, match=r"run\.sqlite: is damaged: the definitions of its tables"):
        opening(store)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("UPDATE fact SET value = '{' WHERE name = 'experiment'", r"run\.sqlite: is damaged"),
        (
            """UPDATE fact SET value = '{"simulation": "minisim", "sede": 1}' WHERE name = 'experiment'""",
            r"copy: the experiment in run\.sqlite cannot be used: sede: unknown key; did you mean 'seed'",
        ),
        ("UPDATE fact SET value = 'x' WHERE name = 'metrics'", r"run\.sqlite: is damaged"),
        ("UPDATE generation SET seeds = 'x'", r"run\.sqlite: is damaged"),
        (
            "UPDATE fact SET value = replace(hex(zeroblob(50000)), '0', '[') WHERE name = 'metrics'",
            r"run\.sqlite: is damaged: it is nested more than 100 deep",
        ),
        ("UPDATE generation SET seeds = replace(hex(zeroblob(50000)), '0', '[')", r"run\.sqlite: is damaged"),
        ("UPDATE block SET genomes = x'00'", r"run\.sqlite: is damaged"),
    ],
)
def test_damaged_values_are_named(copy: Path, damage: str, words: str) -> None:
    change(copy, damage)
    seal(copy)
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
        patch.setattr("swarmwright.runs.store.open_store.create", interrupted)
        with pytest.raises(SystemExit):
            optimize(EXPERIMENT, out=folder)
    words = (
        "another part of this process is just starting a run in this folder; choose another folder for a new "
        "run, or wait a moment to read this one"
    )
    assert said == [f"{folder}: {words}"] * 3
    with pytest.raises(
        InputError, match="ended within the first second, before anything was stored; start again"
    ):
        Run.open(folder)
    assert optimize(EXPERIMENT, out=folder).state == "done", "nothing is lost by beginning anew"


def test_missing_rows_are_noticed(copy: Path) -> None:
    change(copy, "DELETE FROM block WHERE generation = 1")
    with pytest.raises(InputError, match="is damaged: generation 1: 7 evaluations are missing"):
        resume(copy, generations=9)


@pytest.mark.parametrize(
    ("version", "words"),
    [
        (99, r"has format 99, .* update Swarmwright"),
        (2, r"has format 2, .*: swarmwright optimize .*experiment\.yaml --out NEW"),
    ],
)
def test_a_store_of_another_version_is_left_alone(copy: Path, version: int, words: str) -> None:
    with sqlite3.connect(copy / FILE) as store:
        store.execute(f"PRAGMA user_version = {version}")
    store.close()
    before = (copy / FILE).read_bytes()
    for attempt in (Run.open, resume):
        with pytest.raises(InputError, match=words):
            attempt(copy)
    assert (copy / FILE).read_bytes() == before


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT"
HOSTILE = {
    "a fact that is computed without end": (
        f"DROP TABLE fact; CREATE VIEW fact AS {ENDLESS} 'a' AS name, i AS value FROM n",
        "lacks the table fact",
    ),
    "generations without end": (
        f"DROP TABLE generation; CREATE VIEW generation AS {ENDLESS} i AS generation FROM n",
        "lacks the table generation",
    ),
    "a trigger": (
        "CREATE TRIGGER t AFTER INSERT ON generation BEGIN DELETE FROM fact; END",
        "has the trigger t, which",
    ),
    "another view": ("CREATE VIEW other AS SELECT 1", "has the view other"),
    "an index": ("CREATE INDEX i ON attempt (error)", "has the index i"),
    "a generated column": (
        "ALTER TABLE event ADD COLUMN x AS (zeroblob(100000000))",
        "defines the table event differently",
    ),
}


@pytest.mark.parametrize(("statements", "words"), HOSTILE.values(), ids=HOSTILE)
def test_a_store_with_another_schema_is_not_read(copy: Path, statements: str, words: str) -> None:
    with sqlite3.connect(copy / FILE) as store:
        store.executescript(statements)
    store.close()
    before = (copy / FILE).read_bytes()
    for attempt in (Run.open, resume):
        with pytest.raises(InputError, match=words):
            attempt(copy)
    assert run(["runs", "verify", str(copy)]) == 1
    assert run(["runs", "show", str(copy)]) == 2
    assert run(["runs", "list", str(copy.parent)]) in (0, 2)  # it is named, and the others are listed
    assert (copy / FILE).read_bytes() == before


def test_reading_a_store_can_be_interrupted(copy: Path) -> None:
    def read_for_ever() -> None:
        with reading(copy / FILE) as connection:
            threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]).start()
            connection.execute(f"{ENDLESS} max(i) FROM n").fetchone()

    with pytest.raises(KeyboardInterrupt):
        read_for_ever()


def test_a_pipe_in_the_place_of_a_store_is_not_opened(copy: Path) -> None:
    (copy / FILE).unlink()
    os.mkfifo(copy / FILE)
    with pytest.raises(InputError, match=r"run\.sqlite: is not a regular file"):
        StoreReader(copy)
    for attempt in (Run.open, resume, lambda folder: optimize(EXPERIMENT, out=folder)):
        with pytest.raises(InputError):
            attempt(copy)


def test_a_store_changed_by_hand_does_not_go_on(copy: Path) -> None:
    change_numbers(copy, "fitness", slice(0, 1), 1.0, generation=1)
    seal(copy)
    with pytest.raises(RunError, match="generation 1 is not reproducible here"):
        resume(copy, generations=9)


@pytest.mark.parametrize("column", ["fitness", "genomes"])
def test_a_steady_store_changed_by_hand_does_not_go_on(tmp_path: Path, column: str) -> None:
    method = {"operation": "steady_state", "population": 6, "generations": 3}
    steady = EXPERIMENT.replace(method=method, servers="in-process")
    folder = optimize(steady, out=tmp_path / "run").path
    change_numbers(folder, column, slice(0, 1), 1.0, generation=1)
    seal(folder)
    with pytest.raises(RunError, match="generation 1 is not reproducible here"):
        resume(folder, generations=9)


def test_what_a_killed_process_left_of_a_store_is_in_nobody_s_way(copy: Path) -> None:
    folder = copy.parent / "broken"
    folder.mkdir()
    shutil.copy(copy / FILE, folder / "run.sqlite.new")
    shutil.copy(copy / "experiment.yaml", folder)
    assert optimize(EXPERIMENT, lambda _: False, out=folder).generations == 1


def test_text_where_a_number_should_stand_is_damage(copy: Path) -> None:
    change(copy, "UPDATE generation SET best = CAST('' AS BLOB) WHERE generation = 1")
    with pytest.raises(InputError, match="is damaged: could not convert"):
        _ = Run.open(copy).history


def test_metrics_are_kept_for_each_episode(tmp_path: Path) -> None:
    experiment = EXPERIMENT.replace(fitness="arrived - 0.01 * steps")
    run = optimize(experiment, out=tmp_path / "run")
    metrics = run.record.metrics
    assert metrics.shape == (len(run.record.fitness), 2, len(run._store.metrics))
    best = run.evaluation()
    assert run.best.fitness == best.fitness
    assert (run.best.generation, run.best.candidate) == (best.generation, best.candidate)
    assert best.metrics.tolist() == metrics[best.number].tolist()
    arrived, steps = (run._store.metrics.index(name) for name in ("arrived", "steps"))
    expected = best.metrics[:, arrived] - 0.01 * best.metrics[:, steps]
    assert best.episodes.tolist() == expected.tolist()


def test_the_time_of_a_server_counts_once_and_a_slower_backup_is_no_failure(copy: Path) -> None:
    row = "(1, 0, '{mode}', 0, {count}, 0, 1, 1, 1, NULL, {started}, {seconds}, {ended}, NULL)"
    attempts = [
        ("offloaded", 10, 100.0, 4.0, "'done', NULL"),
        ("offloaded", 5, 102.0, 3.0, "'done', NULL"),  # beside the one before
        ("offloaded", 1, 100.0, 4.0, "'failed', 'it crashed'"),  # of the first ten
        ("offloaded", 5, 101.0, 1.0, "'overtaken', 'server 2 was faster'"),
        ("stepwise", 2, 110.0, 1.5, "'done', NULL"),
    ]
    rows = [
        row.format(mode=mode, count=count, started=started, seconds=seconds, ended=ended)
        for mode, count, started, seconds, ended in attempts
    ]
    change(copy, f"INSERT INTO attempt VALUES {', '.join(rows)}")
    (share,) = StoreReader(copy).servers()
    assert share == (1, 17, 1, 6.5, 1, True, 0, 0)
    said = CliRunner().invoke(program, ["runs", "show", str(copy)]).output
    assert (
        "server 1: 17 episodes (failed ones included), busy for 6.5 s, 1 attempt failed, 1 attempt stopped "
        "as "
        "another server was faster (backup)\n"
    ) in said


def test_incidents_name_the_servers_whose_work_was_copied(copy: Path) -> None:
    with StoreWriter.resume(copy) as store:
        store.begin("by servers")
        session = StoreReader(copy).sessions()[-1].session
        row = "({session}, 0, 'offloaded', 0, 1, 0, 1, {server}, 1, NULL, 0, 1, {ended}, NULL)"
        attempts = [
            (session, server, f"'overtaken', 'server {server + 1} was faster'")
            for server in (3, 4, 3, 5, 3, 4, 6)
        ]
        attempts += [
            (session - 1, 7, "'overtaken', 'server 1 was faster'"),
            (session, 8, "'failed', 'it crashed'"),
            (session, 8, "'done', NULL"),
        ]
        rows = [
            row.format(session=session, server=server, ended=ended) for session, server, ended in attempts
        ]
        change(copy, f"INSERT INTO attempt VALUES {', '.join(rows)}")
        store.incidents({"retries": 1, "backups": 9, "audits_left_out": 2})
    assert [event.text for event in StoreReader(copy).events() if event.kind == "incidents"][-1] == (
        "retries: 1, backups: 9 (repeated work of slow servers, of which the first result "
        "counted; slower were 3 attempts of server 3, 2 attempts of server 4, 1 attempt of server 5 and "
        "others), audits left out: 2"
    )


def test_attempts_that_failed_are_counted_by_reason_and_server(copy: Path) -> None:
    """Reasons that differ in numbers or paths alone are one; where another server was faster is none."""
    row = "(1, 0, 'stepwise', 0, 1, 0, 1, {server}, 1, NULL, 0, 1, '{outcome}', '{error}', NULL)"
    aborted = "sim: was ended by SIGABRT; its files: /tmp/instance-{}/failed-1"
    errors = [(server, "failed", aborted.format(server)) for server in (1, 2, 1, 1)]
    errors += [(2, "failed", "sim: ended with exit status 3"), (2, "overtaken", "server 1 was faster")]
    rows = [row.format(server=server, outcome=outcome, error=error) for server, outcome, error in errors]
    change(copy, f"INSERT INTO attempt VALUES {', '.join(rows)}")
    reasons = StoreReader(copy).failures()
    assert [tuple(reason) for reason in reasons] == [
        (aborted.format(1), 4, {1: 3, 2: 1}, 0),
        ("sim: ended with exit status 3", 1, {2: 1}, 0),
    ]
    said = CliRunner().invoke(program, ["runs", "show", str(copy)]).output
    assert f"  4 attempts (server 1: 3, server 2: 1): {aborted.format(1)}\n" in said
    assert "  1 attempt (server 2: 1): sim: ended with exit status 3\n" in said


def test_attempts_that_servers_hand_back_to_share_them_did_not_fail(copy: Path) -> None:
    row = "(1, 0, 'offloaded', 0, 9, 0, 1, {server}, 1, NULL, 0, 1, '{outcome}', '{error}', NULL)"
    turn = "it is the turn of swarmwright@lab/{}/ab"
    back = [(server, "handed_back", turn.format(tool)) for server, tool in ((7, 1), (7, 2), (8, 1))]
    ended = [*back, (7, "failed", "no licence")]
    rows = [row.format(server=server, outcome=outcome, error=error) for server, outcome, error in ended]
    change(copy, f"INSERT INTO attempt VALUES {', '.join(rows)}")
    said = CliRunner().invoke(program, ["runs", "show", str(copy)]).output
    assert (
        "server 7: 0 episodes (failed ones included), busy for 1.0 s, 1 attempt failed, 2 attempts " in said
    )
    assert "server 8: 0 episodes, busy for 1.0 s, 1 attempt handed back for another tool\n" in said
    assert "failed attempts by reason:\n  1 attempt (server 7: 1): no licence\n" in said
    assert "it is the turn" not in said


def test_attempts_that_are_lost_with_a_server_are_listed_apart(copy: Path) -> None:
    """A server that ends takes all its attempts with it; one of them counts as failed."""
    row = "(1, 0, 'offloaded', {first}, {count}, 0, 1, {server}, 1, NULL, {at}, {took}, {ended}, NULL)"
    crash = "a simulation server was killed by SIGSEGV in step (own.py:14)"
    failed, lost = f"'server_failed', '{crash}'", f"'lost', '{crash}'"
    attempts = [
        (0, 25, 1, 1_700_000_000.0, 1.5, lost),  # of which the next is a part
        (12, 1, 1, 1_700_000_000.0, 1.5, failed),
        (38, 6, 1, 1_700_000_000.5, 1.0, lost),  # waited for the batch before
        (12, 1, 2, 1_700_000_003.0, 0.5, failed),
        (38, 6, 2, 1_700_000_003.0, 0.5, lost),
        (12, 1, 1, 1_700_000_004.0, 0.5, failed),  # the same server, at another time
        (50, 2, 3, 1_700_000_005.0, 1.0, "'server_failed', 'server 3 left'"),
        (52, 2, 3, 1_700_000_005.0, 1.0, "'lost', 'server 3 left'"),
        (60, 1, 1, 1_700_000_006.0, 1.0, "'failed', 'no licence'"),  # of one answer: both failed
        (61, 1, 1, 1_700_000_006.0, 1.0, "'failed', 'no licence'"),
        (62, 1, 4, 1_700_000_007.0, 1.0, "'lost', 'server 1 was faster'"),  # with another that was ended
    ]
    rows = [
        row.format(first=first, count=count, server=server, at=at, took=took, ended=ended)
        for first, count, server, at, took, ended in attempts
    ]
    change(copy, f"INSERT INTO attempt VALUES {', '.join(rows)}")
    store = StoreReader(copy)
    assert [tuple(reason) for reason in store.failures()] == [
        (crash, 3, {1: 2, 2: 1}, 3),
        ("no licence", 2, {1: 2}, 0),
        ("server 3 left", 1, {3: 1}, 1),
    ]
    assert [(one.server, one.failed, one.lost) for one in store.servers()] == [
        (1, 4, 2),
        (2, 1, 1),
        (3, 1, 1),
        (4, 0, 1),
    ]
    said = CliRunner().invoke(program, ["runs", "show", str(copy)]).output
    assert (
        f"  3 attempts (server 1: 2, server 2: 1): {crash}\n"
        "    3 attempts at other evaluations, lost with the server and repeated\n"
    ) in said
    assert "4 attempts failed, 2 more lost with it\n" in said


def test_a_warning_has_the_time_at_which_it_arose(copy: Path) -> None:
    run = Run.open(copy)
    warnings = [WarningEntry("early", time=1_700_000_000.25), WarningEntry("some time")]
    with StoreWriter.resume(copy) as store:
        store.begin("in this process")
        store.note(run.generations, Journal([], warnings))
    early, other = (event for event in StoreReader(copy).events() if event.kind == "warning")
    assert early.time == "2023-11-14T22:13:20.250+00:00"
    assert other.time > early.time


def test_an_attempt_that_ended_in_no_known_way_is_damage(copy: Path) -> None:
    row = "(1, 0, 'stepwise', 0, 1, 0, 1, 7, 1, NULL, 0, 1, 'x' || char(27), NULL, NULL)"
    change(copy, f"INSERT INTO attempt VALUES {row}")
    with pytest.raises(InputError, match="is damaged"):
        list(StoreReader(copy).attempts())
