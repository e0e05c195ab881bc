"""One seed, one record: byte for byte, wherever the episodes ran."""

import itertools

import pytest

from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.runs import attempts, record

RANDOM = """\
simulation: minisim
parameters: {numAgents: 2, numDefenders: 2, placement: random, maxSteps: 12, seed: 17}
controller: {kind: fully_meshed, hidden: 2, activation: sigmoid}
ranking: {kind: absolute, episodes: 2, aggregate: worst}
method: {kind: nnga, population: 14, generations: 3}
"""
COUNTS = (1, 2, 8)


@pytest.mark.journey
def test_any_number_of_servers_on_any_broker(
    kind: str, launch: Launch, experiment: Experiment, broker: BrokerProcess
) -> None:
    """`kind` says whether the tool brings its own broker or starts its servers on another."""
    path = experiment(RANDOM)
    local = launch("optimize", path, "--seed", 4, "--servers", "local", "--out", "local")
    other = launch("optimize", path, "--seed", 5, "--servers", "local", "--out", "other")
    assert (local.wait(), other.wait()) == (0, 0)
    expected = record(path.parent / "local")
    where = [] if kind == "embedded" else ["--broker", broker.url]
    most = 0
    for count in COUNTS:
        name = f"with-{count}"
        run = launch("optimize", path, "--seed", 4, "--servers", count, "--out", name, *where)
        assert run.wait() == 0, run.stderr
        assert record(path.parent / name) == expected, f"{count} servers"
        used = {entry["server"] for entry in attempts(path.parent / name)}
        # On a busy machine some server may come too late for any of the work.
        assert 1 <= len(used) <= count
        most = max(most, len(used))
    assert most > 1
    different = record(path.parent / "other")
    assert all(different[name] != expected[name] for name in expected)


def test_an_experiment_s_own_seed_counts(launch: Launch, experiment: Experiment) -> None:
    path = experiment(RANDOM + "seed: 4\n")
    names = ("file", "option", "again")
    options: list[list[object]] = [[], ["--seed", 4], ["--seed", 5]]
    for name, option in zip(names, options, strict=True):
        assert launch("optimize", path, "--servers", "local", "--out", name, *option).wait() == 0
    records = [record(path.parent / name) for name in names]
    assert records[0] == records[1]
    for one, other in itertools.pairwise(records[1:]):
        assert one["record"] != other["record"]
