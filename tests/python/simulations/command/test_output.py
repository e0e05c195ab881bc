"""What a command prints: logged line by line, the last of it kept."""

import time

import pytest

from swarmwright.simulations.command.process import LINES, CapturedOutput


@pytest.mark.parametrize("size", [1, 7, 1 << 16])
def test_lines_are_the_same_in_pieces_of_any_size(capsys: pytest.CaptureFixture[str], size: int) -> None:
    data = b"".join(b"line %d\r\n" % number for number in range(50)) + b"x" * 5000 + b"\n\xff\nend"
    printed = CapturedOutput(1 << 20, keep=True)
    for start in range(0, len(data), size):
        printed.take(data[start : start + size])
    printed.end()
    assert bytes(printed.all or b"") == data
    logged = capsys.readouterr().err.split("\n")
    assert logged == [*(f"line {number}" for number in range(50)), "x" * 4096, "\ufffd", "end", ""]
    last = [*(f"line {number}" for number in range(50)), f"{'x' * 397}...", "\ufffd", "end"][-LINES:]
    assert printed.tail == "\n".join(last)
    assert printed.summary == " | ".join(last[-3:])


def test_millions_of_lines_are_taken_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    class Stream:
        writes = 0

        def write(self, text: str) -> None:
            self.writes += bool(text)

    stream = Stream()
    monkeypatch.setattr("sys.stderr", stream)
    printed = CapturedOutput(1 << 20)
    printed.take(b"1\n" * 30_000)
    assert stream.writes == 1


def test_lines_without_end_are_not_all_logged(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Logging them takes longer than printing them, and no limit is looked after meanwhile."""
    now = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    printed = CapturedOutput(1 << 30)
    for number in range(30_000):
        printed.take(b"%d\n" % number)
    now += 60  # the log goes on
    printed.take(b"later\n")
    printed.end()
    logged = capsys.readouterr().err.splitlines()
    first, last = map(str, range(10_000)), map(str, range(30_000 - LINES, 30_000))
    omitted = f"[{20_000 - LINES:,} lines omitted: more than 10000 in 60 s]"
    assert logged == [*first, omitted, *last, "later"]
    assert printed.tail.endswith("29999\nlater")


def test_all_lines_are_logged_where_few_are_left_out(capsys: pytest.CaptureFixture[str]) -> None:
    printed = CapturedOutput(1 << 30)
    printed.take(b"".join(b"%d\n" % number for number in range(10_003)))
    printed.end()
    assert capsys.readouterr().err.splitlines() == [str(number) for number in range(10_003)]
