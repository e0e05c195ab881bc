"""Evaluation of machines with Python modules: the engine steps the simulation, Python the machines."""

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
"""Episodes stepped side by side; a Python simulation has one."""


class MachineEvaluations:
    """Evaluations of every candidate with every seed, stepped in groups side by side.

    Args:
        simulation: its title, or a host.
        parameters: parameters of the simulation.
        architecture: architecture of the controllers, of the kind `python_modules`.
        weights: (candidates, weights).
        seeds: seeds of the episodes.
        metrics: names of the metrics to return.
        together: episodes side by side.
        isolate: split a failing group until only the failing episode is lost, rather than raise.
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
        """Finished evaluations."""
        self.part: NDArray[np.int64] = np.zeros((0, 2), dtype=np.int64)
        """Candidate and episode of the current group, or of the last one."""
        self._fitness = np.full(self.total, np.nan)
        self._values = np.full((self.total, len(self._metrics)), np.nan)
        # Seed by seed, so that a group mixes candidates and the last group does not hold only one of them.
        work = np.array([(c, e) for e in range(len(self._seeds)) for c in range(count)], dtype=np.int64)
        self._queue = deque(work[first : first + together] for first in range(0, self.total, together))
        self._episodes: _engine.Episodes | None = None
        self._robots: Robots | None = None

    def step(self) -> bool:
        """Advance by one step; return whether work remains.

        Raises RunError if the code of a module or of the simulation fails (never with `isolate`): the current
        group is dropped, and the next call continues with the others. Raises InputError for wrong parameters
        and for missing modules.
        """
        if self._robots is None:
            if not self._queue:
                return False
            self.part = self._queue.popleft()
        try:
            with engine_errors(failure=lambda: getattr(self._simulation, "failure", None)):
                self._advance()
        except RunError:
            self._robots = self._episodes = None
            middle = len(self.part) // 2
            if self._isolate and middle:
                self._queue.extendleft([self.part[middle:], self.part[:middle]])
                return True
            self.done += len(self.part)
            if not self._isolate:
                raise
        return self._robots is not None or bool(self._queue)

    def _advance(self) -> None:
        """Begin, continue or end the current group."""
        if self._robots is None:
            seeds = [self._seeds[episode] for episode in self.part[:, 1].tolist()]
            use_threads()
            self._episodes = _engine.Episodes(self._simulation, self._parameters, seeds)
            self._robots = Robots(self._episodes, self._architecture, self._weights, self.part[:, 0])
        assert self._episodes is not None
        if not self._episodes.done:
            self._robots.step()
        if self._episodes.done:
            rows = self.part[:, 0] * len(self._seeds) + self.part[:, 1]
            self._fitness[rows] = self._episodes.fitness()
            self._values[rows] = self._episodes.metrics(self._metrics)
            self.done += len(self.part)
            self._robots = self._episodes = None

    def fitness(self) -> NDArray[np.float64]:
        """Return the fitness, (candidates, episodes), NaN where an episode failed."""
        return self._fitness.reshape(len(self._weights), len(self._seeds))

    def metrics(self) -> NDArray[np.float64]:
        """Return the metrics, (candidates, episodes, metrics), NaN where an episode failed."""
        return self._values.reshape(len(self._weights), len(self._seeds), -1)

    def results(self) -> NDArray[np.float64]:
        """Return fitness and metrics of every evaluation, (candidates * episodes, 1 + metrics)."""
        return np.concatenate([self._fitness[:, np.newaxis], self._values], axis=1)
