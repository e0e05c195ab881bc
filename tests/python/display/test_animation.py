from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from swarmwright.display import Body, Scene, record
from swarmwright.display._look import BLUE, GREEN, RED, rgb
from swarmwright.display.animation import LAST_FRAME_SECONDS, MOST_FRAMES, _pace, between, save


def count(image: Image.Image, color: str) -> int:
    """Number of pixels of exactly this colour."""
    pixels = np.asarray(image.convert("RGB"))
    return int((pixels == rgb(color)).all(axis=2).sum())


def column(image: Image.Image, color: str) -> float:
    """Mean x of the pixels of this colour above the legend."""
    pixels = np.asarray(image.convert("RGB"))[: int(image.height * 0.8)]
    return float(np.nonzero((pixels == rgb(color)).all(axis=2))[1].mean())


def test_animation_shows_the_agent_on_its_way_to_the_goal(crossing: Any, tmp_path: Path) -> None:
    path = tmp_path / "crossing.gif"
    recording = record(crossing)
    save(recording, path)
    with Image.open(path) as animation:
        frames = int(getattr(animation, "n_frames"))  # noqa: B009 - GIF has it, the base class does not
        assert frames > len(recording.scenes), "bodies glide between two steps"
        assert animation.info["loop"] == 0
        places = []
        for frame in (0, frames // 3, 2 * frames // 3):
            animation.seek(frame)
            places.append(column(animation, BLUE))
            assert count(animation, RED) > 50, "the defender"
        assert places == sorted(places)
        assert places[2] - places[0] > animation.width / 3
        animation.seek(frames - 1)
        assert animation.info["duration"] == pytest.approx(1000 * LAST_FRAME_SECONDS, abs=10)
        assert column(animation, GREEN) > places[2], "the arrived agent, on the goal"
        field = animation.convert("RGB").crop((0, 0, animation.width, int(animation.height * 0.8)))
        assert count(field, BLUE) == 0, "nobody is on the way any more"
    assert path.stat().st_size < 150_000


def test_speed_shortens_the_animation(crossing: Any, tmp_path: Path) -> None:
    recording = record(crossing)

    def seconds(speed: float) -> float:
        save(recording, tmp_path / "x.gif", speed=speed)
        total = 0
        with Image.open(tmp_path / "x.gif") as animation:
            for frame in range(int(getattr(animation, "n_frames")) - 1):  # noqa: B009
                animation.seek(frame)
                total += animation.info["duration"]
        return total / 1000

    assert seconds(1.0) == pytest.approx(12 * 0.25, rel=0.1)
    assert seconds(3.0) == pytest.approx(12 * 0.25 / 3, rel=0.1)


def test_still_shows_the_whole_way(crossing: Any, tmp_path: Path) -> None:
    path = tmp_path / "crossing.png"
    save(record(crossing), path)
    with Image.open(path) as still:
        assert still.width >= 1000
        # A line of one colour runs from the start to the goal: more than half of the width.
        pixels = np.asarray(still.convert("RGB")).astype(int)
    greenish = (pixels[:, :, 1] > pixels[:, :, 0] + 40) & (pixels[:, :, 1] > pixels[:, :, 2])
    assert greenish.sum(axis=1).max() > pixels.shape[1] / 2


@pytest.mark.parametrize("message", ["costs $5 or \\frac{", "", "x" * 500, "two\nlines", "日本語 🤖"])
def test_any_message_can_be_shown(crossing: Any, tmp_path: Path, message: str) -> None:
    crossing.message = message
    save(record(crossing), tmp_path / "message.png")
    assert (tmp_path / "message.png").stat().st_size > 5000


def test_many_bodies_and_odd_maps(tmp_path: Path) -> None:
    from swarmwright.display._episode import Recording

    random = np.random.default_rng(1)
    bodies = tuple(Body("agent", float(x), float(y), "caught", 0.0) for x, y in random.random((500, 2)))
    for width, height in ((1.0, 1.0), (1000.0, 1.0), (1.0, 1000.0)):
        recording = Recording((Scene(width, height, 0, "", bodies),), -1.0, 0.0)
        for name in ("x.gif", "x.png"):
            save(recording, tmp_path / name)
            with Image.open(tmp_path / name) as picture:
                assert 100 < picture.height < 2000


def test_other_endings_are_refused(crossing: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"\.gif or \.png"):
        save(record(crossing), tmp_path / "x.mp4")


@given(scenes=st.integers(1, 5000), seconds=st.floats(0.02, 100))
def test_pace_keeps_the_duration_and_the_number_of_frames(scenes: int, seconds: float) -> None:
    per_step, frame = _pace(scenes, seconds)
    assert per_step * (scenes - 1) <= MOST_FRAMES * (1 + 1e-9)
    assert per_step * frame == pytest.approx(seconds)


@given(share=st.floats(0, 1), x=st.floats(0, 100), y=st.floats(0, 100))
def test_between_is_on_the_way(share: float, x: float, y: float) -> None:
    before, after = (Scene(100, 100, 0, "", (Body("agent", at, 50.0, "free", 0.0),)) for at in (x, y))
    middle = between(before, after, share).bodies[0]
    assert min(x, y) - 1e-9 <= middle.x <= max(x, y) + 1e-9
