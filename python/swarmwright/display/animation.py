"""Animated GIFs, and the frames of animations and videos."""

import io
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.time_limit import check_time_limit
from swarmwright.display._episode import Caption, Part, Shown
from swarmwright.display._key import scale_of
from swarmwright.display._look import Looks, build_palette, floor_color, floor_labels
from swarmwright.display._scene import Bodies, Scene
from swarmwright.display.drawing import Picture

_LEAST_SHARE = 0.6
"""Smallest duration of a step, as a share of a frame's time; shorter steps are skipped."""


def compute_pace(scenes: int, step_seconds: float, *, frame_seconds: float, most: int) -> tuple[float, float]:
    """Return frames per step and seconds per frame, for smooth motion with at most `most` frames.

    Fewer than 1 frame per step skips steps.

    Args:
        scenes: scenes of the episode, its first one included.
        step_seconds: duration of a step.
        frame_seconds: approximate duration of a frame.
        most: largest number of frames.
    """
    steps = max(scenes - 1, 1)
    ideal = step_seconds / frame_seconds
    # Steps that are much shorter than a frame are not visible individually.
    per_step = ideal if ideal < _LEAST_SHARE else max(1.0, float(round(ideal)))
    if per_step * steps > most:
        per_step = most / steps
        if per_step > 1:
            per_step = float(int(per_step))
    return per_step, step_seconds / per_step


def interpolate_scenes(scenes: tuple[Scene, ...], per_step: float) -> Iterator[tuple[Scene, float]]:
    """Yield scenes with their time in steps; bodies move smoothly between steps."""
    for each in _interpolate_scenes(scenes, per_step):
        check_time_limit()
        yield each


def _interpolate_scenes(scenes: tuple[Scene, ...], per_step: float) -> Iterator[tuple[Scene, float]]:
    if per_step < 1:
        last = len(scenes) - 1
        chosen = sorted({min(last, round(i / per_step)) for i in range(int(last * per_step) + 2)})
        yield from ((scenes[i], float(i)) for i in chosen)
        return
    parts = int(per_step)
    for index, (before, after) in enumerate(pairwise(scenes)):
        for part in range(parts):
            share = part / parts
            yield interpolate_scene(before, after, share), index + share
    yield scenes[-1], float(len(scenes) - 1)


def interpolate_scene(before: Scene, after: Scene, share: float) -> Scene:
    """Interpolate between two scenes, share 0..1; states change at the end of the step."""
    if len(before.bodies) != len(after.bodies):
        return before
    a, b = Bodies.from_bodies(before.bodies), Bodies.from_bodies(after.bodies)
    # The shorter turn.
    turn = (b.heading - a.heading + np.pi) % (2 * np.pi) - np.pi
    x, y = (_interpolate(getattr(a, axis), getattr(b, axis), share) for axis in ("x", "y"))
    return replace(before, bodies=a.with_positions(x, y, a.heading + np.float32(share) * turn))


def _interpolate(
    before: NDArray[np.float32], after: NDArray[np.float32], share: float
) -> NDArray[np.float32]:
    return (before.astype(np.float64) * (1 - share) + after.astype(np.float64) * share).astype(np.float32)


FRAME_SECONDS = 0.06
"""Approximate seconds of a frame; viewers do not show frames shorter than 0.02."""

MOST_FRAMES = 400
LAST_FRAME_SECONDS = 2.0


def write(
    part: Part,
    path: Path,
    *,
    caption: Caption,  # noqa: ARG001
    speed: float = 1.0,
    shown: Shown | None = None,
) -> None:
    """Write a GIF of 560 pixels in width. Raises OSError."""
    from PIL import Image

    recording = part.recording
    step_seconds = max(recording.step_size, 0.02) / speed
    picture = Picture(part, dpi=80, shown=shown)
    frames: list[Image.Image] = []
    # One palette without dithering, so that static areas do not flicker.
    colors = Image.new("P", (1, 1))
    looks = Looks(recording.scenes)
    custom = list(dict.fromkeys(looks.color(look) for look in looks.names()))
    greys = {floor_color(grey) for scene in recording.scenes for grey in floor_labels(scene)}
    valued = scale_of(recording) is not None
    colors.putpalette(build_palette(custom, sorted(greys), values=valued, states=picture.states))
    count, seconds = compute_pace(
        len(recording.scenes), step_seconds, frame_seconds=FRAME_SECONDS, most=MOST_FRAMES
    )
    for scene, time in interpolate_scenes(recording.scenes, count):
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
