"""What a behaviour or a condition in Python is, and what it gets."""

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
    """A parameter that is designed together with the machine, within its range.

    low, high: lowest and highest value, both possible, -1e6 to 1e6. integer: whether it is one.
    """

    low: float
    high: float
    integer: bool = False


@dataclass(frozen=True)
class Senses:
    """What n robots sense in a step: the sensors of the preset e-puck-rm1.2 of `arena`, one row for each."""

    proximity: Numbers
    """(n, 2): the sum of the readings of proximity sensors as a vector, x ahead and y to the left."""
    light: Numbers
    """(n, 2): the vector towards the light."""
    ground: Numbers
    """(n,): 0 black, 0.5 grey, 1 white."""
    neighbours: Numbers
    """(n,): how many other robots are in range."""
    attraction: Numbers
    """(n, 2): the vector towards neighbours; the nearer they are, the longer it is."""

    @classmethod
    def of(cls, sensors: Numbers) -> "Senses":
        """Return what is in rows of 9 sensors."""
        return cls(sensors[:, 0:2], sensors[:, 2:4], sensors[:, 4], sensors[:, 5], sensors[:, 6:8])


class RandomNumbers:
    """Random numbers of n robots in a step, by their index: the same index gives the same number again.

    They follow from the robot's random sensor and from the place of the module in the machine, so that an
    episode can be repeated.
    """

    def __init__(
        self, bits: NDArray[np.uint32], place: int, words: Sequence[NDArray[np.uint32]] = ()
    ) -> None:
        self._bits = bits
        self._place = place
        self.words = words
        """Those of the step, for the engine's modules alone."""

    def unit(self, index: int = 0) -> Numbers:
        """Return numbers of 0 to 1, 1 excluded, multiples of 2^-24, (n,)."""
        word = pcg4d(self._bits, index + 4, self._place + 5, 6)[0]
        return (word >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-24)

    def integer(self, below: int, index: int = 0) -> NDArray[np.int64]:
        """Return integers of 0 to below - 1, (n,); below is at most 65536."""
        word = pcg4d(self._bits, index + 4, self._place + 5, 6)[1].astype(np.int64)
        return (word >> 16) * below >> 16


class Behaviour(ABC):
    """What a robot does in a state of a machine, or in a subtree of a tree.

    One object acts for many robots at once, those of many episodes: all arrays have a row for each of n
    robots, and n changes from step to step. What a row holds must follow from that row alone. Keep nothing in
    `self`, of which an attribute that `act` sets is an error; what is to be remembered belongs in `state`.
    """

    parameters: ClassVar[Mapping[str, Parameter]] = {}
    """What the behaviour is set by."""
    state: ClassVar[int] = 0
    """How many numbers each robot keeps between steps; all are 0 when it enters the state."""
    c_code: ClassVar[str | None] = None
    """The same for one robot in C, for exported controllers; statements that set `left` and `right`."""

    @abstractmethod
    def act(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> NDArray[np.floating]:
        """Return the speeds of the left and of the right wheel, (n, 2), of -1 to 1; others are cut.

        Args:
            senses: what each of the n robots senses.
            parameters: by name, (n,) each.
            state: (n, state), changed in place.
            random: the robots' random numbers of this step; an episode that is repeated has them again.
        """


class Condition(ABC):
    """When a transition is made, or a subtree is done; see `Behaviour`."""

    parameters: ClassVar[Mapping[str, Parameter]] = {}
    """What the condition is set by."""
    state: ClassVar[int] = 0
    """How many numbers each robot keeps between steps; all are 0 when it enters the state."""
    c_code: ClassVar[str | None] = None
    """The same for one robot in C, for exported controllers; statements that set `probability`."""

    @abstractmethod
    def probability(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> NDArray[np.floating]:
        """Return the probability with which the condition holds in this step, (n,), 0 to 1; others are cut.

        Args:
            senses: as in `Behaviour.act`.
            parameters: as in `Behaviour.act`.
            state: (n, state), changed in place.
            random: as in `Behaviour.act`.
        """


def pcg4d(bits: NDArray[np.uint32], *beside: int) -> list[NDArray[np.uint32]]:
    """Return four random words for each number, as the engine does: see its `random.rs`."""
    start = [np.uint32((word * 1664525 + 1013904223) & 0xFFFFFFFF) for word in beside]
    v = [bits * np.uint32(1664525) + np.uint32(1013904223), *(np.full(bits.shape, value) for value in start)]
    for last in (False, True):
        v[0] = v[0] + v[1] * v[3]
        v[1] = v[1] + v[2] * v[0]
        v[2] = v[2] + v[0] * v[1]
        v[3] = v[3] + v[1] * v[2]
        if not last:
            v = [one ^ (one >> np.uint32(16)) for one in v]
    return v
