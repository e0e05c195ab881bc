"""Checks of behaviours and conditions in Python find what breaks reproducibility."""

from pathlib import Path

import pytest

from swarmwright import RunError
from swarmwright.testing import check_behaviour, check_condition

HEAD = """import numpy as np
from swarmwright.controllers.modules import Behaviour, Condition

class Spin(Behaviour):
    steps = 0

    def __init__(self):
        self.seen = []
        self.turn = np.ones(2)

    def act(self, senses, parameters, state, random):
        speeds = np.zeros((len(senses.ground), 2)) + self.turn
"""


def behaviour(folder: Path, *lines: str) -> str:
    """Write a behaviour whose `act` has these lines; return its name."""
    body = "".join(f"        {line}\n" for line in lines)
    (folder / "spin.py").write_text(f"{HEAD}{body}        return speeds\n")
    return f"{folder}/spin.py:Spin"


def test_a_behaviour_without_memory_passes(tmp_path: Path) -> None:
    check_behaviour(behaviour(tmp_path, "speeds *= 0.5"))


def test_a_counter_in_self_is_found(tmp_path: Path) -> None:
    name = behaviour(tmp_path, "self.steps += 1", "speeds += np.sin(self.steps / 7)")
    with pytest.raises(
        RunError, match=r"spin\.py:4: .*act: changes self\.steps, which is shared by all robots"
    ):
        check_behaviour(name)


def test_results_that_depend_on_earlier_episodes_of_the_object_are_found(tmp_path: Path) -> None:
    name = behaviour(tmp_path, "self.turn *= 0.99")
    with pytest.raises(AssertionError, match="gave different results: keep what is to be remembered"):
        check_behaviour(name)


def test_what_is_kept_in_self_is_found_without_an_effect(tmp_path: Path) -> None:
    name = behaviour(tmp_path, "self.seen.append(1)")
    with pytest.raises(AssertionError, match=r"self\.seen was set or changed"):
        check_behaviour(name)


def test_a_constant_that_is_made_at_the_first_call_is_found(tmp_path: Path) -> None:
    """Runs accept it, since it does no harm; a check cannot know that the next object makes the same one."""
    name = behaviour(tmp_path, "if not hasattr(self, 'gains'):", "    self.gains = np.ones(2)")
    with pytest.raises(AssertionError, match=r"self\.gains was set or changed: .* constants in __init__"):
        check_behaviour(name)


def test_probabilities_beyond_0_to_1_are_cut_as_in_a_run(tmp_path: Path) -> None:
    (tmp_path / "near.py").write_text(
        "from swarmwright.controllers.modules import Condition\n\n"
        "class Near(Condition):\n"
        "    def probability(self, senses, parameters, state, random):\n"
        "        return senses.neighbours / 3 - 0.5\n"
    )
    check_condition(f"{tmp_path}/near.py:Near")
