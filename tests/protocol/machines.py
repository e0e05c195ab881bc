"""Machines of modules in Python, from decision 002 alone: it shares nothing with the engine."""

from collections.abc import Callable, Sequence

import numpy as np

Single = np.float32
ZERO, ONE = Single(0), Single(1)
_WORD = 0xFFFFFFFF
_BLACK, _WHITE, _SHORT = Single("0.1"), Single("0.95"), Single("0.1")
_PULLS = {2: (1, 0, 0, -5), 3: (-1, 0, 0, -5), 4: (0, 1, 0, -6), 5: (0, 0, -1, -5)}
"""Of behaviours that follow vectors: what light, neighbours (times alpha, its square), obstacles count."""


def pcg4d(v: Sequence[int]) -> list[int]:
    """Four words from four words."""
    x, y, z, w = ((one * 1664525 + 1013904223) & _WORD for one in v)
    for shift in (True, False):
        x = (x + y * w) & _WORD
        y = (y + z * x) & _WORD
        z = (z + x * y) & _WORD
        w = (w + y * z) & _WORD
        if shift:
            x, y, z, w = (one ^ one >> 16 for one in (x, y, z, w))
    return [x, y, z, w]


def _sixteen(one: int, other: int) -> int:
    return one % 256 + other % 256 * 256


def _limited(weight: Single, low: float, high: float) -> Single:
    return min(max(weight, Single(low)), Single(high))


def _length(x: Single, y: Single) -> Single:
    return np.sqrt(x * x + y * y)  # type: ignore[no-any-return] # a float32


class Tree:
    """A behaviour tree at work, for one robot."""

    def __init__(self, weights: Sequence[Single], subtrees: int, sigmoid: Callable[[Single], Single]) -> None:
        self.machine = Machine(weights, subtrees, 1, sigmoid)
        self.running = 0

    def step(self, sensors: Sequence[Single]) -> list[Single]:
        """The speeds of both wheels."""
        machine = self.machine
        words = machine.words(sensors)
        for index in range(self.running, machine.count):
            row = machine.rows[index]
            if not Single((words[index] >> 8) * 2**-24) < machine.probability(row[4:], sensors):
                self.running = index
                return machine.act(row, sensors, _sixteen(words[0], words[1]))
            machine.turn = 0
        self.running, machine.turn = 0, 0
        return [ZERO, ZERO]


class Machine:
    """A machine at work, for one robot."""

    def __init__(
        self, weights: Sequence[Single], states: int, transitions: int, sigmoid: Callable[[Single], Single]
    ) -> None:
        self.sigmoid = sigmoid
        self.count = int(_limited(weights[0], 1, states))
        width = 4 + 5 * transitions
        self.rows = [weights[1 + at * width :][:width] for at in range(states)]
        self.transitions = transitions
        self.state, self.activate, self.turn = 0, True, 0

    def step(self, sensors: Sequence[Single]) -> list[Single]:
        """The speeds of both wheels."""
        row = self.rows[self.state]
        words = self.words(sensors)
        speeds = self.act(row, sensors, _sixteen(words[0], words[1]))
        if self.activate:
            self.activate = False
            return speeds
        count = min(int(_limited(row[3], 0, 4)), self.transitions)
        holding = [
            transition
            for transition, word in zip([row[4 + 5 * k :][:5] for k in range(count)], words, strict=False)
            if Single((word >> 8) * 2**-24) < self.probability(transition, sensors)
        ]
        if holding:
            chosen = holding[_sixteen(words[2], words[3]) * len(holding) >> 16]
            self.state = min(int(_limited(chosen[0], 0, 16)), self.count - 1)
            self.activate, self.turn = True, 0
        return speeds

    def words(self, sensors: Sequence[Single]) -> list[int]:
        """The random numbers of a step."""
        within = min(max(sensors[8], ZERO), Single(1 - 2**-24))
        return pcg4d([int(float(within) * 2**24), 1, 2, 3])

    def act(self, row: Sequence[Single], sensors: Sequence[Single], sixteen: int) -> list[Single]:
        """What the behaviour of a state does."""
        behaviour = int(_limited(row[0], 0, 5))
        near = sensors[:2]
        if behaviour == 1:
            return [ZERO, ZERO]
        if behaviour == 0:
            if self.turn > 0:
                self.turn -= 1
                return [-ONE, ONE]
            if self.turn < 0:
                self.turn += 1
                return [ONE, -ONE]
            if _length(*near) >= _SHORT and near[0] >= 0:
                steps = max(1, sixteen * int(_limited(row[1], 1, 100)) >> 16)
                self.turn = steps if near[1] < 0 else -steps
            return [ONE, ONE]
        light, once, squared, obstacles = (Single(one) for one in _PULLS[behaviour])
        alpha = Single(int(_limited(row[2], 1, 5)))
        neighbours = (once + squared * alpha) * alpha
        x, y = (
            light * sensors[2 + axis] + neighbours * sensors[6 + axis] + obstacles * near[axis]
            for axis in (0, 1)
        )
        length = _length(x, y)
        if length < _SHORT:
            x, y, length = ONE, ZERO, ONE
        inner = x / length
        inner = ZERO if np.isnan(inner) else _limited(inner, -1, 1)
        return [inner, ONE] if y > 0 else [ONE, inner]

    def probability(self, transition: Sequence[Single], sensors: Sequence[Single]) -> Single:
        """How probable it is that a condition holds."""
        condition = int(_limited(transition[1], 0, 5))
        fixed = _limited(transition[2], 0, 1)
        if condition in {3, 4}:
            more = sensors[5] - Single(int(_limited(transition[3], 1, 10)))
            return self.sigmoid(_limited(transition[4], 0, 20) * (more if condition == 3 else -more))
        black, white = sensors[4] <= _BLACK, sensors[4] >= _WHITE
        on = [black, not black and not white, not black and white]
        return fixed if condition == 5 or on[condition] else ZERO
