"""Many episodes at once: the record of one after the other, mistakes that are explained, and faster."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import BatchSimulation, Experiment, InputError, RunError, evaluate, optimize, simulate
from swarmwright._own._host import Host
from swarmwright.testing import check_batch_simulation
from tests.python.own import minisim, minisim_batch
from tests.python.own.test_ways import experiment
from tests.python.records import same_record


@pytest.mark.parametrize("metrics", [False, True])
@pytest.mark.parametrize(
    ("mode", "servers"),
    [("auto", "local"), ("stepwise", 1), ("batched", 1), ("offloaded", 1), ("offloaded", 2)],
)
def test_the_record_is_that_of_the_engine(mode: str, servers: Any, metrics: bool, tmp_path: Path) -> None:
    more = {"fitness": "arrived - caught - 0.01 * steps + 0.001 * distance"} if metrics else {}
    expected = optimize(experiment("minisim", **more), servers="local", out=tmp_path / "engine")
    one = experiment(minisim_batch.Minisim, mode=mode, **more)
    same_record(optimize(one, servers=servers, out=tmp_path / "run"), expected)


def test_parameter_sets_and_recurrent_networks() -> None:
    meshed = {"kind": "fully_meshed", "hidden": 2}
    genomes = np.random.default_rng(1).normal(size=(40, 98)).astype(np.float32)
    found = []
    for simulation in ("minisim", minisim_batch.Minisim):
        one = experiment(simulation, controller=meshed)
        found.append(evaluate(one, genomes[:, : one.genome_size], servers="local"))
    assert found[0].tobytes() == found[1].tobytes()


def test_the_check_for_ones_own_tests() -> None:
    check_batch_simulation(minisim_batch.Minisim, {"numAgents": 3, "numDefenders": 2})


class Shaken(BatchSimulation):
    """What an episode does depends on how many there are, or it makes a mistake."""

    title, sensors, actuators = "shaken", 1, 1
    parameters = {"trouble": ""}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seeds: Any) -> Any:
        self.trouble, self.seeds, self.left = parameters["trouble"], seeds, 3
        if self.trouble == "refused":
            raise InputError("trouble: refused")
        self.x = np.zeros((len(seeds), 2, 1))
        return self.x if self.trouble != "flat" else self.x[:, :, 0]

    def step(self, actions: Any) -> Any:
        self.left -= 1
        if self.trouble == "depends":
            self.x += len(self.x)
        if self.trouble == "raise" and 3 in self.seeds:
            raise ValueError("no three")
        if self.trouble == "nan":
            self.x[self.seeds == 3] = np.nan
        return self.x + actions

    def done(self) -> Any:
        return self.left == 0 if self.trouble == "done" else np.full(len(self.x), self.left == 0)

    def fitness(self) -> Any:
        return self.x.sum() if self.trouble == "fitness" else self.x.sum(axis=(1, 2))


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        ("flat", r"Shaken.reset: observations of the shape \(1, 2\) returned, expected \(1, agents, 1\)"),
        ("done", r"Shaken.done: bool of the shape \(\) returned, expected \(1,\) booleans"),
        ("fitness", r"Shaken.fitness: the shape \(\) returned, expected \(1,\) numbers"),
        ("raise", r"Shaken.step: ValueError: no three \(.*test_batch.py:\d+\)"),
        ("nan", r"Shaken.step: sensor 0 of agent 0 in episode 0 is nan, expected a finite number"),
    ],
)
def test_mistakes(trouble: str, words: str) -> None:
    one = Experiment.from_mapping({"simulation": Shaken, "parameters": {"trouble": trouble, "seed": 3}})
    with pytest.raises(RunError, match=f"the episode failed: {words}"):
        simulate(one, servers="local")
    host = Host(Shaken)
    words = words.replace(r"\(1,", r"\(4,").replace("episode 0", "episode 3")

    def run() -> None:
        host.start(f'{{"trouble": "{trouble}"}}', np.arange(4, dtype=np.uint64))
        for _ in range(3):
            host.go(np.zeros((4, 2, 1), np.float32))
        host.results(metrics=False)

    with pytest.raises(RunError, match=words):
        run()


@pytest.mark.parametrize("servers", ["local", 1])
@pytest.mark.parametrize("trouble", ["raise", "nan"])
def test_one_episode_fails_and_the_others_are_sound(trouble: str, servers: Any) -> None:
    one = Experiment.from_mapping(
        {"simulation": Shaken, "parameters": {"trouble": trouble, "seed": 0}, "ranking": {"episodes": 3}}
    )
    genomes = np.zeros((3, one.genome_size), np.float32)
    assert (evaluate(one, genomes, servers=servers) == 0).all()  # seeds 0 to 2
    failing = one.replace(parameters={"seed": 3})
    assert np.isnan(evaluate(failing, genomes, servers=servers)).all()


def test_the_check_finds_what_depends_on_others() -> None:
    with pytest.raises(AssertionError, match="an episode alone"):
        check_batch_simulation(Shaken, {"trouble": "depends"})


def test_faster_than_one_after_the_other() -> None:
    seconds = {}
    for simulation in (minisim.Minisim, minisim_batch.Minisim):
        one = experiment(simulation)
        genomes = np.zeros((24, one.genome_size), np.float32)
        start = time.process_time()
        evaluate(one, genomes, servers="local")
        seconds[simulation] = time.process_time() - start
    assert seconds[minisim_batch.Minisim] * 2 < seconds[minisim.Minisim]
