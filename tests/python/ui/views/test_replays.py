"""Replays for the player that is open, other parameters, and files to take along."""

import io
import json
import shutil
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

import swarmwright
from swarmwright import Run
from swarmwright.runs.page import PackedEpisode, pack_replay
from swarmwright.ui.app import create_app
from swarmwright.ui.views.run import send_parts
from tests.python.ui.client import Answer, call


def parts(answer: Answer) -> list[tuple[int, bytes]]:
    """Return kind and content of the parts of an answer."""
    split, body = [], answer.body
    while body:
        kind, length = (int.from_bytes(body[at : at + 4], "little") for at in (0, 4))
        split.append((kind, body[8 : 8 + length]))
        body = body[8 + length :]
    return split


def data_of(content: bytes) -> dict[str, Any]:
    """Return the plain values of a packed episode."""
    length = int.from_bytes(content[:4], "little")
    values: dict[str, Any] = json.loads(content[4 : 4 + length])
    return values


def post(app: Starlette, name: str, **values: Any) -> Answer:
    return call(
        app,
        f"/api/{name}",
        method="POST",
        headers={"content-type": "application/json"},
        body=json.dumps(values).encode(),
    )


def test_an_episode_is_packed_for_the_player(app: Starlette, two_runs: Path) -> None:
    run = Run(two_runs / "run-1")
    answer = call(app, "/api/episode", run="run-1", generation=1, candidate=3, episode=1)
    assert answer.status == 200
    assert answer.headers["x-seed"] == str(run.evaluation(3, 1).seeds[1])
    ((kind, content),) = parts(answer)  # 5 steps: there is no beginning
    data = data_of(content)
    assert kind == 1
    assert "candidate 3 of generation 1" in data["title"]
    assert data["episodes"][0]["fitness"][-1] == pytest.approx(run.evaluation(3, 1).episodes[1])
    assert call(app, "/api/episode", run="run-1", generation=1, candidate=3, episode=1).body == answer.body


def test_a_long_episode_begins_before_it_is_computed(app: Starlette) -> None:
    answer = call(
        app,
        "/api/episode",
        run="run-1",
        seed=3,
        parameters='{"maxSteps": 300, "speedAgents": 0, "speedDefenders": 0}',
    )
    (first, beginning), (second, whole) = parts(answer)
    assert (first, second) == (0, 1)
    assert len(data_of(beginning)["episodes"][0]["fitness"]) == 101
    assert len(data_of(whole)["episodes"][0]["fitness"]) > 101
    assert "fitness of this episode" not in dict(data_of(beginning)["facts"])
    assert dict(data_of(whole)["facts"])["changed parameters"].startswith("maxSteps 300 (in the run 5)")


def test_the_player_reaches_nothing_and_has_no_episode(app: Starlette) -> None:
    answer = call(app, "/player")
    assert answer.headers["content-security-policy"].startswith("sandbox allow-scripts; default-src 'none'")
    assert b'"episodes"' not in answer.body.partition(b'id="episode">')[2].partition(b"</script>")[0]


def test_parameters_are_listed_with_their_values(app: Starlette) -> None:
    values = call(app, "/api/parameters", run="run-1").values
    listed = {parameter["key"]: parameter for parameter in values["parameters"]}
    assert listed["maxSteps"]["value"] == 5
    assert listed["maxSteps"]["is_set"]
    assert listed["speedAgents"]["kind"] == "number"
    assert listed["speedAgents"]["description"]
    assert "seed" not in listed


