"""The tab of a competition's progress."""

import json
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

from swarmwright import Run, optimize
from swarmwright.analysis.competition import measure_progress
from swarmwright.simulations.user_code import trust
from swarmwright.ui.app import create_app
from swarmwright.ui.views import progress
from tests.python.runs.optimization.test_competing import MINISIM, POPULATIONS
from tests.python.ui.client import Answer, call
from tests.python.ui.views.test_replays import data_of, parts, post


@pytest.fixture(scope="module")
def competition(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return optimize(POPULATIONS, servers="in-process", out=tmp_path_factory.mktemp("runs") / "race").path


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Give each test a state folder and no results of its own."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(progress, "TOURNAMENTS", progress.Tournaments())
    yield tmp_path / "state" / "swarmwright" / "ui-progress"
    assert progress.playing.acquire(timeout=20), "matches are still being played"
    progress.playing.release()


@pytest.fixture
def app(competition: Path, open_app: Callable[[Path], Starlette]) -> Starlette:
    return open_app(competition.parent)


def play(app: Starlette, run: str = "race", **values: Any) -> Answer:
    return post(app, "progress_play", **{"run": run, "champions": 3, "episodes": 2, **values})


def wait(app: Starlette, run: str = "race") -> dict[str, Any]:
    """Return what is known when no match is being played."""
    end = time.monotonic() + 30
    while time.monotonic() < end:
        known = call(app, "/api/progress", run=run).values
        if known["playing"] is None:
            return known
        time.sleep(0.02)
    pytest.fail("the matches did not end")


def test_results_are_those_of_the_library_and_kept(app: Starlette, competition: Path, state: Path) -> None:
    assert "progress" in call(app, "/api/tabs", run="race").values["tabs"]
    known = call(app, "/api/progress", run="race").values
    assert (known["playing"], known["error"], known["result"], known["present"]) == (None, None, None, 4)
    assert play(app).status == 200
    result = wait(app)["result"]
    expected = measure_progress(Run(competition), champions=3, episodes=2, servers="in-process")
    assert result["generations"] == [0, 2, 3]
    for side, other in zip(result["sides"], expected.sides, strict=True):
        assert side["name"] == other.side
        assert side["outcomes"] == other.outcomes.tolist()
        assert side["ratings"] == other.ratings.tolist()
        assert (side["take"], side["verdict"], side["cycles"]) == (other.take, other.verdict, other.cycles)
    progress.TOURNAMENTS = progress.Tournaments()  # as in a later window
    assert call(app, "/api/progress", run="race").values["result"] == result
    [file] = state.iterdir()
    assert file.stat().st_mode & 0o077 == 0 or file.parent.stat().st_mode & 0o077 == 0
    for content in ("", "{", "[1]", "[" * 100_000, "7"):
        file.write_text(content)
        assert call(app, "/api/progress", run="race").values["result"] is None, content


def test_a_cell_is_replayed(app: Starlette, competition: Path) -> None:
    answer = call(app, "/api/episode", run="race", match="3,0", episode=1)
    assert answer.headers["x-seed"] == "1000000001"
    ((_, content),) = parts(answer)
    data = data_of(content)
    assert "agents of generation 3 against defenders of generation 0" in data["title"]
    matrix = measure_progress(Run(competition), champions=4, episodes=2, servers="in-process")
    fitness = [
        data_of(parts(call(app, "/api/episode", run="race", match="3,0", episode=episode))[-1][1])[
            "episodes"
        ][0]["fitness"][-1]
        for episode in (0, 1)
    ]
    assert sum(fitness) / 2 == pytest.approx(matrix.sides[0].outcomes[3, 0], rel=1e-6)
    exported = post(app, "export", run="race", match="3,0", to=".html").values
    assert exported["name"] == "race-3-0-seed-1000000000.html"


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("progress_play", {"run": "race", "champions": 1, "episodes": 2}, "champions: must be from 2 to 40"),
        ("progress_play", {"run": "race", "champions": 41, "episodes": 2}, "champions: must be from 2 to 40"),
        ("progress_play", {"run": "race", "champions": 3, "episodes": 10**30}, "episodes: must be from 2"),
        ("progress_play", {"run": "race", "champions": "9" * 99, "episodes": 2}, "must be a whole number"),
        ("progress_play", {"run": "race", "champions": [3], "episodes": 2}, "champions: must be a whole"),
        ("progress_play", {"run": "race", "champions": True, "episodes": 2}, "champions: must be a whole"),
        ("progress_play", {"run": "race", "champions": 2.5, "episodes": 2}, "champions: must be a whole"),
        ("progress_play", {"run": "race", "episodes": 2}, "champions: must be a whole"),
        ("progress_play", {"run": "../x", "champions": 3, "episodes": 2}, "there is no such run"),
        ("progress_play", {"run": 7, "champions": 3, "episodes": 2}, "run: must be text"),
        ("progress_play", {"run": "race\0", "champions": 3, "episodes": 2}, "there is no such run"),
        ("progress_stop", {"run": "\ud800"}, "run: is not valid Unicode"),
        ("progress_stop", {}, "run: must be text"),
        ("export", {"run": "race", "match": "3,0", "to": "python"}, "watch a candidate of the generation"),
        ("export", {"run": "race", "match": 3, "to": ".html"}, "match: must be generations such as"),
        ("export", {"run": "race", "match": "3,99", "to": ".html"}, "no generation 99"),
        ("what_if", {"run": "race", "match": "3,0", "parameters": {}}, "of matches there are only replays"),
    ],
)  # fmt: skip
def test_wrong_requests_are_told_why(app: Starlette, name: str, values: dict[str, Any], message: str) -> None:
    answer = post(app, name, **values)
    assert (answer.status, message in answer.values["error"]) == (422, True), answer.values


