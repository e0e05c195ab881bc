"""Sides of a match, which a class declares or which are its groups."""

from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Group, InputError, Side
from swarmwright.common.groups import DeclaredSide
from swarmwright.simulations.base import check_sides
from swarmwright.simulations.host import describe
from tests.python.simulations.pursuit import Pursuit

GROUPS = {name: Group(1, 1, 1) for name in ("red", "blue", "ball boys")}
METRICS = ("red_goals", "blue_goals")


def check(sides: Any, groups: Mapping[str, Group] = GROUPS) -> dict[str, DeclaredSide]:
    return {side.name: side for side in check_sides(sides, groups, METRICS, "Soccer")}


def test_each_group_is_a_side_unless_a_class_declares_sides() -> None:
    assert describe(Pursuit()).sides == (
        DeclaredSide("hunters", ("hunters",)),
        DeclaredSide("prey", ("prey",)),
    )
    declared = {"prey": Side(), "pack": Side(["hunters"], fitness="caught")}
    kind = type("Declaring", (Pursuit,), {"sides": declared, "metrics": {"caught": "Prey caught."}})
    assert describe(kind()).sides == (
        DeclaredSide("prey", ("prey",)),
        DeclaredSide("pack", ("hunters",), "caught"),
    )


def test_a_single_kind_of_agents_has_no_sides() -> None:
    assert check({}, {}) == check({}, {"all": Group(4, 1, 1)}) == {}


def test_groups_that_could_not_be_announced_are_no_sides() -> None:
    for name in ("", "x" * 101, "bell\a"):
        assert check({}, {name: Group(1, 1, 1), "b": Group(1, 1, 1)}) == {}


SIDE: Any = Side
"""For arguments of wrong types."""
RED = Side(("red", "ball boys"))


@pytest.mark.parametrize(
    ("sides", "message"),
    [
        ([RED], r"Soccer.sides: \[Side\(groups=\('red', 'ball boys'\), .*\] found, expected a mapping"),
        ({"red": RED}, "Soccer.sides: 1 found, expected 2 to 256 sides"),
        ({str(i): RED for i in range(257)}, "Soccer.sides: 257 found, expected 2 to 256 sides"),
        ({"red": RED, "blu": Side()}, r"sides\['blu'\].groups: there is no group 'blu'; did you mean 'blue'"),
        ({"red": RED, "x": Side(("y",))}, "no group 'y'; available: red, blue, ball boys"),
        ({"red": RED, "blue": Side(("blue", "red"))}, r"\['blue'\].groups: 'red' belongs to the side 'red',"),
        ({"red": Side(("red", "red")), "blue": Side()}, r"sides\['red'\].groups: 'red' found twice"),
        ({"red": Side(), "blue": Side()}, "Soccer.sides: ball boys missing; each group belongs to a side"),
        ({"red": RED, "blue": Side("blue")}, "groups: 'blue' found, expected names of groups"),
        ({"red": RED, "blue": SIDE({"blue"})}, "groups: {'blue'} found, expected names of groups"),
        ({"red": RED, "blue": SIDE(([1],))}, r"groups: \[1\] found, expected text of 1 to 100 printable"),
        ({"red": RED, "blue": Side(fitness="goals")}, "fitness: there is no metric 'goals'; did you mean"),
        ({"red": RED, "blue": Side(fitness="fitness")}, "no metric 'fitness'; available: red_goals, blue_g"),
        ({"red": RED, "blue": Side(fitness="")}, r"\['blue'\].fitness: '' found, expected text of 1 to 100"),
        ({"red": RED, "blue": SIDE(fitness=["x"])}, r"fitness: \['x'\] found, expected text"),
        ({"red": RED, "blue": ("blue",)}, r"\['blue'\]: \('blue',\) found, expected Side\(groups="),
        ({"red": RED, "": Side(("blue",))}, "Soccer.sides: the name: '' found, expected text of 1 to 100 pr"),
        ({"red": RED, "\x1b[2J": Side(("blue",))}, r"the name: '\\x1b\[2J' found, expected text"),
        ({"red": RED, "two\nlines": Side(("blue",))}, r"the name: 'two\\nlines' found, expected text"),
        ({"red": RED, "\u202eder": Side(("blue",))}, r"the name: '\\u202eder' found, expected text"),
        ({"red": RED, 1: Side(("blue",))}, "the name: 1 found, expected text"),
        ({"red": RED, "x" * 101: Side(("blue",))}, r"the name: 'x{56}\.\.\. found, expected text"),
    ],
)
def test_each_mistake_has_its_message(sides: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        check(sides)
    assert "\n" not in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.binary(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@given(
    st.dictionaries(
        st.sampled_from(["red", "blue", "a", ""]) | st.text() | st.integers(),
        st.builds(Side, ANYTHING | st.lists(st.sampled_from(list(GROUPS))), ANYTHING) | ANYTHING,
        max_size=4,
    )
    | ANYTHING
)
def test_whatever_a_class_says_is_checked_or_refused_with_a_printable_line(sides: Any) -> None:
    try:
        declared = check(sides)
    except InputError as error:
        assert str(error).isprintable()  # noqa: PT017 - nothing else may be raised
        return
    assert sorted(group for side in declared.values() for group in side.groups) == sorted(GROUPS)
