"""A plain script plays the simulation server against our optimization tool."""

import json
import threading
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.plain_server import MeasuringServer, PlainServer, Toy
from tests.system.runs import attempts, evaluations, record, warnings

STARTS, STEPS = [4.0, -2.5, 6.25], 8
TOY = f"""\
simulation: toy
requirements: {{dimensions: 1}}
parameters: {{starts: {STARTS}, steps: {STEPS}}}
sensors: 2
actuators: 1
controller: {{kind: fully_meshed, hidden: 2}}
method: {{kind: nnga, population: 10, generations: 3}}
seed: 5
timeouts: {{discovery: 4, step: 10}}
"""


def by_hand(specification: dict[str, Any], genome: list[float]) -> float:
    """The fitness of a genome, computed without any message."""
    return played(specification, genome).fitness


def played(specification: dict[str, Any], genome: list[float]) -> Toy:
    """The toy at the end of a genome's episode."""
    controllers = [Controller({**specification, "weights": genome}) for _ in STARTS]
    toy = Toy(STARTS, STEPS)
    while acting := toy.acting:
        senses = {agent: np.asarray(toy.sense(agent), dtype=np.float32) for agent in acting}
        toy.move({agent: float(controllers[agent](sense)[0]) for agent, sense in senses.items()})
    return toy


@pytest.mark.journey
@pytest.mark.parametrize("version", [3, 5], ids=["mqtt3", "mqtt5"])
def test_fitness_is_what_the_controllers_earn(
    broker: BrokerProcess, connect: Any, launch: Launch, experiment: Experiment, version: int
) -> None:
    servers = [connect(PlainServer, broker.url, number, version=version) for number in (8, 15)]
    path = experiment(TOY)
    program = launch("optimize", path, "--broker", broker.url, "--out", "result")
    assert program.wait() == 0, program.stderr
    folder = path.parent / "result"
    best = json.loads((folder / "best.json").read_text())
    rows = evaluations(folder)
    assert len(rows) > 10
    for fitness, genome in rows:
        assert fitness == by_hand(best["controller"], genome)
    assert best["fitness"] == max(fitness for fitness, _ in rows)
    assert sum(server.episodes for server in servers) == 2 * len(rows), "each evaluation is audited once"
    assert all(server.episodes for server in servers), "both had work"


def test_without_sizes_the_tool_asks_for_them(
    embedded: BrokerProcess, connect: Any, launch: Launch, experiment: Experiment
) -> None:
    connect(PlainServer, embedded.url)
    text = TOY.replace("sensors: 2\nactuators: 1\n", "")
    program = launch("optimize", experiment(text), "--broker", embedded.url, "--out", "result")
    assert program.wait() == 2
    assert "sensors" in program.stderr
    assert "actuators" in program.stderr


def test_a_slow_and_a_quick_server_give_the_same_record(
    embedded: BrokerProcess, connect: Any, launch: Launch, experiment: Experiment
) -> None:
    """The slow one takes the first episode and answers last: arrival does not count."""

    class Slow(PlainServer):
        def finish(self, fitness: float) -> None:
            pause.wait(0.15)
            super().finish(fitness)

    pause = threading.Event()
    path = experiment(TOY)
    records = []
    for name, kinds in (("quick", [PlainServer]), ("mixed", [Slow, PlainServer, Slow])):
        servers = [connect(each, embedded.url, number) for number, each in enumerate(kinds, 1)]
        program = launch("optimize", path, "--broker", embedded.url, "--out", name)
        assert program.wait() == 0, program.stderr
        records.append(record(path.parent / name))
        first = [entry for entry in attempts(path.parent / name) if entry["generation"] == 0]
        order = [entry["candidate"] for entry in first]
        assert (order == sorted(order)) == (len(kinds) == 1), order
        for server in servers:
            server.close()
    assert records[0] == records[1]


def test_fitness_is_made_of_the_metrics_that_a_plain_server_sends(
    broker: BrokerProcess, connect: Any, launch: Launch, experiment: Experiment
) -> None:
    """A server that does not announce them is there too, and is not used."""
    plain = connect(PlainServer, broker.url, 8)
    server = connect(MeasuringServer, broker.url, 15)
    path = experiment(TOY + 'fitness: "3 * met - steps / 8 + fitness / 100"\n')
    program = launch("optimize", path, "--broker", broker.url, "--out", "result")
    assert program.wait() == 0, program.stderr
    folder = path.parent / "result"
    best = json.loads((folder / "best.json").read_text())
    rows = evaluations(folder)
    for fitness, genome in rows:
        toy = played(best["controller"], genome)
        assert fitness == 3 * toy.metrics["met"] - toy.metrics["steps"] / 8 + toy.fitness / 100
    assert best["fitness"] == max(fitness for fitness, _ in rows)
    assert (server.episodes, plain.episodes) == (2 * len(rows), 0), "each evaluation is audited once"
    told = "server 8 answered, but does not announce the metrics met, steps"
    assert any(told in text for text in warnings(folder))


def test_an_episode_whose_metric_is_missing_has_failed(
    embedded: BrokerProcess, connect: Any, launch: Launch, experiment: Experiment
) -> None:
    connect(MeasuringServer, embedded.url)
    path = experiment(TOY + 'fitness: "mean"\n')
    program = launch("optimize", path, "--broker", embedded.url, "--out", "result")
    assert program.wait() == 0, program.stderr
    folder = path.parent / "result"
    best = json.loads((folder / "best.json").read_text())
    seen = set()
    for fitness, genome in evaluations(folder):
        mean = played(best["controller"], genome).metrics["mean"]
        assert (mean is None and np.isnan(fitness)) or fitness == mean
        seen.add(mean is None)
    assert seen == {True, False}
    errors = [attempt["error"] for attempt in attempts(folder)]
    assert "the metric mean is missing from the result" in errors


def test_a_metric_that_no_server_announces_is_told_before_the_run(
    embedded: BrokerProcess, connect: Any, launch: Launch, experiment: Experiment
) -> None:
    connect(MeasuringServer, embedded.url)
    path = experiment(TOY.replace("discovery: 4", "discovery: 1") + 'fitness: "stpes"\n')
    program = launch("optimize", path, "--broker", embedded.url, "--out", "result")
    assert program.wait() == 1
    assert "metrics stpes" in program.stderr
    assert "(it announces met, steps, mean); did you mean 'steps'?" in program.stderr
    assert not (path.parent / "result").exists()
