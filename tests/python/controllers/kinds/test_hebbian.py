"""Networks with Hebbian learning as a representation."""

import numpy as np
import pytest
from pydantic import ValidationError

from swarmwright import Controller
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers.kinds.hebbian import Hebbian, HebbianOptions
from swarmwright.testing import check_representation


def network(**options: float | str) -> Hebbian:
    return Hebbian(HebbianOptions.model_validate(options), sensors=3, actuators=2)


def test_it_is_a_representation() -> None:
    check_representation("hebbian")
    check_representation("hebbian", {"hidden": 0, "learning_range": 0.5, "mutation": "proportional"})


def test_without_a_learning_rate_it_is_a_fully_meshed_network_and_with_one_it_becomes_another() -> None:
    subject = network(weight_range=0.5)
    genome = subject.initial(Stream(1, "x"))
    assert genome.size == subject.genome_size == 1 + 4 * 8
    plain = {**subject.architecture(), "kind": "fully_meshed", "activation": "clamp", "output_range": [0, 1]}
    meshed = Controller({**plain, "weights": [float(gene) for gene in genome[1:]]})
    readings = np.random.default_rng(1).uniform(0, 1, (20, 3)).astype(np.float32)

    def outputs(controller: Controller) -> list[list[float]]:
        return [controller(reading).tolist() for reading in readings]

    expected = outputs(meshed)
    genome[0] = 0.0
    assert outputs(Controller(subject.specification(genome))) == expected
    genome[0] = 0.1
    learning = Controller(subject.specification(genome))
    found = outputs(learning)
    assert found[0] == expected[0], "the first step is made before it learns"
    assert found != expected
    learning.reset()
    assert outputs(learning) == found, "an episode begins with the genes"


def test_the_learning_rate_has_a_range_of_its_own() -> None:
    subject = network(learning_range=0.02)
    genomes = subject.initials(Streams(1, "x", 0, range(500)))
    rates, rest = genomes[:, 0], genomes[:, 1:]
    assert 0 <= rates.min() < 0.001
    assert 0.019 < rates.max() <= 0.02
    assert abs(float(rates.mean()) - 0.01) < 0.001
    assert np.abs(rest).max() > 1.99
    low, high = subject.initial_range
    assert (low[0], high[0], low[1], high[1]) == (0, 0.02, -2, 2)
    mutants = subject.mutations(genomes, Streams(2, "x", 0, range(500)), severity=0.5, probability=1.0)
    moved = np.abs(mutants.astype(np.float64) - genomes)
    assert 0.0099 < moved[:, 0].max() <= 0.01 + 1e-8
    assert moved[:, 1:].max() > 0.99


def test_what_is_not_mutated_keeps_its_bits() -> None:
    subject = network(hidden=0)
    genomes = subject.initials(Streams(1, "x", 0, range(300)))
    mutants = subject.mutations(genomes, Streams(2, "x", 0, range(300)), severity=0.3, probability=0.5)
    same = (mutants[:, 0] == genomes[:, 0]).mean()
    assert 0.4 < same < 0.6


@pytest.mark.parametrize("option", ["learning_range", "weight_range", "bias_range", "iterations"])
def test_a_range_that_is_none(option: str) -> None:
    with pytest.raises(ValidationError, match=option):
        HebbianOptions.model_validate({option: 0})
