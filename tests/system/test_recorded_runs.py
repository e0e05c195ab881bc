"""A listener beside whole runs: what crosses the broker is the protocol and nothing else."""

from typing import Any

import pytest

from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.peer import PRESENCE, STATUS
from tests.system.recorder import Recorder, Referee, check_shapes
from tests.system.runs import attempts

RUNS = {
    "one agent": (
        "simulation: minisim\nmode: stepwise\nmethod: {population: 10, generations: 2}\nfaults: {audit: 0}\n"
    ),
    "swarm": (
        "simulation: minisim\nmode: stepwise\n"
        "parameters: {numAgents: 4, numDefenders: 2, placement: random, maxSteps: 12}\n"
        "ranking: {kind: absolute, episodes: 2}\n"
        "method: {kind: random_search, population: 5, generations: 2}\n"
        "controller: {kind: fully_meshed, hidden: 1}\n"
        "faults: {audit: 0}\n"
    ),
}


@pytest.mark.journey
@pytest.mark.parametrize("name", RUNS)
def test_a_run_speaks_the_protocol_and_nothing_else(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment, name: str
) -> None:
    recorder: Recorder = connect(Recorder, broker.url)
    serve(broker.url, count=2)
    path = experiment(RUNS[name])
    program = launch("optimize", path, "--broker", broker.url, "--out", "result")
    assert program.wait() == 0, program.stderr
    recorder.settle()
    check_shapes(recorder.messages)
    referee = Referee()
    referee.follow(recorder.messages)
    episodes = attempts(path.parent / "result")
    assert len(referee.finished) == len(set(referee.finished)) == len(episodes) >= 16
    assert all(entry["error"] is None for entry in episodes)
    assert referee.most_at_once == 2, "both servers worked at the same time"
    assert {entry["server"] for entry in episodes} == {1, 2}
    assert sum(entry["steps"] for entry in episodes) <= len(recorder.on("sensor"))
    assert len(recorder.on("sensor")) == len(recorder.on("actuator"))
    titles = {
        content["simulation"] for topic in ("control", "sensor", "fitness") for content in recorder.on(topic)
    }
    assert titles == {"minisim"}
    assert not any(content["visual"] for content in recorder.on("control"))


def test_servers_leave_nothing_behind(broker: BrokerProcess, serve: Serve, connect: Any) -> None:
    servers = serve(broker.url, count=2)
    first: Recorder = connect(Recorder, broker.url)
    presences = {f"{PRESENCE}1", f"{PRESENCE}2"}
    servers.until(lambda _: {message.topic for message in first.messages} == presences, "presence")
    seen: Recorder = connect(Recorder, broker.url)
    seen.settle()
    assert {message.topic for message in seen.messages} == presences
    assert all(message.retained for message in seen.messages)
    servers.stop()
    after: Recorder = connect(Recorder, broker.url)
    after.settle()
    assert after.messages == []


def test_prefixes_keep_groups_apart(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    """Two groups with the same server id on one broker; a third group finds nobody."""
    recorder: Recorder = connect(Recorder, broker.url)
    serve(broker.url, "--prefix", "lab/a")
    serve(broker.url, "--prefix", "lab/b")
    text = RUNS["one agent"] + "timeouts: {discovery: 1}\n"
    runs = [
        launch(
            "optimize", experiment(f"{text}prefix: lab/{group}\n", f"{group}.yaml"), "--broker", broker.url
        )
        for group in "abc"
    ]
    assert [run.wait() for run in runs] == [0, 0, 1]
    assert "no server fits" in runs[2].stderr
    recorder.settle()
    groups = {message.topic.split("/")[1]: [] for message in recorder.messages}  # type: dict[str, list[str]]
    for message in recorder.messages:
        assert message.topic.startswith("lab/")
        groups[message.topic.split("/")[1]].append(message.topic.split("/", 2)[2])
    assert groups.keys() == {"a", "b", "c"}
    assert {topic for topic in groups["c"] if not topic.startswith(STATUS)} == {"discovery"}
    assert groups["a"].count("fitness") == groups["b"].count("fitness") > 0
