"""A picture in characters: two pixels in each with colours, shades without."""

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.untrusted import one_line

_SHADES = " .:-=+*#%@"
"""From dark to bright."""
_RESET = "\x1b[0m"


def as_text(drawn: NDArray[np.uint8], head: str, columns: int, rows: int, *, color: bool) -> str:
    """Return a line and below it a picture, (height, width, 3), in at most so many columns and rows."""
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(drawn))
    available = max(rows - 1, 1)
    # A character is about twice as high as wide.
    scale = min(columns / image.width, 2 * available / image.height)
    width, height = max(1, round(image.width * scale)), max(1, round(image.height * scale / 2))
    width, height = min(width, columns), min(height, available)
    small = np.asarray(image.resize((width, 2 * height), Image.Resampling.BOX))
    lines = _colored(small) if color else _shaded(small)
    return "\n".join([one_line(head)[:columns], *lines])


def _colored(pixels: NDArray[np.uint8]) -> list[str]:
    lines = []
    for upper, lower in zip(pixels[::2].tolist(), pixels[1::2].tolist(), strict=True):
        cells = [
            f"\x1b[38;2;{r};{g};{b}m\x1b[48;2;{x};{y};{z}m▀"
            for (r, g, b), (x, y, z) in zip(upper, lower, strict=True)
        ]
        lines.append("".join(cells) + _RESET)
    return lines


def _shaded(pixels: NDArray[np.uint8]) -> list[str]:
    bright = pixels.astype(float).mean(axis=2).reshape(len(pixels) // 2, 2, -1).mean(axis=1)
    levels = (bright / 256 * len(_SHADES)).astype(int)
    return ["".join(_SHADES[level] for level in row).rstrip() for row in levels.tolist()]
