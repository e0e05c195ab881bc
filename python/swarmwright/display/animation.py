"""Episodes as pictures: an animated GIF, or a still of all trajectories as PNG."""

import io
import warnings
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from swarmwright.display._drawing import Picture
from swarmwright.display._episode import Recording
from swarmwright.display._look import palette
from swarmwright.display._scene import Body, Scene

FRAME_SECONDS = 0.06
"""Seconds that a frame of an animation stands, about; viewers show nothing faster than 0.02."""

MOST_FRAMES = 400
LAST_FRAME_SECONDS = 2.0

FORMATS = (".gif", ".png")
"""Endings that `save` knows."""


def save(recording: Recording, path: Path, *, speed: float = 1.0) -> None:
    """Write an episode as a picture, by the ending of `path`: .gif moves, .png shows all trajectories.

    speed: how many times faster than the simulation's step size an animation runs.
    Raises ValueError for another ending, OSError where nothing can be written.
    """
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise ValueError(f"'{path}': pictures end with {' or '.join(FORMATS)}.")
    with warnings.catch_warnings():
        # A message in a script that the font lacks is shown as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing", category=UserWarning)
        if ending == ".gif":
            _save_animation(recording, path, speed)
        else:
            _save_still(recording, path)


def _save_still(recording: Recording, path: Path) -> None:
    picture = Picture(recording, dpi=144)
    picture.draw(recording.scenes[-1], len(recording.scenes) - 1)
    buffer = io.BytesIO()
    picture.figure.savefig(buffer, format="png")
    path.write_bytes(buffer.getvalue())


def _save_animation(recording: Recording, path: Path, speed: float) -> None:
    from PIL import Image

    step_seconds = max(recording.step_size, 0.02) / speed
    picture = Picture(recording, dpi=80)
    frames: list[Image.Image] = []
    # One palette, without dithering: still areas stay the same from frame to frame, nothing flickers.
    colors = Image.new("P", (1, 1))
    colors.putpalette(palette())
    count, seconds = _pace(len(recording.scenes), step_seconds)
    for scene, time in _in_between(recording.scenes, count):
        frames.append(picture.image(scene, time).quantize(palette=colors, dither=Image.Dither.NONE))
    durations = [max(20, round(1000 * seconds))] * len(frames)
    durations[-1] = round(1000 * LAST_FRAME_SECONDS)
    buffer = io.BytesIO()
    frames[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=durations,
        loop=0,
        optimize=True,
    )
    path.write_bytes(buffer.getvalue())


def _pace(scenes: int, step_seconds: float) -> tuple[float, float]:
    """Frames a step and seconds a frame, such that it looks smooth and stays below MOST_FRAMES.

    Frames a step below 1 leave steps out.
    """
    steps = max(scenes - 1, 1)
    per_step = max(1.0, float(round(step_seconds / FRAME_SECONDS)))
    if per_step * steps > MOST_FRAMES:
        per_step = MOST_FRAMES / steps
        if per_step > 1:
            per_step = float(int(per_step))
    return per_step, step_seconds / per_step


def _in_between(scenes: tuple[Scene, ...], per_step: float) -> Iterator[tuple[Scene, float]]:
    """Scenes with their time in steps; bodies glide from one step to the next."""
    if per_step < 1:
        last = len(scenes) - 1
        chosen = sorted({min(last, round(i / per_step)) for i in range(MOST_FRAMES + 1)})
        yield from ((scenes[i], float(i)) for i in chosen)
        return
    parts = int(per_step)
    for index, (before, after) in enumerate(pairwise(scenes)):
        for part in range(parts):
            share = part / parts
            yield between(before, after, share), index + share
    yield scenes[-1], float(len(scenes) - 1)


def between(before: Scene, after: Scene, share: float) -> Scene:
    """The scene a share (0..1) of the way from one to the next; states change at the end of the step."""
    if len(before.bodies) != len(after.bodies):
        return before
    bodies = tuple(
        Body(a.kind, a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), a.state, a.radius)
        for a, b in zip(before.bodies, after.bodies, strict=True)
    )
    return Scene(before.width, before.height, before.step, before.message, bodies)