def test_other_parameters_are_compared_on_the_same_seeds(app: Starlette, two_runs: Path) -> None:
    question: dict[str, Any] = {"run": "run-1", "caller": "page", "episodes": 10}
    values = post(app, "what_if", **question, number=1, parameters={}).values
    expected = swarmwright.post_evaluate(two_runs / "run-1", episodes=10, servers="in-process")
    assert values["changed"] is None
    assert values["unchanged"]["fitness"]["mean"] == expected.mean.mean
    assert values["seeds"] == [str(seed) for seed in expected.seeds]
    slow = post(app, "what_if", **question, number=2, parameters={"speedAgents": 0.0, "maxSteps": 9}).values
    assert slow["unchanged"] == values["unchanged"]
    assert slow["changed"]["seeds"] == values["seeds"]
    assert slow["changed"]["fitness"]["mean"] < values["unchanged"]["fitness"]["mean"]
    assert slow["changed"]["metrics"].keys() == values["unchanged"]["metrics"].keys()
    old = post(app, "what_if", **question, number=1, parameters={"maxSteps": 8})
    assert old.status == 422
    assert "newer question" in old.values["error"]


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ({"parameters": "{"}, "parameters: must be an object of JSON"),
        ({"parameters": "[1]"}, "parameters: must be an object of JSON"),
        ({"parameters": "[" * 5000}, "parameters: must be an object of JSON"),
        ({"parameters": json.dumps({f"a{index}": 1 for index in range(101)})}, "parameters: at most 100"),
        ({"parameters": '{"maxSteps": -1}'}, "parameters.maxSteps: -1 found"),
        ({"parameters": '{"maxSteps": "<b>many</b>"}'}, "parameters.maxSteps: "),
        (
            {"parameters": '{"maxSteps": 10000000, "speedAgents": 0, "speedDefenders": 0}'},
            "too long to be shown",
        ),
        ({"parameters": '{"<script>": 1}'}, "parameters.<script>: unknown parameter"),
        ({"parameters": '{"a=b": 1}'}, "'a=b' is not the name of a parameter"),
        ({"parameters": '{"seed": 1}'}, "parameters.seed: has no effect here"),
        ({"seed": -1}, "seed: must be from 0"),
        ({"seed": "1" * 50}, "seed: must be a whole number"),
        ({"episode": 9}, "episode 9: the run has"),
        ({"generation": 99}, "no generation 99"),
        ({"run": "../x"}, "there is no such run"),
    ],
)
def test_episodes_that_cannot_be_shown_are_refused(
    app: Starlette, query: dict[str, Any], message: str
) -> None:
    answer = call(app, "/api/episode", **{"run": "run-1", **query})
    if answer.status == 200:  # the beginning had been sent
        kind, content = parts(answer)[-1]
        assert kind == 2
        assert message in content.decode()
    else:
        assert answer.status == 422
        assert message in answer.values["error"]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"parameters": []}, "parameters: must be a mapping"),
        ({"episodes": 0}, "episodes: must be from 1 to 1000"),
        ({"episodes": 10**9}, "episodes: must be from 1 to 1000"),
        ({"episodes": "x"}, "must be a whole number"),
        ({"number": None}, "must be a whole number"),
        ({"caller": 3}, "caller: must be text"),
        ({"candidate": [1]}, "candidate: must be a whole number"),
        ({"run": "/"}, "there is no such run"),
        ({"parameters": {"numAgents": 0}}, "parameters.numAgents: "),
    ],
)
def test_wrong_questions_are_told_why(app: Starlette, values: dict[str, Any], message: str) -> None:
    question = {"run": "run-1", "caller": "other", "number": 1, "parameters": {}, **values}
    answer = post(app, "what_if", **question)
    assert answer.status == 422
    assert message in answer.values["error"]


@pytest.fixture
def endless(tmp_path: Path) -> Path:
    """Return a folder with the run `endless`, of a class whose episodes take 10 ms a step."""
    file = tmp_path / "endless.py"
    file.write_text(
        "import time\n"
        "from swarmwright import Parameter, Simulation\n"
        "from swarmwright.display import Scene\n"
        "class Endless(Simulation):\n"
        "    sensors, actuators, parameters = 1, 1, {'last': Parameter(1)}\n"
        "    def reset(self, parameters, seed):\n"
        "        self.steps, self.last = 0, parameters['last']\n"
        "        return [[0.0]]\n"
        "    def step(self, actions):\n"
        "        time.sleep(0.01 if self.last > 1 else 0)\n"
        "        self.steps += 1\n"
        "        return [[0.0]]\n"
        "    def done(self):\n"
        "        return self.steps >= self.last\n"
        "    def fitness(self):\n"
        "        return 1.0\n"
        "    def scene(self):\n"
        "        return Scene(1.0, 1.0, self.steps, '', [])\n"
    )
    experiment = {
        "simulation": f"{file}:Endless",
        "method": {"kind": "random_search", "population": 2, "generations": 1},
        "validate": False,
    }
    swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "runs" / "endless")
    return tmp_path / "runs"


