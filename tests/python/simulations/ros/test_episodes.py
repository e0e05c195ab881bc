"""Episodes of robots that move by themselves, without a middleware."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import pytest

from swarmwright.simulations.command.ros_definition import RosOptions
from swarmwright.simulations.ros.episodes import Robots


class Node:
    """A node in a time of its own, whose topics send something at regular intervals."""

    def __init__(self, interval: float) -> None:
        self._interval, self._time, self._next = interval, 100.0, 100.0
        self._callbacks: list[Callable[[Any], None]] = []

    def subscribe(self, _topic: str, _kind: str, callback: Callable[[Any], None], _depth: int) -> Any:
        self._callbacks.append(callback)
        return SimpleNamespace(publishers=lambda: 1)

    def publisher(self, *_: object) -> Any:
        return MagicMock()

    def types(self, _topic: str) -> list[str]:
        return []

    def now(self) -> float:
        return self._time

    def spin_once(self, timeout: float) -> None:
        self._time += min(max(timeout, 0.0), 0.01)
        if self._time >= self._next:
            self._next += self._interval
            for callback in self._callbacks:
                callback(SimpleNamespace(data=0.5))


def robots(interval: float, metrics: dict[str, Any] | None = None, **sensor: float) -> Robots:
    place = {"topic": "light", "type": "std_msgs/Float32"}
    options = RosOptions.model_validate(
        {
            "ros": 1,
            "sensors": [{"sensor": "light", **place, **sensor}],
            "actuators": [{"actuator": "speed", "topic": "speed", "type": "std_msgs/Float32"}],
            "step": 0.1,
            "steps": 5,
            "metrics": {"light": {"sensor": "light"}, **(metrics or {})},
        }
    )
    return Robots(options.attachment(), cast("Any", Node(interval)), lambda: None)


def episode(driven: Robots) -> dict[str, Any]:
    answer = driven.reset({}, 1)
    while "done" not in answer:
        answer = driven.step([[0.5]])
    return answer


def test_steps_that_a_slow_sensor_stretches_are_reported_once() -> None:
    driven = robots(0.5)
    answer = episode(driven)
    assert answer["metrics"] == {"light": 0.5}
    assert "steps took 0.5" in answer["warning"]
    assert "instead of 0.1 s (simulation.step), over 5 steps" in answer["warning"]
    assert "for /light (std_msgs/Float32; sensor light); make steps longer" in answer["warning"]
    assert "warning" not in episode(driven)


def test_for_a_slow_metric_another_remedy_is_named() -> None:
    score = {"topic": "score", "type": "std_msgs/Float32"}
    warning = episode(robots(0.5, {"score": score}, timeout=60.0))["warning"]
    assert "for /score (std_msgs/Float32; metric score); make steps longer" in warning
    assert warning.endswith("or give slow metrics a value otherwise")
    assert "warning" not in episode(robots(0.5, {"score": {**score, "otherwise": 0}}, timeout=60.0))


@pytest.mark.parametrize(("interval", "sensor"), [(0.05, {}), (0.1, {}), (0.5, {"timeout": 60.0})])
def test_sensors_that_are_in_time_need_no_warning(interval: float, sensor: dict[str, float]) -> None:
    assert "warning" not in episode(robots(interval, None, **sensor))
