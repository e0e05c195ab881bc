"""Wrong input and wrong peers: what is wrong, where, how to mend it; an exit status; never a traceback."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.system.brokers import BrokerProcess, Kind
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.plain_server import PlainServer
from tests.system.processes import Program
from tests.system.runs import attempts, record, warnings

QUICK = "simulation: minisim\nmethod: {population: 6, generations: 2}\ntimeouts: {discovery: 1, step: 5}\n"
TOY = """\
simulation: toy
requirements: {dimensions: 1}
parameters: {starts: [4.0, -2.5], steps: 4}
sensors: 2
actuators: 1
method: {population: 6, generations: 2}
timeouts: {discovery: 1.5, step: 2}
"""


def says(program: Program, status: int, *words: str) -> None:
    """It ends with the status, and with all words on standard error."""
    assert program.wait() == status, program.stderr
    for word in words:
        assert word in program.stderr, program.stderr


@pytest.mark.parametrize("command", ["optimize", "simulate", "serve", "servers"])
def test_no_broker_there(launch: Launch, experiment: Experiment, unused_port: int, command: str) -> None:
    url = f"mqtt://127.0.0.1:{unused_port}"
    what = {"serve": ["minisim"], "servers": []}.get(command, [experiment(QUICK)])
    says(launch(command, *what, "--broker", url), 1, url, "swarmwright broker")


@pytest.mark.parametrize("command", ["optimize", "serve", "servers"])
def test_a_broker_that_asks_for_a_password(
    kind: Kind, tmp_path: Path, launch: Launch, experiment: Experiment, cleanup: Any, command: str
) -> None:
    broker = BrokerProcess(kind, tmp_path / "locked", {"lab": "correct horse"})
    cleanup.callback(broker.stop)
    broker.start()
    what = {"serve": ["minisim"], "servers": []}.get(command, [experiment(QUICK), "--servers", 1])
    arguments = [command, *what, "--broker", broker.url]
    says(launch(*arguments), 1, broker.url, "SWARMWRIGHT_USERNAME", "SWARMWRIGHT_PASSWORD")
    wrong = {"SWARMWRIGHT_USERNAME": "lab", "SWARMWRIGHT_PASSWORD": "battery staple"}
    refused = launch(*arguments, env=wrong)
    says(refused, 1, broker.url, "lab")
    assert "battery staple" not in refused.stderr
    right = launch(*arguments, env={**wrong, "SWARMWRIGHT_PASSWORD": "correct horse"})
    if command == "serve":
        right.until(lambda program: "is ready" in "".join(program.lines), "a server that is ready")
    else:
        assert right.wait() == 0, right.stderr


@pytest.mark.parametrize(
    ("announced", "asked", "words"),
    [
        ({"capabilities": {"dimensions": 3}}, "", ["1 dimensions", "server 31", "3 dimensions"]),
        (
            {"capabilities": {"dimensions": 1, "max_agents": 4}},
            "requirements: {dimensions: 1, max_agents: 9}",
            ["at least 9 agents", "server 31", "at most 4 agents"],
        ),
        ({"title": "chess"}, "", ["simulation toy", "no server answered"]),
        ({"title": "chess", "answers": True}, "", ["simulation toy", "server 31", "offers chess"]),
    ],
    ids=["dimensions", "agents", "silent", "title"],
)
def test_no_server_fits(
    embedded: BrokerProcess,
    connect: Callable[..., Any],
    launch: Launch,
    experiment: Experiment,
    announced: dict[str, Any],
    asked: str,
    words: list[str],
) -> None:
    """A server that answers anyway, as a careless script does: the message says what was found."""

    class Careless(PlainServer):
        def discovered(self, content: dict[str, Any]) -> None:
            if answers:
                content = {**content, "simulation": self.title}
            super().discovered(content)

    announced = dict(announced)
    answers = announced.pop("answers", False)
    connect(Careless, embedded.url, 31, **announced)
    text = TOY.replace("requirements: {dimensions: 1}", asked) if asked else TOY
    run = launch("optimize", experiment(text), "--broker", embedded.url, "--out", "result")
    says(run, 1, "no server fits", embedded.url, "required", "found", *words)


def test_what_our_servers_offer_is_found_too(
    broker: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment
) -> None:
    """They do not answer when they do not fit; their presence says why."""
    serve(broker.url, first=5)
    text = QUICK + "requirements: {dimensions: 3}\n"
    says(
        launch("optimize", experiment(text), "--broker", broker.url),
        1,
        "required: simulation minisim, 3 dimensions",
        "server 5: has 2 dimensions",
    )
    misspelt = launch(
        "optimize",
        experiment("simulation: minisin\ntimeouts: {discovery: 1}\n", "typo.yaml"),
        "--broker",
        broker.url,
    )
    says(misspelt, 1, "minisin", "did you mean 'minisim'")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("simulation: minisin\n", ["minisin", "did you mean 'minisim'"]),
        ("simulation: minisim\nmethod:\n  kind: nga\n", ["bad.yaml:3", "nga", "nnga"]),
        (
            "simulation: minisim\nparameters:\n  maxStep: 3\n",
            ["bad.yaml:3", "maxStep", "did you mean 'maxSteps'"],
        ),
        (
            "simulation: minisim\nparameters:\n  seed: 1\n  maxSteps: many\n",
            ["bad.yaml:4", "maxSteps", "many"],
        ),
        ("simulation: minisim\ncontroller: {kind: layerd}\n", ["bad.yaml:2", "layerd", "layered"]),
        ("simulation: minisim\nmethod:\n  kind: nnga\n  population: [1]\n", ["bad.yaml:4", "population"]),
        ("simulation: minisim\nrankings: {}\n", ["bad.yaml:2", "did you mean 'ranking'"]),
        ("simulation: minisim\nseed: 1\nseed: 2\n", ["bad.yaml:3", "seed"]),
        ("simulation: minisim\nbroker: http://localhost\n", ["bad.yaml:2", "mqtt://"]),
        ("simulation: minisim\nprefix: 'a/#'\n", ["bad.yaml:2", "prefix"]),
    ],
)
def test_wrong_experiments(launch: Launch, experiment: Experiment, text: str, words: list[str]) -> None:
    says(launch("optimize", experiment(text, "bad.yaml")), 2, *words)


def test_a_second_server_with_an_id_that_is_taken(
    broker: BrokerProcess, serve: Serve, launch: Launch
) -> None:
    first = serve(broker.url, first=9)
    second = launch("serve", "minisim", "--broker", broker.url, "--id", 9)
    says(second, 1, "id 9", f"process {first.pids[9]}", "--id")
    assert first.process.poll() is None


def test_two_scripts_with_one_id(
    broker: BrokerProcess, connect: Callable[..., Any], launch: Launch, experiment: Experiment
) -> None:
    """Nothing tells their messages apart: neither is used; with a third, of another id, the run goes on."""
    twins = [connect(PlainServer, broker.url, 6) for _ in range(2)]
    # Episodes so long that both twins have answered before one ends.
    path = experiment(TOY.replace("[4.0, -2.5], steps: 4", "[400.0, -250.0], steps: 60"))
    says(
        launch("optimize", path, "--broker", broker.url, "--out", "none"),
        1,
        "server 6: two servers answer to this id",
    )
    connect(PlainServer, broker.url, 7)
    run = launch("optimize", path, "--broker", broker.url, "--out", "one")
    says(run, 0)
    episodes = attempts(path.parent / "one")
    assert {entry["server"] for entry in episodes if entry["error"] is None} == {7}
    assert "id 6" in run.stderr + json.dumps(warnings(path.parent / "one"))
    assert all(twin.episodes == 0 for twin in twins)


class WrongSensors(PlainServer):
    """Sends one number too many."""

    def send(self, topic: str, **fields: Any) -> None:
        if topic == "sensor":
            fields["sensor"] = [*fields["sensor"], 0.5]
        super().send(topic, **fields)


class NotANumber(PlainServer):
    """Sends NaN as fitness, as Python's json does without being asked."""

    def finish(self, fitness: float) -> None:
        super().finish(fitness * float("nan"))


