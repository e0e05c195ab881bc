"""`servers --watch`: what is drawn and what is printed of a view."""

import io
from typing import Any

import pytest
from rich.console import Console

from swarmwright.cli._output import Output
from swarmwright.cli._watching import Lines, Screen, cells, headline
from swarmwright.servers.broker.watching import ServerRow, ToolRow, View

Json = dict[str, Any]
WORDS = "server 3 has not answered the actuators of agent 2 in step 7 for 4.0 s"
STEP = {"server": 3, "kind": "episode", "missing": "sensors", "evaluations": 1, "agent": 2, "step": 7}
SILENT = ServerRow(
    3,
    "busy",
    ["minisim"],
    "ada",
    doing=[{**STEP, "silent": 4.0, "words": WORDS, "tool": "ada"}],
    use={"server": 3, "mode": "stepwise", "speed": 12.345, "failures": 2, "reason": "late", "benched": 3.2},
)
FREE = ServerRow(1, "ready", ["minisim", "exit"], None)
STATUS = {"tool": "ada", "state": "evaluating", "run": "r-1", "generation": 3, "generations": 9}
ADA = ToolRow(
    {**STATUS, "done": 8, "total": 20, "waiting_for": [{"silent": 4.0, "words": WORDS}], "servers": []}, 0.5
)
VIEW = View([FREE, SILENT], [ADA], None)


def drawn(view: View, width: int = 160) -> str:
    screen = Screen(Output(), "mqtt://x:1")
    screen.view = view
    console = Console(file=io.StringIO(), width=width, force_terminal=False, markup=False)
    console.print(screen)
    return str(console.file.getvalue())  # type: ignore[attr-defined]


def test_the_table_names_everybody_and_who_is_waited_for() -> None:
    text = drawn(VIEW)
    assert text.splitlines()[0].rstrip() == f"Blocking: {WORDS}"
    for word in ("minisim, exit", "episode, step 7, agent 2", "4.0 s", "12.3/s", "2, paused for 3.2 s"):
        assert word in text
    for word in ("r-1", "3 of 9", "8 of 20"):
        assert word in text


def test_a_terminal_of_80_columns_shows_all() -> None:
    lines = drawn(VIEW, 80).splitlines()
    assert max(map(len, lines)) <= 80
    for word in ("minisim", "12.3/s", "3 of 9", "agent 2"):
        assert any(word in line for line in lines), word


@pytest.mark.parametrize("width", [40, 59])
def test_a_narrow_terminal_shows_what_matters_most(width: int) -> None:
    lines = drawn(VIEW, width).splitlines()
    assert max(map(len, lines)) <= width
    for word in ("busy", "4.0 s", "3 of 9", "8 of 20"):
        assert any(word in line for line in lines), word


def test_cells_of_a_server_of_which_nothing_is_known() -> None:
    assert cells(ServerRow(7, None, [], None)) == ("7", "-", "-", "-", "-", "-", "-", "-")


def test_the_headline_says_what_matters_most() -> None:
    assert headline(VIEW, "b")[0].startswith("Blocking: server 3")
    assert "b is lost (gone)" in headline(View([SILENT], [ADA], "gone"), "b")[0]
    assert headline(View([FREE], [], None), "b")[0] == "1 server, none blocking"
    alone = ToolRow({**STATUS, "waiting_for": [], "no_server": {"seconds": 3.0, "found": "none"}}, 0.1)
    assert headline(View([], [alone], None), "b")[0] == "ada: waiting for a server for 3.0 s (none)"


def test_a_server_that_is_reserved_for_a_tool_that_was_killed(capsys: pytest.CaptureFixture[str]) -> None:
    held = ServerRow(4, "busy", ["minisim"], "ada")
    words = "server 4 is still reserved for ada, which sends no status"
    assert headline(View([held], [], None, [held]), "b")[0].startswith(words)
    other = ServerRow(5, "busy", ["minisim"], "ada")
    view = View([held, other], [], None, [held, other], {"ada"})
    assert headline(view, "b")[0].startswith(
        "server 4 is still reserved for ada, which has ended; it becomes free after its current "
        "work, at the latest after its --step-timeout"
    )
    assert headline(view, "b")[0].endswith("(+1)")
    Lines(Output(), "b").show(view)
    shown = capsys.readouterr().out
    assert "server 4 is still reserved" in shown
    assert "server 5 is still reserved" in shown


def test_lines_are_printed_for_what_has_changed(capsys: pytest.CaptureFixture[str]) -> None:
    lines = Lines(Output(), "mqtt://x:1")

    def said(view: View) -> list[str]:
        lines.show(view)
        return [line.split("  ", 1)[1] for line in capsys.readouterr().out.splitlines()]

    assert said(VIEW) == [
        "server 1: ready (minisim, exit)",
        "server 3: busy for ada (minisim), paused: late",
        "tool ada: run r-1, 3 of 9 generations done",
        WORDS,
    ]
    assert said(VIEW) == []
    assert said(View([FREE], [], "gone")) == [
        "mqtt://x:1 is lost (gone); trying again",
        "server 3 has left",
        "tool ada has left",
    ]
    assert said(View([FREE], [], None)) == ["mqtt://x:1 is back"]
