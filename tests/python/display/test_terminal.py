import io
from typing import Any

import pytest

from swarmwright.display.terminal import CLEAR_BELOW, HIDE_CURSOR, SHOW_CURSOR, play


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
