"""An episode whose trajectory is known: the agent crosses the map in a straight line and arrives."""

import pytest

from swarmwright.common.engine_types import BodyFields, SceneFields

WIDTH, HEIGHT, STEPS = 13.0, 7.0, 12


class Crossing:
    """Implements `swarmwright.display.Playable`; the agent is at x = step + 0.5."""

    def __init__(self, message: str = "Hello", lines: int = 3) -> None:
        self.now = 0
        self.message = message
        self.lines = lines
        self.step_size = 0.25

    @property
    def done(self) -> bool:
        return self.now == STEPS

    @property
    def fitness(self) -> float:
        return -float(STEPS - self.now)

    def step(self) -> None:
        self.now += 1

    def scene(self) -> SceneFields:
        agent: BodyFields = {
            "kind": "agent",
            "x": self.now + 0.5,
            "y": 3.5,
            "state": "arrived" if self.done else "free",
            "radius": 0.0,
        }
        defender: BodyFields = {"kind": "defender", "x": 8.0, "y": 6.0, "state": "", "radius": 0.5}
        goal: BodyFields = {"kind": "goal", "x": 12.5, "y": 3.5, "state": "", "radius": 0.5}
        return {
            "width": WIDTH,
            "height": HEIGHT,
            "grid": False,
            "step": self.now,
            "message": self.message,
            "bodies": [goal, defender, agent],
        }

    def text(self, columns: int, color: bool, rows: int, unicode: bool) -> str:
        """A heading and the agent, again and again up to `lines` lines."""
        head = f"{self.message} - step {self.now}"
        body = "●" if unicode else "o"
        if color:
            body = f"\x1b[32m{body}\x1b[0m"
        return "\n".join([head[:columns]] + [body] * (min(self.lines, rows) - 1))


@pytest.fixture
def crossing() -> Crossing:
    return Crossing()
