"""The first difference between two runs."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from swarmwright import InputError, Run, optimize
from swarmwright.runs import differences
from swarmwright.runs.differences import find_first_difference
from swarmwright.runs.export import csv_lines
from tests.python.records import EXPERIMENT


def refused(*_: object) -> None:
    pytest.fail("the records were compared")


@pytest.mark.slow
def test_runs_with_the_same_digests_are_compared_by_these(
    finished: Run, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(differences, "csv_lines", refused)
    assert find_first_difference(finished, Run.open(copy)) is None


def test_a_run_that_goes_on_after_another(
    finished: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shorter = optimize(EXPERIMENT, lambda now: now.generation < 1, out=tmp_path / "shorter")
    words = f"{shorter.path} ends after {shorter.evaluations} evaluations, but {finished.path} continues"
    read = list(csv_lines(finished._store))
    assert len(read) > shorter.evaluations + 1
    monkeypatch.setattr(differences, "csv_lines", refused)
    for one, other in ((shorter, finished), (finished, shorter)):
        assert find_first_difference(one, other) == words
    monkeypatch.undo()
    monkeypatch.setattr(differences, "_begin_equally", lambda *_: False)
    assert find_first_difference(shorter, finished) == words


def test_damage_below_equal_digests_is_found(finished: Run, copy: Path) -> None:
    with closing(sqlite3.connect(copy / "run.sqlite")) as store:
        store.execute("UPDATE block SET fitness = zeroblob(length(fitness)) WHERE generation = 1")
        store.commit()
    with pytest.raises(InputError, match="is damaged: generation 1: the table block does not match"):
        find_first_difference(finished, Run.open(copy))


def test_other_runs_differ_in_a_value(finished: Run, tmp_path: Path) -> None:
    other = optimize(EXPERIMENT.replace(seed=EXPERIMENT.seed + 1), out=tmp_path / "other")
    assert "in generation 0, candidate 0 (evaluation 0), " in (find_first_difference(finished, other) or "")


def test_a_run_without_a_generation(finished: Run, copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that was killed in its first."""
    empty = Run.open(copy)
    monkeypatch.setattr(Run, "generations", property(lambda run: 0 if run is empty else run._store.finished))
    for one, other in ((empty, finished), (finished, empty)):
        assert find_first_difference(one, other) == f"{empty.path} has no finished generation"