@pytest.mark.parametrize(
    ("match", "message"),
    [
        ("3", "match: must be generations such as"),
        ("3,-1", "match: must be generations such as"),
        ("3,0,0", "must have a generation of each of agents, defenders, not 3 numbers"),
        ("3,99", "no generation 99"),
        ("9" * 5000 + ",1", "match: must be generations such as"),
        ("<script>,1", "match: must be generations such as"),
    ],
)
def test_matches_that_are_none_are_refused(app: Starlette, match: str, message: str) -> None:
    answer = call(app, "/api/episode", run="race", match=match)
    assert (answer.status, message in answer.values["error"]) == (422, True), answer.values


def test_other_runs_have_no_such_tab(tmp_path: Path, open_app: Callable[[Path], Starlette]) -> None:
    optimize({**MINISIM, "parameters": {}}, servers="in-process", out=tmp_path / "alone")
    optimize(
        {**POPULATIONS, "method": {"population": 5, "generations": 1}},
        servers="in-process",
        out=tmp_path / "short",
    )
    app = open_app(tmp_path)
    assert "progress" not in call(app, "/api/tabs", run="alone").values["tabs"]
    for run, message in (("alone", "is not a competition"), ("short", "needs at least two finished")):
        answer = call(app, "/api/progress", run=run)
        assert (answer.status, message in answer.values["error"]) == (422, True)
        assert message in play(app, run).values["error"]
    assert call(app, "/api/episode", run="alone", match="0,0").status == 422


def hold(monkeypatch: pytest.MonkeyPatch) -> tuple[threading.Event, threading.Event]:
    """Let matches wait; return what says that they do, and what lets them go on."""
    began, go_on = threading.Event(), threading.Event()

    def measure(run: Run, **options: Any) -> Any:
        began.set()
        options["on_progress"](1, 18, "")
        while not go_on.wait(0.01):
            options["on_progress"](2, 18, "")
        return measure_progress(run, **options)

    monkeypatch.setattr(progress, "measure_progress", measure)
    return began, go_on


def test_matches_are_stopped_and_those_of_other_runs_wait(
    competition: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, open_app: Callable[[Path], Starlette]
) -> None:
    for name in ("first", "second"):
        shutil.copytree(competition, tmp_path / "runs" / name)
    app = open_app(tmp_path / "runs")
    began, go_on = hold(monkeypatch)
    play(app, "first")
    assert began.wait(20)
    assert play(app, "first").values["playing"]["whole"] == 18, "asked twice, played once"
    play(app, "second")
    end = time.monotonic() + 20
    waiting = ""
    while not waiting and time.monotonic() < end:
        waiting = call(app, "/api/progress", run="second").values["playing"]["waiting_for"]
    assert waiting == "the matches of another run"
    post(app, "progress_stop", run="first")
    known = wait(app, "first")
    assert (known["result"], known["error"]) == (None, None)
    post(app, "progress_stop", run="second")
    assert wait(app, "second")["result"] is None
    go_on.set()
    play(app, "second")
    assert wait(app, "second")["result"] is not None
    assert post(app, "progress_stop", run="second").status == 200, "there is nothing to stop"


def test_few_runs_wait(app: Starlette, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "MOST_WAITING", 1)
    waiting = {"a": progress.Playing(), "b": progress.Playing()}
    monkeypatch.setattr(progress.TOURNAMENTS, "_playing", waiting)
    assert "are waiting; stop some" in play(app).values["error"]


