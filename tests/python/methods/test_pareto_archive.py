"""Archives of Pareto coevolution: which champions they keep."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmwright.methods.archive import dominates
from swarmwright.methods.pareto_archive import ParetoArchive

POINTS = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=12)


def compare_on_one(first: tuple[int, ...], second: tuple[int, ...]) -> float:
    """Play the numbers game of de Jong 2007: the largest dimension of the second decides."""
    decisive = int(np.argmax(second))
    return 1.0 if first[decisive] >= second[decisive] else -1.0


def fill(points: list[tuple[int, ...]], largest: int) -> ParetoArchive:
    """Submit points one by one; each is learner and test."""
    archive = ParetoArchive(largest)
    for generation, point in enumerate(points):
        outcomes = {
            (generation, test): compare_on_one(point, points[test]) for test in [*archive.tests, generation]
        }
        outcomes |= {
            (learner, generation): compare_on_one(points[learner], point) for learner in archive.learners
        }
        archive.update(generation, outcomes)
    return archive


def outcomes_of(points: list[tuple[int, ...]], archive: ParetoArchive) -> NDArray[np.float64]:
    rows = [[compare_on_one(points[row], points[test]) for test in archive.tests] for row in archive.learners]
    return np.array(rows, dtype=np.float64).reshape(len(archive.learners), len(archive.tests))


@given(POINTS, st.integers(1, 5))
def test_it_has_a_limit(points: list[tuple[int, ...]], largest: int) -> None:
    archive = fill(points, largest)
    assert 1 <= len(archive.learners) <= largest
    assert len(archive.tests) <= largest
    assert archive.learners == sorted({*archive.learners})
    assert archive.tests == sorted({*archive.tests})


@given(POINTS)
def test_its_tests_tell_all_learners_apart(points: list[tuple[int, ...]]) -> None:
    """With enough of them, no two learners have the same outcomes against the tests."""
    archive = fill(points, 100)
    outcomes = outcomes_of(points, archive)
    assert len(np.unique(outcomes, axis=0)) == len(archive.learners)


@given(POINTS)
def test_a_champion_that_dominates_all_others_stays(points: list[tuple[int, ...]]) -> None:
    archive = fill([*points, (5, 5, 5), *points], 100)
    assert len(points) in archive.learners
    outcomes = outcomes_of([*points, (5, 5, 5), *points], archive)
    assert not dominates(outcomes)[:, archive.learners.index(len(points))].any()


def test_learners_that_failed_come_last() -> None:
    archive = ParetoArchive(1)
    archive.update(0, {(0, 0): 1.0})
    archive.update(1, {(0, 1): 1.0, (1, 0): np.nan})
    assert archive.learners == [0]


def test_of_equal_learners_the_first_is_kept() -> None:
    assert fill([(1, 1, 1)] * 5, 100).learners == [0]
