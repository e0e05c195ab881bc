"""Environments with mistakes, parallel and Gymnasium's, for the tests."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from swarmwright.common.errors import SimulationError

SPACE = spaces.Box(-1, 1, (2,), np.float32)


class Parallel:
    """A parallel environment of two agents that fails as it is told to.

    trouble: raise, more (a third agent appears), shape (the observation grows), assert (in the constructor,
    without a word), flags (agents that have ended are flagged, and stay), dropped (agents that are gone have
    rewards and observations all the same), alone (reset returns observations alone), four (step returns four
    values), all (a reward of `__all__`), refused (SimulationError), unseen (a has no
    observation in the third step), unpaid (b has no reward), last (b has none in the step in which it is
    flagged, and later), back (b returns for the last step), nothing (rewards are None), none. extra: more
    agents like b. alike: agents have names of one kind. reward: instead of a number.
    """

    possible_agents = ["a", "b"]  # noqa: RUF012

    def __init__(
        self,
        trouble: str = "none",
        size: int = 2,
        agents: bool = True,
        extra: int = 0,
        alike: bool = False,
        reward: Any = None,
    ) -> None:
        assert trouble != "assert"
        self.possible_agents = [*self.possible_agents, *(f"b_{number}" for number in range(extra))]
        if alike:
            self.possible_agents = [f"c_{number}" for number in range(2 + extra)]
        self.trouble, self.size, self.reward = trouble, size, reward
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
        return self.seen() if self.trouble == "alone" else (self.seen(), {})

    def step(self, actions: dict[str, Any]) -> Any:
        assert set(actions) == set(self.agents)
        self.left -= 1
        if self.trouble == "raise" and self.left == 3:
            raise ValueError("the wheels came off")
        if self.trouble == "refused" and self.left == 3:
            raise SimulationError("the wheels came off")
        if self.trouble == "more" and self.left == 3:
            self.agents.append("c")
        if self.left == 2 and "b" in self.agents and self.trouble not in {"flags", "last"}:
            self.agents.remove("b")
        rewards = self.rewards(actions)
        seen = self.seen()
        if self.trouble == "unseen" and self.left == 3:
            del seen["a"]
        if self.trouble == "dropped":
            rewards = dict.fromkeys(self.possible_agents, float(self.left))
            seen = {name: np.ones(self.size) for name in self.possible_agents}
        if self.trouble == "back" and self.left == 1:
            self.agents.append("b")
            seen = self.seen()
        if self.trouble == "last":
            if self.left <= 2:
                rewards.pop("b", None)
            return seen, rewards, {"b": self.left <= 2}, dict.fromkeys(self.agents, self.left == 0), {}
        if self.trouble == "flags":
            # b is flagged in a single step, as its observation is nothing later.
            seen = {name: None if name == "b" and self.left < 2 else one for name, one in seen.items()}
            truncated = dict.fromkeys(self.agents, self.left == 0)
            return seen, rewards, {"a": False, "b": self.left == 2}, truncated, {}
        if not self.left:
            self.agents = []
        return (seen, rewards, {}, {}) if self.trouble == "four" else (seen, rewards, {}, {}, {})

    def rewards(self, actions: dict[str, Any]) -> Any:
        if self.trouble == "nothing":
            return None
        given: dict[str, Any] = {name: float(self.left) for name in actions}
        if self.reward is not None:
            given = dict.fromkeys(actions, np.array(self.reward))
        if self.trouble == "unpaid":
            given.pop("b", None)
        if self.trouble == "all":
            given["__all__"] = 1.0
        return given

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


class Odd(Failing):
    """Is not as Gymnasium says: values says how many `step` returns; reward and seen are returned."""

    def __init__(self, values: int = 5, reward: Any = 1.0, seen: Any = 0, late: bool = False) -> None:
        super().__init__(endless=True)
        self.values, self.reward, self.seen, self.late = values, reward, seen, late

    def step(self, action: Any) -> Any:
        _, reward, *rest = super().step(action)
        odd = self.steps > 2 or not self.late
        return (self.seen, self.reward if odd else reward, *rest)[: self.values]


class Nowhere(gymnasium.Env[Any, Any]):
    """Has no spaces."""


# A wrapper of Gymnasium unpacks what is returned, the environment itself does not.
gymnasium.register("Odd-v0", entry_point="broken:Odd", disable_env_checker=True, order_enforce=False)
gymnasium.register("Limited-v0", entry_point="broken:Odd", disable_env_checker=True, max_episode_steps=9)
gymnasium.register("Nowhere-v0", entry_point="broken:Nowhere", disable_env_checker=True)
gymnasium.register("Several-v0", entry_point="broken:Several")
gymnasium.register("Failing-v0", entry_point="broken:Failing")


class Remembering(gymnasium.Env[Any, Any]):
    """`reset` keeps how many steps there have been; or nothing is determined by the seed.

    closing: what is wrong with `close`. zero_is_none: the seed 0 counts as none. video: has no effect.
    """

    observation_space = SPACE
    action_space = SPACE
    unseeded = np.random.default_rng()

    def __init__(
        self,
        random: bool = False,
        closing: str = "",
        zero_is_none: bool = False,
        video: bool = False,  # noqa: ARG002
    ) -> None:
        self.random, self.steps = random, 0
        self.closing, self.zero_is_none = closing, zero_is_none

    def __getattribute__(self, name: str) -> Any:
        if name == "close" and self.closing == "missing":
            raise AttributeError(name)
        return super().__getattribute__(name)

    def close(self) -> None:
        if self.closing == "fails":
            raise RuntimeError("closed twice")

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed or None if self.zero_is_none else seed, options=options)
        self.left = 3
        first = self.np_random.random() if self.zero_is_none else 0.0
        return np.full(2, first, np.float32), {}

    def step(self, _action: Any) -> Any:
        self.steps += 1
        self.left -= 1
        reward = self.unseeded.random() if self.random else self.steps
        return np.zeros(2, np.float32), reward, not self.left, False, {}


class Masked(gymnasium.Env[Any, Any]):
    """Allows two of four actions, which change in each step; the reward is the number of the action."""

    action_space = spaces.Discrete(4)
    observation_space = spaces.Dict({"observation": SPACE, "action_mask": spaces.MultiBinary(4)})

    def seen(self) -> Any:
        self.allowed = [self.steps % 4, (self.steps + 1) % 4]
        mask = np.isin(np.arange(4), self.allowed).astype(np.int8)
        return {"observation": np.zeros(2, np.float32), "action_mask": mask}

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed, options=options)
        self.steps = 0
        return self.seen(), {}

    def step(self, action: Any) -> Any:
        assert action in self.allowed
        self.steps += 1
        return self.seen(), float(action), self.steps == 5, False, {}


gymnasium.register("Masked-v0", entry_point="broken:Masked", disable_env_checker=True)
gymnasium.register("Vector-v0", vector_entry_point="gymnasium.envs.classic_control:CartPoleVectorEnv")
gymnasium.register("Remembering-v0", entry_point="broken:Remembering")
