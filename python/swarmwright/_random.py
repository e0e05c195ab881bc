"""Random numbers by counter, the same bits on every machine.

A stream is addressed by (seed, purpose, generation, candidate) and never shared, so a number does not depend
on what was drawn before it elsewhere. The raw 64-bit words are Philox 4x64-10 (Salmon et al., "Parallel
random numbers: as easy as 1, 2, 3", SC 2011) with key = (seed, purpose) and counter = (block, candidate,
generation, 0). Everything above the raw words is done here with exact integer operations and single IEEE
binary64 operations: NumPy may change the distributions of its `Generator` between versions, and the functions
of a C library differ between machines.
"""

from hashlib import sha256

import numpy as np
from numpy.random import Philox
from numpy.typing import NDArray

_WORDS = 1 << 64


def purpose_key(purpose: str) -> int:
    """Return the 64-bit key of a purpose: the first eight bytes, little-endian, of its name's SHA-256."""
    return int.from_bytes(sha256(purpose.encode()).digest()[:8], "little")


class Stream:
    """An endless sequence of random numbers with an address of its own.

    Args:
        seed: of the experiment, 0 to 2**64 - 1.
        purpose: what the numbers are for, like "nnga.mutate"; another purpose is another sequence.
        generation: 0 to 2**64 - 1.
        candidate: index within the generation, 0 to 2**64 - 1.

    """

    def __init__(self, seed: int, purpose: str, generation: int = 0, candidate: int = 0) -> None:
        key = np.array([seed, purpose_key(purpose)], dtype=np.uint64)
        counter = np.array([0, candidate, generation, 0], dtype=np.uint64)
        self._bits = Philox(key=key, counter=counter)

    def raw(self, count: int) -> NDArray[np.uint64]:
        """Return `count` words of 64 random bits."""
        return np.asarray(self._bits.random_raw(count), dtype=np.uint64)

    def unit(self, count: int) -> NDArray[np.float64]:
        """Return `count` multiples of 2**-53, uniform in [0, 1)."""
        return (self.raw(count) >> np.uint64(11)).astype(np.float64) * 2.0**-53

    def uniform(self, border: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return one number per border b >= 0, uniform in [-b, b)."""
        return (self.unit(len(border)) * 2.0 - 1.0) * border

    def integer(self, below: int) -> int:
        """Return an integer, uniform in 0 .. below - 1, without bias (1 <= below <= 2**64)."""
        limit = _WORDS - _WORDS % below
        while True:
            word = int(self._bits.random_raw())
            if word < limit:
                return word % below

    def integers(self, below: int, count: int) -> list[int]:
        """Return `count` integers, the same as so many calls of `integer` would."""
        # As a rule no word is drawn in vain: less than one in 2**64 / below.
        words = self.raw(count).tolist()
        limit = _WORDS - _WORDS % below
        accepted = [word % below for word in words if word < limit]
        while len(accepted) < count:
            accepted.append(self.integer(below))
        return accepted