def test_code_of_others_is_not_executed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, open_app: Callable[[Path], Starlette]
) -> None:
    source = (Path(__file__).parents[2] / "simulations" / "duel.py").read_text()
    (tmp_path / "duel.py").write_text(source)
    optimize(
        {
            "simulation": f"{tmp_path / 'duel.py'}:Duel",
            "ranking": {"kind": "tournament", "pairing": "round_robin"},
            "method": {"population": 4, "generations": 2},
            "validate": False,
        },
        servers="in-process",
        out=tmp_path / "runs" / "theirs",
    )
    app = open_app(tmp_path / "runs")
    assert play(app, "theirs").status == 200
    assert wait(app, "theirs")["error"] is None
    monkeypatch.setattr(trust, "_granted", set())
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "another user"))
    answer = play(app, "theirs")
    assert (answer.status, "--trust" in answer.values["error"]) == (422, True), answer.values


def test_a_run_that_is_deleted_meanwhile(
    competition: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, open_app: Callable[[Path], Starlette]
) -> None:
    shutil.copytree(competition, tmp_path / "runs" / "race")
    app = open_app(tmp_path / "runs")
    began, go_on = hold(monkeypatch)
    play(app)
    assert began.wait(20)
    shutil.rmtree(tmp_path / "runs" / "race")
    go_on.set()
    end = time.monotonic() + 30
    while progress.TOURNAMENTS._playing and time.monotonic() < end:
        time.sleep(0.02)
    assert progress.TOURNAMENTS._playing == {}
    [error] = progress.TOURNAMENTS._errors.values()
    assert "run.sqlite" in error
    assert "Traceback" not in error


def test_a_damaged_store_is_a_message(
    competition: Path, tmp_path: Path, open_app: Callable[[Path], Starlette]
) -> None:
    shutil.copytree(competition, tmp_path / "runs" / "race")
    file = tmp_path / "runs" / "race" / "run.sqlite"
    content = bytearray(file.read_bytes())
    for position in range(len(content) // 2, len(content) - 64, 97):
        content[position] ^= 0xFF
    file.write_bytes(content)
    app = open_app(tmp_path / "runs")
    answer = play(app)
    error = answer.values.get("error") if answer.status == 422 else wait(app)["error"]
    assert error
    assert "Traceback" not in error


def test_matches_take_no_longer_than_the_limit(app: Starlette, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "LONGEST_S", 0.05)
    hold(monkeypatch)
    play(app)
    assert "is too long here; use `swarmwright progress RUN`" in wait(app)["error"]


def test_servers_that_are_gone_are_a_message(
    competition: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, open_app: Callable[[Path], Starlette]
) -> None:
    shutil.copytree(competition, tmp_path / "runs" / "race")
    app = open_app(tmp_path / "runs")
    monkeypatch.setattr("swarmwright.ui.window.catalogue.is_local", lambda _: False)
    monkeypatch.setattr("swarmwright.ui.replays.LONGEST_SEARCH_S", 0.5)
    monkeypatch.setattr(
        "swarmwright.ui.brokers.Brokers.list_addresses", lambda _: [("mqtt://127.0.0.1:9", "")]
    )
    play(app)
    assert "127.0.0.1:9" in wait(app)["error"]


def test_strangers_start_nothing(competition: Path, complete_list: None) -> None:  # noqa: ARG001
    app = create_app(competition.parent, token="secret" * 8)
    assert call(app, "/api/progress", run="race").status == 401
    assert play(app).status == 401
    read_only = create_app(competition.parent, token=None, read_only=True)
    assert play(read_only).status == 200, "nothing is changed"
    assert wait(read_only)["result"] is not None
    elsewhere = {"content-type": "application/json", "origin": "http://evil.example"}
    body = json.dumps({"run": "race", "champions": 3, "episodes": 2}).encode()
    assert call(read_only, "/api/progress_play", method="POST", headers=elsewhere, body=body).status == 403
    plain = {"content-type": "text/plain"}
    assert call(read_only, "/api/progress_play", method="POST", headers=plain, body=body).status == 415


def test_results_that_cannot_be_kept_are_shown(
    app: Starlette, state: Path, caplog: pytest.LogCaptureFixture
) -> None:
    state.parent.mkdir(parents=True)
    state.write_text("a file in the place of the folder")
    play(app)
    assert wait(app)["result"] is not None
    assert "ui-progress: cannot be written" in caplog.text


def test_a_mistake_of_ours_is_logged(
    app: Starlette, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise KeyError("never seen")

    monkeypatch.setattr(progress, "measure_progress", fail)
    play(app)
    assert "the matches failed" in wait(app)["error"]
    assert "never seen" in caplog.text


def test_few_results_are_kept(monkeypatch: pytest.MonkeyPatch, state: Path) -> None:
    monkeypatch.setattr(progress, "MOST_KEPT", 3)
    for number in range(6):
        progress.write_result(f"{number}", {"number": number})
    assert sorted(file.name for file in state.iterdir()) == ["3.json", "4.json", "5.json"]
    assert progress.read_result("5") == {"number": 5}
