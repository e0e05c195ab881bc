"""The states of controllers on a scene as text: signs or colours on the map, and a line that counts them."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.display._bodies import Bodies, scene_of
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
