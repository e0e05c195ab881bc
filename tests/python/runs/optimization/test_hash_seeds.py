"""Simulations that depend on Python's hash seed: the same record on servers, a warning in this process."""

import sys
from pathlib import Path

import pytest

from swarmwright import Experiment, Run, optimize

pytestmark = pytest.mark.slow

CODE = """
from swarmwright import Simulation

class Swarm(Simulation):
    sensors = actuators = 1

    def reset(self, parameters, seed):
        self.names = {f"robot {number}" for number in range(20)}
        self.score, self.over = 0.0, False
        return [[0.1 * number] for number in range(20)]

    def step(self, actions):
        for row, name in zip(actions, ORDER, strict=True):
            self.score += float(row[0]) * int(name.split()[1])
        self.over = True
        return [[0.0]] * 20

    def done(self):
        return self.over

    def fitness(self):
        return self.score
"""


def run(folder: Path, order: str, servers: str | int) -> Run:
    (folder / "swarm.py").write_text(CODE.replace("ORDER", order))
    experiment = Experiment.from_mapping(
        {
            "simulation": f"{folder}/swarm.py:Swarm",
            "method": {"kind": "random_search", "population": 5, "generations": 2},
            "controller": {"hidden": []},
            "validate": False,
        }
    )
    return optimize(experiment, servers=servers, out=folder / f"run-{servers}")


def test_servers_have_one_hash_seed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    one, two = (run(tmp_path, "self.names", servers) for servers in (1, 2))
    assert one.digest == two.digest
    assert [each.sessions[0].versions["hash seed"] for each in (one, two)] == ["0", "0"]
    assert not caplog.messages


@pytest.mark.skipif(not sys.flags.hash_randomization, reason="this process has a fixed hash seed")
def test_in_process_runs_that_depend_on_it_are_warned_about(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONHASHSEED", raising=False)
    done = run(tmp_path, "self.names", "in-process")
    assert done.sessions[0].versions["hash seed"] == "random"
    (text,) = caplog.messages
    assert "episodes of Swarm depend on Python's hash seed, " in text
    assert "differs in its fitness, " in text
    assert "PYTHONHASHSEED=0" in text


def test_others_are_not(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    run(tmp_path, "sorted(self.names)", "in-process")
    assert not caplog.messages
