import io
import json
import re
from typing import Any

import numpy as np
import pytest

from swarmwright import _engine
from swarmwright.controllers.modules.grammar import State, Transition, weights_of
from swarmwright.display._scene import scene_from_arrays
from swarmwright.display.terminal import CLEAR_BELOW, HIDE_CURSOR, SHOW_CURSOR, SIGNS, play, with_states


class Terminal(io.StringIO):
    """What was written, and a stream's encoding."""

    def __init__(self, encoding: str) -> None:
        super().__init__()
        self._encoding = encoding

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._encoding


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("LINES", "24")
    return Terminal("utf-8")


def test_piped_frames_stand_one_below_the_other_without_waiting(crossing: Any, screen: Terminal) -> None:
    waits: list[float] = []
    play(crossing, screen, in_place=False, color=False, sleep=waits.append)
    frames = screen.getvalue().split("\n\n")[:-1]
    assert len(frames) == 13
    assert [frame.split("step ")[1].split("\n")[0] for frame in frames] == [str(i) for i in range(13)]
    assert "\x1b" not in screen.getvalue()
    assert not waits


def test_frames_in_place_overwrite_each_other_at_the_step_size(crossing: Any, screen: Terminal) -> None:
    waits: list[float] = []
    play(crossing, screen, in_place=True, color=True, speed=2.0, sleep=waits.append)
    shown = screen.getvalue()
    assert shown.startswith(HIDE_CURSOR)
    assert shown.endswith(SHOW_CURSOR)
    assert shown.count(CLEAR_BELOW) == 13
    assert shown.count("\x1b[4F") == 12, "back by the four lines of the frame before"
    assert len(waits) == 12
    # The clock runs on while nothing really sleeps, so that the waits add up to when each frame is due.
    assert waits[0] == pytest.approx(0.125, abs=0.05)
    assert waits[-1] == pytest.approx(12 * 0.125, abs=0.2)


def test_every_frame_says_the_fitness_so_far(crossing: Any, screen: Terminal) -> None:
    play(crossing, screen, in_place=False, color=False)
    frames = screen.getvalue().split("\n\n")[:-1]
    assert [frame.split("\n")[-1] for frame in frames] == [
        f"fitness {-float(12 - i) + 0.0:.4g}" for i in range(13)
    ]


def test_the_cursor_comes_back_when_interrupted(crossing: Any, screen: Terminal) -> None:
    def interrupt(_seconds: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        play(crossing, screen, in_place=True, color=False, sleep=interrupt)
    assert screen.getvalue().endswith(SHOW_CURSOR)


def test_a_frame_is_never_higher_than_the_terminal(
    crossing: Any, screen: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LINES", "10")
    crossing.lines = 40
    play(crossing, screen, in_place=True, color=False, sleep=lambda _: None)
    for frame in screen.getvalue().split(CLEAR_BELOW)[:-1]:
        assert 8 <= frame.count("\n") < 10


def test_a_terminal_without_utf8_gets_ascii(crossing: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    screen = Terminal("ascii")
    crossing.message = "Grüße"
    play(crossing, screen, in_place=False, color=False)
    assert screen.getvalue().isascii()
    assert "o" in screen.getvalue(), "the agent is still to be seen"


class Stated:
    """An arena whose robots are in states of our choice."""

    def __init__(self, states: list[int]) -> None:
        machine = (State("exploration", {"rwm": 3}, (Transition(0, "black_floor", {"probability": 0.5}),)),)
        controller = {
            "version": 1, "kind": "modules", "sensors": 9, "actuators": 2, "states": 1, "transitions": 1,
            "weights": weights_of(machine, 1, 1),
        }  # fmt: skip
        parameters = {"mission": "aac", "robot": "e-puck-rm1.2", "robots": 12, "duration": 3, "seed": 1}
        self._episode = _engine.Episode("arena", parameters, json.dumps(controller))
        self._states = states

    def machine_states(self) -> Any:
        return np.array(self._states, dtype=np.uint32)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._episode, name)


def counted(legend: str) -> dict[str, int]:
    return {state: int(count) for state, count in re.findall(r"(\w+): (\d+)", legend)}


@pytest.mark.parametrize("unicode", [True, False])
def test_robots_have_the_signs_of_their_states(unicode: bool) -> None:
    episode: Any = Stated([0, 1, 2, 11, 2, 2])
    plain = episode.text(100, False, 40, unicode).rstrip("\n").split("\n")
    *lines, legend = with_states("\n".join(plain), episode, 100, color=False, unicode=unicode).split("\n")
    assert legend == "states   0: 7   1: 1   2: 3   b 11: 1", "those that have not acted are in state 0"
    changed = [
        (one, two)
        for before, now in zip(plain, lines, strict=True)
        for one, two in zip(before, now, strict=True)
    ]
    signs = [two for one, two in changed if one != two]
    assert all(one in "→↗↑↖←↙↓↘>/^\\<v" for one, two in changed if one != two), "robots alone"
    assert sorted(signs) == sorted("00000001222b")
    # Where the robot in state 11 is.
    scene = scene_from_arrays(episode.scene_arrays())
    row = next(row for row, line in enumerate(lines[2:]) if "b" in line)
    y = scene.height * (1 - (row + 0.5) / (len(lines) - 4))
    assert y == pytest.approx(scene.bodies[3].y, abs=scene.height / (len(lines) - 4))


def test_robots_keep_their_arrows_in_the_colours_of_states() -> None:
    episode: Any = Stated([0, 1, 2, 11, 2, 2])
    plain = episode.text(100, True, 40, True).rstrip("\n").split("\n")
    *lines, legend = with_states("\n".join(plain), episode, 100, color=True, unicode=True).split("\n")

    def bare(text: str) -> str:
        return re.sub(r"\x1b\[[0-9;]*m", "", text)

    assert [bare(line) for line in lines] == [bare(line) for line in plain]
    assert counted(bare(legend)) == {"0": 7, "1": 1, "2": 3, "11": 1}
    colors = re.findall(r"(\x1b\[[0-9;]*m)●", legend)
    assert len(set(colors)) == 4
    assert ["".join(lines[1:-1]).count(color) for color in colors] == [7, 1, 3, 1]


def test_many_states_fit_the_line() -> None:
    episode: Any = Stated(list(range(12)))
    last = with_states(episode.text(40, False, 20, True), episode, 40, color=False, unicode=True).split("\n")[
        -1
    ]
    assert last == "states   0: 1   1: 1   2: 1   3: 1"
    assert len(SIGNS) > 16


def test_a_terminal_has_a_line_for_states(screen: Terminal) -> None:
    episode: Any = Stated([1] * 12)
    play(episode, screen, in_place=True, color=False, sleep=lambda _: None)
    frames = screen.getvalue().split(CLEAR_BELOW)[:-1]
    assert all("states   1: 12" in frame for frame in frames)
    assert max(frame.count("\n") for frame in frames) < 24
    tiny = with_states("head\nlegend", episode, 80, color=False, unicode=True)
    assert tiny == "head\nlegend\nstates   1: 12", "without a map"
