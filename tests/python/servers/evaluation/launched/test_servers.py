"""Servers of launchers for the time of a run: their number, their cost, and the end of a budget."""

import re
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, RunError, _engine, optimize, resume
from swarmwright.servers.broker.mosquitto import write_configuration
from swarmwright.servers.evaluation.launched import servers
from swarmwright.servers.evaluation.launched.servers import (
    WORK_S,
    Entry,
    LaunchedServer,
    Load,
    Scaling,
    count_needed,
    start_embedded,
)
from swarmwright.servers.launchers import LAUNCHERS, Health, Specification
from swarmwright.servers.rows import ServerUse
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


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_servers_join_while_there_is_work_and_leave_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(servers, "WORK_S", 1.0)
    numbers: list[int] = []
    looked = servers.LaunchedServers._check_servers

    def look(self: Any, entry: Any, now: float) -> None:
        looked(self, entry, now)
        numbers.append(len(self._present))

    monkeypatch.setattr(servers.LaunchedServers, "_check_servers", look)
    made = experiment(tmp_path, 30, min=1, max=3, idle=1.0)
    run = optimize(made, out=tmp_path / "elastic", progress=False)
    same_record(run, optimize(made, out=tmp_path / "here", servers="in-process", progress=False))
    assert numbers[0] <= 1
    assert max(numbers) == 3


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_a_budget_is_that_of_the_whole_run(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = experiment(tmp_path, 20, count=2, cost_per_hour=0.5, budget=9.0)
    entries: list[Entry] = []
    opened = servers.LaunchedServers.__enter__

    def enter(self: Any) -> Any:
        entries[:] = self._entries
        return opened(self)

    def use_at(number: int, hours: float) -> Any:
        def use(generation: Any) -> None:
            if generation.generation == number:
                entries[0].seconds += 3600 * hours  # as after this time

        return use

    def used(run: Run) -> list[str]:
        return [event.text for event in run.events() if event.kind == "servers"]

    monkeypatch.setattr(servers.LaunchedServers, "__enter__", enter)
    run = optimize(made, use_at(2, 20), out=tmp_path / "run", progress=False)
    assert run.interrupted
    assert 3 <= run.generations < 20
    first = r"process 20\.\d\d server hours, cost 10\.\d\d"
    advice = "continue with `swarmwright resume`"
    assert re.search(f"the budget for servers is spent: {first}; {advice}", caplog.text)
    (text,) = used(run)
    assert re.fullmatch(first, text)
    # Nothing of it is left for another session.
    spent = r"the budget of process, 9, is spent: earlier sessions of this run cost 10\."
    with pytest.raises(
        InputError, match=spent + r".*\. Set a larger budget, such as --set servers\.budget=2\d"
    ):
        resume(run, progress=False)
    with pytest.raises(InputError, match=spent):
        resume(run, servers="process:1", progress=False)
    caplog.clear()
    at = run.generations + 1
    run = resume(run, use_at(at, 9), settings=["servers.budget=14.4"], progress=False)
    assert run.interrupted
    second = (
        r"process 9\.\d\d server hours, cost 4\.\d\d \(the whole run: 29\.\d\d server hours, cost 14\.\d\d\)"
    )
    assert re.search(second, caplog.text)
    assert re.fullmatch(second, used(run)[1])
    run = resume(run, servers="in-process", progress=False)
    same_record(run, optimize(made, out=tmp_path / "here", servers="in-process", progress=False))


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_a_launcher_whose_budget_is_spent_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    component = LAUNCHERS.get("process")
    options = component.options_model.model_validate(
        {"launcher": "process", "cost_per_hour": 1.0, "budget": 1.0}
    )
    with ExitStack() as stack:
        access = start_embedded(stack, ["127.0.0.1"], [], port=None, prefix="")
        specification = Specification("minisim", access.address)
        rows = [
            Entry("process", component(options, specification), options, earlier=ServerUse(7200, 2.0)),
            Entry("other", component(options, specification), options),
        ]
        launched = stack.enter_context(servers.LaunchedServers(rows, access, ""))
        assert [len(row.servers) for row in rows] == [0, 1]
        assert launched.use.keys() == {"process", "other"}
        launched.check()
    assert "the budget of process, 1, is spent" in caplog.text


def test_few_of_many_late_servers_are_asked_for_their_lines(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    component = LAUNCHERS.get("process")
    options = component.options_model.model_validate({"launcher": "process"})
    asked: list[int] = []

    def logs(_launcher: Any, server: int, _lines: int) -> list[str]:
        asked.append(server)
        return [f"line of {server}"]

    with ExitStack() as stack:
        access = start_embedded(stack, ["127.0.0.1"], [], port=None, prefix="")
        entry = Entry("process", component(options, Specification("minisim", access.address)), options)
        launched = servers.LaunchedServers([entry], access, "")
        entry.servers = {server: LaunchedServer(0.0, health=Health("running")) for server in range(50)}
        monkeypatch.setattr(component, "logs", logs)
        launched._report_starting(entry, 100.0)
    assert asked == [0, 1, 2]
    assert "50 started" in caplog.text
    assert "line of 2" in caplog.text


def test_more_servers_than_the_embedded_broker_admits_are_refused(tmp_path: Path) -> None:
    made = experiment(tmp_path, 2).replace(servers={"launcher": "process", "count": 4_001})
    with pytest.raises(InputError, match=r"4001 servers are too many for the embedded broker"):
        optimize(made, out=tmp_path / "run", progress=False)


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_servers_that_their_broker_refuses_are_reported_soon_with_its_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    lab = tmp_path / "lab"
    write_configuration(lab, hosts=["localhost"], port=8883, prefixes=(), iterations=1000)
    broker = _engine.Broker(
        port=0,
        users=str(lab / "passwords"),
        access=str(lab / "acl"),
        certificate=str(lab / "broker.pem"),
        key=str(lab / "broker-key.pem"),
    )
    monkeypatch.setattr(servers, "LATE_S", 2.0)
    monkeypatch.setenv("SWARMWRIGHT_USERNAME", "tool")
    monkeypatch.setenv("SWARMWRIGHT_PASSWORD_FILE", str(lab / "tool.password"))
    monkeypatch.setenv("SWARMWRIGHT_CA_FILE", str(lab / "ca.pem"))
    url = broker.url.replace("127.0.0.1", "localhost")
    made = experiment(tmp_path, 2, start_timeout=6.0)
    hint = (
        r"they log in with the account of this process, tool; the option credentials sets another"
        r"(.|\n)*does not let user .tool. publish"
    )
    try:
        with pytest.raises(RunError, match=rf"runs, but has not reached {url} after 6 s(.|\n)*{hint}"):
            optimize(made, out=tmp_path / "run", broker=url, progress=False)
        soon = rf"process: none of 1 started servers has reached {url} yet; each has 6 s(.|\n)*{hint}"
        assert re.search(soon, caplog.text)
        # With an account of its own, the server comes.
        caplog.clear()
        given = {"launcher": "process", "credentials": str(lab / "server.env")}
        optimize(made.replace(servers=given), out=tmp_path / "run", broker=url, progress=False)
        assert "no server is on" not in caplog.text
    finally:
        broker.stop()


def load(evaluations: int, seconds: float | None = 1.0) -> Load:
    return Load(evaluations, 40, None if seconds is None else 1 / seconds, frozenset())


def test_there_is_a_server_for_each_minute_of_work() -> None:
    assert count_needed(load(1000, None), 2, 9) == 2
    assert count_needed(load(0), 2, 9) == 2
    assert count_needed(load(int(5 * WORK_S)), 2, 9) == 5
    assert count_needed(load(int(50 * WORK_S)), 2, 9) == 9
    # Not more than a generation has evaluations, however long each takes.
    assert count_needed(load(100, 3600.0), 2, 50) == 40


def test_upwards_at_once_and_downwards_after_a_while() -> None:
    scaling = Scaling(1, 9, idle=60.0)
    much, little = load(int(6 * WORK_S)), load(int(2 * WORK_S))
    assert scaling.choose_count(0.0, 1, much) == 6
    assert scaling.choose_count(30.0, 6, little) == 6
    assert scaling.choose_count(80.0, 6, little) == 6
    assert scaling.choose_count(91.0, 6, little) == 2
    assert scaling.choose_count(92.0, 2, much) == 6


def test_a_short_lull_ends_no_server() -> None:
    scaling = Scaling(1, 9, idle=60.0)
    much, none = load(int(6 * WORK_S)), load(0)
    for second in range(0, 600, 10):
        assert scaling.choose_count(float(second), 6, none if second % 40 == 0 else much) == 6


def test_the_status_of_a_pool() -> None:
    status = {
        "generation": 2,
        "generations": 5,
        "total": 120,
        "done": 20,
        "servers": [{"server": 1, "speed": 2.0}, {"server": 2, "speed": 4.0}, {"server": 3}],
        "waiting_for": [{"server": 2, "kind": "block"}],
    }
    assert Load.from_status(status) == Load(100 + 2 * 120, 120, 3.0, frozenset({2}))
    assert Load.from_status({}) == Load(0, 0, None, frozenset())
