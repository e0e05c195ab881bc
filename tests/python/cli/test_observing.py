"""Warnings of a run: the first of each kind, then how many more."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run
from swarmwright.cli._observing import Warnings

MORE = "more warnings of the same kind"
FRAGILE = """\
import numpy as np
from swarmwright import Simulation

class Fragile(Simulation):
    title, dimensions, sensors, actuators = "fragile", 1, 1, 1

    def reset(self, parameters, seed):
        self.x, self.left = 0.0, 5
        return np.array([[0.0]])

    def step(self, actions):
        self.x, self.left = self.x + float(actions[0, 0]), self.left - 1
        if self.x > 1:
            raise ValueError("the wheel came off")
        return np.array([[self.x]])

    def done(self):
        return self.left == 0

    def fitness(self):
        return self.x
"""


@pytest.mark.slow
def test_what_fails_again_and_again_is_told_once_and_counted(program: Any, tmp_path: Path) -> None:
    (tmp_path / "fragile.py").write_text(FRAGILE)
    experiment = tmp_path / "fragile.yaml"
    experiment.write_text(
        "simulation: fragile.py:Fragile\nservers: 1\nseed: 1\n"
        "method: {kind: random_search, population: 60, generations: 4}\n"
    )
    done = program("optimize", "fragile.yaml", "--out", "run", "--log", "log", "--json")
    assert done.returncode == 0, done.stderr
    result = Run.open(tmp_path / "run")
    reasons = [attempt.error for attempt in result.attempts() if attempt.error]
    failed = int((result.record.episodes != result.record.episodes).sum())
    assert len(reasons) == 3 * failed > 20, "nothing of it is lost"
    reason = "Fragile.step: ValueError: the wheel came off (fragile.py:14)"
    assert set(reasons) == {reason}
    lines = [line for line in done.stderr.splitlines() if "failed" in line]
    once = f"an evaluation failed after 3 attempts: {reason}"
    (hint,) = (line for line in lines if "repeat it" in line)
    lines.remove(hint)
    assert lines[1:] == [f"swarmwright: {once}", f"swarmwright: {failed - 1} {MORE}: {once}"]
    # Which candidate it was is in the record, and how it is evaluated again is told once.
    warnings = [event for event in result.events() if event.kind == "warning"]
    first = next(event for event in warnings if event.text.startswith("candidate "))
    assert first.text.endswith(f", episode 0 (seed 0) failed after 3 attempts: {reason}")
    candidate = first.text.split(",")[0]
    assert math.isnan(result.evaluation(int(candidate.split()[1]), first.generation).episodes[0])
    how = f"--candidate {first.generation}:{candidate.split()[1]}"
    assert f"swarmwright evaluate {tmp_path / 'run'} {how}; " in hint
    assert hint.startswith(
        f"swarmwright: generation {first.generation}, {candidate}, episode 0 (seed 0) failed"
    )
    assert not any(event.text.startswith("an evaluation failed") for event in warnings)
    again = program("evaluate", "run", *how.split())
    assert "an episode failed: Fragile.step: ValueError: the wheel came off" in again.stderr
    logged = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
    told = [line["message"] for line in logged if line["event"] == "warning"]
    told = [line for line in told if "repeat it" not in line]
    assert told[1:] == [once, f"{failed - 1} {MORE}: {once}"]


def test_lines_that_differ_in_numbers_alone_are_of_one_kind(capsys: pytest.CaptureFixture[str]) -> None:
    warnings = Warnings()
    for server in range(1, 5):
        warnings.report({"event": "warning", "message": f"server {server} is silent for {server}.5 s"})
    warnings.report({"event": "broker_lost", "reason": "end of file"})
    warnings.report({"event": "broker_back"})
    warnings.report({"event": "warning", "message": f"7 {MORE}: counted already"})
    warnings.close()
    warnings.close()
    assert capsys.readouterr().err.splitlines() == [
        "swarmwright: server 1 is silent for 1.5 s",
        "swarmwright: lost the broker (end of file); trying again",
        "swarmwright: the broker is back",
        f"swarmwright: 7 {MORE}: counted already",
        f"swarmwright: 3 {MORE} (server 2: 1, server 3: 1, server 4: 1): a server is silent for 1.5 s",
    ]


def test_repetitions_are_counted_by_reason_and_server(capsys: pytest.CaptureFixture[str]) -> None:
    """Neither the server, nor a path, nor the number of attempts makes another kind, the exit status does."""
    warnings = Warnings()

    def fails(server: int, reason: str, before: str = "") -> None:
        message = f"{before}an episode failed on server {server}: sim: {reason}"
        warnings.report({"event": "warning", "message": message})

    fails(1, "was ended by SIGABRT; see /tmp/instance-0/failed-7a")
    for server, count in ((1, 4), (2, 2), (1, 3)):
        before = f"{count} {MORE}: "
        fails(server, f"was ended by SIGABRT; see /tmp/instance-{server}/failed-8b", before)
    for status in (3, 4):
        fails(2, f"ended with exit status {status}")
    for attempts in (3, 2, 2):
        message = f"an evaluation failed after {attempts} attempts: no licence"
        warnings.report({"event": "warning", "message": message})
    warnings.close()
    reason = "sim: was ended by SIGABRT; see /tmp/instance-0/failed-7a"
    assert capsys.readouterr().err.splitlines() == [
        f"swarmwright: an episode failed on server 1: {reason}",
        "swarmwright: an episode failed on server 2: sim: ended with exit status 3",
        "swarmwright: an episode failed on server 2: sim: ended with exit status 4",
        "swarmwright: an evaluation failed after 3 attempts: no licence",
        f"swarmwright: 9 {MORE} (server 1: 7, server 2: 2): an episode failed on a server: {reason}",
        f"swarmwright: 2 {MORE}: an evaluation failed after 3 attempts: no licence",
    ]


def test_counts_come_less_and_less_often(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 0.0
    monkeypatch.setattr("swarmwright.cli._observing.time.monotonic", lambda: now)
    warnings = Warnings()
    told = []
    for second in range(101):
        now = float(second)
        warnings.report({"event": "warning", "message": "no licence"})
        if MORE in capsys.readouterr().err:
            told.append(second)
    assert told == [10, 30, 70]
