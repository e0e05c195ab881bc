"""Episodes drawn by the simulation itself: as an animation, a video, a still, or a page."""

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.engine_types import SceneFields
from swarmwright.common.errors import InputError
from swarmwright.common.time_limit import check_time_limit
from swarmwright.common.untrusted import escape_line
from swarmwright.display._episode import Caption, Playable
from swarmwright.display._look import BORDER, INK, PAPER
from swarmwright.display.animation import FRAME_SECONDS as GIF_SECONDS
from swarmwright.display.animation import LAST_FRAME_SECONDS, MOST_FRAMES
from swarmwright.display.files import FORMATS
from swarmwright.display.film import FRAME_SECONDS as FILM_SECONDS
from swarmwright.display.film import encode
from swarmwright.display.page import write_pictures

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["PictureRecording", "Pictured", "Pictures", "record", "save"]


MOST_PICTURES = 600
"""Largest number of recorded pictures of an episode; of longer episodes, every second, fourth, .. step."""
LARGEST_SIZE_PIXELS = (640, 640)
"""Largest size of a picture in pixels; larger pictures are scaled down."""

Draw = Callable[[], NDArray[np.uint8]]
"""Draws the current state, (height, width, 3)."""


@dataclass(frozen=True)
class PictureRecording:
    """A whole episode in pictures.

    pictures: as PNG. steps: the step of each, including the first and the last. fitness_so_far:
    before the first step and after each. step_size: seconds between two steps when shown.
    """

    pictures: tuple[bytes, ...]
    steps: tuple[int, ...]
    fitness_so_far: tuple[float, ...]
    step_size: float

    @property
    def fitness(self) -> float:
        """Fitness of the episode, at its end."""
        return self.fitness_so_far[-1]

    def image(self, index: int) -> "Image":
        """Return a picture, RGB."""
        from PIL import Image

        with Image.open(io.BytesIO(self.pictures[index])) as opened:
            return opened.convert("RGB")

    def select_pictures(self, most: int, shortest: float, speed: float) -> tuple[list[int], float]:
        """Select the pictures of a video; return their indices and the seconds of each.

        most: most pictures. shortest: least seconds of a picture. speed: factor relative to real time.
        """
        seconds = max(self.step_size, 0.02) * (len(self.fitness_so_far) - 1) / speed
        count = max(1, min(len(self.pictures), most, int(seconds / shortest) + 1))
        indices = np.unique(np.linspace(0, len(self.pictures) - 1, count).round().astype(int)).tolist()
        return indices, max(seconds / max(len(indices) - 1, 1), shortest)


class Pictured:
    """An episode of a simulation that draws pictures, to be watched in a terminal."""

    def __init__(self, episode: Playable, draw: Draw) -> None:
        self._episode = episode
        self._draw = draw
        self._step = 0

    @property
    def done(self) -> bool:
        """Whether the episode has ended."""
        return self._episode.done

    @property
    def fitness(self) -> float:
        """Fitness so far; larger is better."""
        return self._episode.fitness

    @property
    def step_size(self) -> float:
        """Seconds between two frames when shown."""
        return self._episode.step_size

    def step(self) -> None:
        """Advance by one step."""
        self._episode.step()
        self._step += 1

    def scene(self) -> SceneFields:
        """Raise InputError, since the simulation draws pictures only."""
        raise InputError(
            "this simulation draws pictures instead of scenes; use --save FILE.html, .gif, .mp4 or .png"
        )

    def text(self, columns: int, color: bool, rows: int, unicode: bool) -> str:
        """Return the picture as characters, below a line with the step."""
        return format_picture(self._draw(), f"step {self._step}", columns, rows, color=color and unicode)


class Pictures:
    """Recorder of pictures of a running episode; of a long episode, every second, fourth, .. step."""

    def __init__(self, draw: Draw) -> None:
        self._draw = draw
        self._pictures: dict[int, bytes] = {}
        self._fitness: list[float] = []
        self._every = 1

    def keep(self, fitness: float, *, ended: bool) -> None:
        """Record a picture, before the first step and after each step; fitness: so far."""
        self._fitness.append(fitness)
        step = len(self._fitness) - 1
        if step % self._every and not ended:
            return
        self._pictures[step] = _encode_png(self._draw())
        if len(self._pictures) > MOST_PICTURES and not ended:
            self._every *= 2
            self._pictures = {
                step: picture for step, picture in self._pictures.items() if step % self._every == 0
            }

    def recording(self, step_size: float) -> PictureRecording:
        """Return the recording; step_size: seconds between two steps when shown."""
        pictures, steps = tuple(self._pictures.values()), tuple(self._pictures)
        return PictureRecording(pictures, steps, tuple(self._fitness[: steps[-1] + 1]), step_size)


def record(episode: Playable, draw: Draw) -> PictureRecording:
    """Step an episode to its end and record pictures."""
    pictures = Pictures(draw)
    pictures.keep(episode.fitness, ended=episode.done)
    while not episode.done:
        check_time_limit()
        episode.step()
        pictures.keep(episode.fitness, ended=episode.done)
    return pictures.recording(episode.step_size)


def _encode_png(drawn: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(drawn))
    image.thumbnail(LARGEST_SIZE_PIXELS, Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", compress_level=1)
    return buffer.getvalue()


_SHADES = " .:-=+*#%@"
"""Characters from dark to bright."""
_RESET = "\x1b[0m"


def format_picture(drawn: NDArray[np.uint8], head: str, columns: int, rows: int, *, color: bool) -> str:
    """Return a heading and a picture, (height, width, 3), as text of at most this many columns and rows."""
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(drawn))
    available = max(rows - 1, 1)
    # A character is about twice as high as wide.
    scale = min(columns / image.width, 2 * available / image.height)
    width, height = max(1, round(image.width * scale)), max(1, round(image.height * scale / 2))
    width, height = min(width, columns), min(height, available)
    small = np.asarray(image.resize((width, 2 * height), Image.Resampling.BOX))
    lines = _format_colored(small) if color else _format_shaded(small)
    return "\n".join([escape_line(head)[:columns], *lines])


def _format_colored(pixels: NDArray[np.uint8]) -> list[str]:
    lines = []
    for upper, lower in zip(pixels[::2].tolist(), pixels[1::2].tolist(), strict=True):
        cells = [
            f"\x1b[38;2;{r};{g};{b}m\x1b[48;2;{x};{y};{z}m▀"
            for (r, g, b), (x, y, z) in zip(upper, lower, strict=True)
        ]
        lines.append("".join(cells) + _RESET)
    return lines


def _format_shaded(pixels: NDArray[np.uint8]) -> list[str]:
    bright = pixels.astype(float).mean(axis=2).reshape(len(pixels) // 2, 2, -1).mean(axis=1)
    levels = (bright / 256 * len(_SHADES)).astype(int)
    return ["".join(_SHADES[level] for level in row).rstrip() for row in levels.tolist()]


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
