import itertools

import pytest

from swarmwright.simulations.attachment import TRIES, AttachmentError, _draw_poses, find_free_position
from swarmwright.simulations.command.ros_definition import Area


def test_the_first_free_place_is_taken() -> None:
    numbers = itertools.count()
    assert find_free_position(lambda: next(numbers), lambda place: place >= 7) == 7
    assert next(numbers) == 8


def test_where_none_is_free_so_many_are_tried() -> None:
    numbers = itertools.count()
    assert find_free_position(lambda: next(numbers), lambda _: False) is None
    assert next(numbers) == TRIES


def test_robots_are_draw_poses_apart_or_refused() -> None:
    area = Area.model_validate({"x": [0, 2], "y": [0, 2]})
    poses = _draw_poses(area, 5, 0.5, seed=1)
    assert poses == _draw_poses(area, 5, 0.5, seed=1)
    for one, other in itertools.combinations(poses, 2):
        assert (one.x - other.x) ** 2 + (one.y - other.y) ** 2 >= 0.25
    with pytest.raises(AttachmentError, match=r"too small for 50 robots, 0\.5 m apart"):
        _draw_poses(area, 50, 0.5, seed=1)
