"""Lines on a terminal are broken between words."""

import sys
import time

import pytest

from swarmwright.cli._output import Output, complain, wrap_line

PROSE = (
    "Not validated on held-out seeds: the evaluations are fewer than the 10 that a validation takes; "
    "`swarmwright resume runs/e-1 --set validate.episodes=100` validates the run."
)


@pytest.mark.parametrize("width", [20, 40, 80, 120])
@pytest.mark.parametrize("indent", ["", "  "])
def test_words_and_commands_in_backticks_stay_whole(width: int, indent: str) -> None:
    first, *rest = wrap_line(indent + PROSE, width)
    assert " ".join([first.strip(), *(line.strip() for line in rest)]) == PROSE
    assert first.startswith(f"{indent}Not")
    assert all(line.startswith(f"{indent}  ") and line[len(indent) + 2] != " " for line in rest)
    command = "`swarmwright resume runs/e-1 --set validate.episodes=100`"
    assert sum(command in line for line in (first, *rest)) == 1
    assert all(len(line) <= width or line.strip() == command for line in (first, *rest))


@pytest.mark.parametrize(
    "line",
    [
        "  swarmwright replay a-long-folder-with-results --broker mqtt://somewhere:1883",
        "  /a/path/python3 -m swarmwright replay a-long-folder-with-results",
        "a-word-without-any-place-for-a-break-that-is-longer-than-the-line",
        "",
        " " * 50,
    ],
)
def test_commands_and_long_words_are_left_to_the_terminal(line: str) -> None:
    assert [one.rstrip() for one in wrap_line(line, 40)] == [line.rstrip()]


def test_rows_of_tables_are_broken_between_columns() -> None:
    rows = [
        "run                     state  best value      created",
        "runs/minisim-1          done   -3.5            2026-11-29 20:37",
    ]
    assert [wrap_line(row, 50) for row in rows] == [
        ["run                     state  best value", "  created"],
        ["runs/minisim-1          done   -3.5", "  2026-11-29 20:37"],
    ]


def test_text_of_others_never_begins_a_line_at_the_left_margin() -> None:
    lines = wrap_line("swarmwright: " + "word swarmwright: spoof " * 50, 30)
    assert all(line.startswith("  ") for line in lines[1:])


@pytest.mark.parametrize("word", ["x ", "` ", "`x` ", "  "])
def test_long_lines_take_no_long_time(word: str) -> None:
    began = time.monotonic()
    wrap_line(word * 200_000, 80)
    assert time.monotonic() - began < 10


def test_only_a_terminal_gets_broken_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    Output().text(PROSE)
    complain(PROSE)
    piped = capsys.readouterr()
    assert (piped.out, piped.err) == (f"{PROSE}\n", f"swarmwright: {PROSE}\n")
    for stream in (sys.stdout, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: True)
    Output().text(PROSE)
    Output(as_json=True).json({"text": PROSE})
    Output().cells([PROSE, PROSE])
    complain(PROSE)
    shown = capsys.readouterr()
    broken = [*wrap_line(PROSE, 40)]
    *lines, record, cells = shown.out.splitlines()
    assert (lines, len(broken) > 3) == (broken, True)
    assert PROSE in record
    assert cells == f"{PROSE}\t{PROSE}"
    assert shown.err.splitlines() == wrap_line(f"swarmwright: {PROSE}", 40)
