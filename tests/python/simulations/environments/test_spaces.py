"""Spaces as sensors and actuators: every value comes back, nothing leaves its bounds."""

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from swarmwright import InputError
from swarmwright.common.errors import SimulationError
from swarmwright.common.ranges import Range
from swarmwright.simulations.environments._environment import actuators, sensors, with_mask


def test_bounded_numbers_are_scaled_and_others_stay() -> None:
    box = spaces.Box(
        np.array([-4.0, -np.inf, 0.0, 5.0, -3e38]), np.array([4.0, 2.0, 10.0, 5.0, 3e38]), dtype=np.float64
    )
    read = sensors(box, "x").read
    assert read([-4.0, -7.0, 2.5, 5.0, 9.0]).tolist() == [-1.0, -7.0, -0.5, 5.0, 9.0]
    act = actuators(box, "x").act
    assert act(np.ones(5)).tolist() == [4.0, 2.0, 10.0, 5.0, 1.0]
    assert act(-np.ones(5)).tolist() == [-4.0, 0.0, 0.0, 5.0, -1.0]


def test_numbers_with_one_bound_reach_the_2_next_to_it() -> None:
    box = spaces.Box(np.array([0.0, 5.0, -np.inf]), np.array([np.inf, np.inf, -7.0]), dtype=np.float64)
    act = actuators(box, "x").act
    values = [act(np.full(3, number)).tolist() for number in (-1.0, 0.0, 1.0)]
    assert values == [[0.0, 5.0, -9.0], [1.0, 6.0, -8.0], [2.0, 7.0, -7.0]]


@pytest.mark.parametrize(
    ("low", "high", "kind"),
    [
        (0, 3, np.int64),
        (-2, 2, np.int64),
        (0, 1, np.uint8),
        (-128, 127, np.int8),
        (0, 255, np.uint8),
        (4, 4, np.int32),
    ],
)
def test_integers_have_bins_of_the_same_width(low: int, high: int, kind: Any) -> None:
    box = spaces.Box(low, high, (1,), kind)
    act = actuators(box, "x").act
    rows = (np.arange(25_600) + 0.5) / 12_800 - 1
    actions = [act(np.array([number])) for number in rows]
    assert all(map(box.contains, actions))
    values, counts = np.unique(actions, return_counts=True)
    assert values.tolist() == list(range(low, high + 1))
    assert counts.max() - counts.min() <= 1
    assert [act(np.array([end])).tolist() for end in (-1.0, 1.0)] == [[low], [high]]


@pytest.mark.parametrize(
    ("low", "high", "kind", "ends"),
    [
        (-(2**63), 2**63 - 1, np.int64, (-1, 1)),
        (0, 2**64 - 1, np.uint64, (0, 2)),
        (2**63 + 5, 2**64 - 1, np.uint64, (2**63 + 5, 2**63 + 7)),
        (2**63 - 2, 2**63 - 1, np.int64, (2**63 - 2, 2**63 - 1)),
        (-(2**63), 7, np.int64, (5, 7)),
    ],
)
def test_integers_with_limits_of_64_bits(low: int, high: int, kind: Any, ends: tuple[int, int]) -> None:
    box = spaces.Box(np.array([low], kind), np.array([high], kind), dtype=kind)
    act = actuators(box, "x").act
    actions = [act(np.array([end])) for end in (-1.0, 1.0)]
    assert tuple(action.tolist()[0] for action in actions) == ends
    assert all(map(box.contains, actions))


