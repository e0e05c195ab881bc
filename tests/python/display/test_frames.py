import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from swarmwright.display import Body, Scene
from swarmwright.display.animation import compute_pace, interpolate_scene, interpolate_scenes

MOST = 400


@given(scenes=st.integers(1, 5000), seconds=st.floats(0.02, 100))
def test_pace_keeps_the_duration_and_the_number_of_frames(scenes: int, seconds: float) -> None:
    per_step, frame = compute_pace(scenes, seconds, frame_seconds=0.06, most=MOST)
    assert per_step * (scenes - 1) <= MOST * (1 + 1e-9)
    assert per_step * frame == pytest.approx(seconds)


@pytest.mark.slow
@given(scenes=st.integers(1, 3000), seconds=st.floats(0.02, 3))
def test_frames_go_from_the_first_scene_to_the_last(scenes: int, seconds: float) -> None:
    trajectory = tuple(Scene(10, 10, step, "", ()) for step in range(scenes))
    per_step, _ = compute_pace(scenes, seconds, frame_seconds=0.06, most=MOST)
    frames = list(interpolate_scenes(trajectory, per_step))
    times = [time for _, time in frames]
    assert times == sorted(times)
    assert (times[0], times[-1]) == (0, scenes - 1)
    assert len(frames) <= MOST + 2
    assert all(scene.step == int(time) for scene, time in frames)


@given(share=st.floats(0, 1), x=st.floats(0, 100), y=st.floats(0, 100))
@example(share=0.8526995517976685, x=75.38190177995979, y=75.38190177995979)
def test_between_is_on_the_way(share: float, x: float, y: float) -> None:
    before, after = (Scene(100, 100, 0, "", (Body("agent", at, 50.0, "free", 0.0),)) for at in (x, y))
    middle = interpolate_scene(before, after, share).bodies[0]
    rounded = 1e-5  # binary32
    assert min(x, y) - rounded <= middle.x <= max(x, y) + rounded


@given(share=st.floats(0, 1), start=st.floats(-3, 3), turn=st.floats(-3, 3))
def test_headings_turn_the_shorter_way(share: float, start: float, turn: float) -> None:
    after = math.remainder(start + turn, 2 * math.pi)
    first, second = (Scene(9, 9, 0, "", (Body("agent", 1, 1, heading=at),)) for at in (start, after))
    heading = interpolate_scene(first, second, share).bodies[0].heading
    assert heading is not None
    assert abs(math.remainder(heading - start - share * turn, 2 * math.pi)) < 1e-5
