"""Shows an episode as text: in place on a terminal, frame after frame elsewhere."""

import shutil
import time
from collections.abc import Callable
from typing import TextIO

from swarmwright.display._episode import Playable

HIDE_CURSOR, SHOW_CURSOR = "\x1b[?25l", "\x1b[?25h"
CLEAR_LINE, CLEAR_BELOW = "\x1b[K", "\x1b[J"
NARROWEST = 16
"""Columns below which a frame is no longer made smaller to fit the terminal's height."""

ASCII = str.maketrans(
    {
        **dict.fromkeys("─━═", "-"),
        **dict.fromkeys("│┃║", "|"),
        **dict.fromkeys("┌┐└┘╭╮╰╯├┤┬┴┼╔╗╚╝", "+"),
        **dict.fromkeys("·•", "."),
        **dict.fromkeys("●○", "o"),
        **dict.fromkeys("★☆◆◇", "*"),
        **dict.fromkeys("■□█▓▒░", "#"),
        **dict.fromkeys("▲△", "A"),
        **dict.fromkeys("▼▽", "V"),
        **dict.fromkeys("×✕✗✖", "x"),
        **dict.fromkeys("–—", "-"),
        "…": "~",
    }
)


def play(
    episode: Playable,
    stream: TextIO,
    *,
    in_place: bool,
    color: bool,
    speed: float = 1.0,
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    """Step an episode to its end and show every frame.

    in_place: overwrite the last frame and wait `step_size` between two; else write them one below the other.
    speed: how many times faster than `step_size`. sleep: waits some seconds.
    """
    painter = _Painter(stream, in_place=in_place, color=color)
    with painter:
        painter.show(episode)
        due = time.monotonic()
        while not episode.done:
            if in_place:
                due += episode.step_size / speed
                sleep(max(0.0, due - time.monotonic()))
            episode.step()
            painter.show(episode)


class _Painter:
    def __init__(self, stream: TextIO, *, in_place: bool, color: bool) -> None:
        self._stream = stream
        self._in_place = in_place
        self._color = color
        self._unicode = "utf" in (getattr(stream, "encoding", None) or "utf-8").lower()
        self._height = 0

    def __enter__(self) -> None:
        if self._in_place:
            self._stream.write(HIDE_CURSOR)

    def __exit__(self, *_: object) -> None:
        if self._in_place:
            self._stream.write(SHOW_CURSOR)
            self._stream.flush()

    def show(self, episode: Playable) -> None:
        size = shutil.get_terminal_size((80, 24))
        lines = self._fitting(episode, size.columns, size.lines if self._in_place else None)
        if not self._in_place:
            self._stream.write("\n".join(lines) + "\n\n")
        else:
            # Back to the first line of the last frame; each line is overwritten, so that nothing flickers.
            up = f"\x1b[{self._height}F" if self._height else ""
            body = "".join(f"{line}{CLEAR_LINE}\n" for line in lines)
            self._stream.write(f"{up}{body}{CLEAR_BELOW}")
            self._height = len(lines)
        self._stream.flush()

    def _fitting(self, episode: Playable, columns: int, rows: int | None) -> list[str]:
        """The frame, narrower than the terminal if it would else be higher than it."""
        while True:
            lines = episode.text(columns, self._color).rstrip("\n").split("\n")
            if rows is None or len(lines) < rows or columns <= NARROWEST:
                break
            columns = max(NARROWEST, columns * 9 // 10)
        if self._unicode:
            return lines
        return [line.translate(ASCII).encode("ascii", "replace").decode() for line in lines]
