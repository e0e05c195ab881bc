"""Simulations in which something goes wrong, as parameters say."""

import os
import sys
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright import InputError, Parameter, Simulation


class Abort(BaseException):
    """Not an Exception, as those are that end a process."""


class MuteError(Exception):
    """Says nothing."""

    def __str__(self) -> str:
        raise ValueError("no words")


class Walk(Simulation):
    """Two agents add up what they are told. In episodes whose seed is a multiple of 3 there is `trouble`."""

    title = "walk"
    dimensions = 1
    sensors = 2
    actuators = 1
    parameters = {"steps": Parameter(4, minimum=1), "trouble": ""}  # noqa: RUF012
    metrics = {"steps": "Steps done."}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.trouble = parameters["trouble"] if seed % 3 == 0 else ""
        self.left: int = parameters["steps"]
        self.sum = 0.0
        if parameters["trouble"] == "refused":
            raise InputError("trouble: refused found, expected none")
        if self.trouble == "reset":
            raise LookupError("no start")
        return self.seen()

    def seen(self) -> Any:
        rows: Any = np.array([[self.left, 0.0], [self.sum, 1.0]])
        wrong = {
            "shape": rows[:, :1],
            "flat": rows[0],
            "rows": rows[:1],
            "nan": np.full((2, 2), np.nan),
            "huge": rows + 1e300,
            "text": "left, right",
            "nothing": None,
            "ragged": [[1.0], [1.0, 2.0]],
            "gymnasium": (rows, 0.0, False, False, {}),
            "array": np.full((20, 20), "left"),
        }
        return wrong.get(self.trouble, rows) if self.left < 4 else rows

    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        if self.trouble == "raise":
            _ = [0, 1][int(2 + actions[0, 0] * 0)]
        if self.trouble == "numpy":
            np.concatenate([actions, np.zeros(3)])
        if self.trouble == "compiled":
            np.random.default_rng(0).normal(scale=-1)
        if self.trouble in {"fork", "fork and raise", "fork and exit"}:
            self.fork()
        self.sum += float(actions.sum())
        self.left -= 1
        return np.asarray(self.seen()) if self.trouble == "" else self.seen()

    def fork(self) -> None:
        """Fork a process that returns, and wait for its end."""
        child = os.fork()
        if child == 0:
            if self.trouble == "fork and raise":
                raise LookupError("in the child")
            if self.trouble == "fork and exit":
                sys.exit(7)
            return
        _, status = os.waitpid(child, 0)
        assert os.waitstatus_to_exitcode(status) == (7 if self.trouble == "fork and exit" else 1)

    def done(self) -> Any:
        return {"not done": None}.get(self.trouble, self.left <= 0)

    def fitness(self) -> Any:
        if self.trouble == "mute":
            raise MuteError
        if self.trouble == "abort":
            raise Abort
        wrong = {"fitness": np.nan, "no fitness": None, "bytes as fitness": b"1"}
        return wrong.get(self.trouble, self.sum)

    def measure(self) -> Any:
        wrong = {"measure": {"left": self.left}, "measure text": "left", "measure nan": {"steps": None}}
        return wrong.get(self.trouble, {"steps": 4 - self.left, "left": self.left})

    def acting(self) -> ArrayLike | None:
        wrong: dict[str, ArrayLike] = {
            "acting": [0, 2],
            "acting text": ["0"],
            "acting float": [0.5],
            "acting flags": [1, 1],
        }
        return wrong.get(self.trouble)


class InTurn(Simulation):
    """Three agents act one after the other, in a line; what each does is seen by the next; the last one
    rests."""

    title = "in turn"
    sensors = 1
    actuators = 2

    def reset(self, parameters: dict[str, Any], seed: int) -> ArrayLike:  # noqa: ARG002
        self.turn, self.x = 0, np.full((3, 1), seed / 10)
        return self.x

    def acting(self) -> list[int]:
        return [self.turn % 3]

    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        agent = self.turn % 3
        others = np.delete(actions, agent, axis=0)
        assert not others.any(), others
        self.x[(agent + 1) % 3] += actions[agent, 0] - actions[agent, 1]
        self.turn += 1
        # Those who do not act next need not sense.
        return np.where(np.arange(3)[:, None] == self.turn % 3, self.x, np.nan)

    def done(self) -> bool:
        return self.turn == 7

    def fitness(self) -> float:
        return float(self.x.sum())


class Drifting(Simulation):
    """Agents steer themselves."""

    title = "drifting"
    sensors = actuators = 1
    parameters = {"drift": Parameter(0.0, minimum=-1.0, maximum=1.0)}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seed: int) -> ArrayLike:
        self.x, self.left, self.drift = seed / 8, 5, parameters["drift"]
        return [[self.x]]

    def acting(self) -> ArrayLike:
        return []

    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        assert actions.tolist() == [[0.0]]
        self.x += self.drift
        self.left -= 1
        return [[self.x]]

    def done(self) -> bool:
        return self.left == 0

    def fitness(self) -> float:
        return -abs(self.x)


class Function(Simulation):
    """Everything is computed when an episode starts, and no agent acts."""

    title = "function"
    sensors = actuators = 1
    parameters = {"x": Parameter(0.0, minimum=-5.0, maximum=5.0)}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seed: int) -> ArrayLike:  # noqa: ARG002
        self.x: float = parameters["x"]
        return [[0.0]]

    def step(self, actions: NDArray[np.float32]) -> ArrayLike:  # noqa: ARG002
        raise AssertionError("a step")

    def done(self) -> bool:
        return True

    def fitness(self) -> float:
        return -((self.x - 1) ** 2)


class Rule(Simulation):
    """Has no agents that are steered, for three steps."""

    title = "rule"
    sensors = actuators = 0
    parameters = {"x": Parameter(0.0, minimum=-5.0, maximum=5.0)}  # noqa: RUF012
    metrics = ("steps",)

    def reset(self, parameters: dict[str, Any], seed: int) -> None:  # noqa: ARG002
        self.x: float = parameters["x"]
        self.shapes: list[tuple[int, ...]] = []

    def step(self, actions: NDArray[np.float32]) -> None:
        self.shapes.append(actions.shape)

    def done(self) -> bool:
        return len(self.shapes) == 3

    def fitness(self) -> float:
        assert set(self.shapes) == {(1, 0)}
        return -((self.x - 1) ** 2)

    def measure(self) -> dict[str, float]:
        return {"steps": len(self.shapes)}


class Alone(Walk):
    """There can be one object only."""

    title = "alone"
    copies = False
    parameters = {}  # noqa: RUF012
    made = 0

    def __init__(self) -> None:
        type(self).made += 1
        assert type(self).made == 1, "a second object"

    def reset(self, parameters: dict[str, Any], seed: int) -> ArrayLike:
        return np.asarray(super().reset({"trouble": "", "steps": 4, **parameters}, seed))
