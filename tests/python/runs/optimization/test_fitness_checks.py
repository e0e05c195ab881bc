"""Fitness that cannot guide a search is warned of once."""

from pathlib import Path

import numpy as np
import pytest

from swarmwright import Experiment, optimize, resume
from swarmwright.runs.optimization.fitness_checks import FitnessChecks

CONTROLLER = "it seems not to depend on the controller"
SEED = "it seems not to depend on the seed"


def same(method: dict[str, object]) -> Experiment:
    """An experiment in which no controller has an effect."""
    return Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": {"steering": "rule", "maxSteps": 20},
            "method": {**method, "population": 6, "generations": 2},
            "servers": "local",
        }
    )


def warnings(caplog: pytest.LogCaptureFixture, *generations: list[list[float]]) -> list[str]:
    checks = FitnessChecks()
    for number, episodes in enumerate(generations):
        checks.add(number, np.array(episodes))
    checks.tell()
    checks.tell()
    return caplog.messages


@pytest.mark.parametrize(
    ("generations", "words"),
    [
        ([[[1.0, 2.0], [1.0, 2.0]], [[3.0, 4.0], [3.0, 4.0]]], [CONTROLLER]),
        ([[[1.0], [1.0]]] * 12, [CONTROLLER]),
        ([[[1.0, 1.0], [2.0, 2.0]]], [SEED]),
        ([[[1.0], [2.0]]], []),
        ([[[1.0, 2.0]]], []),  # one candidate
        ([[[1.0], [1.0]], [[1.0], [2.0]]], []),
        ([[[1.0, 1.0], [np.nan, 2.0]]], []),
        ([[[1e-300, 0.0], [3.0, 0.5]]] * 2, ["the absolute fitness in generation 0 ranges from 1e-300 to 3"]),
        ([[[np.nan, 0.0], [0.0, 0.5]]], []),
    ],
)
def test_what_is_warned_of(
    generations: list[list[list[float]]], words: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    messages = warnings(caplog, *generations)
    assert len(messages) == len(words)
    assert all(part in message for part, message in zip(words, messages, strict=True))


def test_a_long_run_is_not_waited_for(caplog: pytest.LogCaptureFixture) -> None:
    checks = FitnessChecks()
    for number in range(5):
        assert not caplog.messages
        checks.add(number, np.ones((3, 1)))
    assert len(caplog.messages) == 1


def test_a_converged_run_that_is_resumed_is_not_judged(caplog: pytest.LogCaptureFixture) -> None:
    checks = FitnessChecks()
    for number in range(40, 47):
        checks.add(number, np.ones((3, 2)))
    checks.tell()
    assert not caplog.messages
    checks.add(47, np.array([[1e-300, 1.0]]))
    assert len(caplog.messages) == 1  # numbers in another byte order


@pytest.mark.parametrize(("from_random", "reached"), [(False, False), (True, True)])
def test_equal_fitness_may_be_the_most(
    from_random: bool, reached: bool, caplog: pytest.LogCaptureFixture
) -> None:
    checks = FitnessChecks(from_random=from_random, target_is_reached=lambda: reached)
    for number in range(6):
        checks.add(number, np.ones((3, 2)))
    checks.tell()
    assert not caplog.messages


@pytest.mark.parametrize(
    "method",
    [
        {"kind": "nnga"},
        {"kind": "nnga", "operation": "steady_state", "in_flight": 2},
        {"kind": "random_search"},
        {"kind": "cma_es"},
    ],
)
def test_a_run_ends_with_the_warning(
    method: dict[str, object], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    optimize(same(method), out=tmp_path / "run")
    assert sum(CONTROLLER in message for message in caplog.messages) == 1


@pytest.mark.parametrize("operation", ["generational", "steady_state"])
def test_resumed_for_a_generation_it_ends_without(
    operation: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    optimize(same({"kind": "nnga", "operation": operation}), out=tmp_path / "run")
    caplog.clear()
    resume(tmp_path / "run", generations=3)
    assert not [message for message in caplog.messages if CONTROLLER in message]


@pytest.mark.parametrize("operation", ["generational", "steady_state"])
def test_a_run_that_reaches_its_target_ends_without(
    operation: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made = same({"kind": "nnga", "operation": operation, "target": -1e9})
    optimize(made, out=tmp_path / "run")
    assert not [message for message in caplog.messages if CONTROLLER in message]


def test_a_run_that_starts_from_controllers_ends_without(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    optimize(same({"kind": "nnga"}), out=tmp_path / "first")
    caplog.clear()
    optimize(
        same({"kind": "nnga"}).replace(start_from={"run": str(tmp_path / "first")}), out=tmp_path / "second"
    )
    assert not [message for message in caplog.messages if CONTROLLER in message]
