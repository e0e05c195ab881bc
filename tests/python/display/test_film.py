"""Films are written, and decoded again by ffmpeg."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imageio_ffmpeg import get_ffmpeg_exe

from swarmwright import InputError, RunError
from swarmwright.display import Caption, record
from swarmwright.display import film as module
from swarmwright.display._look import BLUE, to_rgb
from swarmwright.display.files import save
from swarmwright.display.film import LAST_FRAME_SECONDS


def frames(path: Path) -> tuple[list[np.ndarray[Any, Any]], str]:
    """Every frame as (height, width, 3), and what ffmpeg says about the file."""
    said = subprocess.run([get_ffmpeg_exe(), "-i", path], capture_output=True, text=True, check=False).stderr
    width, height = map(int, said.split(" yuv420p")[1].split(", ")[1].split(" ")[0].split("x"))
    raw = subprocess.run(
        [get_ffmpeg_exe(), "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"],
        capture_output=True, check=True,
    ).stdout  # fmt: skip
    pixels = np.frombuffer(raw, dtype=np.uint8).reshape(-1, height, width, 3)
    return list(pixels), said


def bluish(frame: np.ndarray[Any, Any]) -> float:
    """Mean column of what has the colour of a free agent, above the legend."""
    upper = frame[: int(len(frame) * 0.8)].astype(int)
    return float(np.nonzero((abs(upper - to_rgb(BLUE)) < 25).all(axis=2))[1].mean())


@pytest.mark.slow
def test_a_film_shows_the_agent_on_its_way(crossing: Any, tmp_path: Path) -> None:
    path = tmp_path / "crossing.mp4"
    save(record(crossing), path, caption=Caption("a title"), speed=2.0)
    shown, said = frames(path)
    assert "a title" in said
    assert "h264" in said
    seconds = 12 * 0.25 / 2 + LAST_FRAME_SECONDS
    assert f"Duration: 00:00:0{int(seconds)}" in said
    places = [bluish(shown[index]) for index in (0, 15, 30)]
    assert places == sorted(places)
    assert places[2] - places[0] > shown[0].shape[1] / 3


def test_without_ffmpeg_it_says_how_to_get_it(
    crossing: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "")
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(InputError, match="pip install imageio-ffmpeg"):
        save(record(crossing), tmp_path / "x.mp4")


@pytest.mark.slow
def test_what_ffmpeg_complains_of_is_said(
    crossing: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_find_ffmpeg", lambda _: get_ffmpeg_exe())
    with pytest.raises(RunError, match="No such file or directory"):
        save(record(crossing), tmp_path / "nowhere" / "x.mp4")
