"""Servers of launchers for the time of a run: their number, their cost, and the end of a budget."""

from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, optimize, resume
from swarmwright.evaluation.launched import scaling, servers
from tests.paced_simulation import written
from tests.python.records import same_record


def experiment(folder: Path, generations: int, **options: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": written(folder / "simulation"),
            "method": {"population": 20, "generations": generations},
            "validate": False,
            "servers": {"launcher": "process", **options},
        }
    )


@pytest.mark.timeout(180)
def test_servers_join_while_there_is_work_and_leave_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scaling, "WORK_S", 1.0)
    numbers: list[int] = []
    looked = servers.LaunchedServers._look

    def look(self: Any, entry: Any, now: float) -> None:
        looked(self, entry, now)
        numbers.append(len(self._present))

    monkeypatch.setattr(servers.LaunchedServers, "_look", look)
    made = experiment(tmp_path, 30, min=1, max=3, idle=1.0)
    run = optimize(made, out=tmp_path / "elastic", progress=False)
    same_record(run, optimize(made, out=tmp_path / "here", servers="in-process", progress=False))
    assert numbers[0] <= 1
    assert max(numbers) == 3


@pytest.mark.timeout(180)
def test_a_spent_budget_interrupts_the_run_which_goes_on_later(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = experiment(tmp_path, 20, count=2, cost_per_hour=0.5, budget=9.0)
    entries: list[servers.Entry] = []
    opened = servers.LaunchedServers.__enter__

    def enter(self: Any) -> Any:
        entries.extend(self._entries)
        return opened(self)

    def use(generation: Any) -> None:
        if generation.generation == 2:
            entries[0].seconds += 20 * 3600  # as after 10 hours

    monkeypatch.setattr(servers.LaunchedServers, "__enter__", enter)
    run = optimize(made, use, out=tmp_path / "run", progress=False)
    assert run.interrupted
    assert 3 <= run.generations < 20
    assert "the budget for servers is spent: process 20.00 hours, cost 10.00" in caplog.text
    (used,) = [event.text for event in run.events() if event.kind == "servers"]
    assert used == "process 20.00 hours, cost 10.00"
    run = resume(run, servers="in-process", progress=False)
    same_record(run, optimize(made, out=tmp_path / "here", servers="in-process", progress=False))
