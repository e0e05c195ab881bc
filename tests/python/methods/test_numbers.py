"""Normal numbers, and the limits of genes."""

import numpy as np
import pytest
from scipy.special import ndtri

from swarmwright.core.random_numbers import Streams
from swarmwright.methods._numbers import limits
from swarmwright.testing._samples import BoundedGenes

GOLDEN = ["-0x1.d5ffc7a2b4345p-2", "-0x1.c4224067a3ed1p-2", "0x1.95f69df403427p+0", "-0x1.0bd9106487adbp+1"]


def test_limits_of_genes_are_finite_binary32() -> None:
    lower, upper = limits(BoundedGenes())
    largest = float(np.finfo(np.float32).max)
    assert lower.tolist() == [0.0] * 9 + [2.0, -largest, -largest]
    assert upper.tolist() == [1.0] * 9 + [largest, -2.0, largest]


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
