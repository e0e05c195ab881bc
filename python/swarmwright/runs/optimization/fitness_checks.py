"""Warnings about fitness that cannot guide a search, once per run and early enough to stop it."""

import logging
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

_GENERATIONS = 5
"""Generations with equal fitness before a warning; sparse rewards may be equal in the first."""
_LARGEST_RATIO = 1e100
"""Ratio of the largest to the smallest fitness of a generation that no simulation should exceed."""

_LOGGER = logging.getLogger("swarmwright")


class FitnessChecks:
    """Checks the episodes of a session of a run.

    It warns when the fitness is equal for all candidates, equal for all seeds, or spread over too many orders
    of magnitude. The first two are checked only from the first generation of a run on, since a converged
    population has equal fitness for a good reason.

    Args:
        from_random: whether the first candidates are random, and so expected to differ.
        target_is_reached: tells whether the run has reached its target, so that equal fitness may be the
            maximum.
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
        """Add the fitness of a generation, (candidates, episodes), NaN for failed episodes.

        Call it after the run has counted the generation, for `target_is_reached`.
        """
        if not self._generations and generation:  # a resumed run
            self._same_candidates = self._same_episodes = False
        self._generations += 1
        candidates, count = episodes.shape
        self._has_candidates |= candidates > 1
        self._has_seeds |= count > 1
        # NaN is equal to nothing.
        self._same_candidates = self._same_candidates and bool((episodes == episodes[:1]).all())
        self._same_episodes = self._same_episodes and bool((episodes == episodes[:, :1]).all())
        if self._narrow:
            self._narrow = self._is_narrow(generation, episodes)
        if self._generations == _GENERATIONS:
            self.tell()

    def tell(self) -> None:
        """Log the warnings that apply to all generations so far, once."""
        if self._generations and self._has_candidates and self._same_candidates:
            # If both hold, the first warning explains the second.
            if self._from_random and not self._target_is_reached():
                _LOGGER.warning(
                    "all candidates so far had the same fitness in every episode, so it seems not to depend "
                    "on the controller. Check that the simulation uses the actuators, and that the fitness "
                    "measures their effects"
                )
        elif self._has_seeds and self._same_episodes:
            _LOGGER.warning(
                "all episodes of a candidate had the same fitness so far, so it seems not to depend on the "
                "seed. Use a single episode (ranking.episodes: 1), or let the simulation use the seed "
                "(Minisim: parameters.placement: random)"
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
            "the absolute fitness in generation %d ranges from %.3g to %.3g; a server may send numbers in "
            "the wrong byte order",
            generation, low, high,
        )  # fmt: skip
        return False
