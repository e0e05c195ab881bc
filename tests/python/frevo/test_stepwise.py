"""FREVO's networks on simulation servers, every step through the broker."""

from pathlib import Path

import numpy as np
import pytest

from swarmwright import evaluate, frevo
from swarmwright.frevo._document import open_session
from swarmwright.frevo._networks import networks


@pytest.mark.parametrize("name", ["emergency_exit_stadium", "emergency_exit_random"])
def test_fitness_is_frevos_through_the_broker(data: Path, name: str) -> None:
    experiment = frevo.load(data / f"{name}.zre").experiment.replace(mode="stepwise", servers=2)
    chosen = networks(open_session(data / f"{name}.zre"))[::5]
    genomes = np.array([network.specification["weights"] for network in chosen], dtype=np.float32)
    fitness = evaluate(experiment, genomes)
    expected = [network.fitness for network in chosen]
    assert fitness.tolist() == pytest.approx(expected, rel=0, abs=1e-9)


@pytest.mark.parametrize("update", ["sequential", "simultaneous"])
def test_both_kinds_of_update_are_the_same_with_and_without_broker(data: Path, update: str) -> None:
    field = str(data / "stadium.json")
    experiment = frevo.load(data / "emergency_exit_stadium.zse").experiment.replace(
        mode="stepwise", parameters={"field": field, "update": update, "steps": 10}
    )
    genomes = np.random.default_rng(3).uniform(-2, 2, (4, experiment.genome_size)).astype(np.float32)
    local = evaluate(experiment, genomes, servers="local")
    assert evaluate(experiment, genomes, servers=2).tolist() == local.tolist()
    assert len(set(local.tolist())) == 4
