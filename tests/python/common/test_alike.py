"""Names that are written differently are the same, others are not."""

import pytest

from swarmwright.common.suggestions import alike, fold_name


@pytest.mark.parametrize("name", ["goal x", "goal_x", "goalX", "Goal-X", "goal ｘ"])
def test_case_and_signs_do_not_count(name: str) -> None:
    assert fold_name(name) == "goalx"
    assert alike(name, ["goal y", "goal x"]) == [1]


def test_letters_of_all_scripts_count() -> None:
    assert alike("Απόσταση", ["ταχύτητα", "απόσταση"]) == [1]
    assert alike("höhe", ["hühe"]) == []
    assert alike("скорость", ["maxSteps", "высота"]) == []


def test_exact_names_come_first_and_all_are_returned() -> None:
    assert alike("light-", ["light+", "light-"]) == [1]
    assert alike("light", ["light+", "light-"]) == [0, 1]
    assert alike("+", ["+", "-"]) == [0]
    assert alike("-", ["+", "*"]) == []
