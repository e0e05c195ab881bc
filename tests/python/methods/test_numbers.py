"""What libraries are told, and what becomes of their points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri

from swarmwright.core.random_numbers import Streams
from swarmwright.methods._numbers import FAILED, costs, costs_near, rounded
from swarmwright.testing._samples import BoundedGenes

GOLDEN = ["-0x1.d5ffc7a2b4345p-2", "-0x1.c4224067a3ed1p-2", "0x1.95f69df403427p+0", "-0x1.0bd9106487adbp+1"]
FITNESS = st.lists(
    st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.just(float("nan"))), min_size=1, max_size=8
)


@given(FITNESS)
def test_costs_are_in_the_order_of_fitness_and_finite(values: list[float]) -> None:
    fitness = np.array(values)
    told = costs(fitness)
    assert np.isfinite(told).all()
    assert np.isfinite(told.sum() - told.min())
    for one, cost in zip(fitness, told, strict=True):
        for other, another in zip(fitness, told, strict=True):
            if one > other:
                assert cost <= another
            if np.isnan(one) and not np.isnan(other):
                assert cost > another


@given(st.floats(-1e100, 1e100))
def test_costs_of_usual_size_are_minus_the_fitness(value: float) -> None:
    assert costs(np.array([value])).tolist() == [-value]


def test_costs_of_enormous_fitness() -> None:
    told = costs(np.array([1e300, 1e101, 1e100, 0.0, -1e300, np.nan, -1.7e308]))
    assert told[:5] == pytest.approx([-201e100, -2e100, -1e100, 0.0, 201e100], rel=1e-12)
    assert told[4] < told[6] < told[5] == FAILED


def test_failed_candidates_come_just_behind_the_worst() -> None:
    told = costs_near(np.array([3.0, np.nan, -2.0, np.nan]))
    assert told.tolist() == [-3.0, np.nextafter(2.0, 3.0), 2.0, np.nextafter(2.0, 3.0)]


def test_points_become_genomes_within_bounds() -> None:
    subject = BoundedGenes()
    points = np.array([np.full(12, 1e300), np.full(12, -1e300), np.full(12, 0.1)])
    genomes = rounded(points, subject)
    lower, upper = subject.bounds
    assert genomes.dtype == np.float32
    assert np.isfinite(genomes).all()
    assert ((lower <= genomes) & (genomes <= upper)).all()
    assert genomes[2, 0] == np.float32(0.1)


def test_normal_numbers_are_normal() -> None:
    shares = Streams(1, "x", 0, [0, 1]).units(100_000) + 2.0**-54
    drawn = Streams(1, "x", 0, [0, 1]).normals(100_000)
    assert drawn == pytest.approx(ndtri(shares), rel=1e-13, abs=1e-14)
    assert drawn.mean() == pytest.approx(0, abs=0.01)
    assert drawn.std() == pytest.approx(1, abs=0.01)


def test_normal_numbers_are_the_same_bits_everywhere() -> None:
    # Written down once; no function of a C library is in between.
    found = [value.hex() for value in Streams(7, "golden", 0, [0]).normals(4)[0].tolist()]
    assert found == GOLDEN
