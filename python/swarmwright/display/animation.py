"""An episode as an animated GIF."""

import io
from pathlib import Path

from swarmwright.display._caption import Caption
from swarmwright.display._frames import in_between, pace
from swarmwright.display._key import scale_of
from swarmwright.display._look import Looks, floor_color, floors, palette
from swarmwright.display._part import Part
from swarmwright.display._shown import Shown
from swarmwright.display.drawing import Picture

FRAME_SECONDS = 0.06
"""Seconds that a frame is shown, about; viewers show nothing faster than 0.02."""

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
    # One palette, without dithering: still areas stay the same from frame to frame, nothing flickers.
    colors = Image.new("P", (1, 1))
    looks = Looks(recording.scenes)
    own = list(dict.fromkeys(looks.color(look) for look in looks.all()))
    greys = {floor_color(grey) for scene in recording.scenes for grey in floors(scene)}
    valued = scale_of(recording) is not None
    colors.putpalette(palette(own, sorted(greys), values=valued, states=picture.states))
    count, seconds = pace(len(recording.scenes), step_seconds, frame_seconds=FRAME_SECONDS, most=MOST_FRAMES)
    for scene, time in in_between(recording.scenes, count):
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
