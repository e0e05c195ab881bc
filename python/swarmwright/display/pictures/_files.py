"""Saving of episodes of pictures in formats by file suffix."""

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.display._episode import Caption
from swarmwright.display._look import BORDER, INK, PAPER
from swarmwright.display.animation import FRAME_SECONDS as GIF_SECONDS
from swarmwright.display.animation import LAST_FRAME_SECONDS, MOST_FRAMES
from swarmwright.display.files import FORMATS
from swarmwright.display.film import FRAME_SECONDS as FILM_SECONDS
from swarmwright.display.film import encode
from swarmwright.display.page import write_pictures
from swarmwright.display.pictures._record import PictureRecording

if TYPE_CHECKING:
    from PIL.Image import Image

COLORS = 256
_STILLS, _ROW = 6, 3
"""Pictures of a still, and of each of its rows."""
_LINE_HEIGHT_PIXELS = 20
"""Height of a line of text, in pixels."""


def save(
    recording: PictureRecording, path: Path, *, caption: Caption | None = None, speed: float = 1.0
) -> None:
    """Save an episode: .gif and .mp4 as animations, .png as six moments, .html as a page with playback.

    Raises ValueError for an unknown suffix, InputError when ffmpeg is missing for a video, and OSError.
    """
    ending = path.suffix.lower()
    if ending not in _WRITERS:
        raise ValueError(f"'{path}': unknown suffix; use {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.")
    _WRITERS[ending](recording, path, caption or Caption(), speed)


def _write_animation(recording: PictureRecording, path: Path, _caption: Caption, speed: float) -> None:
    from PIL import Image

    chosen, seconds = recording.select_pictures(MOST_FRAMES, GIF_SECONDS, speed)
    images = [recording.image(index) for index in chosen]
    # One palette for the whole episode without dithering, so that static areas do not flicker.
    sample = [images[round(number * (len(images) - 1) / 3)].resize((160, 120)) for number in range(4)]
    strip = Image.new("RGB", (640, 120))
    for number, image in enumerate(sample):
        strip.paste(image, (160 * number, 0))
    palette = strip.quantize(COLORS)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [round(1000 * seconds)] * (len(frames) - 1) + [round(1000 * LAST_FRAME_SECONDS)]
    buffer = io.BytesIO()
    frames[0].save(
        buffer, "GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0, optimize=True
    )
    path.write_bytes(buffer.getvalue())


def _write_film(recording: PictureRecording, path: Path, caption: Caption, speed: float) -> None:
    chosen, seconds = recording.select_pictures(len(recording.pictures), FILM_SECONDS, speed)
    encode(_iterate_images(recording, chosen), seconds, path, title=caption.title)


def _iterate_images(recording: PictureRecording, chosen: list[int]) -> "Iterator[Image]":
    for index in chosen:
        yield recording.image(index)


def _write_still(recording: PictureRecording, path: Path, caption: Caption, _speed: float) -> None:
    """Draw six moments from the first to the last step, each with step and fitness so far."""
    from PIL import Image, ImageDraw, ImageFont

    count = min(_STILLS, len(recording.pictures))
    chosen = [round(number * (len(recording.pictures) - 1) / max(count - 1, 1)) for number in range(count)]
    images = [recording.image(index) for index in chosen]
    for image in images:
        image.thumbnail((400, 400))
    width, height = images[0].size
    columns = min(count, _ROW)
    rows = -(-count // columns)
    size = (columns * (width + 8) + 8, rows * (height + _LINE_HEIGHT_PIXELS + 8) + _LINE_HEIGHT_PIXELS + 8)
    sheet = Image.new("RGB", size, PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    draw.text((8, 5), caption.title, fill=INK, font=font)
    for number, (index, image) in enumerate(zip(chosen, images, strict=True)):
        row, column = divmod(number, columns)
        left, top = (
            8 + column * (width + 8),
            8 + _LINE_HEIGHT_PIXELS + row * (height + _LINE_HEIGHT_PIXELS + 8),
        )
        step = recording.steps[index]
        draw.text(
            (left, top),
            f"step {step}   fitness {recording.fitness_so_far[step] + 0.0:.4g}",
            fill=INK,
            font=font,
        )
        sheet.paste(image, (left, top + _LINE_HEIGHT_PIXELS - 2))
        draw.rectangle(
            (left - 1, top + _LINE_HEIGHT_PIXELS - 3, left + width, top + _LINE_HEIGHT_PIXELS - 2 + height),
            outline=BORDER,
        )
    buffer = io.BytesIO()
    sheet.save(buffer, "PNG")
    path.write_bytes(buffer.getvalue())


def _write_page(recording: PictureRecording, path: Path, caption: Caption, speed: float) -> None:
    write_pictures(recording, path, caption=caption, speed=speed)


_WRITERS: dict[str, Callable[[PictureRecording, Path, Caption, float], None]] = {
    ".html": _write_page,
    ".gif": _write_animation,
    ".mp4": _write_film,
    ".png": _write_still,
}
