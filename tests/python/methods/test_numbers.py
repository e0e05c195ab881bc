"""Normal numbers, and the limits of genes."""

import numpy as np
import pytest
from scipy.stats import kstest

from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.methods._numbers import limits
from swarmwright.testing._methods import BoundedGenes

GOLDEN = ["-0x1.f44acc0000000p-2", "0x1.f997b40000000p-1", "-0x1.def4be0000000p-1", "0x1.b7721e0000000p+0"]


def test_limits_of_genes_are_finite_binary32() -> None:
    lower, upper = limits(BoundedGenes())
    largest = float(np.finfo(np.float32).max)
    assert lower.tolist() == [0.0] * 9 + [2.0, -largest, -largest]
    assert upper.tolist() == [1.0] * 9 + [largest, -2.0, largest]


def test_normal_numbers_are_normal() -> None:
    drawn = Streams(1, "x", 0, [0, 1]).normals(99_999)
    for candidate, row in enumerate(drawn):
        words = Stream(1, "x", 0, candidate).raw(50_000)
        length = ((words & 0xFFFFFFFF) >> 1).astype(np.float64) + 0.5
        radius = np.sqrt(-2 * np.log(length * 2.0**-31))
        angle = (words >> 32).astype(np.uint32).view(np.int32) * (np.pi * 2.0**-31)
        pairs = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
        assert row == pytest.approx(pairs.ravel()[:-1], abs=2e-6)
    assert kstest(drawn.ravel(), "norm").pvalue > 0.01
    assert abs(np.corrcoef(drawn[0, :-1], drawn[0, 1:])[0, 1]) < 0.01


def test_normal_numbers_are_the_same_bits_everywhere() -> None:
    # Written down once; no function of a C library is in between.
    found = [value.hex() for value in Streams(7, "golden", 0, [0]).normals(4)[0].tolist()]
    assert found == GOLDEN
