"""Noise that all matches of a seed share neither hides cycles nor makes them."""

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright.analysis.competition import assess

PLAYERS, EPISODES = 12, 10


def play_numbers(random: np.random.Generator) -> NDArray[np.float64]:
    """Return the outcomes of the intransitive numbers game of Watson and Pollack 2001."""
    own, other = random.random((2, PLAYERS, 2))
    gaps = own[:, np.newaxis] - other[np.newaxis]
    nearest = np.abs(gaps).argmin(axis=2)
    return np.asarray(np.sign(np.take_along_axis(gaps, nearest[..., np.newaxis], axis=2)[..., 0]))


def play_strengths(random: np.random.Generator) -> NDArray[np.float64]:
    """Return the outcomes of a game in which the stronger is better against everybody."""
    own, other = np.sort(random.normal(size=PLAYERS)), random.normal(size=PLAYERS)
    return np.tanh(own[:, np.newaxis] - other[np.newaxis])


@pytest.mark.parametrize("effect", [0.0, 5.0])
def test_hard_and_easy_seeds_hide_no_cycles(effect: float) -> None:
    for seed in range(3):
        random = np.random.default_rng(seed)
        outcomes = play_numbers(random)[..., np.newaxis] + random.normal(scale=effect, size=EPISODES)
        noise = random.normal(scale=0.3, size=(PLAYERS, PLAYERS, EPISODES))
        assert assess("left", range(PLAYERS), outcomes + noise).cycles


def test_hard_and_easy_seeds_make_no_cycles() -> None:
    alarms = 0
    for seed in range(12):
        random = np.random.default_rng(seed)
        outcomes = play_strengths(random)[..., np.newaxis] + random.normal(scale=3.0, size=EPISODES)
        noise = random.normal(scale=0.5, size=(PLAYERS, PLAYERS, EPISODES))
        alarms += assess("left", range(PLAYERS), outcomes + noise).cycles
    assert alarms <= 2


def test_the_cyclic_share_does_not_depend_on_a_level_common_to_a_seed() -> None:
    random = np.random.default_rng(5)
    values = play_numbers(random)[..., np.newaxis] + random.normal(size=(PLAYERS, PLAYERS, EPISODES))
    plain = assess("left", range(PLAYERS), values)
    shifted = assess("left", range(PLAYERS), values + random.normal(scale=9.0, size=EPISODES))
    assert shifted.cyclic_share == pytest.approx(plain.cyclic_share)
    assert shifted.null == pytest.approx(plain.null)
