"""A controller on a robot, without a middleware."""

from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import pytest

from swarmwright.simulations.ros import control
from swarmwright.simulations.ros.control import Control
from swarmwright.simulations.ros.topics import Missing

CYCLES = 5


class Refusing:
    """Refuses the second and third step."""

    def __init__(self) -> None:
        self._steps = 0

    def reset(self) -> None:
        """Nothing to forget."""

    def step(self, sensors: Any) -> list[float]:
        """Return the number of the step."""
        assert list(sensors) == [0.5]
        self._steps += 1
        if self._steps in (2, 3):
            raise ValueError("a node has overflowed")
        return [float(self._steps)]


def test_why_the_robot_stands_is_brought_up_to_date(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    both, one = Missing(["/a", "/b"], []), Missing([], ["/b: no value"])
    reasons = [None, both, both, one, one, one, None, one]
    inputs = SimpleNamespace(missing=lambda: reasons.pop(0), draw=lambda: None, values=[0.5])
    monkeypatch.setattr(control, "Inputs", lambda *_: inputs)
    monkeypatch.setattr(control, "Outputs", lambda *_: MagicMock())
    clock = iter([0.0, *(0.6 * number for number in range(1000))])
    monkeypatch.setattr(control, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    node = MagicMock()
    node.say = lambda level, text: said.append(f"{level}: {text}")
    node.publisher.return_value.listeners.return_value = 0
    node.has_ended.side_effect = [*[False] * len(reasons), True, True]
    node.now.side_effect = range(1, 1 + len(reasons))
    mapping = SimpleNamespace(sensors=(), actuators=(), rate=1, reset_after_silence=False)
    Control(node, cast("Any", mapping), MagicMock()).run(lambda: False)
    running = "info: all sensors are there: the controller runs at 1 Hz"
    assert said == [
        running,
        "warning: stopped: nothing comes from /a, /b",
        "warning: stopped: /b: no value",
        running,
        "warning: stopped: /b: no value",
    ]


def test_the_robot_stops_when_a_step_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    commands: list[float] = []
    inputs = SimpleNamespace(missing=lambda: None, draw=lambda: None, values=[0.5])
    outputs = SimpleNamespace(publish=commands.extend, stop=lambda: commands.append(0.0))
    monkeypatch.setattr(control, "Inputs", lambda *_: inputs)
    monkeypatch.setattr(control, "Outputs", lambda *_: outputs)
    node = MagicMock()
    node.say = lambda level, text: said.append(f"{level}: {text}")
    node.publisher.return_value.listeners.return_value = 0
    node.has_ended.side_effect = [*[False] * CYCLES, True, True]
    node.now.side_effect = range(1, 1 + CYCLES)
    mapping = SimpleNamespace(sensors=(), actuators=(), rate=1, reset_after_silence=False)
    Control(node, cast("Any", mapping), Refusing()).run(lambda: False)
    assert commands == [1.0, 0.0, 0.0, 4.0, 5.0]
    # Once, however many steps are refused after one another.
    assert [line for line in said if "stopped" in line] == ["warning: stopped: a node has overflowed"]