@pytest.mark.usefixtures("complete_list")
def test_episodes_of_any_simulation_end_in_time(endless: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmwright.ui.replays.LONGEST_S", 0.3)
    monkeypatch.setattr("swarmwright.ui.replays.LONGEST_REPLAY_S", 0.3)
    app = create_app(endless, token=None)
    changes = {"last": 10**6}
    answer = post(app, "what_if", run="endless", caller="endless", number=1, parameters=changes)
    assert (answer.status, answer.values.get("error")) == (
        422,
        "these episodes take more than 0 s; choose fewer or shorter ones",
    )
    refusal = call(app, "/api/episode", run="endless", parameters=json.dumps(changes))
    assert "this takes more than 0 s" in refusal.body.decode()
    exported = post(app, "export", run="endless", to=".html", parameters=changes)
    assert "this takes more than 0 s" in exported.values["error"]


@pytest.mark.usefixtures("complete_list")
def test_an_episode_stays_in_a_thread_that_ends_with_its_reader(
    endless: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: set[int] = set()
    make = pack_replay

    def note_thread(*arguments: Any, **options: Any) -> Iterator[PackedEpisode]:
        threads.add(threading.get_ident())
        for part in make(*arguments, **options):
            threads.add(threading.get_ident())
            yield part

    monkeypatch.setattr("swarmwright.ui.views.run.pack_replay", note_thread)
    parts = send_parts(Run(endless / "endless"), {"parameters": {"last": 10**6}}, lambda _: None)
    assert next(parts)
    (thread,) = threads
    assert thread != threading.get_ident()
    parts.close()  # type: ignore[attr-defined] # it is a generator
    end = time.monotonic() + 20
    while any(each.ident == thread for each in threading.enumerate()):
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.usefixtures("complete_list")
def test_only_brokers_of_the_window_compute_and_resume(
    two_runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = {
        **Run(two_runs / "run-1").experiment.to_mapping(),
        "broker": "mqtt://127.0.0.1:9",
        "servers": "auto",
    }
    swarmwright.optimize(values, servers="in-process", out=tmp_path / "runs" / "received")
    monkeypatch.setattr("swarmwright.simulations.catalogue.is_local", lambda _: False)
    app = create_app(tmp_path / "runs", token=None, broker="mqtt://127.0.0.1:10")
    requests: list[Callable[[], Answer]] = [
        lambda: call(app, "/api/episode", run="received"),
        lambda: post(app, "what_if", run="received", caller="received", number=1, parameters={}),
        lambda: post(app, "export", run="received", to=".html"),
        lambda: post(app, "resume", runs=["received"]),
    ]
    for request in requests:
        answer = request()
        assert answer.status == 422
        assert "does not show the broker that the run names" in answer.values["error"]
    assert app.state.window.jobs.list_jobs() == []
    app.state.window.brokers.add("mqtt://127.0.0.1:9", "")
    for request in requests[:2]:
        assert "no broker answers" in request().values["error"]


@pytest.mark.usefixtures("complete_list")
def test_a_run_that_replaces_another_has_its_own_episodes(two_runs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "run"
    app = create_app(tmp_path / "runs", token=None)
    bodies = []
    for name in ("run-1", "run-2"):
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(two_runs / name, folder)
        app.state.window.index.refresh()
        bodies.append(call(app, "/api/episode", run="run", generation=0, candidate=0).body)
    assert bodies[0] != bodies[1]


def fetch(app: Starlette, answer: Answer) -> Answer:
    assert answer.status == 200, answer.body
    return call(app, "/api/export_file", id=answer.values["id"])


@pytest.mark.slow
def test_code_is_exported_with_its_verification(app: Starlette) -> None:
    answer = post(app, "export", run="run-1", to="python", generation=0, candidate="3", verify=True)
    assert answer.values["verified"] is True
    assert "bit-identical in 10,000 random sequences" in answer.values["lines"][0]
    assert answer.values["name"] == "run-1-0-3-python.zip"
    file = fetch(app, answer)
    assert file.headers["content-disposition"] == f'attachment; filename="{answer.values["name"]}"'
    assert file.headers["content-security-policy"].startswith("sandbox")
    with zipfile.ZipFile(io.BytesIO(file.body)) as archive:
        names = {Path(name).name for name in archive.namelist()}
        assert {"controller.py", "controller_test.py"} <= names


def test_a_replay_is_exported_as_a_page_and_a_picture(app: Starlette, two_runs: Path) -> None:
    answer = post(app, "export", run="run-1", to=".html", seed="7", parameters={"maxSteps": 6})
    page = fetch(app, answer)
    run = Run(two_runs / "run-1")
    assert page.body.decode() == run.replay(seed=7, parameters={"maxSteps": 6}).html
    assert page.headers["content-type"].startswith("text/html")
    best = run.best
    assert answer.values["name"] == f"run-1-{best.generation}-{best.candidate}-seed-7.html"
    picture = fetch(app, post(app, "export", run="run-1", to=".png"))
    assert picture.body.startswith(b"\x89PNG")
    film = fetch(app, post(app, "export", run="run-1", to=".gif", speed=8))
    assert film.body.startswith(b"GIF8")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"to": "cobol"}, "cobol"),
        ({"to": 3}, "to: must be text"),
        ({"to": "../x"}, "../x"),
        ({"to": "machine"}, "machine"),
        ({"to": "c", "group": "a"}, "group"),
        ({"to": "c", "group": 3}, "group: must be text"),
        ({"to": ".gif", "speed": 0}, "speed: must be from 0.1 to 100"),
        ({"to": ".gif", "speed": "fast"}, "speed: must be a number"),
        ({"to": ".html", "parameters": [1]}, "parameters: must be an object of JSON"),
        ({"to": ".html", "episode": 77}, "episode 77"),
        ({"to": "python", "candidate": 10**6}, "no evaluation 1000000"),
    ],
)
def test_what_cannot_be_exported_is_refused(app: Starlette, values: dict[str, Any], message: str) -> None:
    answer = post(app, "export", run="run-1", **values)
    assert answer.status == 422
    assert message in answer.values["error"]


def test_files_are_kept_for_a_while_only(app: Starlette, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = call(app, "/api/export_file", id="x")
    assert missing.status == 422
    assert "export it again" in missing.values["error"]
    monkeypatch.setattr("swarmwright.ui.exports.FILE_BYTES", 1000)
    large = post(app, "export", run="run-1", to=".html")
    assert large.status == 422
    assert "can be downloaded" in large.values["error"]


@pytest.mark.usefixtures("complete_list")
def test_names_of_files_are_plain(two_runs: Path, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    folder = tmp_path / "runs" / 'a "quoted"\u202e <b>run'
    swarmwright.optimize(Run(two_runs / "run-1").experiment, servers="in-process", seed=9, out=folder)
    app = create_app(tmp_path / "runs", token=None)
    answer = post(app, "export", run=folder.name, to=".html", generation=0, candidate=1, seed=5)
    assert answer.values["name"] == "a_quoted_b_run-0-1-seed-5.html"
    fetch(app, answer)


def test_a_read_only_window_exports(two_runs: Path, complete_list: None) -> None:  # noqa: ARG001 - a fixture
    app = create_app(two_runs, token=None, read_only=True)
    assert post(app, "export", run="run-1", to="python").status == 200
