"""Candidates that bring down the servers that a run started, or make them hang."""

import os
import re
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, Run, RunError, evaluate, optimize, resume
from tests.python.servers.supervision import poison

FILE = poison.__file__


def experiment(kind: str, **changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": f"{FILE}:{kind}",
            "controller": {"hidden": []},
            "method": {"kind": "random_search", "population": 20, "generations": 3},
            "seed": 1,
            **changes,
        }
    )


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The record without any trouble."""
    return optimize(experiment("Sound"), servers="in-process", out=tmp_path_factory.mktemp("sound") / "run")


def poisoned(run: Run) -> list[int]:
    return np.flatnonzero(np.isnan(run.record.fitness)).tolist()


def as_sound_otherwise(run: Run, sound: Run) -> None:
    bad = poisoned(run)
    assert 0 < len(bad) < 6
    others = np.setdiff1d(np.arange(len(run.record.fitness)), bad)
    assert run.record.fitness[others].tobytes() == sound.record.fitness[others].tobytes()
    assert run.record.genomes.tobytes() == sound.record.genomes.tobytes()


@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.parametrize(("mode", "servers"), [("stepwise", 1), ("batched", 1), ("batched", 2)])
def test_crashes_of_episodes_that_are_stepped(mode: str, servers: int, sound: Run, tmp_path: Path) -> None:
    """The server was at work: it is started again however often."""
    run = optimize(experiment("Leave", mode=mode), servers=servers, out=tmp_path / "run")
    as_sound_otherwise(run, sound)


@pytest.mark.journey
@pytest.mark.timeout(120)
def test_a_crash_costs_the_candidate_and_nothing_else(
    sound: Run, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = optimize(experiment("Crash"), servers=2, out=tmp_path / "two")
    as_sound_otherwise(run, sound)
    attempts = [attempt for attempt in run.attempts() if attempt.error]
    assert len(attempts) >= 3 * len(poisoned(run))
    bad = {(attempt.generation, attempt.candidate) for attempt in attempts if attempt.candidates == 1}
    # Others may have waited on a server that went down.
    assert bad >= {divmod(number, 20) for number in poisoned(run)}
    line = Path(FILE).read_text().splitlines().index("        ctypes.string_at(0)") + 1
    assert f"was killed by SIGSEGV in poison ({os.path.relpath(FILE)}:{line})" in str(attempts[0].error)
    (stack,) = {attempt.stack for attempt in attempts if attempt.stack}
    assert "Segmentation fault" in stack
    assert "string_at" in stack
    assert "about to crash" in stack
    incidents = [event.text for event in run.events() if event.kind == "incidents"]
    assert f"quarantined: {len(poisoned(run))}" in incidents[0]
    crashes = [attempt for attempt in attempts if attempt.outcome == "server_failed"]
    assert f"server failures: {len(crashes)}" in incidents[0], (
        "of the attempts on a server that crashed, one is to blame"
    )
    named = [(event.generation, event.text) for event in run.events() if "is quarantined" in event.text]
    places = [divmod(number, 20) for number in poisoned(run)]
    assert [generation for generation, _ in named] == [generation for generation, _ in places]
    for (_, candidate), (_, text) in zip(places, named, strict=True):
        assert text.startswith(f"candidate {candidate}, episode 0 (seed 0) failed after ")
        assert " and is quarantined, since servers failed 3 times " in text

    # The same record from workers, and from a run that is cut short and resumed with other servers.
    workers = optimize(experiment("Crash"), servers="local", out=tmp_path / "workers")
    assert workers.digest == run.digest
    begun = optimize(experiment("Crash"), lambda _: False, servers="local", out=tmp_path / "begun")
    assert resume(begun, servers=3).digest == run.digest
    assert not [one for one in caplog.messages if "given up" in one]


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_a_hang_costs_the_candidate_and_nothing_else(sound: Run, tmp_path: Path) -> None:
    one = experiment("Hang", timeouts={"step": 1}, faults={"quarantine": 2})
    run = optimize(one, servers="local", out=tmp_path / "run")
    as_sound_otherwise(run, sound)
    errors = [str(attempt.error) for attempt in run.attempts() if attempt.error]
    assert any(
        re.search(r"made no step for 1 s in poison \(.*poison.py:\d+\) and was ended", e) for e in errors
    )


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched"])
@pytest.mark.timeout(120)
def test_other_modes(mode: str, sound: Run, tmp_path: Path) -> None:
    one = experiment("Hang", mode=mode, timeouts={"step": 1}, faults={"quarantine": 1, "backup": False})
    as_sound_otherwise(optimize(one, servers=2, out=tmp_path / "hang"), sound)
    one = experiment("Crash", mode=mode, faults={"quarantine": 1})
    as_sound_otherwise(optimize(one, servers=2, out=tmp_path / "crash"), sound)


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_the_exit_status_is_told(sound: Run, tmp_path: Path) -> None:
    run = optimize(experiment("Leave"), servers="local", out=tmp_path / "run")
    as_sound_otherwise(run, sound)
    assert any("ended with status 7" in str(attempt.error) for attempt in run.attempts())


def test_sys_exit_ends_an_episode_not_the_server(sound: Run, tmp_path: Path) -> None:
    run = optimize(experiment("Exit"), servers="in-process", out=tmp_path / "run")
    as_sound_otherwise(run, sound)
    line = Path(FILE).read_text().splitlines().index("        sys.exit(3)") + 1
    texts = [event.text for event in run.events()]
    assert any(re.search(rf"Exit.step: SystemExit: 3 \(.*poison.py:{line}\)", text) for text in texts)
    failed = len(poisoned(run))
    assert f"retries: {2 * failed}, failed: {failed}" in texts, "said as servers say it"


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_servers_that_others_kill_are_no_candidates_failure(tmp_path: Path) -> None:
    one = experiment("Slow", method={"kind": "random_search", "population": 12, "generations": 2})
    killed: list[int] = []

    def kill(done: int, _total: int, _waiting: str) -> None:
        from swarmwright.servers.supervision.local_servers import _running

        if done >= 3 * len(killed) and len(killed) < 4:
            (servers,) = _running.values()
            if pids := servers.pids:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

    run = optimize(one, servers=2, on_progress=kill, out=tmp_path / "run")
    assert len(killed) == 4
    assert not np.isnan(run.record.fitness).any()
    expected = evaluate(experiment("Sound"), run.record.genomes, servers="in-process")
    assert run.record.fitness.tobytes() == expected.tobytes()


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_a_server_that_cannot_be_started_again_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RunError, match=r"(?s)all simulation servers have failed.*licence server"):
        optimize(experiment("Unstartable"), servers=1, out=tmp_path / "run")


@pytest.mark.slow
def test_what_is_printed_is_in_the_log_with_its_candidate(tmp_path: Path, program: Any) -> None:
    (tmp_path / "talk.yaml").write_text(
        f"simulation: {FILE}:Talk\ncontroller: {{hidden: []}}\nseed: 1\n"
        "method: {kind: random_search, population: 20, generations: 3}\n"
    )
    done = program("optimize", "talk.yaml", "--servers", "2", "--out", "run", "--server-output")
    assert done.returncode == 0, done.stderr
    log = (tmp_path / "run" / "servers.log").read_text()
    crashed = optimize(experiment("Exit"), servers="in-process", out=tmp_path / "exit")
    generation, candidate = divmod(poisoned(crashed)[0], 20)
    for text in ("printed", "logged", "UserWarning: warned"):
        assert re.search(rf"server \d, candidate {generation}:{candidate}, episode 0: .*{text}\n", log), log
    assert re.search(r"server \d: written\n", log)
    assert "printed" in done.stderr
    assert ": printed" not in done.stdout
    assert "servers.log" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("operation", ["generational", "steady_state"])
def test_what_is_printed_in_the_post_evaluation_is_no_generation_s(tmp_path: Path, operation: str) -> None:
    method = {"kind": "random_search", "population": 4, "generations": 3, "operation": operation}
    told = experiment("Tell", method=method, validate={"episodes": 6, "candidates": 1}, faults={"audit": 0})
    run = optimize(told, servers=1, out=tmp_path / "run")
    log = (run.path / "servers.log").read_text().splitlines()
    of_it = [re.findall(r"server \d+, post-evaluation, episode (\d+): seed (\d+)$", line) for line in log]
    assert run.unseen is not None
    found = sorted((int(e), int(s)) for [(e, s)] in filter(None, of_it))
    assert found == sorted(enumerate(run.unseen.seeds))
    others = [line for line, found in zip(log, of_it, strict=True) if not found]
    number = r"\d+" if operation == "steady_state" else r"[012]:[0123]"
    assert len(others) == 12
    assert all(re.search(rf"candidate {number}, episode 0: seed \d+$", line) for line in others), others
