"""An order of mappings with any plain values."""

from math import inf, nan
from typing import Any

import pytest

from swarmwright.common.values import sort_key


def test_mappings_are_sorted_by_the_size_of_numbers_wherever_they_are() -> None:
    ordered: list[dict[str, Any]] = [
        {},
        {"a": None},
        {"a": 2},
        {"a": 2, "b": "x"},
        {"a": 10.5},
        {"a": "run-2"},
        {"a": "run-10"},
        {"a": [4, 2]},
        {"a": [10, 2]},
    ]
    backwards = list(reversed(ordered))
    assert sorted(backwards, key=lambda one: sort_key(one, {"a", "b"})) == ordered


@pytest.mark.parametrize(
    ("less", "more"),
    [
        ([0.05], [0.5]),
        ("0.05 * steps", "0.5 * steps"),
        ({"x": 0.01}, {"x": 0.1}),
        ("1.25 * steps", "10.05 * steps"),
        ("a01", "a1"),
        ("1e-05", "1e-5"),
        (1, 10**400),
        (0.5, 10**400),
        (10**400, 10**400 + 1),
        (-inf, nan),
        (nan, 0),
    ],
)
def test_different_values_are_never_equal(less: object, more: object) -> None:
    assert sort_key({"a": less}, ["a"]) < sort_key({"a": more}, ["a"])
