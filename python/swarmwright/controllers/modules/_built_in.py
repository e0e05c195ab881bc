"""The engine's modules in Python, with the same bits, for machines that have others beside them."""

# ruff: noqa: ARG002 - all have the same arguments

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common import modules
from swarmwright.controllers.modules._base import (
    Behaviour,
    Condition,
    Numbers,
    Parameter,
    Parameters,
    RandomNumbers,
    Senses,
)

_SHORT = np.float32(0.1)
_BLACK, _WHITE = np.float32(0.1), np.float32(0.95)
_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
_TANH_LIMIT = np.float32(9.15)
_TANH_P = np.array([0.5, 0.015736774, 7.970824e-5, 4.2581547e-8], dtype=np.float32)
_TANH_Q = np.array([1.0, 0.11480684, 0.0013933508, 2.7218455e-6], dtype=np.float32)


def _parameters(*names: str) -> Mapping[str, Parameter]:
    return {name: Parameter(*modules.RANGES[name]) for name in names}


def _length(vector: Numbers) -> Numbers:
    x, y = vector[:, 0], vector[:, 1]
    found: Numbers = np.sqrt(x * x + y * y)
    return found


def _sigmoid(x: Numbers) -> Numbers:
    y = np.clip(_HALF * x, -_TANH_LIMIT, _TANH_LIMIT)
    z = y * y
    p = ((_TANH_P[3] * z + _TANH_P[2]) * z + _TANH_P[1]) * z + _TANH_P[0]
    q = ((_TANH_Q[3] * z + _TANH_Q[2]) * z + _TANH_Q[1]) * z + _TANH_Q[0]
    t = (y * p) / q
    found: Numbers = _HALF + _HALF * np.clip((t + t) / (_ONE + t * t), -_ONE, _ONE)
    return found


def below(
    one: NDArray[np.uint32], other: NDArray[np.uint32], count: NDArray[np.uint32]
) -> NDArray[np.uint32]:
    """Return numbers below counts, from 16 bits of two random words."""
    byte = np.uint32(255)
    return ((one & byte | (other & byte) << np.uint32(8)) * count) >> np.uint32(16)


class Exploration(Behaviour):
    """Straight ahead; an obstacle in front makes the robot turn on the spot for a random time."""

    parameters = _parameters("rwm")
    state = 1
    """How many more steps the robot turns: to the left above 0, to the right below."""

    def act(self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers) -> Numbers:
        """Return the speeds."""
        turn = state[:, 0].copy()
        to_left, to_right = turn > 0, turn < 0
        speeds = np.ones((len(turn), 2), dtype=np.float32)
        speeds[to_left, 0] = -1
        speeds[to_right, 1] = -1
        ahead = (_length(senses.proximity) >= _SHORT) & (senses.proximity[:, 0] >= 0)
        begins = ahead & ~(to_left | to_right)
        words = random.words
        steps = below(words[0], words[1], parameters["rwm"].astype(np.uint32)).astype(np.float32)
        steps = np.maximum(steps, _ONE)
        state[:, 0] = turn - np.sign(turn)
        state[begins, 0] = np.where(senses.proximity[:, 1] < 0, steps, -steps)[begins]
        return speeds


class Stop(Behaviour):
    """Stays where it is."""

    def act(self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers) -> Numbers:
        """Return the speeds."""
        return np.zeros((len(senses.ground), 2), dtype=np.float32)


class _Follow(Behaviour):
    """Follows a sum of vectors."""

    light: ClassVar[float] = 0
    obstacles: ClassVar[float] = -5

    def neighbours(self, parameters: Parameters) -> Numbers | np.float32:
        """Return the factor of the vector towards neighbours."""
        return _ZERO

    def act(self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers) -> Numbers:
        """Return the speeds: the outer wheel at full speed."""
        factor = self.neighbours(parameters)
        x, y = (
            np.float32(self.light) * senses.light[:, axis]
            + factor * senses.attraction[:, axis]
            + np.float32(self.obstacles) * senses.proximity[:, axis]
            for axis in (0, 1)
        )
        length = np.sqrt(x * x + y * y)
        short = length < _SHORT
        inner = np.where(short, _ONE, x) / np.where(short, _ONE, length)
        inner = np.clip(np.where(np.isnan(inner), _ZERO, inner), -_ONE, _ONE)
        to_left = np.where(short, _ZERO, y) > 0
        return np.stack([np.where(to_left, inner, _ONE), np.where(to_left, _ONE, inner)], axis=1)


class Phototaxis(_Follow):
    """Towards the light, around obstacles."""

    light = 1


class AntiPhototaxis(_Follow):
    """Away from the light, around obstacles."""

    light = -1


class Attraction(_Follow):
    """Towards neighbours, around obstacles."""

    parameters = _parameters("alpha")
    obstacles = -6

    def neighbours(self, parameters: Parameters) -> Numbers:
        """Return alpha."""
        return parameters["alpha"]


class Repulsion(_Follow):
    """Away from neighbours, around obstacles."""

    parameters = _parameters("alpha")

    def neighbours(self, parameters: Parameters) -> Numbers:
        """Return -alpha^2."""
        return -parameters["alpha"] * parameters["alpha"]


class _Floor(Condition):
    """On ground of a colour."""

    parameters = _parameters("probability")

    @abstractmethod
    def holds(self, ground: Numbers) -> NDArray[np.bool_]:
        """Return where the ground has the colour."""

    def probability(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> Numbers:
        """Return the probability on ground of the colour, 0 elsewhere."""
        return np.where(self.holds(senses.ground), parameters["probability"], _ZERO)


class BlackFloor(_Floor):
    """On black ground."""

    def holds(self, ground: Numbers) -> NDArray[np.bool_]:
        """Return where the ground is black."""
        return ground <= _BLACK


class WhiteFloor(_Floor):
    """On white ground."""

    def holds(self, ground: Numbers) -> NDArray[np.bool_]:
        """Return where the ground is white."""
        return (ground >= _WHITE) & (ground > _BLACK)


class GreyFloor(_Floor):
    """On grey ground."""

    def holds(self, ground: Numbers) -> NDArray[np.bool_]:
        """Return where the ground is neither black nor white."""
        return (ground > _BLACK) & (ground < _WHITE)


class Neighbours(Condition):
    """The more neighbours there are, the more likely."""

    parameters = _parameters("xi", "eta")
    sign: ClassVar[np.float32] = _ONE

    def probability(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> Numbers:
        """Return the logistic function of how many there are more than xi, times eta."""
        return _sigmoid(parameters["eta"] * (self.sign * (senses.neighbours - parameters["xi"])))


class FewNeighbours(Neighbours):
    """The fewer neighbours there are, the more likely."""

    sign = -_ONE


class FixedProbability(Condition):
    """Always equally likely."""

    parameters = _parameters("probability")

    def probability(
        self, senses: Senses, parameters: Parameters, state: Numbers, random: RandomNumbers
    ) -> Numbers:
        """Return the probability."""
        return parameters["probability"]
