"""The names of metrics: one rule for classes, commands, robots, attached simulators and servers."""

import pytest

from swarmwright.common.metric_names import check, problem_of, suggest_name
from swarmwright.simulations.command.definition import CommandOptions


@pytest.mark.parametrize("name", ["a", "_1", "way_left", "A9", "in"])
def test_names(name: str) -> None:
    assert problem_of(name) is None


@pytest.mark.parametrize(
    ("name", "better"), [("", "_"), ("1st", "_1st"), ("a-b", "a_b"), ("é", "_"), ("a b\n", "a_b_")]
)
def test_what_is_no_name(name: str, better: str) -> None:
    assert "a metric's name has letters (A-Z, a-z), digits and _" in str(problem_of(name))
    assert suggest_name(name) == better
    assert problem_of(better) is None
    with pytest.raises(ValueError, match=rf"write {better}: last"):
        CommandOptions.model_validate({"command": "run", "metrics": {name: "last(x)"}})


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        (7, "7: is of the type int, not text; "),
        ("", "'': is empty; "),
        ("1st", "'1st': begins with a digit; "),
        ("a-b c-d", "'a-b c-d': has '-', ' '; "),
    ],
)
def test_the_message_says_what_is_wrong(name: object, wrong: str) -> None:
    assert str(problem_of(name)).startswith(f"{wrong}a metric's name")


def test_of_several_names_the_first_wrong_one_is_refused() -> None:
    check(["a", "b"])
    with pytest.raises(ValueError, match=r"^'1st': begins with a digit"):
        check(["a", "1st", ""])
