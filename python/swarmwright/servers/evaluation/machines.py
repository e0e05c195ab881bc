"""Machines with modules in Python in many episodes: the engine steps the simulation, Python the machines."""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.errors import RunError, engine_errors
from swarmwright.common.processes import use_threads
from swarmwright.controllers.modules.played import Robots

LANES = 256
"""Episodes that are stepped side by side; of a simulation in Python one."""


class MachineEvaluations:
    """Every candidate in an episode of every seed, a step of as many as fit side by side at a time.

    Args:
        simulation: its title, or a host.
        parameters: of the simulation.
        architecture: of the controllers, of the kind `python_modules`.
        weights: (candidates, weights).
        seeds: of the episodes.
        metrics: names of those that are wanted.
        together: episodes side by side.
        isolate: divide episodes of which one fails until it is alone, rather than raise.
    """

    def __init__(
        self,
        simulation: Any,  # noqa: ANN401 - as the engine takes it
        parameters: dict[str, Any],
        architecture: Mapping[str, Any],
        weights: NDArray[np.float32],
        seeds: Sequence[int],
        metrics: Sequence[str],
        *,
        together: int,
        isolate: bool = False,
    ) -> None:
        self._simulation, self._parameters = simulation, parameters
        self._architecture, self._weights = architecture, weights
        self._seeds, self._metrics, self._isolate = list(seeds), list(metrics), isolate
        count = len(weights)
        self.total = count * len(self._seeds)
        self.done = 0
        """Evaluations that have ended."""
        self.part: NDArray[np.int64] = np.zeros((0, 2), dtype=np.int64)
        """Candidate and episode of those under way, or of those that have ended last."""
        self._fitness = np.full(self.total, np.nan)
        self._values = np.full((self.total, len(self._metrics)), np.nan)
        # All candidates with the first seed, then all with the next one: episodes beside each other are as
        # different as can be, and the last part is not made of one candidate.
        work = np.array([(c, e) for e in range(len(self._seeds)) for c in range(count)], dtype=np.int64)
        self._open = deque(work[first : first + together] for first in range(0, self.total, together))
        self._episodes: _engine.Episodes | None = None
        self._robots: Robots | None = None

    def step(self) -> bool:
        """Advance by one step; return whether there is more to do.

        Raises RunError where the code of a module or of the simulation fails: what is under way is left out
        then, and the next call goes on with the rest. With `isolate` nothing is raised. Raises InputError for
        wrong parameters, and for modules that are not here.
        """
        if self._robots is None:
            if not self._open:
                return False
            self.part = self._open.popleft()
        try:
            with engine_errors(failure=lambda: getattr(self._simulation, "failure", None)):
                self._go()
        except RunError:
            self._robots = self._episodes = None
            middle = len(self.part) // 2
            if self._isolate and middle:
                self._open.extendleft([self.part[middle:], self.part[:middle]])
                return True
            self.done += len(self.part)
            if not self._isolate:
                raise
        return self._robots is not None or bool(self._open)

    def _go(self) -> None:
        """Begin with a part, go on with it, or end it."""
        if self._robots is None:
            seeds = [self._seeds[episode] for episode in self.part[:, 1].tolist()]
            use_threads()
            self._episodes = _engine.Episodes(self._simulation, self._parameters, seeds)
            self._robots = Robots(self._episodes, self._architecture, self._weights, self.part[:, 0])
        assert self._episodes is not None
        if not self._episodes.done:
            self._robots.step()
        if self._episodes.done:
            places = self.part[:, 0] * len(self._seeds) + self.part[:, 1]
            self._fitness[places] = self._episodes.fitness()
            self._values[places] = self._episodes.metrics(self._metrics)
            self.done += len(self.part)
            self._robots = self._episodes = None

    def fitness(self) -> NDArray[np.float64]:
        """Return (candidates, episodes), NaN where an episode failed."""
        return self._fitness.reshape(len(self._weights), len(self._seeds))

    def metrics(self) -> NDArray[np.float64]:
        """Return (candidates, episodes, metrics), NaN where an episode failed."""
        return self._values.reshape(len(self._weights), len(self._seeds), -1)

    def results(self) -> NDArray[np.float64]:
        """Return fitness and metrics of every evaluation, (candidates * episodes, 1 + metrics)."""
        return np.concatenate([self._fitness[:, np.newaxis], self._values], axis=1)
