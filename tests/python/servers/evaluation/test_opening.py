"""The environment's variables for connections to brokers."""

from pathlib import Path

import pytest

from swarmwright import Experiment, InputError, optimize
from swarmwright.servers.broker.credentials import CREDENTIALS
from swarmwright.servers.evaluation import opening
from swarmwright.servers.evaluation.opening import open_backend


@pytest.fixture(autouse=True)
def _clean(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (*CREDENTIALS, "SWARMWRIGHT_KEEP_ALIVE"):
        monkeypatch.setenv(name, "")


SIMULATION = """
import os
import numpy as np
from swarmwright import Simulation

class World(Simulation):
    title = "world"
    sensors = actuators = 1

    def reset(self, parameters, seed):
        self.left = 1
        return np.ones((1, 1))

    def step(self, actuators):
        self.left -= 1
        return np.ones((1, 1))

    def done(self):
        return self.left == 0

    def fitness(self):
        return float(os.environ.get("SWARMWRIGHT_USERNAME") == "ada")
"""


@pytest.mark.slow
def test_simulations_have_the_credentials_behind_the_embedded_broker_too(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Some connect to a broker themselves, such as proxy FMUs."""
    monkeypatch.setenv("SWARMWRIGHT_USERNAME", "ada")
    monkeypatch.setenv("SWARMWRIGHT_PASSWORD", "horse")
    (tmp_path / "world.py").write_text(SIMULATION)
    experiment = Experiment.from_mapping(
        {
            "simulation": f"{tmp_path / 'world.py'}:World",
            "method": {"kind": "nnga", "population": 4, "generations": 1},
            "ranking": {"episodes": 1},
            "servers": 1,
        }
    )
    assert optimize(experiment, out=tmp_path / "run").best.fitness == 1.0


@pytest.mark.parametrize("broker", [None, "mqtt://localhost:1"])
def test_wrong_credentials_are_reported_before_servers_start(
    monkeypatch: pytest.MonkeyPatch, broker: str | None
) -> None:
    monkeypatch.setattr(opening, "LocalServers", lambda *_, **__: pytest.fail("servers are started"))
    monkeypatch.setenv("SWARMWRIGHT_CERTIFICATE_FILE", "chain.pem")
    with (
        pytest.raises(InputError, match="SWARMWRIGHT_KEY_FILE is not"),
        open_backend(Experiment.from_mapping({"simulation": "minisim"}), broker=broker, servers=1),
    ):
        pass


@pytest.mark.parametrize("broker", [None, "mqtt://localhost:1"])
def test_a_wrong_keep_alive_interval_is_reported_before_servers_start(
    monkeypatch: pytest.MonkeyPatch, broker: str | None
) -> None:
    monkeypatch.setattr(opening, "LocalServers", lambda *_, **__: pytest.fail("servers are started"))
    monkeypatch.setenv("SWARMWRIGHT_KEEP_ALIVE", "0")
    with (
        pytest.raises(InputError, match=r"SWARMWRIGHT_KEEP_ALIVE \(environment\): .* from 1 to 3600"),
        open_backend(Experiment.from_mapping({"simulation": "minisim"}), broker=broker, servers=1),
    ):
        pass
