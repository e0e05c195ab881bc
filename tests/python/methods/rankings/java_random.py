"""The random numbers of Java, as FREVO draws them."""

import numpy as np
from numpy.typing import NDArray


class JavaRandom:
    """java.util.Random, behind the method of NumPy's generators that pairings call."""

    def __init__(self, seed: int) -> None:
        self._state = (seed ^ 0x5DEECE66D) % 2**48
        self.seeds: list[int] = []
        """After each number, the seed of a generator that goes on from there."""

    def integers(self, bounds: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.array([self._draw(bound) for bound in bounds.tolist()])

    def _draw(self, bound: int) -> int:
        while True:
            self._state = (self._state * 0x5DEECE66D + 0xB) % 2**48
            bits = self._state >> 17
            if bits - bits % bound + bound - 1 < 2**31:
                self.seeds.append(self._state ^ 0x5DEECE66D)
                return (bound * bits) >> 31 if bound & -bound == bound else bits % bound
