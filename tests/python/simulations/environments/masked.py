"""A parallel environment with action masks, for the tests."""

from typing import Any

import gymnasium


def made() -> Any:
    return gymnasium.make("broken:Masked-v0")


class MaskedParallel:
    """Two agents, each in an environment of `broken`."""

    possible_agents = ["a", "b"]  # noqa: RUF012

    def observation_space(self, _agent: str) -> Any:
        return made().observation_space

    def action_space(self, _agent: str) -> Any:
        return made().action_space

    def reset(self, seed: int) -> Any:  # noqa: ARG002
        self.agents = list(self.possible_agents)
        self.each = {name: made() for name in self.agents}
        return {name: one.reset()[0] for name, one in self.each.items()}, {}

    def step(self, actions: dict[str, Any]) -> Any:
        ended = [self.each[name].step(action) for name, action in actions.items()]
        self.agents = [] if ended[0][2] else self.agents
        seen, rewards, *_ = (dict(zip("ab", ones, strict=True)) for ones in zip(*ended, strict=True))
        return seen, rewards, {}, {}, {}


def parallel_env() -> MaskedParallel:
    return MaskedParallel()
