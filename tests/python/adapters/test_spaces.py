"""Spaces as sensors and actuators: every value comes back, nothing leaves its bounds."""

import numpy as np
import pytest
from gymnasium import spaces

from swarmwright import InputError
from swarmwright.adapters._spaces import actuators, sensors


def test_bounded_numbers_are_scaled_and_others_stay() -> None:
    box = spaces.Box(
        np.array([-4.0, -np.inf, 0.0, 5.0, -3e38]), np.array([4.0, 2.0, 10.0, 5.0, 3e38]), dtype=np.float64
    )
    read = sensors(box, "x").read
    assert read([-4.0, -7.0, 2.5, 5.0, 9.0]).tolist() == [-1.0, -7.0, -0.5, 5.0, 9.0]
    act = actuators(box, "x").act
    assert act(np.ones(5)).tolist() == [4.0, 1.0, 10.0, 5.0, 1.0]
    assert act(-np.ones(5)).tolist() == [-4.0, -1.0, 0.0, 5.0, -1.0]


def test_pictures_are_flattened() -> None:
    box = spaces.Box(0, 255, (2, 2, 3), np.uint8)
    read = sensors(box, "x")
    assert read.width == 12
    assert read.read(np.full((2, 2, 3), 255, np.uint8)).tolist() == [1.0] * 12
    action = actuators(box, "x").act(np.full(12, 1.0))
    assert (action.dtype, action.shape, action.max()) == (np.uint8, (2, 2, 3), 255)


def test_choices_are_one_number_each() -> None:
    assert sensors(spaces.Discrete(3, start=-1), "x").read(0).tolist() == [0, 1, 0]
    both = sensors(spaces.MultiDiscrete([2, 3], start=[1, 0]), "x")
    assert both.read(np.array([2, 0])).tolist() == [0, 1, 1, 0, 0]
    assert sensors(spaces.MultiBinary([2, 2]), "x").read(np.eye(2, dtype=np.int8)).tolist() == [1, 0, 0, 1]


def test_parts_follow_each_other() -> None:
    parts = spaces.Dict(
        {"b": spaces.Discrete(2), "a": spaces.Tuple([spaces.Box(0, 2, (2,)), spaces.Discrete(1)])}
    )
    read = sensors(parts, "x")
    seen = {"a": (np.array([0.0, 1.0], np.float32), 0), "b": 1}
    assert read.width == 5
    assert read.read(seen).tolist() == [-1, 0, 1, 0, 1]


def test_the_largest_actuator_chooses() -> None:
    choose = actuators(spaces.Discrete(3, start=5), "x")
    assert choose.width == 3
    assert [choose.act(np.array(row)) for row in ([0, 0, 1.0], [-1.0, -1, -1], [-1, 0, 0])] == [7, 5, 6]
    sign = actuators(spaces.Discrete(2), "x")
    assert (sign.width, sign.act(np.array([0.1])), sign.act(np.array([-0.1]))) == (1, 1, 0)
    assert actuators(spaces.Discrete(1), "x").act(np.array([1.0])) == 0
    several = actuators(spaces.MultiDiscrete(np.array([[2, 3]]), start=np.array([[0, 1]])), "x")
    assert several.width == 4
    assert several.act(np.array([1.0, 0.0, 0.5, -1.0])).tolist() == [[1, 2]]
    binary = actuators(spaces.MultiBinary(3), "x")
    assert binary.act(np.array([0.3, 0.0, -1.0])).tolist() == [1, 0, 0]


@pytest.mark.parametrize(
    "space",
    [
        spaces.Box(-2, 3, (2, 2), np.float32),
        spaces.Discrete(4, start=2),
        spaces.MultiDiscrete([3, 2, 4]),
        spaces.MultiBinary((2, 3)),
    ],
)
def test_every_action_is_in_its_space(space: "spaces.Space[object]") -> None:
    act = actuators(space, "x")
    for row in np.random.default_rng(1).uniform(-1, 1, (50, act.width)):
        assert space.contains(act.act(row))


def test_what_has_no_fixed_size_is_refused() -> None:
    with pytest.raises(InputError, match=r"x\['a'\]: a Text space cannot be read by sensors"):
        sensors(spaces.Dict({"a": spaces.Text(5)}), "x")
    with pytest.raises(InputError, match="x: a Dict space cannot be steered by actuators"):
        actuators(spaces.Dict({"a": spaces.Discrete(5)}), "x")
