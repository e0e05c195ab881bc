"""Fitness that cannot guide a search: warned of once in a run, early enough to stop it."""

import logging
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

_GENERATIONS = 5
"""After so many equal fitness is warned of; that of sparse rewards may still be equal in the first."""
_LARGEST_RATIO = 1e100
"""Ratio of the largest to the smallest fitness of a generation that no simulation is expected to have."""

_LOGGER = logging.getLogger("swarmwright")


class FitnessChecks:
    """Looks at the episodes of a session of a run, and warns.

    Of fitness that is equal for all candidates, of episodes that are equal for all seeds, and of fitness over
    too many orders of magnitude. The first two are looked for from the first generation of a run on: a
    population that has converged is equal for a good reason.

    Args:
        from_random: whether the first candidates are random, and so expected to differ.
        target_is_reached: whether the run has reached its target, and so ends with what may be the most.
    """

    def __init__(
        self, *, from_random: bool = True, target_is_reached: Callable[[], bool] = lambda: False
    ) -> None:
        self._from_random = from_random
        self._target_is_reached = target_is_reached
        self._generations = 0
        self._has_candidates = self._has_seeds = False
        self._same_candidates = self._same_episodes = True
        self._narrow = True

    def add(self, generation: int, episodes: NDArray[np.float64]) -> None:
        """Take the fitness of a generation, (candidates, episodes), NaN for episodes that failed.

        The run has been told of it: `target_is_reached` knows it.
        """
        if not self._generations and generation:  # of a run that is resumed
            self._same_candidates = self._same_episodes = False
        self._generations += 1
        candidates, count = episodes.shape
        self._has_candidates |= candidates > 1
        self._has_seeds |= count > 1
        # What failed is equal to nothing.
        self._same_candidates = self._same_candidates and bool((episodes == episodes[:1]).all())
        self._same_episodes = self._same_episodes and bool((episodes == episodes[:, :1]).all())
        if self._narrow:
            self._narrow = self._is_narrow(generation, episodes)
        if self._generations == _GENERATIONS:
            self.tell()

    def tell(self) -> None:
        """Warn of what all generations so far have in common, unless that was done."""
        if self._generations and self._has_candidates and self._same_candidates:
            # Where both are the same, the reason for the first explains the second.
            if self._from_random and not self._target_is_reached():
                _LOGGER.warning(
                    "all candidates so far had the same fitness in every episode: it seems not to depend on "
                    "the controller. Check that the simulation uses the actuators, and that fitness counts "
                    "what they change"
                )
        elif self._has_seeds and self._same_episodes:
            _LOGGER.warning(
                "all episodes of a candidate had the same fitness so far: it seems not to depend on the "
                "seed, so one is enough (ranking.episodes: 1), unless the simulation is meant to differ by "
                "seed: then let it use the seed (Minisim: parameters.placement: random)"
            )
        self._same_candidates = self._same_episodes = False

    @staticmethod
    def _is_narrow(generation: int, episodes: NDArray[np.float64]) -> bool:
        sizes = np.abs(episodes[np.isfinite(episodes) & (episodes != 0.0)])
        if not sizes.size:
            return True
        low, high = float(sizes.min()), float(sizes.max())
        if low >= high / _LARGEST_RATIO:
            return True
        _LOGGER.warning(
            "the fitness of generation %d has sizes from %.3g to %.3g: a server may send its numbers in "
            "another byte order",
            generation, low, high,
        )  # fmt: skip
        return False