@pytest.mark.parametrize(
    ("space", "seen", "words"),
    [
        (
            spaces.Box(-1, 1, (2,)),
            np.array([0.5]),
            r"of the shape \(1,\) is not in Box\(2,\)",
        ),
        (spaces.Box(-1, 1, (2,)), "text", "'text' is not in"),
        (spaces.Box(-1, 1, (2,)), [[1.0], [1.0, 2.0]], "is not in"),
        (spaces.Discrete(3), -1, r"-1 is not in Discrete\(3\)"),
        (spaces.Discrete(3), 3, "3 is not in"),
        (spaces.Discrete(3, start=2), 1, "1 is not in"),
        (spaces.Discrete(3), 1.5, "1.5 is not in"),
        (spaces.Discrete(3), None, "None is not in"),
        (spaces.Discrete(3), float("inf"), "inf is not in"),
        (spaces.MultiDiscrete([3, 3]), np.array([3, 0]), r"is not in MultiDiscrete\(\[3 3\]\)"),
        (spaces.MultiDiscrete([3, 3]), np.array([0, -1]), "is not in"),
        (spaces.MultiDiscrete([3, 3]), np.array([1]), "is not in"),
        (spaces.MultiBinary(2), [0, 2], r"is not in MultiBinary\(2\)"),
        (spaces.MultiBinary(2), [0], "is not in"),
        (spaces.Dict({"a": spaces.Discrete(2)}), {"b": 1}, r"{'b': 1} is not in Dict"),
        (spaces.Dict({"a": spaces.Discrete(2)}), {"a": 2}, r"2 is not in Discrete\(2\)"),
        (spaces.Tuple([spaces.Discrete(2)]), (), r"\(\) is not in Tuple"),
    ],
)
def test_an_observation_that_is_not_in_its_space(space: Any, seen: Any, words: str) -> None:
    with pytest.raises(SimulationError, match=f"^x.*: the observation .*{words}"):
        sensors(space, "x").read(seen)


def test_numbers_may_exceed_their_bounds() -> None:
    assert sensors(spaces.Box(-1, 1, (2,)), "x").read([3.0, -4.0]).tolist() == [3.0, -4.0]


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
        spaces.Dict({"a": spaces.Box(-2, 3, (2,)), "b": spaces.Tuple([spaces.Discrete(3)])}),
    ],
)
def test_every_action_is_in_its_space(space: "spaces.Space[object]") -> None:
    act = actuators(space, "x")
    for row in np.random.default_rng(1).uniform(-1, 1, (50, act.width)):
        assert space.contains(act.act(row))


def test_what_has_no_fixed_size_is_refused() -> None:
    with pytest.raises(InputError, match=r"x\['a'\]: a Text space has no fixed number of values for sensors"):
        sensors(spaces.Dict({"a": spaces.Text(5)}), "x")
    with pytest.raises(InputError, match=r"x\['a'\]: actuators cannot control a Text space"):
        actuators(spaces.Dict({"a": spaces.Text(5)}), "x")
    with pytest.raises(InputError, match="x: a Tuple space without parts"):
        actuators(spaces.Tuple([]), "x")


def test_parts_of_an_action_follow_each_other() -> None:
    space = spaces.Dict(
        {"move": spaces.Box(0, 4, (2,)), "signal": spaces.Tuple([spaces.Discrete(3), spaces.MultiBinary(1)])}
    )
    made = actuators(space, "x")
    assert made.width == 2 + 3 + 1
    assert made.ranges == (Range(0, 4), Range(0, 4), None, None, None, None)
    action = made.act(np.array([-1.0, 0.5, 0.1, 0.9, 0.2, 1.0]))
    assert list(action) == ["move", "signal"]
    assert action["move"].tolist() == [0, 3]
    assert (action["signal"][0], action["signal"][1].tolist()) == (1, [1])


def masked(actions: Any, mask: Any) -> Any:
    return with_mask(spaces.Dict({"observation": spaces.Discrete(2), "action_mask": mask}), actions, "x")


