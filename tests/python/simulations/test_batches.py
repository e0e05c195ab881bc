"""Many episodes at once: the record of one after the other, mistakes that are explained."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import (
    BatchSimulation,
    Experiment,
    InputError,
    Parameter,
    RunError,
    evaluate,
    optimize,
    simulate,
)
from swarmwright.servers.evaluation.base import Controllers, Results
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.simulations.host import Host
from swarmwright.testing import check_batch_simulation
from tests.python.records import same_record
from tests.python.simulations import minisim, minisim_batch
from tests.python.simulations.test_ways import experiment

CONTROLLER = {"kind": "layered", "hidden": [2]}


@pytest.mark.slow
@pytest.mark.parametrize("metrics", [False, True])
@pytest.mark.parametrize(
    ("mode", "servers"),
    [("auto", "in-process"), ("stepwise", 1), ("batched", 1), ("offloaded", 1), ("offloaded", 2)],
)
def test_the_record_is_that_of_the_engine(mode: str, servers: Any, metrics: bool, tmp_path: Path) -> None:
    more = {"fitness": "arrived - caught - 0.01 * steps + 0.001 * distance"} if metrics else {}
    expected = optimize(experiment("minisim", **more), servers="in-process", out=tmp_path / "engine")
    one = experiment(minisim_batch.Minisim, mode=mode, **more)
    same_record(optimize(one, servers=servers, out=tmp_path / "run"), expected)


def test_parameter_sets_and_recurrent_networks() -> None:
    meshed = {"kind": "fully_meshed", "hidden": 2}
    genomes = np.random.default_rng(1).normal(size=(40, 98)).astype(np.float32)
    found = []
    for simulation in ("minisim", minisim_batch.Minisim):
        one = experiment(simulation, controller=meshed)
        found.append(evaluate(one, genomes[:, : one.genome_size], servers="in-process"))
    assert found[0].tobytes() == found[1].tobytes()


def test_the_check_for_ones_own_tests() -> None:
    check_batch_simulation(minisim_batch.Minisim, {"numAgents": 3, "numDefenders": 2})


class Shaken(BatchSimulation):
    """What an episode does depends on how many there are, or it makes a mistake."""

    title, sensors, actuators = "shaken", 1, 1
    parameters = {"trouble": ""}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seeds: Any) -> Any:
        self.trouble, self.seeds, self.left = parameters["trouble"], seeds, 3
        if self.trouble == "reset" and 3 in seeds:
            raise ValueError("no three")
        if self.trouble == "refused":
            raise InputError("trouble: refused")
        self.x = np.zeros((len(seeds), 2, 1)) + np.asarray(seeds)[:, None, None] / 8
        return self.x if self.trouble != "flat" else self.x[:, :, 0]

    def step(self, actions: Any) -> Any:
        self.left -= 1
        if self.trouble == "depends":
            self.x += len(self.x)
        if self.trouble == "raise" and 3 in self.seeds:
            raise ValueError("no three")
        if self.trouble == "late" and self.left == 0 and 3 in self.seeds:
            raise ValueError("no three at the end")
        if self.trouble == "nan":
            self.x[self.seeds == 3] = np.nan
        self.x = self.x + actions
        return self.x

    def done(self) -> Any:
        return self.left == 0 if self.trouble == "done" else np.full(len(self.x), self.left == 0)

    def fitness(self) -> Any:
        if self.trouble == "no fitness":
            return np.where(self.seeds == 3, np.nan, self.x.sum(axis=(1, 2)))
        return self.x.sum() if self.trouble == "fitness" else self.x.sum(axis=(1, 2))


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        ("flat", r"Shaken.reset: observations of the shape \(1, 2\) returned, expected \(1, agents, 1\)"),
        ("done", r"Shaken.done: bool of the shape \(\) returned, expected \(1,\) booleans"),
        ("fitness", r"Shaken.fitness: the shape \(\) returned, expected \(1,\) numbers"),
        ("raise", r"Shaken.step: ValueError: no three \(.*test_batches.py:\d+\)"),
        ("nan", r"Shaken.step: sensor 0 of agent 0 in episode 0 is nan, expected a finite number"),
    ],
)
def test_mistakes(trouble: str, words: str) -> None:
    one = Experiment.from_mapping({"simulation": Shaken, "parameters": {"trouble": trouble, "seed": 3}})
    with pytest.raises(RunError, match=f"the episode failed: {words}"):
        simulate(one, servers="in-process")
    host = Host(Shaken)
    words = words.replace(r"\(1,", r"\(4,").replace("episode 0", "episode 3")

    def run() -> None:
        host.start({"trouble": trouble}, np.arange(4, dtype=np.uint64))
        for _ in range(3):
            host.go(np.zeros((4, 2, 1), np.float32))
        host.results(metrics=False)

    with pytest.raises(RunError, match=words):
        run()


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "servers"), [("auto", "in-process"), ("offloaded", 1), ("batched", 1)])
@pytest.mark.parametrize("trouble", ["raise", "late", "nan", "reset", "no fitness"])
def test_one_episode_fails_and_the_others_are_sound(trouble: str, mode: str, servers: Any) -> None:
    """Seed 3 makes trouble; the others, beside it, get what they get without it."""

    def results(trouble: str, mode: str, servers: Any) -> Results:
        one = Experiment.from_mapping(
            {"simulation": Shaken, "parameters": {"trouble": trouble}, "mode": mode, "controller": CONTROLLER}
        )
        genomes = np.random.default_rng(1).normal(size=(3, one.genome_size)).astype(np.float32)
        with open_backend(one, servers=servers) as backend:
            return backend.evaluate(
                Controllers.from_genomes(one.representation(), genomes), range(6), lambda *_: None
            )

    found, sound = results(trouble, mode, servers), results("", "auto", "in-process")
    assert np.isnan(found.fitness[:, 3]).all()
    others = [0, 1, 2, 4, 5]
    assert found.fitness[:, others].tobytes() == sound.fitness[:, others].tobytes()
    assert len(set(sound.fitness.ravel())) == 18
    reasons = {*found.journal.errors}
    assert reasons
    assert all(reason.startswith("Shaken.") or "fitness is" in reason for reason in reasons)


class Resting(BatchSimulation):
    """Agents rest for some steps, each episode at other times; nobody's actuators are needed then."""

    title, sensors, actuators = "resting", 1, 1
    metrics = ("beside",)

    def reset(self, parameters: dict[str, Any], seeds: Any) -> Any:  # noqa: ARG002
        self.step_number, self.seeds = 0, np.asarray(seeds).astype(int)
        self.x = np.zeros((len(seeds), 2, 1)) + self.seeds[:, None, None] / 8
        return self.x

    def acting(self) -> Any:
        first = (self.step_number + self.seeds) % 3 != 0
        return np.stack([first, first & (self.seeds % 2 == 0)], axis=1)

    def step(self, actions: Any) -> Any:
        going = ~self.done()
        assert not actions[~self.acting() | ~going[:, None]].any()
        self.step_number += 1
        self.x += np.where(going[:, None, None], actions + 0.01 * self.step_number, 0)
        return self.x

    def done(self) -> Any:
        return self.step_number >= 3 + self.seeds % 4

    def fitness(self) -> Any:
        return self.x.sum(axis=(1, 2))

    def measure(self) -> Any:
        return {"beside": np.full(len(self.x), float(len(self.x)))}


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_episodes_that_go_on_by_themselves_for_a_while(mode: str) -> None:
    one = Experiment.from_mapping(
        {"simulation": Resting, "mode": mode, "ranking": {"episodes": 5}, "controller": CONTROLLER}
    )
    genomes = np.random.default_rng(1).normal(size=(9, one.genome_size)).astype(np.float32)
    here = evaluate(one, genomes, servers="in-process")
    assert len(set(here)) == 9
    assert evaluate(one, genomes, servers=1).tobytes() == here.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "least"), [("stepwise", 1), ("batched", 10), ("offloaded", 20)])
