"""Cost of an agent-step as the number of agents grows."""

from typing import Any

from benchmarks.measurement import Samples
from benchmarks.rollout import LAYERED, MESHED, Block

AGENTS = (10, 100, 1_000, 10_000, 100_000)
BASE = 100
"""Others are compared with this many agents."""
AGENT_STEPS = 4_000_000
"""In one sample, about."""


def minisim(agents: int, defenders: int) -> tuple[Block, int]:
    """A map on which nobody arrives or is caught, 10 square metres for each agent; and its agent-steps."""
    side = round((10 * agents) ** 0.5) + 100
    steps = 20
    parameters: dict[str, Any] = {
        "mapWidth": side,
        "mapHeight": side,
        "numAgents": agents,
        "numDefenders": defenders,
        "placement": "random",
        "goalRadius": 0,
        "captureRadius": 0,
        "speedDefenders": 0.33,
        "maxSteps": steps,
    }
    # Vectors are full, and at least one pair of them.
    candidates = max(32, round(AGENT_STEPS / agents / steps / 32) * 32)
    return Block("minisim", parameters, LAYERED, candidates), candidates * agents * steps


def emergency_exit(agents: int) -> tuple[Block, int]:
    """10 cells for each agent, one agent in each row of ten; walls keep everybody from the exit."""
    side = max(20, round((10 * agents) ** 0.5))
    steps = 20
    places = [[x, y] for y in range(3, side) for x in range(y % 2, side, 9)][:agents]
    if len(places) < agents:
        places += [[x, y] for y in range(3, side) for x in range(y % 2 + 4, side, 9)][: agents - len(places)]
    field = {
        "width": side,
        "height": side,
        "exits": [[0, 0]],
        "blockades": [[1, 0], [0, 1], [1, 1]],
        "agents": places,
    }
    assert len(places) == agents
    candidates = max(32, round(AGENT_STEPS / agents / steps / 32) * 32)
    parameters = {"field": field, "steps": steps}
    return Block("emergency_exit", parameters, MESHED, candidates), candidates * agents * steps


class GrowthSuite:
    """Nanoseconds of processor time for each agent-step of one lane."""

    def __init__(self, agents: tuple[int, ...] = AGENTS) -> None:
        self._shapes: dict[str, dict[int, tuple[Block, int]]] = {}
        self._samples: dict[tuple[str, int], Samples] = {}
        for name in ("Minisim, 1 defender", "Minisim, 40 defenders", "Emergency Exit"):
            for count in agents:
                self._samples[name, count] = Samples(f"{name}, {count:,} agents", "ns/agent-step")
            base = self._samples[name, BASE]
            for count in agents:
                if count != BASE:
                    self._samples[name, count].against = base
            self._samples[name, agents[-1]].aim = "<= 2"
        self._agents = agents

    def repeat(self) -> None:
        """Take one sample of everything."""
        for name, count in self._samples:
            if name == "Emergency Exit":
                block, agent_steps = emergency_exit(count)
            else:
                block, agent_steps = minisim(count, 40 if "40" in name else 1)
            # What it takes to read parameters and to draw places is no step.
            seconds = block.time().processor
            self._samples[name, count].add(seconds / agent_steps * 1e9)

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return list(self._samples.values())

    def close(self) -> None:
        """Nothing is left open."""
