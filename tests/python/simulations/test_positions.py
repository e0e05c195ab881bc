"""Positions of sensors and actuators follow from their names and the robot's description."""

import math

import pytest

from swarmwright.simulations.positions import positions, positions_of


def polar(position: tuple[float, float]) -> tuple[float, float]:
    return round(math.hypot(*position), 3), round(math.degrees(math.atan2(position[1], position[0])) % 360, 1)


def test_numbered_sensors_lie_around_the_robot() -> None:
    assert positions_of([f"ray {index}" for index in range(4)], []) == [(1, 0), (0, 1), (-1, 0), (0, -1)]
    turned = positions_of(["ray 0", "ray 1"], [30.0, 300.0])
    assert turned is not None
    assert [polar(position) for position in turned] == [(1, 30), (1, 300)]


def test_each_kind_has_its_circle() -> None:
    names = ["ray 0", "ray 1", "attraction 45", "attraction 225", "speed", "ground left", "ground right"]
    found = positions_of(names, [])
    assert found is not None
    assert [polar(position) for position in found] == [
        (1, 0), (1, 180), (0.667, 45), (0.667, 225), (0, 0), (0.333, 90), (0.333, 270)
    ]  # fmt: skip
    assert len({*found}) == len(found)


@pytest.mark.parametrize("names", [[], ["speed"], ["", ""], ["level 0"]])
def test_names_without_directions(names: list[str]) -> None:
    assert positions_of(names, []) is None


def test_the_arenas_rays_are_known() -> None:
    robot = {
        "radius": 0.05,
        "drive": {"kind": "differential", "wheel_base": 0.05, "max_speed": 0.1},
        "sensors": [{"kind": "proximity", "angles": [20, 90, 200], "range": 0.1}, {"kind": "compass"}],
    }
    sensors, actuators = positions("arena", {"robot": robot})
    assert sensors is not None
    assert [polar(position) for position in sensors] == [(1, 20), (1, 90), (1, 200), (0.5, 0), (0.5, 90)]
    assert actuators == [(0, 1), (0, -1)]


def test_other_simulations() -> None:
    sensors, actuators = positions("emergency_exit", {})
    assert sensors is not None
    assert [polar(position)[1] for position in sensors] == [0, 90, 90, 45, 0, 315, 270, 225, 180, 135]
    assert actuators == [(1, 0), (0, 1)]