def test_episodes_are_stepped_together(mode: str, least: int) -> None:
    one = Experiment.from_mapping(
        {"simulation": Resting, "mode": mode, "fitness": "beside", "controller": CONTROLLER}
    )
    beside = evaluate(one, np.zeros((60, one.genome_size), np.float32), servers=1)
    assert beside.max() >= least
    assert mode != "stepwise" or beside.max() == 1


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["batched", "offloaded"])
def test_parameter_sets(mode: str) -> None:
    tuned = {"kind": "parameter_set", "parameters": {"drift": {"type": "real", "range": [-1, 1]}}}
    one = Experiment.from_mapping(
        {"simulation": Drifting, "mode": mode, "controller": tuned, "ranking": {"episodes": 3}}
    )
    genomes = np.array([[0.1], [0.5], [0.8]], np.float32)
    found = evaluate(one, genomes, servers=1)
    assert found.tobytes() == evaluate(one, genomes, servers="in-process").tobytes()
    assert len(set(found)) == 3


class Drifting(BatchSimulation):
    """Agents steer themselves."""

    title, sensors, actuators = "drifting in numpy", 1, 1
    parameters = {"drift": Parameter(0.0, minimum=-1.0, maximum=1.0)}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seeds: Any) -> Any:
        self.x, self.left, self.drift = np.asarray(seeds) / 8, 5, parameters["drift"]
        return self.x[:, None, None]

    def acting(self) -> Any:
        return np.zeros((len(self.x), 1), bool)

    def step(self, actions: Any) -> Any:
        assert not actions.any()
        self.x = self.x + self.drift
        self.left -= 1
        return self.x[:, None, None]

    def done(self) -> Any:
        return np.full(len(self.x), self.left == 0)

    def fitness(self) -> Any:
        return -np.abs(self.x)


def test_the_check_finds_what_depends_on_others() -> None:
    with pytest.raises(AssertionError, match="an episode alone"):
        check_batch_simulation(Shaken, {"trouble": "depends"})


def test_all_episodes_are_stepped_by_one_call(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: dict[Any, int] = dict.fromkeys((minisim.Minisim, minisim_batch.Minisim), 0)
    for simulation in calls:

        def step(
            self: Any, actions: Any, *, simulation: Any = simulation, original: Any = simulation.step
        ) -> Any:
            calls[simulation] += 1
            return original(self, actions)

        monkeypatch.setattr(simulation, "step", step)
        one = experiment(simulation)
        evaluate(one, np.zeros((24, one.genome_size), np.float32), servers="in-process")
    assert 0 < calls[minisim_batch.Minisim] * 20 < calls[minisim.Minisim]
