"""Shows an episode as text: in place on a terminal, frame after frame elsewhere."""

import shutil
import time
from collections.abc import Callable
from typing import TextIO

from swarmwright.display._episode import Playable
from swarmwright.display._text import with_states

HIDE_CURSOR, SHOW_CURSOR = "\x1b[?25l", "\x1b[?25h"
CLEAR_LINE, CLEAR_BELOW = "\x1b[K", "\x1b[J"
LINES = 24
"""Most lines of a scene where there is no terminal to measure."""


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
        size = shutil.get_terminal_size((80, LINES))
        # On a terminal one line is for the fitness and one for the cursor below the frame.
        rows = size.lines - 2 if self._in_place else LINES
        # And one for the states of controllers.
        rows -= getattr(episode, "machine_states", lambda: None)() is not None
        text = episode.text(size.columns, self._color, max(rows, 1), self._unicode)
        text = with_states(text, episode, size.columns, color=self._color, unicode=self._unicode)
        so_far = f"fitness {episode.fitness + 0.0:.4g}"  # no -0
        lines = [*text.rstrip("\n").split("\n"), so_far[: size.columns]]
        if not self._unicode:
            lines = [line.encode("ascii", "replace").decode() for line in lines]
        if not self._in_place:
            self._stream.write("\n".join(lines) + "\n\n")
        else:
            # Back to the first line of the last frame; each line is overwritten, so that nothing flickers.
            up = f"\x1b[{self._height}F" if self._height else ""
            body = "".join(f"{line}{CLEAR_LINE}\n" for line in lines)
            self._stream.write(f"{up}{body}{CLEAR_BELOW}")
            self._height = len(lines)
        self._stream.flush()
