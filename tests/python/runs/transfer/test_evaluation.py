"""Where the episodes of a transfer are evaluated, and how many servers are started for them."""

from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, Run, optimize, transfer
from swarmwright.servers.supervision.local_servers import LocalServers

pytestmark = pytest.mark.slow

PARAMETERS = {"numAgents": 3, "numDefenders": 3, "placement": "random", "speedDefenders": 0.5}
BUILT_IN: dict[str, Any] = {"simulation": "minisim", "parameters": PARAMETERS}
FALLING = """
from swarmwright import Parameter, Simulation


class Falling(Simulation):
    sensors, actuators = 1, 1
    parameters = {"gain": Parameter(1.0)}

    def reset(self, parameters, seed):
        self.value, self.left = parameters["gain"] * (seed % 7), 2
        return [[1.0]]

    def done(self):
        return self.left == 0

    def step(self, actions):
        self.left -= 1
        self.value -= float(actions[0][0])
        return [[1.0]]

    def fitness(self):
        return self.value
"""


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many servers are started, start by start."""
    counts: list[int] = []
    enter = LocalServers.__enter__

    def counted(servers: LocalServers) -> LocalServers:
        counts.append(servers.count)
        return enter(servers)

    monkeypatch.setattr(LocalServers, "__enter__", counted)
    return counts


def _run(folder: Path, **experiment: Any) -> Run:
    method = {"kind": "random_search", "population": 4, "generations": 1}
    values = {"method": method, "controller": {"hidden": [2]}, "validate": False, **experiment}
    return optimize(Experiment.from_mapping(values), out=folder / "run", servers="in-process")


def test_built_in_simulations_need_no_servers_unless_they_are_asked_for(
    tmp_path: Path, started: list[int]
) -> None:
    run = _run(tmp_path, **BUILT_IN)
    options: dict[str, Any] = {"vary": {"parameters.speedDefenders": (0.2, 0.9)}, "candidates": 2, "seeds": 3}
    evaluate_source = transfer([run], **options)
    assert started == []
    on_servers = transfer([run], servers=1, **options)
    assert started == [1, 1], "once for the run's own simulation, once for all sampled models"
    assert on_servers.to_mapping() == evaluate_source.to_mapping()


def test_the_servers_of_the_experiment_are_started_once_for_all_models(
    tmp_path: Path, started: list[int]
) -> None:
    run = _run(tmp_path, **BUILT_IN, servers=2)
    transfer([run], vary={"parameters.speedDefenders": (0.2, 0.9)}, candidates=1, seeds=3)
    assert started == [2, 2]


def test_worker_processes_are_started_once_for_all_models(tmp_path: Path, started: list[int]) -> None:
    (tmp_path / "falling.py").write_text(FALLING)
    run = _run(tmp_path, simulation=f"{tmp_path}/falling.py:Falling")
    options: dict[str, Any] = {"vary": {"parameters.gain": (1.0, 2.0)}, "candidates": 2, "seeds": 4}
    evaluate_source = transfer([run], servers="in-process", **options)
    assert started == []
    assert transfer([run], servers="local", **options).to_mapping() == evaluate_source.to_mapping()
    assert len(started) == 2
