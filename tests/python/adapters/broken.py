"""Environments with mistakes, parallel and Gymnasium's, for the tests."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

SPACE = spaces.Box(-1, 1, (2,), np.float32)


class Parallel:
    """A parallel environment of two agents that fails as it is told to.

    trouble: raise, more (a third agent appears), shape (the observation grows), assert (in the constructor,
    without a word), none. extra: more agents like b.
    """

    possible_agents = ["a", "b"]  # noqa: RUF012

    def __init__(self, trouble: str = "none", size: int = 2, agents: bool = True, extra: int = 0) -> None:
        assert trouble != "assert"
        self.possible_agents = [*self.possible_agents, *(f"b_{number}" for number in range(extra))]
        self.trouble, self.size = trouble, size
        if not agents:
            self.possible_agents = []

    def observation_space(self, _agent: str) -> Any:
        return spaces.Box(-1, 1, (self.size,), np.float32)

    def action_space(self, agent: str) -> Any:
        return spaces.Discrete(3) if agent == "a" else SPACE

    def reset(self, seed: int) -> Any:
        self.agents = list(self.possible_agents)
        self.random = np.random.default_rng(seed)
        self.left = 6
        return self.seen(), {}

    def step(self, actions: dict[str, Any]) -> Any:
        assert set(actions) == set(self.agents)
        self.left -= 1
        if self.trouble == "raise" and self.left == 3:
            raise ValueError("the wheels came off")
        if self.trouble == "more" and self.left == 3:
            self.agents.append("c")
        if self.left == 2:
            self.agents.remove("b")
        rewards = {name: float(self.left) for name in actions}
        seen = self.seen()
        if not self.left:
            self.agents = []
        return seen, rewards, {}, {}, {}

    def seen(self) -> dict[str, Any]:
        grown = self.trouble == "shape" and self.left == 3
        return {name: self.random.uniform(-1, 1, self.size + grown) for name in self.agents}

    def close(self) -> None:
        pass


def parallel_env(**options: Any) -> Parallel:
    return Parallel(**options)


class Failing(gymnasium.Env[Any, Any]):
    """Fails in the fourth step; or never ends."""

    observation_space = spaces.Discrete(3)
    action_space = SPACE

    def __init__(self, endless: bool = False, text: bool = False) -> None:
        self.endless = endless
        if text:
            self.observation_space = spaces.Text(3)  # type: ignore[assignment]

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed, options=options)
        self.steps = 0
        return 0, {}

    def step(self, _action: Any) -> Any:
        self.steps += 1
        if self.steps == 4 and not self.endless:
            np.linalg.inv(np.zeros((2, 2)))  # raises far from here
        return self.steps % 3, 1.0, False, False, {}


class Several(Failing):
    """Gives several rewards at once, from the start or after some steps."""

    def __init__(self, first: int = 0, start: int = 0) -> None:
        super().__init__(endless=True)
        self.first, self.start = first, start

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        assert not self.start
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> Any:
        seen, reward, *rest = super().step(action)
        return seen, np.ones(3 if self.steps > self.first else 1) * reward, *rest


gymnasium.register("Several-v0", entry_point="broken:Several")
gymnasium.register("Failing-v0", entry_point="broken:Failing")