@pytest.mark.parametrize("mask", [spaces.MultiBinary(3), spaces.Box(0, 1, (3,), np.int8)])
def test_a_mask_is_no_sensor_and_allows_choices(mask: Any) -> None:
    seen, allowed = masked(spaces.Discrete(3, start=5), mask)
    observation = {"observation": 1, "action_mask": np.array([1, 0, 1], np.int8)}
    assert seen.width == 2
    assert seen.read(observation).tolist() == [0, 1]
    assert allowed(observation).tolist() == [True, False, True]
    choose = actuators(spaces.Discrete(3, start=5), "x").act
    for row, choice in (([0.1, 0.9, 0.2], 7), ([0.3, 0.9, 0.2], 5)):
        assert choose(np.array(row), allowed(observation)) == choice
    # As that of an agent whose turn it is not.
    assert allowed({"observation": 1, "action_mask": np.zeros(3)}) is None
    with pytest.raises(SimulationError, match=r"x\['action_mask'\]: .* of the shape .* is not in"):
        allowed({"observation": 1, "action_mask": np.ones(4)})
    for without in ({"observation": 1}, {"observation": 1, "action_mask": None}, np.ones(3)):
        with pytest.raises(SimulationError, match=r"^x: an observation lacks 'action_mask', which is"):
            allowed(without)


def test_masks_of_several_choices() -> None:
    space = spaces.MultiDiscrete([2, 3], start=[4, 0])
    act = actuators(space, "x").act
    row = np.array([1.0, 0.9, 0.5, 0.1])
    assert act(row, np.array([1, 1, 1, 1, 1], bool)).tolist() == [5, 0]
    assert act(row, np.array([1, 0, 0, 1, 1], bool)).tolist() == [4, 1]
    assert act(row, np.array([1, 0, 0, 0, 0], bool)).tolist() == [4, 0], "a choice without any is free"
    _, allowed = masked(space, spaces.Tuple([spaces.MultiBinary(2), spaces.MultiBinary(3)]))
    seen = {"observation": 0, "action_mask": (np.array([0, 1]), np.array([1, 0, 0]))}
    assert allowed(seen).tolist() == [False, True, True, False, False]
    sign = actuators(spaces.Discrete(2), "x").act
    assert [sign(np.array([-1.0]), np.array([no, True])) for no in (True, False)] == [0, 1]


@pytest.mark.parametrize(
    ("actions", "mask"),
    [
        (spaces.Box(-1, 1, (3,)), spaces.MultiBinary(3)),
        (spaces.Discrete(4), spaces.MultiBinary(3)),
        (spaces.Discrete(3), spaces.Discrete(3)),
    ],
)
def test_what_is_not_a_mask_of_the_actions_is_sensed(actions: Any, mask: Any) -> None:
    seen, allowed = masked(actions, mask)
    assert seen.width == 2 + 3
    assert allowed({"observation": 1, "action_mask": np.array([1, 0, 1])}) is None


def test_what_scaled_numbers_stand_for() -> None:
    box = spaces.Box(np.array([-4.0, -np.inf, 0.0, -1.0]), np.array([4.0, 2.0, 10.0, 1.0]), dtype=np.float64)
    scaled = (Range(-4, 4), None, Range(0, 10), None)
    assert sensors(box, "x").ranges == scaled
    assert actuators(box, "x").ranges == (Range(-4, 4), Range(0, 2), Range(0, 10), None)
    both = spaces.Dict({"a": spaces.Discrete(2), "b": box, "c": spaces.MultiBinary(2)})
    assert sensors(both, "x").ranges == (None, None, *scaled, None, None)
    for choices in (spaces.Discrete(3), spaces.MultiDiscrete([2, 4]), spaces.MultiBinary(2)):
        made = actuators(choices, "x")
        assert made.ranges == (None,) * made.width
        assert sensors(choices, "x").ranges == (None,) * sensors(choices, "x").width
    whole = actuators(spaces.Box(2, 5, (1,), np.int64), "x")
    assert whole.ranges == (Range(1.5, 5.5),)
    for number in np.linspace(-0.99, 0.99, 50):
        assert whole.act(np.array([number])).tolist() == [round(1.5 + (number + 1) / 2 * 4)]
