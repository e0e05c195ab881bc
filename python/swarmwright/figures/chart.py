"""Line charts, drawn by Pillow: a tenth of the time that matplotlib needs, and its font."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmwright.core.untrusted import one_line
from swarmwright.figures.scale import Scale, cut, labels, limits, ticks

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont
    from PIL.ImageFont import ImageFont as BitmapFont

INK, PALE, PAPER, GRID, FRAME = "#22303c", "#59646d", "#ffffff", "#e3e7eb", "#9aa5b1"
WIDTH, HEIGHT = 1350, 780
"""Pixels of the picture."""
_TOP, _BOTTOM, _RIGHT = 80, 131, 26  # pixels around the frame; on the left it depends on the labels
_FINER = 3  # curves are drawn so many times as large, then made smaller: that is what makes them smooth
_MARGINS = (0.02, 0.12)

Points = NDArray[np.float64]
"""Pixels: (points, 2)."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A line through (x[i], y[i]), or the area between y and `until` where that is given.

    width: pixels. step: whether a value holds until the next one.
    """

    name: str
    color: str
    y: NDArray[np.float64]
    until: NDArray[np.float64] | None = None
    width: float = 3.3
    step: bool = False


@dataclass(frozen=True, kw_only=True)
class Chart:
    """What there is to see."""

    title: str
    subtitle: str
    x_name: str
    y_name: str
    x: NDArray[np.float64]
    """Whole numbers, ascending."""
    curves: Sequence[Curve]
    mark: tuple[float, float, str, str]
    """A point that stands out: x, y, its text and colour."""

    def draw(self) -> "Image":
        """Return the picture, RGB, WIDTH x HEIGHT."""
        from PIL import Image, ImageDraw

        picture = Image.new("RGB", (WIDTH, HEIGHT), PAPER)
        pen = ImageDraw.Draw(picture)
        heights = [curve.y for curve in self.curves]
        heights += [curve.until for curve in self.curves if curve.until is not None]
        whole = np.stack([np.where(np.isfinite(one), one, np.nan) for one in heights])
        hidden = cut([(self.x, whole.min(axis=0), whole.max(axis=0))])
        if hidden is not None:
            heights = [one[one >= hidden.low] for one in heights]
        low, high = limits(np.concatenate([*heights, [self.mark[1]]]), _MARGINS[1])
        if hidden is not None:
            low = hidden.low
        y_ticks = ticks(low, high, 8)
        y_labels = labels(y_ticks)
        font = _font(23)
        left = round(62 + max((pen.textlength(label, font=font) for label in y_labels), default=0))
        right, bottom = WIDTH - _RIGHT, HEIGHT - _BOTTOM
        x = Scale(*limits(self.x, _MARGINS[0]), left, right)
        y = Scale(low, high, bottom, _TOP)
        x_ticks = ticks(x.low, x.high, 9, whole=True)
        for tick in x_ticks:
            pen.line([(x.at(tick), _TOP), (x.at(tick), bottom)], fill=GRID, width=2)
        for tick in y_ticks:
            pen.line([(left, y.at(tick)), (right, y.at(tick))], fill=GRID, width=2)
        self._draw_curves(picture, x, y)
        pen.line([(left, _TOP), (left, bottom), (right, bottom)], fill=FRAME, width=2)
        for tick, label in zip(x_ticks, labels(x_ticks), strict=True):
            pen.line([(x.at(tick), bottom), (x.at(tick), bottom + 8)], fill=INK, width=2)
            pen.text((x.at(tick), bottom + 13), label, font=font, fill=INK, anchor="ma")
        for tick, label in zip(y_ticks, y_labels, strict=True):
            pen.line([(left - 8, y.at(tick)), (left, y.at(tick))], fill=INK, width=2)
            pen.text((left - 15, y.at(tick)), label, font=font, fill=INK, anchor="rm")
        pen.text(((left + right) / 2, bottom + 42), self.x_name, font=_font(25), fill=INK, anchor="ma")
        _upright(picture, (18, (_TOP + bottom) // 2), self.y_name)
        title = _fitting(pen, one_line(self.title), 31, right - left)
        pen.text((left, 31), title, font=_font(31, bold=True), fill=INK, anchor="ls")
        pen.text(
            (left, 66), _fitting(pen, self.subtitle, 23, right - left), font=font, fill=PALE, anchor="ls"
        )
        if hidden is not None:
            pen.text((right - 12, bottom - 12), hidden.note, font=font, fill=PALE, anchor="rs")
        self._draw_legend(pen)
        self._draw_mark_text(pen, x, y)
        return picture

    def _draw_curves(self, picture: "Image", x: Scale, y: Scale) -> None:
        from PIL import Image, ImageDraw

        box = (round(x.start), _TOP, round(x.end), round(y.start))
        size = ((box[2] - box[0]) * _FINER, (box[3] - box[1]) * _FINER)
        fine = picture.crop(box).resize(size, Image.Resampling.NEAREST)
        pen = ImageDraw.Draw(fine, "RGBA")

        def pixels(values: NDArray[np.float64]) -> Points:
            points = np.stack([x.each(self.x) - box[0], y.each(values) - box[1]], axis=1)
            return points[np.isfinite(values)] * _FINER

        for curve in self.curves:
            points = pixels(curve.y)
            if curve.until is not None:
                back = pixels(curve.until)[::-1]
                _area(pen, np.concatenate([_thinned(points, _FINER), _thinned(back, _FINER)]), curve.color)
            else:
                width = round(curve.width * _FINER)
                _line(pen, _thinned(_stepped(points) if curve.step else points, _FINER), curve.color, width)
        place = np.array([x.at(self.mark[0]) - box[0], y.at(self.mark[1]) - box[1]]) * _FINER
        for radius, color in ((9.5, PAPER), (7.4, self.mark[3])):
            corner = radius * _FINER
            pen.ellipse([*(place - corner), *(place + corner)], fill=color)
        picture.paste(fine.reduce(_FINER), box)

    def _draw_mark_text(self, pen: "ImageDraw", x: Scale, y: Scale) -> None:
        value_x, value_y, text, color = self.mark
        half = pen.textlength(text, font=_font(25, bold=True)) / 2
        center = min(max(x.at(value_x), x.start + half + 4), x.end - half - 4)
        place = (center, y.at(value_y) - 19)
        pen.text(place, text, font=_font(25, bold=True), fill=color, anchor="ms")

    def _draw_legend(self, pen: "ImageDraw") -> None:
        font, swatch, gap, apart = _font(23), 46, 18, 46
        widths = [swatch + gap + pen.textlength(curve.name, font=font) for curve in self.curves]
        place = (WIDTH - sum(widths) - apart * (len(widths) - 1)) / 2
        middle = HEIGHT - 34
        for curve, width in zip(self.curves, widths, strict=True):
            if curve.until is not None:
                pen.rectangle([place, middle - 8, place + swatch, middle + 7], fill=_light(curve.color))
            else:
                pen.line(
                    [(place, middle), (place + swatch, middle)], fill=curve.color, width=round(curve.width)
                )
            pen.text((place + swatch + gap, middle), curve.name, font=font, fill=INK, anchor="lm")
            place += width + apart


def prepare() -> None:
    """Load what `draw` needs, so that it need not wait for it."""
    from PIL import Image, ImageDraw, ImageFont, PngImagePlugin

    del Image, ImageDraw, ImageFont, PngImagePlugin
    _font(23)


def _area(pen: "ImageDraw", points: Points, color: str) -> None:
    if len(points) > 2:
        pen.polygon(points.ravel().tolist(), fill=f"{color}29")


def _line(pen: "ImageDraw", points: Points, color: str, width: int) -> None:
    if len(points) == 1:
        # One generation alone would be nothing to see.
        points = points + np.array([[-4 * width, 0], [4 * width, 0]]) / 2
    pen.line(points.ravel().tolist(), fill=color, width=width)
    # Round joints; Pillow's own take ten times as long.
    reach = (width - 1) / 2
    for x, y in points.tolist():
        pen.ellipse([x - reach, y - reach, x + reach, y + reach], fill=color)


def _stepped(points: Points) -> Points:
    """Return the corners of steps: each height holds until the next point."""
    corners = np.repeat(points, 2, axis=0)
    corners[1::2, 0] = np.append(points[1:, 0], points[-1:, 0])
    corners = corners[:-1]
    # What lies within a straight line is no corner.
    inner = (corners[1:-1, 1] == corners[:-2, 1]) & (corners[1:-1, 1] == corners[2:, 1])
    return corners[np.concatenate([[True], ~inner, [True]])] if len(points) > 1 else corners


def _thinned(points: Points, column: int) -> Points:
    """Return the lowest and the highest point of each column of pixels, where there are many more."""
    columns = np.floor(points[:, 0] / column)
    starts = np.flatnonzero(np.diff(columns, prepend=np.nan) != 0)
    if len(points) <= 4 * len(starts):
        return points
    kept = []
    for first, last in zip(starts, np.append(starts[1:], len(points)), strict=True):
        heights = points[first:last, 1]
        kept += sorted({first, first + int(heights.argmin()), first + int(heights.argmax()), last - 1})
    return points[kept]


def _light(color: str) -> str:
    """Return how an area of this colour looks on paper."""
    parts = (int(color[place : place + 2], 16) for place in (1, 3, 5))
    return "#" + "".join(f"{round(255 + (part - 255) * 0x29 / 255):02x}" for part in parts)


def _upright(picture: "Image", middle: tuple[int, int], text: str) -> None:
    """Write from bottom to top."""
    from PIL import Image, ImageDraw

    font = _font(25)
    length = round(ImageDraw.Draw(picture).textlength(text, font=font)) + 4
    strip = Image.new("RGB", (length, 36), PAPER)
    ImageDraw.Draw(strip).text((length / 2, 18), text, font=font, fill=INK, anchor="mm")
    turned = strip.transpose(Image.Transpose.ROTATE_90)
    picture.paste(turned, (middle[0] - 18, middle[1] - length // 2))


def _fitting(pen: "ImageDraw", text: str, size: int, width: float) -> str:
    """Return the text, cut where it would be longer than `width`."""
    font = _font(size, bold=True)
    if pen.textlength(text, font=font) <= width:
        return text
    while text and pen.textlength(f"{text}…", font=font) > width:
        text = text[: -1 - len(text) // 20]
    return f"{text}…"


@cache
def _font(size: int, *, bold: bool = False) -> "FreeTypeFont | BitmapFont":
    """Return DejaVu Sans, which comes with matplotlib and knows most scripts, or Pillow's own font."""
    from PIL import ImageFont

    found = find_spec("matplotlib")
    if found is not None and found.origin is not None:
        folder = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf"
        try:
            return ImageFont.truetype(str(folder / f"DejaVuSans{'-Bold' if bold else ''}.ttf"), size)
        except OSError:
            pass
    return ImageFont.load_default(size)
