"""What the window asks for, and what it is told."""

import asyncio
import base64
import json
import shutil
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.applications import Starlette

from swarmwright import Run
from swarmwright.ui.window import Window
from tests.python.ui.client import call


def test_a_run_is_described(app: Starlette, two_runs: Path) -> None:
    run = Run(two_runs / "run-1")
    values = call(app, "/api/run", run="run-1").values
    assert values["curve"]["best_so_far"] == [summary.best_so_far for summary in run.history]
    assert values["best"]["candidate"] == run.best.candidate
    assert values["experiment"]["simulation"] == run.experiment.simulation
    assert values["sessions"][0]["outcome"] == "done"


def test_every_evaluation_is_in_the_grid(app: Starlette, two_runs: Path) -> None:
    run = Run(two_runs / "run-1")
    values = call(app, "/api/density", run="run-1", columns=50, rows=20).values
    cells = np.frombuffer(base64.b64decode(values["cells"]), np.uint8).reshape(50, 20)
    assert values["evaluations"] == run.evaluations
    assert (values["lowest"], values["highest"]) == (run.fitness.min(), run.fitness.max())
    assert cells.any(axis=1).sum() == min(50, run.evaluations)


def test_a_point_finds_its_evaluation(app: Starlette, two_runs: Path) -> None:
    run = Run(two_runs / "run-1")
    for number in (0, 7, run.evaluations - 1):
        point: dict[str, Any] = {
            "number": number,
            "fitness": run.fitness[number],
            "width": 0.1,
            "height": 0.01,
        }
        found = call(app, "/api/nearest", run="run-1", **point).values
        assert found["number"] == number
        assert found["fitness"] == run.fitness[number]


def test_the_journal_names_servers_and_failures(app: Starlette) -> None:
    assert set(call(app, "/api/journal", run="run-1").values) == {"events", "servers", "failures"}


@pytest.mark.parametrize(
    ("target", "query", "message"),
    [
        ("run", {}, "there is no such run"),
        ("run", {"run": "../x"}, "there is no such run"),
        ("density", {"run": "run-1", "columns": "9" * 500, "rows": 5}, "columns: must be a whole number"),
        ("density", {"run": "run-1", "columns": 10**9, "rows": 5}, "columns: must be from 1 to 4096"),
        ("density", {"run": "run-1", "columns": 0, "rows": 5}, "columns: must be from 1 to 4096"),
        ("nearest", {"run": "run-1", "number": "x"}, "number: must be a number"),
        (
            "nearest",
            {"run": "run-1", "number": 1, "fitness": "nan", "width": 1, "height": 1},
            "must be finite",
        ),
        ("nearest", {"run": "run-1", "number": "1e300", "fitness": 0, "width": "1e300", "height": 1}, None),
        ("nearest", {"run": "run-1", "number": 1, "fitness": 0, "width": "1e308", "height": 1}, None),
        ("journal", {"run": "run-1\0"}, "there is no such run"),
    ],
)
def test_wrong_requests_are_told_why(
    app: Starlette, target: str, query: dict[str, Any], message: str | None
) -> None:
    answer = call(app, f"/api/{target}", **query)
    if message is None:
        assert answer.status == 200
    else:
        assert answer.status == 422
        assert message in answer.values["error"]


def test_a_client_that_leaves_before_the_end_of_its_request_is_no_error(app: Starlette) -> None:
    messages: list[dict[str, Any]] = [
        {"type": "http.disconnect"},
        {"type": "http.request", "body": b'{"text": "simul', "more_body": True},
    ]
    answer = call(
        app, "/api/check", method="POST", headers={"content-type": "application/json"}, messages=messages
    )
    assert answer.status == 400


def test_a_slow_reader_gets_what_has_changed_at_once(two_runs: Path) -> None:
    async def read() -> list[dict[str, object]]:
        window = Window(two_runs)
        window.index.refresh()
        events = window.events(0)
        first = await anext(events)
        for name in ("run-1", "run-2"):
            window.index._update(name, None)
        second = await anext(events)
        await events.aclose()  # type: ignore[attr-defined]
        return [json.loads(event.removeprefix(b"data: ")) for event in (first, second)]

    first, second = asyncio.run(read())
    assert len(first["rows"]) == 2  # type: ignore[arg-type]
    assert second["gone"] == ["run-1", "run-2"]


def test_the_list_goes_on_after_an_error_of_the_disk(two_runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def watch() -> int:
        window = Window(two_runs, read_only=True)
        refresh = window.index.refresh
        errors = [OSError("no space left")]

        def fail_once(seconds: float) -> bool:
            if errors:
                raise errors.pop()
            return refresh(seconds)

        monkeypatch.setattr(window.index, "refresh", fail_once)
        monkeypatch.setattr("swarmwright.ui.window.REFRESH_S", 0.01)
        watcher = asyncio.create_task(window.watch())
        message = await asyncio.wait_for(anext(window.events(0)), 20)
        watcher.cancel()
        return len(json.loads(message.removeprefix(b"data: "))["rows"])

    assert asyncio.run(watch()) > 0


@pytest.mark.parametrize("part", ["queue", "list"])
def test_the_window_goes_on_after_a_mistake_and_says_so_once(
    two_runs: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, part: str
) -> None:
    async def watch() -> int:
        window = Window(two_runs)
        refresh = window.index.refresh
        looks = 0
        is_repeated = threading.Event()

        def fail(*_: float) -> bool:
            nonlocal looks
            looks += 1
            if looks == 5:
                is_repeated.set()
            raise KeyError("never seen")

        monkeypatch.setattr("swarmwright.ui.window.REFRESH_S", 0.01)
        if part == "queue":
            monkeypatch.setattr(window.jobs, "advance", fail)
        else:
            monkeypatch.setattr(window.index, "refresh", lambda _: fail() if looks < 5 else refresh())
        watcher = asyncio.create_task(window.watch())
        message = await asyncio.wait_for(anext(window.events(0)), 20)
        assert await asyncio.to_thread(is_repeated.wait, 20)
        watcher.cancel()
        return len(json.loads(message.removeprefix(b"data: "))["rows"])

    assert asyncio.run(watch()) == 2
    [record] = [record for record in caplog.records if "never seen" in record.getMessage()]
    assert record.getMessage().startswith(
        {"queue": "the queue stands still", "list": "the list of runs is not up to date"}[part]
    )
    assert record.exc_info, "where it happened is told"


def test_a_run_is_opened_anew_when_its_files_change(two_runs: Path, tmp_path: Path) -> None:
    shutil.copytree(two_runs / "run-1", tmp_path / "run-1")
    window = Window(tmp_path)
    window.index.refresh()
    run = window.run_of("run-1")
    assert window.run_of("run-1") is run
    (tmp_path / "run-1" / "run.sqlite").touch()  # a warning, which the list does not show
    assert not window.index.refresh()
    assert window.run_of("run-1") is not run


def test_the_pages_that_are_kept_are_bounded(two_runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmwright.ui.window.REPLAY_BYTES", 1000)
    window = Window(two_runs)
    for number in range(10):
        window.keep_page(str(number), "x" * 400)
    assert [*window._pages] == ["8", "9"]
