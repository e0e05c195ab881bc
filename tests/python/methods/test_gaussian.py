"""Weights by rank, Adam, and the engine's functions for methods that draw from a normal distribution."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import _engine
from swarmwright._engine import centered_ranks, utilities
from swarmwright.methods._gaussian import logarithm
from tests.python.methods.functions import Points


def test_ranks_are_centered_and_shared_by_equals() -> None:
    assert centered_ranks(np.array([5.0, 1e300, -7.0])).tolist() == [0.0, 0.5, -0.5]
    assert centered_ranks(np.full(6, 3.0)).tolist() == [0.0] * 6
    assert centered_ranks(np.array([1.0, 1.0, 2.0, 3.0, 3.0])).tolist() == [-0.375, -0.375, 0.0, 0.375, 0.375]


def test_failed_candidates_share_the_lowest_rank() -> None:
    assert centered_ranks(np.array([np.nan, -1e300, np.nan])).tolist() == [-0.25, 0.5, -0.25]


@pytest.mark.parametrize("size", [4, 5, 20, 1001])
def test_utilities_are_those_of_the_source(size: int) -> None:
    raw = [max(0.0, math.log(size / 2 + 1) - math.log(k)) for k in range(1, size + 1)]
    expected = np.array(raw) / sum(raw) - 1 / size
    places = np.random.default_rng(1).permutation(size)  # 0 is the best
    assert utilities(-places.astype(np.float64)) == pytest.approx(expected[places], abs=1e-14)


@given(st.lists(st.sampled_from([-1e300, -1.0, 0.0, 2.5, 1e300, math.nan]), min_size=4, max_size=30))
def test_utilities_add_up_to_0_and_are_shared_by_equals(values: list[float]) -> None:
    fitness = np.array(values)
    weights = utilities(fitness)
    assert abs(math.fsum(weights)) < 1e-14
    order = np.where(np.isnan(fitness), -np.inf, fitness)
    for value in set(order.tolist()):
        assert len(set(weights[order == value].tolist())) == 1
    by_value = [weights[order == value][0] for value in sorted(set(order.tolist()))]
    assert by_value == sorted(by_value)
    if len(by_value) == 1:
        assert by_value == [0.0], "a plateau changes nothing"


def test_exponential_and_logarithm_have_the_same_bits_everywhere() -> None:
    numbers = np.array([-700.0, -1.5, 0.0, 1e-9, 0.1, 1.0, 20.0, 700.0])
    expected = np.array([math.exp(number) for number in numbers])
    assert np.abs(_engine.exp(numbers) - expected).max() <= np.spacing(expected).max()
    assert _engine.exp(np.array([0.1, 1.0])).tobytes().hex() == "d4005ab3c7aef13f6a57148b0abf0540"
    positive = np.array([1e-300, 0.3, 1.0, 2.0, 13.0, 1e300])
    assert _engine.log(positive) == pytest.approx([math.log(number) for number in positive], rel=3e-16)
    assert _engine.log(np.array([0.3, 13.0])).tobytes().hex() == "21a7bdfc7843f3bf518c312b04850440"
    assert logarithm(1) == 0.0


def space(genes: int = 3) -> tuple[Points, Points, Points, Points]:
    return np.zeros(genes), np.ones(genes), np.full(genes, -9.0), np.full(genes, 9.0)


def test_the_first_step_of_adam_has_its_length_whatever_the_gradient() -> None:
    values: dict[str, Any] = {"start": None, "noise": 0.1, "step": 0.05, "learning": [0.0]}
    search = _engine.Search.pairs(1, "openai_es", space=space(), population=100, **values)
    search.tell(search.ask().astype(np.float64) @ np.array([1.0, -200.0, 0.0]))
    moved = search.state("center")
    assert np.abs(moved) == pytest.approx([0.05] * 3, rel=1e-4)
    assert (moved[0] > 0, moved[1] < 0) == (True, True)


def test_what_does_not_fit_is_refused() -> None:
    values: dict[str, Any] = {"start": None, "noise": 0.1, "step": 0.05, "learning": [0.0]}
    with pytest.raises(_engine.InputError, match="expected 3 values, found 2"):
        _engine.Search.pairs(
            1, "x", space=(np.zeros(3), np.ones(2), np.zeros(3), np.ones(3)), population=2, **values
        )
    with pytest.raises(_engine.InputError, match="3 found, expected an even number"):
        _engine.Search.pairs(1, "x", space=space(), population=3, **values)
    with pytest.raises(_engine.InputError, match="decay, or rate and change"):
        _engine.Search.pairs(1, "x", space=space(), population=2, **{**values, "learning": []})
    search = _engine.Search.pairs(1, "x", space=space(), population=2, **values)
    with pytest.raises(_engine.InputError, match="for each genome of the last ask"):
        search.tell(np.zeros(2))
    assert search.ask().tobytes() == search.ask().tobytes(), "as long as nothing is told"
    with pytest.raises(_engine.InputError, match="for each genome of the last ask"):
        search.tell(np.zeros(3))
    search.tell(np.zeros(2))
    with pytest.raises(_engine.InputError, match="name: unknown: sigma"):
        search.state("sigma")
