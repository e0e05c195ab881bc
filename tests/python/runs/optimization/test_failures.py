"""Failed episodes are named in the journal, whatever counts the candidates."""

import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, RunError, optimize, resume
from swarmwright.common.engine_types import FailedEvaluation, Outcome
from swarmwright.runs.optimization.failures import Failures
from swarmwright.servers.evaluation.base import Results
from swarmwright.servers.evaluation.evaluate import log_failures
from swarmwright.servers.rows import AttemptEntry, Journal, WarningEntry

FRAGILE = """\
import numpy as np
from swarmwright import Simulation

class Fragile(Simulation):
    title, dimensions, sensors, actuators = "fragile", 1, 1, 1

    def reset(self, parameters, seed):
        self.x = 0.0
        return np.array([[1.0]])

    def step(self, actions):
        self.x = float(actions[0, 0])
        if self.x > 0.5:
            raise ValueError("the wheel came off")
        return np.array([[self.x]])

    def done(self):
        return self.x != 0.0

    def fitness(self):
        return self.x
"""


def attempt(
    candidate: int,
    episode: int,
    number: int,
    error: str | None,
    candidates: int = 1,
    outcome: Outcome | None = None,
) -> AttemptEntry:
    ended = outcome or ("done" if error is None else "failed")
    return AttemptEntry(
        "offloaded", candidate, candidates, episode, 1, 1, number, None, 0.0, 1.0, ended, error, None
    )


def given_up(candidate: int, episode: int, quarantined: int | None = None) -> FailedEvaluation:
    return {"candidate": candidate, "episode": episode, "quarantined": quarantined}


def results(fitness: list[list[float]], *attempts: AttemptEntry) -> Results:
    warnings = [
        WarningEntry("an evaluation failed after 3 attempts: no licence", 1, failed=given_up(1, 1)),
        WarningEntry("server 2 is slow"),
    ]
    values = np.array(fitness)
    return Results(values, np.empty((*values.shape, 0)), Journal(list(attempts), warnings))


def test_attempts_that_were_cancelled_did_not_fail(caplog: pytest.LogCaptureFixture) -> None:
    tried = [attempt(0, 0, 1, "server 2 was faster", outcome="overtaken"), attempt(0, 0, 2, None)]
    journal = Journal([*tried, attempt(1, 0, 1, "no licence")], [])
    assert journal.errors == ["no licence"]
    backend: Any = None  # of no kind that tells by itself
    log_failures(backend, Results(np.ones((2, 1)), np.empty((2, 1, 0)), journal))
    assert caplog.messages == ["an episode failed: no licence"]


def test_candidate_episode_and_seed_are_named(caplog: pytest.LogCaptureFixture) -> None:
    failures = Failures(Path("/runs/my run"))
    tried = [attempt(0, 0, 1, "busy"), attempt(0, 0, 2, None), attempt(0, 1, 1, None)]
    tried += [attempt(1, 1, number, "no licence") for number in (1, 2, 3)]
    found = failures.add_warnings(results([[1.0, 2.0], [3.0, np.nan]], *tried), [17, 18], generation=4)
    assert [(one.text, one.candidate) for one in found.journal.warnings] == [
        ("server 2 is slow", None),
        ("episode 1 (seed 18) failed after 3 attempts: no licence", 1),
    ]
    assert found.journal.attempts == tried
    assert not caplog.messages
    for _ in range(2):
        failures.tell()
    (hint,) = caplog.messages
    assert hint == (
        "generation 4, candidate 1, episode 1 (seed 18) failed after 3 attempts; repeat it: swarmwright "
        "evaluate '/runs/my run' --candidate 4:1; all failures: swarmwright runs show '/runs/my run'"
    )


def test_attempts_at_a_candidate_are_counted_with_their_copies_and_without_those_lost_at_others() -> None:
    """Copies on two servers have one number; what waited at a server that failed is no attempt."""
    crash = "a simulation server was killed by SIGSEGV in step (own.py:14)"
    whole = attempt(0, 0, 1, crash, candidates=2, outcome="lost")
    first = attempt(0, 0, 1, crash, outcome="server_failed")._replace(stack="line 14 in step")
    waited = attempt(1, 0, 1, crash, outcome="lost")
    copied = [one._replace(server=2, stack=None) for one in (whole, first, waited)]
    overtaken = attempt(0, 0, 2, "server 2 was faster", outcome="overtaken")
    again = [
        attempt(0, 0, 2, crash, outcome="server_failed")._replace(server=3),
        attempt(1, 0, 1, crash, outcome="lost")._replace(server=3),
    ]
    later = attempt(1, 0, 1, crash, outcome="server_failed")._replace(started=50.0)
    tried = [whole, first, waited, *copied, *again, later, overtaken]
    found = Failures(Path("run")).add_warnings(results([[np.nan], [np.nan]], *tried), [17])
    assert [one.text for one in found.journal.warnings[1:]] == [
        f"episode 0 (seed 17) failed after 3 attempts: {crash}",
        f"episode 0 (seed 17) failed after 1 attempt: {crash}",
    ]


