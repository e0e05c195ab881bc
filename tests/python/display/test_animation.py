from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from swarmwright.display import record
from swarmwright.display._look import BLUE, GREEN, RED, to_rgb
from swarmwright.display.animation import LAST_FRAME_SECONDS
from swarmwright.display.files import save

pytestmark = pytest.mark.slow


def count(image: Image.Image, color: str) -> int:
    """Number of pixels of exactly this colour."""
    pixels = np.asarray(image.convert("RGB"))
    return int((pixels == to_rgb(color)).all(axis=2).sum())


def column(image: Image.Image, color: str) -> float:
    """Mean x of the pixels of this colour above the legend."""
    pixels = np.asarray(image.convert("RGB"))[: int(image.height * 0.8)]
    return float(np.nonzero((pixels == to_rgb(color)).all(axis=2))[1].mean())


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
