"""Evaluation in this process tells why episodes failed, and repeats them as servers do."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from swarmwright import Experiment, Run, Simulation, evaluate, optimize, resume
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.in_process import PythonBackend


class Broken(Simulation):
    """Every episode fails, for as many reasons as there are seeds below `reasons`."""

    sensors = actuators = 1
    parameters = {"reasons": 1}  # noqa: RUF012 - as in the base class

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.reason = min(seed, parameters["reasons"] - 1)
        return np.zeros((1, 1))

    def step(self, actions: Any) -> Any:  # noqa: ARG002 - of the base class
        return np.zeros((1, 1))

    def done(self) -> bool:
        return True

    def fitness(self) -> float:
        raise ValueError(f"reason {self.reason}")


@pytest.mark.parametrize(("reasons", "told"), [(1, []), (2, ["reason 0", "reason 1"])])
def test_where_all_episodes_fail_each_of_several_reasons_is_told(reasons: int, told: list[str]) -> None:
    """A single one is in the error that ends the run, which names the last."""
    experiment = Experiment.from_mapping(
        {"simulation": Broken, "parameters": {"reasons": reasons}, "controller": {"kind": "layered"}}
    )
    backend = PythonBackend(experiment)
    found: list[str] = []
    backend.log_failure = lambda reason, _stack: found.append(reason)
    representation = experiment.representation()
    genomes = np.zeros((2, experiment.genome_size), np.float32)
    results = backend.evaluate(Controllers.from_genomes(representation, genomes), [0, 1], lambda *_: None)
    assert np.isnan(results.fitness).all()
    assert len(found) == len(told)
    assert all(words in reason for words, reason in zip(told, found, strict=True))


class Shaky(Simulation):
    """The first attempts at some seeds fail, as many as `times` says."""

    sensors = actuators = 1
    parameters = {"times": 1}  # noqa: RUF012 - as in the base class
    metrics = {"seen": "how much it has seen"}  # noqa: RUF012 - as in the base class
    begun: ClassVar[dict[tuple[int, float], int]] = {}

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.times, self.seed = parameters["times"], seed
        self.action = float("nan")
        return np.ones((1, 1))

    def step(self, actions: Any) -> Any:
        self.action = float(actions[0, 0])
        key = self.seed, self.action
        self.begun[key] = self.begun.get(key, 0) + 1
        if int(1e6 * self.action) % 3 == 0 and self.begun[key] <= self.times:
            raise ValueError("shaken")
        return np.ones((1, 1))

    def done(self) -> bool:
        return self.action == self.action

    def fitness(self) -> float:
        return self.action + self.seed % 7

    def measure(self) -> dict[str, float]:
        return {"seen": self.action}


@pytest.fixture(autouse=True)
def _at_rest() -> None:
    Shaky.begun.clear()


def shaky(times: int, **others: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": Shaky,
            "parameters": {"times": times},
            "controller": {"hidden": []},
            "servers": "in-process",
            "ranking": {"episodes": 2},
            "method": {"population": 10, "generations": 3},
            "validate": False,
            **others,
        }
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "others",
    [
        {},
        {"fitness": "fitness + 2 * seen"},
        {"method": {"population": 10, "generations": 3, "operation": "steady_state"}},
        {"method": {"kind": "racing", "evaluations": 60}, "ranking": {}},
        {"ranking": {"kind": "race", "episodes": 6}},
        {"validate": {"episodes": 20, "candidates": 2}},
    ],
)
def test_what_fails_for_a_time_is_repeated_and_leaves_no_trace_in_the_record(
    others: dict[str, Any], tmp_path: Path
) -> None:
    shaken = optimize(shaky(2, **others), out=tmp_path / "shaken")
    failed = [attempt for attempt in shaken.attempts() if attempt.error]
    assert failed, "something has failed"
    assert {attempt.mode for attempt in failed} == {"in-process"}
    assert {attempt.attempt for attempt in shaken.attempts()} == {1, 2, 3}
    assert sum(attempt.stack is not None for attempt in failed) == 1
    Shaky.begun.clear()
    still = optimize(shaky(0, **others), out=tmp_path / "still")
    assert [*still.attempts()] == [] == [*still.events()]
    assert shaken.record.fitness.tobytes() == still.record.fitness.tobytes()
    assert shaken.record.genomes.tobytes() == still.record.genomes.tobytes()
    if shaken.validation is not None and still.validation is not None:
        assert np.array_equal(shaken.validation.best.episodes, still.validation.best.episodes)


@pytest.mark.slow
def test_attempts_and_incidents_are_counted_as_on_servers(tmp_path: Path) -> None:
    run = optimize(shaky(100), out=tmp_path / "run")
    failed = int(np.isnan(run.record.episodes).sum())
    assert failed > 0
    assert sum(attempt.error is not None for attempt in run.attempts()) == 3 * failed
    texts = [event.text for event in run.events()]
    assert texts[-1] == f"retries: {2 * failed}, failed: {failed}"
    assert any(
        ": Shaky.step: ValueError: shaken" in text and "failed after 3 attempts" in text for text in texts
    )
    assert run._store.servers() == [], "this process is no server"
    assert [one.servers for one in run._store.failures()] == [{-1: 3 * failed}]


def test_the_number_of_attempts_is_that_of_the_experiment() -> None:
    experiment = shaky(2)
    genomes = np.random.default_rng(1).normal(size=(30, experiment.genome_size)).astype(np.float32)
    assert np.isfinite(evaluate(experiment, genomes)).all()
    Shaky.begun.clear()
    assert np.isnan(evaluate(experiment.replace(faults={"attempts": 2}), genomes)).any()
    Shaky.begun.clear()
    assert np.isnan(evaluate(experiment.replace(faults={"attempts": 1}), genomes)).any()


def test_two_failures_for_the_same_reason_are_enough_where_episodes_repeat_themselves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Shaky, "determinism", "bitwise")
    experiment = shaky(2)
    genomes = np.random.default_rng(1).normal(size=(30, experiment.genome_size)).astype(np.float32)
    assert np.isnan(evaluate(experiment, genomes)).any()


@pytest.mark.slow
def test_a_resumed_run_has_the_same_record(tmp_path: Path) -> None:
    whole = optimize(shaky(1), out=tmp_path / "whole")
    Shaky.begun.clear()
    optimize(shaky(1), lambda report: report.generation < 1, out=tmp_path / "parts")
    assert resume(tmp_path / "parts").digest == whole.digest == Run.open(tmp_path / "whole").digest
