"""What servers did when, from the attempts in the store."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from swarmwright import InputError, Run, optimize
from swarmwright.runs.timeline import timeline, waiting
from tests.python.records import EXPERIMENT, write_attempts


@pytest.fixture(scope="module")
def run(finished: Run, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run whose attempts are known: 100 s from 1,000,000 on."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    shutil.copytree(finished.path, folder)
    write_attempts(folder)
    return Run(folder)


def test_time_at_work_counts_once_and_lies_in_its_bins(run: Run) -> None:
    shown = timeline(run, bins=10)
    assert (shown.started, shown.seconds) == (1_000_000, 100)
    assert shown.timing.servers == (7, 9)
    np.testing.assert_allclose(shown.timing.busy[0], [10, 5, 0, 0, 0, 0, 0, 0, 0, 10], atol=1e-6)
    np.testing.assert_allclose(shown.timing.busy[1], [10, 10, 10, 10, 0, 0, 5, 0, 0, 0], atol=1e-6)
    assert shown.timing.episodes.tolist()[0] == [0, 16, 0, 0, 0, 0, 0, 0, 0, 8]
    assert shown.timing.evaluated.sum() == pytest.approx(run.evaluations)


def test_failures_have_their_reasons_and_their_candidates(run: Run) -> None:
    (failures,) = timeline(run, bins=10).timing.failures
    assert (failures.server, failures.bin, failures.attempts) == (9, 6, 2)
    assert (failures.reason, failures.generation, failures.candidate) == ("out of fuel", 1, 3)


def test_the_last_answer_of_a_generation_is_waited_for(run: Run) -> None:
    assert waiting(run) == {9: (1, 25.0)}


def test_a_part_of_a_session(run: Run) -> None:
    shown = timeline(run, 1, begin=50, end=100, bins=5)
    np.testing.assert_allclose(shown.timing.busy, [[0, 0, 0, 0, 10], [0, 5, 0, 0, 0]], atol=1e-6)
    assert shown.timing.episodes.sum() == 8


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"session": 5}, "has no session 5"),
        ({"begin": 3.0, "end": 3.0}, "must be ascending seconds"),
        ({"end": float("nan")}, "must be ascending seconds"),
        ({"end": float("inf")}, "must be ascending seconds"),
        ({"bins": 0}, "bins: must be from 1"),
    ],
)
def test_parts_that_do_not_exist_are_refused(run: Run, options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        timeline(run, **options)  # type: ignore[arg-type]


def test_a_run_in_its_own_process_has_its_generations(tmp_path: Path) -> None:
    run = optimize(EXPERIMENT, servers="in-process", out=tmp_path / "run")
    shown = timeline(run)
    assert shown.timing.servers == ()
    assert shown.timing.evaluated.sum() == pytest.approx(run.evaluations)