class UnknownAgent(PlainServer):
    """Speaks for an agent that there is not."""

    def send(self, topic: str, **fields: Any) -> None:
        if topic == "sensor":
            fields["agent"] = 10**9
        super().send(topic, **fields)


MISBEHAVIOUR: dict[type[PlainServer], list[str]] = {
    WrongSensors: ["3", "sensors", "2"],
    NotANumber: ["fitness"],
    UnknownAgent: ["agent 1000000000"],
}


def test_nobody_but_a_server_that_sends_nonsense(
    embedded: BrokerProcess, connect: Callable[..., Any], launch: Launch, experiment: Experiment
) -> None:
    connect(WrongSensors, embedded.url, 3)
    run = launch("optimize", experiment(TOY), "--broker", embedded.url, "--out", "alone")
    says(run, 1, "server 3: fits, but failed", *MISBEHAVIOUR[WrongSensors])


@pytest.mark.parametrize("wrong", MISBEHAVIOUR, ids=lambda kind: kind.__name__)
def test_a_server_that_sends_nonsense_beside_one_that_works(
    embedded: BrokerProcess,
    connect: Callable[..., Any],
    launch: Launch,
    experiment: Experiment,
    wrong: type[PlainServer],
) -> None:
    """It costs time, but nothing else, and the journal says what it sent."""
    path = experiment(TOY)
    bad = connect(wrong, embedded.url, 3)
    connect(PlainServer, embedded.url, 4)
    both = launch("optimize", path, "--broker", embedded.url, "--out", "both")
    says(both, 0)
    bad.close()
    says(launch("optimize", path, "--broker", embedded.url, "--out", "good"), 0)
    assert record(path.parent / "both") == record(path.parent / "good")
    failures = [entry["error"] for entry in attempts(path.parent / "both") if entry["server"] == 3]
    assert failures
    for word in MISBEHAVIOUR[wrong]:
        assert all(word in failure for failure in failures if "was faster" not in failure)
