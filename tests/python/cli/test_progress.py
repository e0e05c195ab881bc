"""The lines that tell how far a run is."""

import time
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from swarmwright import Generation
from swarmwright.cli import _progress
from swarmwright.cli._output import Output
from swarmwright.experiment.budget import Budget


def generation(number: int) -> Generation:
    return Generation(
        generation=number, generations=3000, best=1.0, mean=0.5, best_so_far=1.0, failed=0, failed_so_far=0,
        evaluations=8 * (number + 1), seconds=0.1, evaluations_per_second=80.0, seconds_left=1.0,
        waiting_for="",
    )  # fmt: skip


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    return now


def test_piped_output_has_a_line_every_few_seconds(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    budget = Budget(generations=3000, evaluations=None, seconds=None)
    with _progress.progress(Output(), budget) as shown:
        for number in range(3000):  # 11.7 seconds
            shown.generation(generation(number))
            clock[0] += 1 / 256
        shown.finish()
        shown.finish()
    told = [line.split(" of 3000 generations")[0] for line in capsys.readouterr().out.splitlines()]
    assert told == ["1", "1281", "2561", "3000"]


def test_slow_generations_have_a_line_each(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    with _progress.progress(Output(), Budget(generations=3000, evaluations=None, seconds=None)) as shown:
        for number in range(4):
            shown.generation(generation(number))
            clock[0] += 5.0
        shown.finish()
    assert len(capsys.readouterr().out.splitlines()) == 4


def test_the_generation_before_a_stall_is_told_first(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    with _progress.progress(Output(), Budget(generations=3000, evaluations=None, seconds=None)) as shown:
        for number in range(2):
            shown.generation(generation(number))
        for _ in range(2):
            shown.evaluating(3, 8, "server 2 is busy")
            clock[0] += 2.0
    first, second, stalled = capsys.readouterr().out.splitlines()
    assert (first[:2], second[:2], stalled) == ("1 ", "2 ", "3 of 8 episodes; server 2 is busy")


@pytest.mark.usefixtures("clock")
def test_json_has_an_object_for_each_generation(capsys: pytest.CaptureFixture[str]) -> None:
    budget = Budget(generations=3000, evaluations=None, seconds=None)
    with _progress.progress(Output(as_json=True), budget) as shown:
        for number in range(100):
            shown.generation(generation(number))
        shown.finish()
    assert len(capsys.readouterr().out.splitlines()) == 100


@pytest.mark.slow
def test_the_number_of_evaluations_is_said_once(
    program: Callable[..., "CompletedProcess[str]"], tmp_path: Path
) -> None:
    (tmp_path / "x.yaml").write_text("simulation: minisim\nmethod: {population: 8}\nvalidate: false\n")
    line = {}
    for limit in ("generations=2", "evaluations=20"):
        done = program("optimize", "x.yaml", "--servers", "local", "--set", f"method.{limit}", "--out", limit)
        assert done.returncode == 0, done.stderr
        line[limit] = done.stdout.splitlines()[0]
    assert line["generations=2"].startswith("1 of 2 generations  best ")
    assert "  8 evaluations (" in line["generations=2"]
    assert line["evaluations=20"].startswith("8 of 20 evaluations  best ")
    assert line["evaluations=20"].count("evaluations") == 1
    assert "/s  " in line["evaluations=20"]
