"""The comparison with ARGoS: its statistics, and that the arena agrees in aggregation."""

import json

import numpy as np
import pytest

from benchmarks.against_argos import DATA, ROBOTS, Pair, draw, holm, pairs, summary, table


def pair(theirs: list[float], ours: list[float]) -> Pair:
    return Pair("aac", "hand", np.array(theirs), np.array(ours))


def test_holm_is_that_of_the_textbook() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]


def test_welch_interval() -> None:
    one = pair([1, 2, 3, 4], [2, 4, 6, 8, 10])
    # Standard errors 0.645 and 1.414 with 3 and 4 degrees of freedom: 5.5 in all.
    assert one.difference == pytest.approx(3.5)
    assert one.half_width == pytest.approx(2.501 * 1.5546, rel=1e-3)
    assert one.agrees


def test_rounding_does_not_set_equal_values_apart() -> None:
    one = pair([20.625] * 20, [20.625 + 1e-9] * 20)
    assert (one.agrees, one.p) == (True, 1.0)
    assert not pair([1.0] * 20, [2.0] * 20).agrees


@pytest.mark.timeout(120)
@pytest.mark.parametrize("kind", list(ROBOTS))
def test_the_arena_agrees_with_argos(kind: str) -> None:
    """The 30 seeds of ARGoS have differences of their own, so that only a large one is a mistake."""
    data = json.loads(DATA.read_text(encoding="utf-8"))
    data["scores"] = {"aac": data["scores"]["aac"]}
    found = pairs(kind, data, 20)
    assert len(found) == len(data[kind])
    assert min(holm([one.p for one in found])) > 0.001
    assert summary(found).count(f"of {len(found)} differences") == 1
    assert len(list(table(found))) == 2 + len(found)
    assert len(draw(found).axes) == 3
