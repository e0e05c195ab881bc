"""Problems that are not built in: XOR and cart-pole, many candidates at once."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright import BatchSimulation

Numbers = NDArray[np.float64]


class Xor(BatchSimulation):
    """The four cases of XOR, seeds 0 to 3, an episode of one step each; fitness: the squared error."""

    title, dimensions, sensors, actuators = "xor", 1, 2, 1

    def reset(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> ArrayLike:  # noqa: ARG002
        """Show a case to each episode's agent."""
        cases = np.stack([seeds // 2 % 2, seeds % 2], axis=1).astype(np.float64)
        self._wanted = np.where(cases[:, 0] != cases[:, 1], 1.0, -1.0)
        self._cases = cases[:, np.newaxis]
        self._error: Numbers | None = None
        return self._cases

    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        """Take the answers."""
        self._error = np.asarray((actions[:, 0, 0] - self._wanted) ** 2)
        return self._cases

    def done(self) -> ArrayLike:
        """After the answer."""
        return np.full(len(self._wanted), self._error is not None)

    def fitness(self) -> ArrayLike:
        """Return less the squared error."""
        assert self._error is not None
        return -self._error


class CartPole(BatchSimulation):
    """The equations, starts and limits of Gymnasium's CartPole-v1; fitness: steps, at most 500.

    Source: Barto, Sutton and Anderson, "Neuronlike adaptive elements that can solve difficult learning
    control problems", IEEE Transactions on Systems, Man and Cybernetics 13(5), 1983. The cart is pushed with
    10 N to the side that the actuator's sign says.
    """

    title, dimensions, sensors, actuators = "cart_pole", 1, 4, 1
    steps = 500

    def reset(self, parameters: dict[str, Any], seeds: NDArray[np.uint64]) -> ArrayLike:  # noqa: ARG002
        """Put the cart near the middle, the pole nearly upright."""
        drawn = {seed: np.random.default_rng(seed).uniform(-0.05, 0.05, 4) for seed in np.unique(seeds)}
        self._state = np.stack([drawn[seed] for seed in seeds], axis=1)
        self._stood = np.zeros(len(seeds))
        self._fallen = np.zeros(len(seeds), dtype=bool)
        return self._seen()

    def _seen(self) -> Numbers:
        return self._state.T[:, np.newaxis]

    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        """Push the carts for 0.02 s."""
        _, speed, angle, turn = self._state
        force = np.where(actions[:, 0, 0] > 0, 10.0, -10.0)
        sine, cosine = np.sin(angle), np.cos(angle)
        push = (force + 0.05 * turn**2 * sine) / 1.1
        turning = (9.8 * sine - cosine * push) / (0.5 * (4 / 3 - 0.1 * cosine**2 / 1.1))
        change = np.stack([speed, push - 0.05 * turning * cosine / 1.1, turn, turning])
        self._state = np.where(self._fallen, self._state, self._state + 0.02 * change)
        self._stood += ~self._fallen
        self._fallen |= (np.abs(self._state[0]) > 2.4) | (np.abs(self._state[2]) > 12 * 2 * np.pi / 360)
        return self._seen()

    def done(self) -> ArrayLike:
        """When the pole has fallen, the cart has left, or the time is over."""
        return self._fallen | (self._stood >= self.steps)

    def fitness(self) -> ArrayLike:
        """Return the steps until then."""
        return self._stood
