"""FREVO's networks evaluated in every way: stepwise, batched and offloaded by servers, and in process."""

from pathlib import Path

import numpy as np
import pytest

from swarmwright import _engine, evaluate, frevo
from swarmwright.interop.frevo._document import open_session
from swarmwright.interop.frevo._score import read_networks

NAMES = ["emergency_exit_stadium", "emergency_exit_random"]


def reference(path: Path) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.float32]], list[float]]:
    """The weights of all networks of a result file, and FREVO's fitness of each."""
    found = read_networks(open_session(path))
    weights = [network.specification["weights"] for network in found]
    return np.array(weights, dtype=np.float32), [network.fitness for network in found]


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
@pytest.mark.parametrize("name", NAMES)
def test_fitness_is_frevos_through_the_broker(data: Path, name: str, mode: str) -> None:
    experiment = frevo.load(data / f"{name}.zre").experiment.replace(mode=mode, servers=2)
    genomes, expected = reference(data / f"{name}.zre")
    assert len(expected) == 50
    assert evaluate(experiment, genomes).tolist() == pytest.approx(expected, rel=0, abs=1e-9)


@pytest.mark.parametrize("level", _engine.levels())
@pytest.mark.parametrize("name", NAMES)
def test_fitness_is_frevos_with_every_instruction_set(data: Path, name: str, level: str) -> None:
    experiment = frevo.load(data / f"{name}.zre").experiment
    genomes, expected = reference(data / f"{name}.zre")
    ranking = experiment.new_ranking()
    fitness, _ = _engine.evaluate(
        experiment.simulation,
        experiment.parameters,
        experiment.representation().architecture(),
        genomes,
        ranking.seeds(experiment.first_seed),
        level=level,
    )
    assert fitness.sum(axis=1).tolist() == pytest.approx(expected, rel=0, abs=1e-9)


@pytest.mark.slow
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
