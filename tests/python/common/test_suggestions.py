"""Did you mean."""

import pytest

from swarmwright.common.suggestions import did_you_mean

KNOWN = ["seed", "mapWidth", "numAgents", "speedAgents", "speedDefenders", "generate", "max_steps"]


@pytest.mark.parametrize(
    ("word", "nearest"),
    [
        ("speed", "speedAgents"),  # not seed, which is spelt alike
        ("Speed", "speedAgents"),
        ("width", "mapWidth"),
        ("steps", "max_steps"),
        ("speedDefender", "speedDefenders"),
        ("sede", "seed"),
        ("SEED", "seed"),
        ("numagent", "numAgents"),
    ],
)
def test_names_that_have_the_word_come_first(word: str, nearest: str) -> None:
    assert did_you_mean(word, KNOWN) == f"; did you mean '{nearest}'?"


@pytest.mark.parametrize("word", ["s", "sp", "", "colour"])
def test_what_is_near_none(word: str) -> None:
    """A letter or two are no word."""
    assert did_you_mean(word, ["numAgents", "speedAgents"]) == ""
