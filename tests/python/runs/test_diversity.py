import time
from pathlib import Path

import numpy as np
import pytest

from swarmwright.runs.diversity import _disagreement, diversity
from tests.python.analysis.runs import KnownRun

SIZE = 13  # genes of 4-2-1


def test_the_first_generation_is_one_and_equal_candidates_are_none(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    first = random.standard_normal((8, SIZE))
    half = first.mean(axis=0) + (first - first.mean(axis=0)) / 2
    same = np.tile(first[0], (8, 1))
    run = KnownRun(tmp_path, [[0.0] * 8] * 3, genomes=np.concatenate([first, half, same]))
    assert diversity(run) == pytest.approx([1.0, 0.5, 0.0], abs=1e-6)


def test_genes_count_by_their_own_spread(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    first, second = random.standard_normal((2, 50, SIZE))
    second *= 0.3
    units = 10.0 ** np.arange(-6, SIZE - 6)
    plain = diversity(KnownRun(tmp_path, [[0.0] * 50] * 2, genomes=np.concatenate([first, second])))
    scaled = diversity(KnownRun(tmp_path, [[0.0] * 50] * 2, genomes=np.concatenate([first, second]) * units))
    assert scaled == pytest.approx(plain, rel=1e-3)


def test_one_candidate_has_none_and_equal_beginnings_are_no_division_by_zero(tmp_path: Path) -> None:
    run = KnownRun(tmp_path, [[0.0], [0.0]])
    assert np.isnan(diversity(run)).all()
    first = np.zeros((4, SIZE))
    second = np.eye(4, SIZE)
    run = KnownRun(tmp_path, [[0.0] * 4] * 2, genomes=np.concatenate([first, second]))
    assert diversity(run)[0] == 0
    assert diversity(run)[1] > 0


def test_choices_differ_or_do_not() -> None:
    genomes = np.array([[1, 5, 0], [1, 6, 0], [1, 7, 1], [1, 8, 1]], dtype=np.float32)
    # No gene 0, every gene 1, four of six pairs of gene 2.
    assert _disagreement(genomes) == pytest.approx((0 + 1 + 4 / 6) / 3)


def test_it_is_cheap(tmp_path: Path) -> None:
    genomes = np.random.default_rng(1).standard_normal((3000, 1000), dtype=np.float32)
    run = KnownRun(tmp_path, [[0.0] * 1000] * 3, genomes=genomes, controller={"hidden": [2]})
    began = time.process_time()
    assert diversity(run) == pytest.approx([1, 1, 1], abs=0.1)
    assert time.process_time() - began < 3
