"""Simulations in Python that step many episodes at once, with numpy."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.simulations.base import Described


class BatchSimulation(Described):
    """A simulation whose methods take and return arrays of many episodes: one numpy call steps them all.

        class Gather(BatchSimulation):
            title, dimensions, sensors, actuators = "gather", 1, 1, 1

            def reset(self, parameters, seeds):
                starts = [np.random.default_rng(int(seed)).uniform(-1, 1, (5, 1)) for seed in seeds]
                self.x = np.stack(starts)
                self.steps = 0
                return self.x

            def step(self, actions):
                self.x += 0.1 * actions
                self.steps += 1
                return self.x

            def done(self):
                return np.full(len(self.x), self.steps == 30)

            def fitness(self):
                return -np.abs(self.x).mean(axis=(1, 2))

    All episodes have the same parameters and as many agents; each has a seed and controllers.
    Wherever a `Simulation` can be used, this can be, too. Offloaded controllers are
    evaluated with up to `lanes` others at once, and a batch has up to `lanes` or 256 episodes; in the mode
    stepwise, and for offloaded parameter sets, there is one episode in the arrays. For the same result in
    every mode, no episode may depend on how many there are: `swarmwright.testing.check_batch_simulation`
    tries that. When a method raises, episodes are repeated one by one, so that only those fail that do alone.
    """

    lanes: int = 1024
    """Most episodes at once."""

    @abstractmethod
    def reset(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> ArrayLike:
        """Start an episode for each seed and return the first observations.

        Args:
            parameters: as in `Simulation.reset`.
            seeds: (episodes,), the only source of chance.

        Returns:
            Observations, (episodes, agents, sensors), finite.

        Raises:
            swarmwright.InputError: as in `Simulation.reset`.
        """

    @abstractmethod
    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        """Advance all episodes by one step.

        Args:
            actions: (episodes, agents, actuators), float32, -1 to 1; 0 for agents that did not act, and for
                episodes that have ended.

        Returns:
            Observations as from `reset`; those of episodes that have ended, and of agents that do not act
            next, do not count.
        """

    @abstractmethod
    def done(self) -> ArrayLike:
        """Return which episodes have ended, (episodes,) booleans.

        Asked after `reset` and after every step.
        """

    @abstractmethod
    def fitness(self) -> ArrayLike:
        """Return how well each went, (episodes,), more is better.

        Asked as often as an episode has ended, when only those that ended with this step count.
        """

    def measure(self) -> Mapping[str, ArrayLike]:
        """Return the metrics, name -> (episodes,), as `fitness`."""
        return {}

    def acting(self) -> ArrayLike | None:
        """Return who acts next, (episodes, agents) booleans; None, the default, for all."""
        return None

    def scene(self) -> Any:  # noqa: ANN401 - a swarmwright.Scene
        """Return what the first episode looks like now, a `swarmwright.display.Scene`; None for nothing."""
        return None
