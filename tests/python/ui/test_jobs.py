"""What the window starts runs, stops and survives it, and nothing else is started."""

import contextlib
import errno
import json
import os
import shutil
import signal
import stat
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

from swarmwright import InputError, Run
from swarmwright.ui.app import create_app
from swarmwright.ui.jobs import MOST_OUTPUTS, OUTPUT_BYTES, Job, Jobs, Process, problems, read_broker
from tests.python.ui.client import Answer, call

SMALL = "simulation: minisim\nservers: in-process\nmethod: {population: 10, generations: 3}\n"
ENDLESS = "simulation: minisim\nservers: in-process\nmethod: {population: 100, generations: 10000000}\n"


@pytest.fixture
def jobs(tmp_path: Path) -> Iterator[Jobs]:
    jobs = Jobs(tmp_path, slots=1)
    yield jobs
    for child in jobs._children:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait(10)


def until(jobs: Jobs, holds: Callable[[list[Job]], bool], seconds: float = 50) -> list[Job]:
    """Go on with the queue, as the window does, until the jobs are as they should be."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        jobs.advance()
        now = jobs.list_jobs()
        if holds(now):
            return now
        time.sleep(0.1)
    pytest.fail(f"still so: {[(job.state, job.line) for job in jobs.list_jobs()]}")


@pytest.mark.slow
def test_runs_are_queued_and_done_one_after_the_other(jobs: Jobs) -> None:
    jobs.start(SMALL, "small", [1, 2])
    most = 0

    def are_done(now: list[Job]) -> bool:
        nonlocal most
        most = max(most, sum(job.state == "running" for job in now))
        return all(job.state == "done" for job in now)

    until(jobs, are_done)
    assert most == 1
    assert [Run(jobs.folder / f"small-{seed}").experiment.seed for seed in (1, 2)] == [1, 2]
    jobs.resume("small-1", 5)
    until(jobs, lambda now: now[0].state == "done")
    assert Run(jobs.folder / "small-1").generations == 5
    jobs.delete(["small-2"])
    until(jobs, lambda now: now[0].state == "done")
    assert not (jobs.folder / "small-2").exists()


@pytest.mark.slow
def test_a_job_is_interrupted_keeps_its_results_and_survives_its_window(jobs: Jobs) -> None:
    [job] = jobs.start(ENDLESS, "endless", [])
    until(jobs, lambda now: now[0].state == "running" and (jobs.folder / "endless" / "run.sqlite").exists())
    later = Jobs(jobs.folder, slots=1)  # of a window that was started after the first one had gone
    [waiting] = later.start(SMALL, "small", [])
    later.advance()
    assert [other.state for other in later.list_jobs()] == ["waiting", "running"]
    assert later.stop(waiting.id).state == "stopped"
    time.sleep(1.0)  # a generation is finished, so that there is something to keep
    later.stop(job.id)
    until(later, lambda now: now[-1].state == "stopped")
    run = Run(jobs.folder / "endless")
    assert run.state == "interrupted"
    assert run.generations > 0


def test_runs_on_a_broker_need_servers_there_and_no_processor(jobs: Jobs) -> None:
    servers = 2
    queue = Jobs(jobs.folder, slots=1, count_servers=lambda _broker, _prefix: servers)
    on_broker = "simulation: minisim\nbroker: mqtt://localhost:9\nprefix: lab\n"
    queue.start(on_broker, "there", [1, 2, 3])
    queue.start(SMALL, "here", [1, 2])
    queue.serve("minisim", 2, "mqtt://localhost:9", "lab")
    queue.start_broker(1883)
    queue.delete(["old"])

    def started() -> list[str]:
        return [" ".join(job.arguments[:2]) for job in queue._choose(queue.list_jobs())]

    assert started() == [
        "optimize there.yaml", "optimize there.yaml", "optimize here.yaml",
        "serve --broker", "broker --port", "runs delete",
    ]  # fmt: skip
    servers = 0
    assert started().count("optimize there.yaml") == 1, "the first one waits for servers itself"


@pytest.mark.parametrize(
    ("text", "broker"),
    [
        ("broker: mqtt://a\nprefix: p", ("mqtt://a", "p")),
        ("simulation: minisim", ("mqtt://env", "")),
        ("servers: local\nbroker: mqtt://a", ("", "")),
        ("servers: {launcher: slurm}\nbroker: mqtt://a", ("mqtt://a", "")),
        ("[", ("", "")),
        ("- a", ("", "")),
    ],
)
def test_the_broker_of_an_experiment_is_that_of_the_command(
    text: str, broker: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWARMWRIGHT_BROKER", "mqtt://env")
    monkeypatch.delenv("SWARMWRIGHT_PREFIX", raising=False)
    assert read_broker(text) == broker


@pytest.mark.slow
def test_a_job_that_is_killed_has_failed(jobs: Jobs) -> None:
    [job] = jobs.start(ENDLESS, "endless", [])
    until(jobs, lambda now: now[0].state == "running")
    process = jobs._read_process(job.id)
    assert process is not None
    os.killpg(process.pid, signal.SIGKILL)
    until(jobs, lambda now: now[0].state == "failed")


@pytest.mark.slow
def test_what_is_wrong_with_an_experiment_is_told_with_its_line(jobs: Jobs) -> None:
    assert jobs.check(SMALL) == []
    [wrong] = jobs.check("simulation: minisim\nmethod: {population: -3}\n")
    assert wrong == {"line": 2, "message": "method.population: must be at least 2, not -3"}
    assert jobs.check("simulation: [\n")[0]["line"] is not None
    assert jobs.check("simulation: ../../nothing.py:Class\n")
    assert jobs.check("\ud800" + SMALL)
    assert jobs.check("x" * (1 << 21)) == [{"line": None, "message": "is larger than 1 MiB"}]
    assert not [*jobs.folder.glob(".check*")]


@pytest.mark.parametrize(
    "name",
    ["", "../out", "a/b", "-rf", ".hidden", "a b", "x" * 101, "a\0", "$(id)", "ü", "a\n", "--out=/tmp/x"],
)
def test_names_that_are_no_names_are_refused(jobs: Jobs, name: str) -> None:
    with pytest.raises(InputError, match="name: "):
        jobs.start(SMALL, name, [])
    assert [*jobs.folder.iterdir()] == []


def test_names_that_are_taken_are_refused(jobs: Jobs) -> None:
    (jobs.folder / "taken").mkdir()
    with pytest.raises(InputError, match="name: taken exists already"):
        jobs.start(SMALL, "taken", [])
    (jobs.folder / "other.yaml").write_text("something else")
    with pytest.raises(InputError, match=r"other\.yaml exists already"):
        jobs.start(SMALL, "other", [])
    assert (jobs.folder / "other.yaml").read_text() == "something else"
    (jobs.folder / "link.yaml").symlink_to(jobs.folder / "elsewhere.yaml")
    with pytest.raises(InputError, match=r"link\.yaml exists already"):
        jobs.start(SMALL, "link", [])
    assert not (jobs.folder / "elsewhere.yaml").exists()


@pytest.mark.slow
def test_a_queue_in_a_received_folder_is_not_executed(jobs: Jobs) -> None:
    [job] = jobs.start(SMALL, "small", [])
    planted = jobs.folder / "received" / ".swarmwright" / "jobs"
    shutil.copytree(jobs._jobs, planted)
    received = Jobs(jobs.folder / "received")
    received.advance()
    assert received.list_jobs() == []
    assert (planted / job.id / "job.json").is_file()


@pytest.mark.parametrize("seeds", [[-1], [2**63], [*range(201)]])
def test_seeds_out_of_range_are_refused(jobs: Jobs, seeds: list[int]) -> None:
    with pytest.raises(InputError, match="seeds: at most 200"):
        jobs.start(SMALL, "small", seeds)


@pytest.mark.parametrize("job", ["", "..", "../..", "nothing", "a/b"])
def test_only_jobs_of_the_queue_are_stopped(jobs: Jobs, job: str) -> None:
    with pytest.raises(InputError, match="there is no such job"):
        jobs.stop(job)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("job.json", "{"),
        ("job.json", "[]"),
        ("job.json", '{"id": 1}'),
        ("process", "1 2"),
        ("process", "[]"),
        ("process", '{"pid": "1", "start_time": "", "boot_id": "", "host": ""}'),
        ("process", '{"pid": -1, "start_time": "", "boot_id": "", "host": ""}'),
        ("process", '{"pid": 1, "start_time": ""}'),
        ("process", ""),
        ("status", "soon"),
    ],
)
def test_damaged_files_of_a_job_harm_nothing(jobs: Jobs, file: str, content: str) -> None:
    [job] = jobs.start(SMALL, "small", [])
    process = replace(Process.of(os.getpid()), start_time="0")
    (jobs._jobs / job.id / "process").write_text(json.dumps(asdict(process)))
    (jobs._jobs / job.id / file).write_text(content)
    states = [known.state for known in jobs.list_jobs()]
    assert states in ([], ["failed"]), "a process that has the number of another one is not taken for it"


@pytest.mark.parametrize(
    ("changes", "state"),
    [
        ({}, "running"),
        ({"start_time": "1"}, "failed"),
        ({"boot_id": "of yesterday"}, "failed"),
        ({"host": "node7"}, "running"),
        ({"host": "node7", "boot_id": "of node7", "start_time": "1"}, "running"),
    ],
)
def test_a_job_belongs_to_its_machine_and_the_time_since_it_was_started(
    jobs: Jobs, monkeypatch: pytest.MonkeyPatch, changes: dict[str, str], state: str
) -> None:
    signals: list[int] = []
    monkeypatch.setattr(os, "killpg", lambda process, _: signals.append(process))
    [job, _] = jobs.start(SMALL, "small", [1, 2])
    process = replace(Process.of(os.getpid()), **changes)  # type: ignore[arg-type]
    (jobs._jobs / job.id / "process").write_text(json.dumps(asdict(process)))
    [_, current] = jobs.list_jobs()
    assert (current.state, current.host) == (state, changes.get("host", ""))
    is_local = state == "running" and not current.host
    assert len([*jobs._choose(jobs.list_jobs())]) == (0 if is_local else 1), "another machine's processors"
    if current.host:
        with pytest.raises(InputError, match="the job runs on node7; stop it in a window there"):
            jobs.stop(job.id)
    else:
        jobs.stop(job.id)
    assert signals == ([os.getpid()] if is_local else [])
    (jobs._jobs / job.id / "status").write_text("0\n")
    assert jobs.list_jobs()[1].state == "done"


def test_the_queue_is_for_this_user_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "new" / "state"))
    jobs = Jobs(tmp_path)
    [job] = jobs.start(SMALL, "small", [])
    for folder in (jobs._jobs / job.id, *(jobs._jobs / job.id).parents):
        if folder == tmp_path:
            break
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700, folder


def test_a_queue_that_cannot_be_locked_is_told(jobs: Jobs) -> None:
    [job] = jobs.start(SMALL, "small", [])
    (jobs._jobs / "lock").mkdir()
    with pytest.raises(InputError, match="lock: cannot be locked: Is a directory"):
        jobs.stop(job.id)


def test_a_job_that_cannot_be_started_keeps_no_other_waiting(
    jobs: Jobs, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs.start(SMALL, "small", [])

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr("subprocess.Popen", refuse)
    jobs.advance()
    [job] = jobs.list_jobs()
    assert (job.state, job.status) == ("failed", 126)
    assert "cannot be started: " in job.line


def test_outputs_are_read_only_on_demand(jobs: Jobs) -> None:
    started = jobs.start(SMALL, "small", [*range(30)])
    for job in started:
        (jobs._jobs / job.id / "output.txt").write_text(f"first\n{'long ' * 10_000}\nlast of {job.run}\n \n")
    [*_, oldest] = jobs.list_jobs()
    assert (oldest.run, oldest.line) == ("small-0", "last of small-0")
    outputs = jobs.read_outputs([job.id for job in started])
    assert len(outputs) == MOST_OUTPUTS
    assert {len(output) for output in outputs.values()} == {OUTPUT_BYTES}
    assert jobs.read_outputs(["../x", f"{oldest.id}/..", "", oldest.id]) == {oldest.id: outputs[oldest.id]}


def test_the_page_asks_for_the_outputs_that_it_shows(tmp_path: Path) -> None:
    app = create_app(tmp_path, token=None)
    jobs = app.state.window.jobs
    names = [job.id for job in (*jobs.start(SMALL, "small", [1, 2]), jobs.start_broker(1883))]
    for name in names:
        (jobs._jobs / name / "output.txt").write_text("x" * 10_000)
    answer = call(app, "/api/jobs")
    assert (len(answer.values["jobs"]), answer.values["outputs"]) == (3, {})
    assert len(answer.body) < 5000
    assert call(app, "/api/jobs", opened=names[:2]).values["outputs"] == dict.fromkeys(
        names[:2], "x" * 10_000
    )
    services = call(app, "/api/brokers", opened=names[2:]).values
    assert [job["id"] for job in services["jobs"]] == names[2:] == [*services["outputs"]]


def test_jobs_that_have_ended_are_not_read_again(jobs: Jobs) -> None:
    [job] = jobs.start(SMALL, "small", [])
    (jobs._jobs / job.id / "status").write_text("0\n")
    [ended] = jobs.list_jobs()
    assert jobs.list_jobs()[0] is ended
    assert ended.state == "done"


def test_lines_without_a_number_are_told_as_they_are() -> None:
    said = "a/.x.yaml:3: method: wrong\n  .x.yaml:4: seed: too\n.x.yaml: cannot be read\n\nwhatever"
    assert [*problems(said, ".x.yaml")] == [
        {"line": 3, "message": "method: wrong"},
        {"line": 4, "message": "seed: too"},
        {"line": None, "message": "cannot be read"},
        {"line": None, "message": "whatever"},
    ]


@pytest.fixture
def app(tmp_path: Path) -> Starlette:
    return create_app(tmp_path, token=None)


def post(app: Starlette, name: str, values: Any, kind: str = "application/json") -> Answer:
    body = values if isinstance(values, bytes) else json.dumps(values).encode()
    return call(app, f"/api/{name}", method="POST", headers={"content-type": kind}, body=body)


@pytest.mark.parametrize(
    ("name", "values", "status", "message"),
    [
        ("start", b"{", 400, "not valid JSON"),
        ("start", b"[" * 100_000, 400, "not valid JSON"),
        ("start", b"\xff", 400, "not valid JSON"),
        ("start", [], 422, "must be an object"),
        ("start", {}, 422, "text: must be text"),
        ("stop", {"job": 3}, 422, "job: must be text"),
        ("stop", {"job": "../x"}, 422, "there is no such job"),
        ("delete", {"runs": []}, 422, "choose 1 to 500 runs"),
        ("delete", {"runs": ["../elsewhere"]}, 422, "there is no such run"),
        ("delete", {"runs": [["a"]]}, 422, None),
        ("resume", {"runs": "all"}, 422, "runs: must be a list"),
        ("check", {"text": "x", "more": "y" * (3 << 20)}, 413, "larger than 2 MiB"),
    ],
)
def test_wrong_requests_start_nothing(
    app: Starlette, tmp_path: Path, name: str, values: Any, status: int, message: str | None
) -> None:
    answer = post(app, name, values)
    assert answer.status == status
    assert message is None or message in answer.values["error"]
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(
    "kind", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data", "x"]
)
def test_forms_of_other_pages_cannot_ask(app: Starlette, kind: str) -> None:
    assert post(app, "stop", {"job": "x"}, kind).status == 415
    assert call(app, "/api/stop").status == 405


@pytest.mark.slow
def test_files_of_the_folder_take_the_place_of_no_module(jobs: Jobs) -> None:
    for name in ("json", "numpy", "swarmwright", "sitecustomize"):
        (jobs.folder / f"{name}.py").write_text("from pathlib import Path\nPath('executed').touch()\n")
    assert jobs.check(SMALL) == []
    jobs.delete(["none"])
    until(jobs, lambda now: now[0].state == "failed")
    assert not (jobs.folder / "executed").exists()


@pytest.mark.slow
def test_what_code_prints_while_it_is_imported_is_no_mistake(jobs: Jobs) -> None:
    (jobs.folder / "chatty.py").write_text("print('loading the model')\n")
    problems = jobs.check("simulation: chatty.py:Sim\nservers: in-process\n")
    assert ["chatty.py: has no class 'Sim'" in problem["message"] for problem in problems] == [True], problems


def test_a_run_that_waits_is_not_queued_again(jobs: Jobs) -> None:
    jobs.start(SMALL, "twice", [])
    with pytest.raises(InputError, match=r"name: twice exists already in .* or in the queue"):
        jobs.start(SMALL, "twice", [])
    assert len(jobs.list_jobs()) == 1
