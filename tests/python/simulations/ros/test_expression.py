"""Expressions of the program have the values that fitness expressions have."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.simulations.fitness import FitnessExpression
from swarmwright.simulations.ros.expression import Expression

NUMBERS = st.floats(-1e6, 1e6)
OPERATORS = ["+", "-", "*", "/", "<", "<=", ">", ">=", "==", "!=", "and", "or"]
LEAVES = st.sampled_from(["a", "b", "1", "2.5", "0"])


def combined(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    pairs = st.tuples(inner, inner)
    return st.one_of(
        st.tuples(inner, st.sampled_from(OPERATORS), inner).map(lambda parts: f"({' '.join(parts)})"),
        inner.map(lambda one: f"(-{one})"),
        inner.map(lambda one: f"(not {one})"),
        inner.map(lambda one: f"abs({one})"),
        st.tuples(inner, st.sampled_from(["3", "-2", "0"])).map(lambda parts: f"({parts[0]}) ** {parts[1]}"),
        pairs.map(lambda both: f"max({both[0]}, {both[1]})"),
        pairs.map(lambda both: f"clip({both[0]}, 0, {both[1]})"),
        st.tuples(inner, inner, inner).map(lambda parts: f"({parts[0]} if {parts[1]} else {parts[2]})"),
    )


@given(st.recursive(LEAVES, combined, max_leaves=8), NUMBERS, NUMBERS)
def test_values(text: str, a: float, b: float) -> None:
    text = f"a + {text}"
    reference = FitnessExpression(text)
    row = np.array([[{"a": a, "b": b}[name] for name in reference.metrics]])
    values, faults = reference(np.zeros(1), row)
    try:
        found = Expression(text)({"a": a, "b": b})
    except (ArithmeticError, ValueError):
        assert faults
        return
    assert faults or found == values[0]


@pytest.mark.parametrize("text", ["c", "a.real", "__import__('os')", "[a]", "a if b", "'a'"])
def test_what_is_none_is_refused(text: str) -> None:
    with pytest.raises((ValueError, SyntaxError)):
        Expression(text)({"a": 1.0, "b": 2.0})


def test_chains_and_functions() -> None:
    values = {"a": 2.0, "b": 9.0}
    assert Expression("1 < a < 3 < b")(values) == 1.0
    assert Expression("sqrt(b) + min(a, b)")(values) == 5.0
    assert math.isclose(Expression("a / b")(values), 2 / 9)


@pytest.mark.parametrize(
    "text",
    [
        "a > 3\nor b > 8\n",
        "  a > 3  # far\n    or b > 8  # or heavy\n",
        "# the end\na > 3 or b > 8",
        "a > 3 or \\\n  b > 8",
        "(a > 3) # one )\nor (b > 8)",
        "a > 3 or b > 8 # two \u2028 parts",
    ],
)
def test_several_lines_and_comments(text: str) -> None:
    """They are checked as fitness expressions, and have the same values here."""
    values = {"a": 2.0, "b": 9.0}
    reference = FitnessExpression(text)
    expected, _ = reference(np.zeros(1), np.array([[values[name] for name in reference.metrics]]))
    assert Expression(text)(values) == expected[0] == 1.0


@pytest.mark.parametrize("text", ["a) + (b", "a) or (\nb", "a +", "a\n+"])
def test_brackets_are_not_completed(text: str) -> None:
    with pytest.raises(ValueError, match="is not a valid expression"):
        FitnessExpression(text)
    with pytest.raises(SyntaxError):
        Expression(text)
