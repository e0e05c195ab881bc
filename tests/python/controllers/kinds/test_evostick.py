"""EvoStick's network as a representation."""

import numpy as np
import pytest
from pydantic import ValidationError

from swarmwright import Controller
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers.kinds.evostick import Evostick, EvostickOptions
from swarmwright.testing import check_representation


def network(sensors: int = 24, actuators: int = 2, weight_range: float = 5.0) -> Evostick:
    return Evostick(EvostickOptions(weight_range=weight_range), sensors=sensors, actuators=actuators)


def test_it_is_a_representation() -> None:
    check_representation("evostick")
    check_representation("evostick", {"weight_range": 0.3, "mutation": "proportional"})


def test_genes_are_the_weights_of_each_sensor_and_the_biases_last() -> None:
    subject = network()
    assert subject.genome_size == 50
    genome = np.zeros(50, np.float32)
    genome[0], genome[48] = 0.25, -0.125  # of the left wheel
    genome[23 * 2 + 1], genome[49] = 1.0, 0.5
    controller = Controller(subject.specification(genome))
    sensors = np.zeros(24, np.float32)
    sensors[0], sensors[23] = 1.0, 2.0
    expected = 2 / (1 + np.exp(-4.924273 * np.array([0.25 - 0.125, 2.0 + 0.5]))) - 1
    np.testing.assert_allclose(controller(sensors), expected, atol=3e-7)


def test_genomes_begin_in_the_whole_range_and_mutants_stay_in_it() -> None:
    subject = network()
    genomes = subject.initials(Streams(1, "x", 0, range(200)))
    assert 4.99 < np.abs(genomes).max() <= 5
    assert abs(float(genomes.mean())) < 0.1
    mutants = subject.mutations(genomes, Streams(2, "x", 0, range(200)), severity=0.5, probability=1.0)
    assert np.abs(mutants).max() == 5
    moved = np.abs(mutants.astype(np.float64) - genomes)
    assert moved.max() <= 2.5
    assert (moved > 0).mean() > 0.99


def test_a_child_has_genes_of_both() -> None:
    subject = network()
    mother, father = (subject.initial(Stream(1, name)) for name in ("mother", "father"))
    child = subject.crossover(mother, father, Stream(1, "child"))
    of_father = child == father
    assert 0 < of_father.sum() < 50
    assert (child[~of_father] == mother[~of_father]).all()
    changes = np.flatnonzero(np.diff(of_father.astype(int)))
    assert len(changes) <= 2, "one run"


@pytest.mark.parametrize("value", [0, -1, 2e6])
def test_a_range_that_is_none(value: float) -> None:
    with pytest.raises(ValidationError, match="weight_range"):
        EvostickOptions(weight_range=value)
