import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Run
from swarmwright.cli import _runs
from swarmwright.cli._output import Output, replace_nonfinite
from swarmwright.cli._progress import Stall
from swarmwright.cli.servers import HEADINGS, row
from swarmwright.common.formatting import format_duration
from tests.conftest import PROGRAM

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner) | st.tuples(inner, inner),
)


@pytest.mark.slow
@given(value=values)
def test_everything_finite_is_kept_and_nothing_else_reaches_json(value: object) -> None:
    text = json.dumps(replace_nonfinite(value), allow_nan=False)
    assert "NaN" not in text or isinstance(value, str) or "NaN" in str(value)
    assert replace_nonfinite(json.loads(text)) == json.loads(text)


def test_no_numbers_become_null(capsys: pytest.CaptureFixture[str]) -> None:
    Output(as_json=True).json({"a": [math.nan, 1.5], "b": {"c": -math.inf}})
    assert json.loads(capsys.readouterr().out) == {"a": [None, 1.5], "b": {"c": None}}


def test_text_and_json_are_never_mixed(capsys: pytest.CaptureFixture[str]) -> None:
    for as_json in (False, True):
        output = Output(as_json=as_json)
        output.text("for people")
        output.json({"for": "machines"})
        assert capsys.readouterr().out == ('{"for": "machines"}\n' if as_json else "for people\n")


def test_a_pipe_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    output = Output()
    assert not output.terminal
    assert not output.color
    capsys.readouterr()


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.4, "0.4 s"),
        (9.96, "10 s"),
        (59.4, "59 s"),
        (59.6, "1 min 00 s"),
        (185, "3 min 05 s"),
        (7620, "2 h 07 min"),
        (math.nan, "?"),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    assert format_duration(seconds) == text


def test_a_stall_is_told_after_two_seconds_and_then_ever_more_rarely(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    stall = Stall()
    told = []
    for tenth in range(400):
        now = tenth / 10
        if stall.line_due(3, 10) is not None:
            told.append(round(now, 1))
    assert told == [2.0, 4.0, 8.0, 16.0, 32.0]
    assert stall.line_due(4, 10) is None, "something came"
    for _ in range(5):  # quick generations: only their ends are seen
        now += 10
        assert stall.line_due(10, 10) is None


def test_a_server_that_says_little_still_has_a_row() -> None:
    assert row({"server": 3, "state": "ready"}) == ("3", "-/-", "ready", *["-"] * 7)


def test_a_server_that_is_lost_has_no_time() -> None:
    """Its last will was fixed when it connected, so the time in it is that of the connection."""
    server = {"server": 3, "since": "2024-01-01T00:00:00Z"}
    times = {state: row({**server, "state": state})[HEADINGS.index("since")] for state in ("ready", "lost")}
    assert times == {"ready": "2024-01-01T00:00:00Z", "lost": "-"}


def test_a_server_that_says_everything() -> None:
    cells = row(
        {
            "server": 3,
            "state": "busy",
            "tool": "me@here/1",
            "since": "2024-01-01T00:00:00Z",
            "host": "h",
            "pid": 7,
            "simulations": ["minisim", "other"],
            "capabilities": {
                "dimensions": 2,
                "swarmwright": {"version": 1, "sensors": 4, "actuators": 1, "metrics": ["arrived", "steps"]},
            },
        }
    )
    assert dict(zip(HEADINGS, cells, strict=True)) == {
        "id": "3",
        "host/pid": "h/7",
        "state": "busy",
        "reserved for": "me@here/1",
        "since": "2024-01-01T00:00:00Z",
        "simulations": "minisim, other",
        "dimensions": "2",
        "sensors": "4",
        "actuators": "1",
        "metrics": "arrived, steps",
    }


LOUD = """\
import numpy as np
from swarmwright import Simulation

class Loud(Simulation):
    sensors = actuators = 1
    def reset(self, parameters, seed):
        print("x" * 1300, flush=True)
        self.acted = None
        return np.ones((1, 1))
    def step(self, actions):
        self.acted = float(actions[0, 0])
        return np.ones((1, 1))
    def done(self):
        return self.acted is not None
    def fitness(self):
        return self.acted
"""


@pytest.mark.slow
def test_what_a_simulation_prints_cannot_make_it_fail(program: Any, tmp_path: Path) -> None:
    """Neither a reader that has gone nor a full disk behind the output is a fault of the simulation."""
    (tmp_path / "loud.py").write_text(LOUD)
    (tmp_path / "loud.yaml").write_text(
        "simulation: loud.py:Loud\ncontroller: {kind: layered, hidden: []}\nservers: in-process\n"
        "method: {kind: random_search, population: 40, generations: 3}\nvalidate: false\n"
    )
    assert program("optimize", "loud.yaml", "--out", "whole").returncode == 0
    whole = Run.open(tmp_path / "whole")
    command = [*PROGRAM, "optimize", "loud.yaml", "--out"]
    begun = subprocess.Popen(
        [*command, "piped"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=tmp_path
    )
    with begun:
        assert begun.stdout is not None
        begun.stdout.read(100)
        begun.stdout.close()
        begun.wait(60)
    with Path("/dev/full").open("w") as full:
        subprocess.run([*command, "full"], stdout=full, stderr=subprocess.DEVNULL, cwd=tmp_path, check=False)
    for name in ("piped", "full"):
        program("resume", name)
        assert Run.open(tmp_path / name).digest == whole.digest, name
    # Also with --json, where it goes to standard error.
    with Path("/dev/full").open("w") as full:
        made = subprocess.run(
            [*command, "json", "--json"], stdout=subprocess.PIPE, stderr=full, cwd=tmp_path, check=True
        )
    assert json.loads(made.stdout.splitlines()[-1])["best"]["fitness"] == whole.best.fitness


def test_progress_of_reading_many_runs_is_shown_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(_runs, "_SLOW_S", -1.0)
    monkeypatch.setattr(_runs, "_UPDATE_S", -1.0)
    for terminal, shown in ((False, ""), (True, "\r\x1b[K1,000 of 5,000 runs read\r\x1b[K")):
        monkeypatch.setattr(sys.stderr, "isatty", lambda terminal=terminal: terminal)
        with _runs.reading_progress(5000) as begin:
            begin(1000)
        assert capsys.readouterr().err == shown
