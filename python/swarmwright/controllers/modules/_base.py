"""Base classes of behaviours and conditions in Python."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float32]
Parameters = Mapping[str, Numbers]
"""Name of a parameter -> its value for each robot, (n,)."""


@dataclass(frozen=True)
class Parameter:
    """A parameter that is optimized together with the machine, within its range.

    low, high: lowest and highest value, inclusive, -1e6 to 1e6. integer: whether it takes integers only.
    """

    low: float
    high: float
    integer: bool = False


@dataclass(frozen=True)
class Senses:
    """Sensors of n robots in a step, one row for each, as those of the preset e-puck-rm1.2 of `arena`."""

    proximity: Numbers
    """(n, 2): the sum of the readings of proximity sensors as a vector, x ahead and y to the left."""
    light: Numbers
    """(n, 2): the vector towards the light."""
    ground: Numbers
    """(n,): 0 black, 0.5 grey, 1 white."""
    neighbours: Numbers
    """(n,): number of other robots in range."""
    attraction: Numbers
    """(n, 2): the vector towards neighbours; the nearer they are, the longer it is."""

    @classmethod
    def from_rows(cls, sensors: Numbers) -> "Senses":
        """Return the senses in rows of 9 sensors."""
        return cls(sensors[:, 0:2], sensors[:, 2:4], sensors[:, 4], sensors[:, 5], sensors[:, 6:8])


class RandomNumbers:
    """Random numbers of n robots in a step, by index: the same index gives the same number again.

    They depend on the robot's random sensor and on the module's position in the machine only, so that
    episodes are reproducible.
    """

    def __init__(
        self, bits: NDArray[np.uint32], position: int, words: Sequence[NDArray[np.uint32]] = ()
    ) -> None:
        self._bits = bits
        self._position = position
        self.words = words
        """Random words of the step, for the engine's modules only."""

    def unit(self, index: int = 0) -> Numbers:
        """Return numbers of 0 to 1, 1 excluded, multiples of 2^-24, (n,)."""
        word = pcg4d(self._bits, index + 4, self._position + 5, 6)[0]
        return (word >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-24)

    def integer(self, below: int, index: int = 0) -> NDArray[np.int64]:
        """Return integers of 0 to below - 1, (n,); below is at most 65536."""
        word = pcg4d(self._bits, index + 4, self._position + 5, 6)[1].astype(np.int64)
        return (word >> 16) * below >> 16


class Behaviour(ABC):
    """The action of a robot in a state of a machine, or in a subtree of a tree.

    One object acts for many robots at once, those of many episodes: all arrays have a row for each of n
    robots, and n changes from step to step. A row of the result may depend on the same row of the arguments
    only. Do not set attributes of `self` in `act`, which is an error; keep memory in `state`.
    """

    parameters: ClassVar[Mapping[str, Parameter]] = {}
    """Parameters of the behaviour by name."""
    state: ClassVar[int] = 0
    """Number of values that each robot keeps between steps; all are 0 when it enters the state."""
    c_code: ClassVar[str | None] = None
    """The same in C for one robot, for exported controllers: statements that set `left` and `right`."""

    @abstractmethod
    def act(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> NDArray[np.floating]:
        """Return the speeds of the left and of the right wheel, (n, 2), in -1..1; values beyond are clipped.

        Args:
            senses: what each of the n robots senses.
            parameters: by name, (n,) each.
            state: (n, state), changed in place.
            random: random numbers of the robots in this step; the same when the episode is repeated.
        """


class Condition(ABC):
    """The condition of a transition or of a subtree; see `Behaviour`."""

    parameters: ClassVar[Mapping[str, Parameter]] = {}
    """Parameters of the condition by name."""
    state: ClassVar[int] = 0
    """Number of values that each robot keeps between steps; all are 0 when it enters the state."""
    c_code: ClassVar[str | None] = None
    """The same in C for one robot, for exported controllers: statements that set `probability`."""

    @abstractmethod
    def probability(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> NDArray[np.floating]:
        """Return the probability that the condition holds in this step, (n,); clipped to 0..1.

        Args:
            senses: as in `Behaviour.act`.
            parameters: as in `Behaviour.act`.
            state: (n, state), changed in place.
            random: as in `Behaviour.act`.
        """


def pcg4d(bits: NDArray[np.uint32], *keys: int) -> list[NDArray[np.uint32]]:
    """Return four random words for each number, as in the engine's `random.rs`."""
    start = [np.uint32((word * 1664525 + 1013904223) & 0xFFFFFFFF) for word in keys]
    v = [bits * np.uint32(1664525) + np.uint32(1013904223), *(np.full(bits.shape, value) for value in start)]
    for last in (False, True):
        v[0] = v[0] + v[1] * v[3]
        v[1] = v[1] + v[2] * v[0]
        v[2] = v[2] + v[0] * v[1]
        v[3] = v[3] + v[1] * v[2]
        if not last:
            v = [word ^ (word >> np.uint32(16)) for word in v]
    return v
