"""An environment whose agents act in turn, with mistakes, for the tests."""

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv  # type: ignore[import-untyped]


class Counting(AECEnv):  # type: ignore[misc]
    """Agents add 0, 1 or 2 to a total in turn; whoever gets it to 5 or more loses and drops out.

    Each action pays its number to the next agent, which collects it when it acts or ends.
    trouble: selection (of an agent that has left), stays (an agent that has ended is not removed), last
    (returns four values), words (rewards are words), truncated (the end is a truncation), twice (each agent
    acts twice in a row), none.
    """

    metadata = {"render_modes": ["rgb_array"], "name": "counting"}  # noqa: RUF012

    def __init__(self, trouble: str = "none", agents: int = 3, render_mode: str | None = None) -> None:
        self.trouble, self.render_mode = trouble, render_mode
        self.possible_agents = [f"side{index}_0" for index in range(agents)]

    def observation_space(self, _agent: str) -> Any:
        return spaces.Dict({"observation": spaces.Box(0, 10, (1,)), "action_mask": spaces.Box(0, 1, (3,))})

    def action_space(self, _agent: str) -> Any:
        return spaces.Discrete(3)

    def reset(self, seed: int | None = None, options: Any = None) -> None:  # noqa: ARG002
        self.agents = list(self.possible_agents)
        self.total, self.turns = 0, 0
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, Any] = {name: {} for name in self.agents}
        self.agent_selection = self.agents[0]

    def observe(self, _agent: str) -> Any:
        mask = [1, 1, 1] if self.total % 2 else [0, 1, 1]
        return {"observation": np.array([self.total], np.float32), "action_mask": np.array(mask)}

    def last(self, observe: bool = True) -> Any:
        returned = super().last(observe)
        if self.trouble == "words":
            return (returned[0], "much", *returned[2:])
        return returned[:4] if self.trouble == "last" else returned

    def step(self, action: int | None) -> None:
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            if self.trouble != "stays":
                self._was_dead_step(action)
            return
        assert self.total % 2 or action != 0, "not allowed"
        self.turns += 1
        self.total += int(action or 0)
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        after = self.agents[(self.agents.index(agent) + 1) % len(self.agents)]
        self.rewards[after] = float(action or 0)
        if self.total >= 5:
            self.total = 0
            self.rewards[agent] = -10.0
            ended = self.truncations if self.trouble == "truncated" else self.terminations
            ended[agent] = True
            if len(self.agents) == 2:
                ended[after] = True
        self._accumulate_rewards()
        if self.trouble != "twice" or self.turns % 2 == 0:
            self.agent_selection = after
        self._deads_step_first()
        if self.trouble == "selection" and self.turns == 2:
            self.agent_selection = "side7_0"

    def render(self) -> Any:
        return np.zeros((2, 2, 3), np.uint8)


def env(**options: Any) -> Any:
    return Counting(**options)
