"""Failed episodes are named in the journal, whatever counts the candidates."""

from pathlib import Path

import numpy as np
import pytest

from swarmwright.evaluation.base import Results
from swarmwright.optimization.failures import Failures
from swarmwright.store import Journal, WarningEntry
from swarmwright.store.rows import AttemptEntry


def attempt(
    candidate: int, episode: int, number: int, error: str | None, candidates: int = 1
) -> AttemptEntry:
    return AttemptEntry(
        "offloaded", candidate, candidates, episode, 1, 1, number, None, 0.0, 1.0, error, None
    )


def results(fitness: list[list[float]], *attempts: AttemptEntry) -> Results:
    warnings = [
        WarningEntry("an evaluation failed after 3 attempts: no licence"),
        WarningEntry("server 2 is slow"),
    ]
    values = np.array(fitness)
    return Results(values, np.empty((*values.shape, 0)), Journal(list(attempts), warnings))


def test_candidate_episode_and_seed_are_named(caplog: pytest.LogCaptureFixture) -> None:
    failures = Failures(Path("/runs/my run"))
    tried = [attempt(0, 0, 1, "busy"), attempt(0, 0, 2, None), attempt(0, 1, 1, None)]
    tried += [attempt(1, 1, number, "no licence") for number in (1, 2, 3)]
    found = failures.named(results([[1.0, 2.0], [3.0, np.nan]], *tried), [17, 18], generation=4)
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
        "evaluate '/runs/my run' --generation 4 --candidate 1; the others: swarmwright runs show "
        "'/runs/my run'"
    )


def test_candidates_that_are_counted_over_the_run(caplog: pytest.LogCaptureFixture) -> None:
    failures = Failures(Path("run"))
    given = results([[np.nan], [0.5]], attempt(7, 0, 1, "broke"), attempt(9, 0, 1, None))
    found = failures.named(given, [3], rows={7: 0, 9: 1})
    assert found.journal.warnings[-1] == WarningEntry("episode 0 (seed 3) failed after 1 attempt: broke", 7)
    failures.tell()
    assert "candidate 7, episode 0 (seed 3) failed after 1 attempt; repeat it: " in caplog.text
    assert "--generation" not in caplog.text


def test_many_failures_are_counted() -> None:
    given = results([[np.nan]] * 25, attempt(0, 0, 3, "broke", candidates=25))
    warnings = Failures(Path("run")).named(given, [0], generation=0).journal.warnings
    assert [one.candidate for one in warnings] == [None, *range(10), None]
    assert warnings[-1].text == "15 more episodes of this generation failed as well"


def test_nothing_is_added_where_a_race_has_dropped_a_candidate() -> None:
    given = results([[1.0, np.nan]], attempt(0, 0, 1, None))
    assert Failures(Path("run")).named(given, [0, 1], generation=0) is given
