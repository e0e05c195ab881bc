"""Archives of Pareto coevolution, which choose the opponents that tell good champions apart.

Source: de Jong, "A monotonic archive for Pareto-coevolution", Evolutionary Computation 15(1), 2007,
doi:10.1162/evco.2007.15.1.61, the Layered Pareto-Coevolution Archive (LAPCA). Opponents are tests, and the
outcomes against them are objectives. In place of a number of layers, a number of learners limits the archive;
tests are chosen greedily, which gives fewer of them.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from swarmwright.methods.archive import ranks


class ParetoArchive:
    """Champions of a population that are not dominated, and the tests that separate them.

    Learners and tests are named by the generation of the champion: a test is the champion of the other side.

    Args:
        largest: largest number of learners, and of tests.
    """

    def __init__(self, largest: int) -> None:
        self._largest = largest
        self._outcomes: dict[tuple[int, int], float] = {}
        self.learners: list[int] = []
        """Champions of the best layers, ascending."""
        self.tests: list[int] = []
        """Tests that separate learners of the same layer or of neighbouring ones, ascending."""

    def update(self, generation: int, outcomes: Mapping[tuple[int, int], float]) -> None:
        """Add the champions of a generation, as a learner and as a test, and keep what is useful.

        Args:
            generation: of both.
            outcomes: of learners against tests, by both generations, larger for better: those of the new
                learner against all tests, and of all learners against the new test. Failed ones may be
                missing or NaN, and are the worst.
        """
        self._outcomes.update(outcomes)
        learners, tests = [*self.learners, generation], [*self.tests, generation]
        values = np.array([[self._outcomes.get((row, test), np.nan) for test in tests] for row in learners])
        values[np.isnan(values)] = np.finfo(np.float64).min
        # Of learners with the same outcomes, the first is enough.
        _, first = np.unique(values, axis=0, return_index=True)
        unique = np.sort(first)
        layers = ranks(values[unique])
        chosen = np.sort(np.lexsort((-unique, layers))[: self._largest])  # the best layers, of one the newest
        self.learners = [learners[index] for index in unique[chosen].tolist()]
        separating = _separate(values[unique[chosen]], layers[chosen], self._largest)
        self.tests = [tests[index] for index in separating]
        self._outcomes = {
            (learner, test): outcome
            for (learner, test), outcome in self._outcomes.items()
            if learner in self.learners and test in self.tests
        }


def _separate(values: NDArray[np.float64], layers: NDArray[np.int64], largest: int) -> list[int]:
    """Return the tests with which learners have different outcomes, ascending, by greedy set cover.

    Args:
        values: (learners, tests) outcomes.
        layers: (learners,), from 0 for the best.
        largest: largest number of tests.
    """
    gaps = layers[np.newaxis] - layers[:, np.newaxis]
    better, worse = np.nonzero((gaps == 0) | (gaps == 1))
    separated = values[better] > values[worse]
    chosen: list[int] = []
    while len(chosen) < largest:
        counts = separated.sum(axis=0)
        newest = len(counts) - 1 - int(counts[::-1].argmax())
        if not counts[newest]:
            break
        chosen.append(newest)
        separated = separated[~separated[:, newest]]
    return sorted(chosen)
