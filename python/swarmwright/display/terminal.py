"""Shows an episode as text: in place on a terminal, frame after frame elsewhere."""

import re
import shutil
import time
from collections.abc import Callable, Sequence
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from swarmwright.display._bodies import Bodies, scene_of
from swarmwright.display._episode import Playable
from swarmwright.display._look import BORDER, lightened, mixed, rgb
from swarmwright.display._scene import Scene
from swarmwright.display._trace import states_of
from swarmwright.display.state_colors import state_color

SIGNS = "0123456789abcdefghijklmnopqrstuvwxyz"
"""What stands for states 0, 1, .. on a map without colours; the last one also for all after it."""
_CELL = re.compile(r"(?:\x1b\[[0-9;]*m)?(.)(?:\x1b\[0m)?")
_FRAMES = {"┌": "│", "+": "|"}


def with_states(text: str, episode: Any, columns: int, *, color: bool, unicode: bool) -> str:  # noqa: ANN401 - a `Playable`
    """Return an episode's text with the states of its agents; the same text where there are none.

    color: agents keep their arrows and have the colours of their states; else the sign of the state is in the
    place of an agent.
    """
    known = episode.machine_states() if hasattr(episode, "machine_states") else None
    if known is None:
        return text
    arrays = getattr(episode, "scene_arrays", None)
    scene = Scene.of(episode.scene()) if arrays is None else scene_of(arrays())
    bodies = Bodies.of(scene.bodies)
    agents = bodies.agents()
    states = states_of(known, int(agents.max(initial=-1)) + 1)
    of_body = np.where(agents >= 0, states[agents] if len(states) else -1, -1)
    lines = text.rstrip("\n").split("\n")
    _mark(lines, scene, bodies, of_body, color=color)
    counts = np.bincount(of_body[of_body >= 0])
    return "\n".join([*lines, _legend(counts, columns, color=color, unicode=unicode)])


def _mark(lines: list[str], scene: Scene, bodies: Bodies, states: NDArray[np.int_], *, color: bool) -> None:
    """Change the characters of agents on the map, which is framed and begins in the second line."""
    upright = _FRAMES.get(lines[1][:1]) if len(lines) > 3 else None
    if upright is None:
        return
    width = len(lines[1]) - 2
    height = next((row for row, line in enumerate(lines[2:]) if not line.startswith(upright)), 0)
    if not height or width < 1:
        return
    # What is drawn last is above: as the engine has it.
    column = _cells(bodies.x / np.float32(scene.width), width)
    row = _cells(1 - bodies.y / np.float32(scene.height), height)
    above = {(int(r), int(c)): int(state) for r, c, state in zip(row, column, states, strict=True)}
    rows: dict[int, dict[int, int]] = {}
    for (at, column_of), state in above.items():
        if state >= 0:
            rows.setdefault(at, {})[column_of] = state
    for at, marks in rows.items():
        cells = [match[0] for match in _CELL.finditer(lines[2 + at][1:-1])]
        if len(cells) != width:
            continue
        for place, state in marks.items():
            plain = _CELL.fullmatch(cells[place])
            assert plain is not None
            cells[place] = _painted(plain[1], state) if color else _sign(state)
        lines[2 + at] = f"{upright}{''.join(cells)}{upright}"


def _cells(shares: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    cells: NDArray[np.int64] = np.clip(np.nan_to_num(shares * count), 0, count - 1).astype(np.int64)
    return cells


def _legend(counts: Sequence[int] | NDArray[np.int64], columns: int, *, color: bool, unicode: bool) -> str:
    """Return how many agents are in each state, of as many states as fit."""
    line, used = "states", len("states")
    for state, count in enumerate(counts):
        if not count:
            continue
        mark = ("●" if unicode else "o") if color else _sign(state)
        words = f" {state}: {count}" if color or mark != str(state) else f": {count}"
        if used + 3 + len(mark + words) > columns:
            break
        used += 3 + len(mark + words)
        line += f"   {_painted(mark, state) if color else mark}{words}"
    return line


def _sign(state: int) -> str:
    return SIGNS[min(state, len(SIGNS) - 1)]


def _painted(text: str, state: int) -> str:
    """Return text in the colour of a state, one that is seen on dark and on light ground."""
    color = state_color(state)
    color = mixed(lightened(color), BORDER, 0.85)
    return f"\x1b[38;2;{';'.join(map(str, rgb(color)))}m{text}\x1b[0m"


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