def test_an_evaluation_in_quarantine_is_named(caplog: pytest.LogCaptureFixture) -> None:
    crash, hang = (
        f"a simulation server {what}" for what in ("was killed by SIGSEGV", "made no step for 1 s")
    )
    why = "servers failed 3 times while evaluating nothing else"
    tried = [attempt(0, 0, 3, hang), attempt(1, 0, 3, crash), attempt(2, 0, 3, crash)]
    given = results([[np.nan]] * 3, *tried)
    given.journal.warnings += [
        WarningEntry(f"an evaluation is quarantined: {why}", 1, failed=given_up(1, 0, quarantined=3)),
        WarningEntry("an evaluation failed after 3 attempts", 2, failed=given_up(2, 0)),
    ]
    failures = Failures(Path("run"))
    found = failures.add_warnings(given, [17], generation=4)
    assert [(one.text, one.candidate) for one in found.journal.warnings] == [
        ("server 2 is slow", None),
        (f"episode 0 (seed 17) failed after 3 attempts: {hang}", 0),
        (f"episode 0 (seed 17) failed after 3 attempts and is quarantined, since {why}: {crash}", 1),
        (f"episode 0 (seed 17) failed after 3 attempts: {crash}", 2),
    ]
    alone = results([[np.nan]], tried[1]._replace(candidate=0))
    alone.journal.warnings.append(given.journal.warnings[-2].shift(0, 0))
    failures = Failures(Path("run"))
    failures.add_warnings(alone, [17], generation=4)
    failures.tell()
    assert "episode 0 (seed 17) failed after 3 attempts and is quarantined; repeat it: " in caplog.text


def test_candidates_that_are_counted_over_the_run(caplog: pytest.LogCaptureFixture) -> None:
    failures = Failures(Path("run"))
    given = results([[np.nan], [0.5]], attempt(7, 0, 1, "broke"), attempt(9, 0, 1, None))
    found = failures.add_warnings(given, [3], rows={7: 0, 9: 1})
    add_warnings = WarningEntry("episode 0 (seed 3) failed after 1 attempt: broke", 7, time=1.0)
    assert found.journal.warnings[-1] == add_warnings, "at the end of its last attempt"
    failures.tell()
    assert "candidate 7, episode 0 (seed 3) failed after 1 attempt; repeat it: " in caplog.text
    assert "--generation" not in caplog.text
    failures = Failures(Path("run"))
    failures.add_warnings(given, [3], rows={7: 0, 9: 1}, first=20)
    caplog.clear()
    failures.tell()
    assert "candidate 27, episode 0 (seed 3) failed" in caplog.text
    assert "--candidate 27; " in caplog.text


@pytest.mark.slow
def test_a_run_that_goes_on_in_steady_state_counts_its_candidates_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "fragile.py").write_text(FRAGILE)
    experiment = Experiment.from_mapping(
        {
            "simulation": f"{tmp_path / 'fragile.py'}:Fragile",
            "method": {
                "kind": "random_search",
                "population": 20,
                "generations": 3,
                "operation": "steady_state",
                "in_flight": 2,
            },
            "servers": 1,
            "seed": 1,
        }
    )
    part = optimize(experiment, lambda _: False, out=tmp_path / "run")
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        run = resume(part)
    (hint,) = (line for line in caplog.messages if "repeat it" in line)
    add_warnings = re.match(r"candidate (\d+), episode 0 ", hint)
    assert add_warnings is not None
    number = int(add_warnings[1])
    assert number >= 20
    assert np.isnan(run.evaluation(number).fitness)
    assert f"--candidate {number}; " in hint


def test_many_failures_are_counted() -> None:
    given = results([[np.nan]] * 25, attempt(0, 0, 3, "broke", candidates=25))
    warnings = Failures(Path("run")).add_warnings(given, [0], generation=0).journal.warnings
    assert [one.candidate for one in warnings] == [None, *range(10), None]
    assert warnings[-1].text == "15 more episodes of this generation failed as well"


def test_nothing_is_added_where_a_race_has_dropped_a_candidate() -> None:
    given = results([[1.0, np.nan]], attempt(0, 0, 1, None))
    assert Failures(Path("run")).add_warnings(given, [0, 1], generation=0) is given


BROKEN = """
from swarmwright import Simulation

class Broken(Simulation):
    sensors = actuators = 1
    parameters = {"fails": 1}
    episodes = 0

    def reset(self, parameters, seed):
        self.fails, self.over = parameters["fails"], False
        Broken.episodes += 1
        return [[1.0]]

    def step(self, actions):
        if Broken.episodes <= self.fails:
            raise ValueError("a wheel came off")
        self.over = True
        return [[1.0]]

    def done(self):
        return self.over

    def fitness(self):
        return 1.0
"""


@pytest.mark.parametrize("fails", [2, 100])
def test_the_reason_of_failures_is_told_once(
    fails: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """By the error, where every candidate of the first generation fails."""
    (tmp_path / "broken.py").write_text(BROKEN)
    experiment = Experiment.from_mapping(
        {
            "simulation": f"{tmp_path}/broken.py:Broken",
            "parameters": {"fails": fails},
            "controller": {"hidden": [1]},
            "method": {"population": 8, "generations": 1},
        }
    )
    error = ""
    try:
        optimize(experiment, servers="in-process", out=tmp_path / "run")
    except RunError as raised:
        error = str(raised)
    told = [text for text in (*caplog.messages, error) if "a wheel came off" in text]
    assert len(told) == 1
    words = (
        "an episode failed: " if fails == 2 else "every candidate of generation 0 failed; the last reason: "
    )
    assert told[0].startswith(f"{words}Broken.step: ValueError: a wheel came off")
