"""Display of episodes as text: in place on a terminal, frame after frame elsewhere."""

import re
import shutil
import time
from collections.abc import Callable, Sequence
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from swarmwright.display._episode import Playable, fill_states
from swarmwright.display._look import BORDER, lighten, mix, to_rgb
from swarmwright.display._scene import Bodies, Scene, scene_from_arrays
from swarmwright.display.machines import state_color

SIGNS = "0123456789abcdefghijklmnopqrstuvwxyz"
"""Signs of states 0, 1, .. on a map without colours; the last sign is also used for all later states."""
_CELL = re.compile(r"(?:\x1b\[[0-9;]*m)?(.)(?:\x1b\[0m)?")
_FRAMES = {"┌": "│", "+": "|"}


def with_states(text: str, episode: Any, columns: int, *, color: bool, unicode: bool) -> str:  # noqa: ANN401 - a `Playable`
    """Return an episode's text with the states of its agents; the same text without states.

    color: agents keep their arrows and are coloured by state; else the sign of the state replaces the agent.
    """
    recorded = episode.machine_states() if hasattr(episode, "machine_states") else None
    if recorded is None:
        return text
    arrays = getattr(episode, "scene_arrays", None)
    scene = Scene.from_fields(episode.scene()) if arrays is None else scene_from_arrays(arrays())
    bodies = Bodies.from_bodies(scene.bodies)
    agents = bodies.agents()
    states = fill_states(recorded, int(agents.max(initial=-1)) + 1)
    body_states = np.where(agents >= 0, states[agents] if len(states) else -1, -1)
    lines = text.rstrip("\n").split("\n")
    _mark(lines, scene, bodies, body_states, color=color)
    counts = np.bincount(body_states[body_states >= 0])
    return "\n".join([*lines, _legend(counts, columns, color=color, unicode=unicode)])


def _mark(lines: list[str], scene: Scene, bodies: Bodies, states: NDArray[np.int_], *, color: bool) -> None:
    """Replace the characters of agents on the map, which is framed and begins in the second line."""
    upright = _FRAMES.get(lines[1][:1]) if len(lines) > 3 else None
    if upright is None:
        return
    width = len(lines[1]) - 2
    height = next((row for row, line in enumerate(lines[2:]) if not line.startswith(upright)), 0)
    if not height or width < 1:
        return
    # Later bodies are drawn above earlier ones, as in the engine.
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
        for cell, state in marks.items():
            plain = _CELL.fullmatch(cells[cell])
            assert plain is not None
            cells[cell] = _paint(plain[1], state) if color else _sign(state)
        lines[2 + at] = f"{upright}{''.join(cells)}{upright}"


def _cells(shares: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    cells: NDArray[np.int64] = np.clip(np.nan_to_num(shares * count), 0, count - 1).astype(np.int64)
    return cells


def _legend(counts: Sequence[int] | NDArray[np.int64], columns: int, *, color: bool, unicode: bool) -> str:
    """Return the number of agents in each state, for as many states as fit."""
    line, used = "states", len("states")
    for state, count in enumerate(counts):
        if not count:
            continue
        mark = ("●" if unicode else "o") if color else _sign(state)
        words = f" {state}: {count}" if color or mark != str(state) else f": {count}"
        if used + 3 + len(mark + words) > columns:
            break
        used += 3 + len(mark + words)
        line += f"   {_paint(mark, state) if color else mark}{words}"
    return line


def _sign(state: int) -> str:
    return SIGNS[min(state, len(SIGNS) - 1)]


def _paint(text: str, state: int) -> str:
    """Color text by state, visible on dark and light backgrounds."""
    color = state_color(state)
    color = mix(lighten(color), BORDER, 0.85)
    return f"\x1b[38;2;{';'.join(map(str, to_rgb(color)))}m{text}\x1b[0m"


HIDE_CURSOR, SHOW_CURSOR = "\x1b[?25l", "\x1b[?25h"
CLEAR_LINE, CLEAR_BELOW = "\x1b[K", "\x1b[J"
LINES = 24
"""Largest number of lines of a scene without a terminal."""


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

    in_place: overwrite the previous frame and wait `step_size` between frames; else write frames one below
    the other. speed: factor relative to `step_size`. sleep: function that waits.
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
        # On a terminal, one line is for the fitness and one for the cursor.
        rows = size.lines - 2 if self._in_place else LINES
        # One more line is for controller states.
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
            # Return to the first line of the last frame and overwrite each line, to avoid flicker.
            up = f"\x1b[{self._height}F" if self._height else ""
            body = "".join(f"{line}{CLEAR_LINE}\n" for line in lines)
            self._stream.write(f"{up}{body}{CLEAR_BELOW}")
            self._height = len(lines)
        self._stream.flush()
