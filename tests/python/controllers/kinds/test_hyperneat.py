"""HyperNEAT: a growing network of positions is decoded into the weights of a layered network."""

import math
from hashlib import sha256
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright import Controller, Experiment, InputError, optimize
from swarmwright.common.arrays import Genome
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.kinds.hyperneat import Hyperneat, HyperneatOptions
from swarmwright.testing import check_representation


def network(sensors: int = 3, actuators: int = 2, **options: Any) -> Hyperneat:
    return Hyperneat(HyperneatOptions.model_validate(options), sensors=sensors, actuators=actuators)


def direct(subject: Hyperneat, weights: list[list[float]]) -> Genome:
    """A genome without hidden nodes; weights: of each output, from its inputs and the bias."""
    options = subject.options
    rows = [[source, weight, 1] for row in weights for source, weight in enumerate(row)]
    nodes = [0.0] * (3 * options.max_nodes)
    genes = [0.0, *(len(row) for row in weights), *nodes, *np.array(rows, dtype=np.float64).ravel()]
    return np.array([*genes, *[0.0] * (subject.genome_size - len(genes))], dtype=np.float32)


def layers(subject: Hyperneat, genome: Genome) -> list[NDArray[np.float32]]:
    """Weights of each layer, (nodes, 1 + inputs), the bias first."""
    weights, result = subject.weights(genome[np.newaxis])[0], []
    sizes = [subject.sensors, *subject.architecture()["hidden"], subject.actuators]
    for inputs, nodes in pairwise(sizes):
        part, weights = np.split(weights, [nodes * (inputs + 1)])
        result.append(part.reshape(nodes, inputs + 1))
    assert not len(weights)
    return result


def test_it_is_a_representation() -> None:
    check_representation("hyperneat")
    check_representation("hyperneat", {"hidden": [], "bias": False, "differences": False, "length": True})
    check_representation("hyperneat", {"hidden": [[3, 3], [2, 1]], "leo": True, "activation": "sigmoid"})


def test_weights_are_a_function_of_positions() -> None:
    subject = network(hidden=[], max_nodes=0, threshold=0.2, largest_weight=3.0)
    genome = direct(subject, [[1.0, 0, -0.5, 0, 0, 0, -0.4], [0, 0, 0.75, 0, 0, 0, 0.0]])
    (found,) = layers(subject, genome)
    sensors, actuators = [-1.0, 0.0, 1.0], [-1.0, 1.0]
    for row, target in zip(found, actuators, strict=True):
        outputs = [math.tanh(0.75 * target), *(math.tanh(x - 0.5 * target - 0.4) for x in sensors)]
        expected = [math.copysign(max(abs(out) - 0.2, 0) / 0.8 * 3, out) for out in outputs]
        assert row.tolist() == pytest.approx(expected, abs=1e-6)
    assert (found == 0).any(), "an output is below the threshold"


def test_each_pair_of_sheets_has_its_outputs() -> None:
    subject = network(hidden=[[2, 1], [1, 3]], max_nodes=0, threshold=0.0, largest_weight=1.0)
    assert [len(sheet) for sheet in subject.sheets] == [3, 2, 3, 2]
    assert subject.sheets[2].tolist() == [[0, -1], [0, 0], [0, 1]]
    levels = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    genome = direct(subject, [[0.0] * 6 + [level] for level in levels])
    for index, layer in enumerate(layers(subject, genome)):
        assert layer[:, 1:].ravel() == pytest.approx(math.tanh(levels[index]))
        assert layer[:, 0] == pytest.approx(math.tanh(levels[3 + index]))


def test_link_expression_decides_which_connections_exist() -> None:
    options = {"hidden": [], "max_nodes": 0, "threshold": 0.0, "bias": False, "leo": True}
    subject = network(4, 4, **options)
    near = [0.0, 0, 0, 0, 1.0, 0, 0.1]  # from the right, or from the same position
    (found,) = layers(subject, direct(subject, [[0.0] * 6 + [1.0], near]))
    assert not found[:, 0].any()
    assert ((found[:, 1:] > 0) == np.tri(4, dtype=bool).T).all()
    assert {*found.ravel().tolist()} == {0.0, found.max().item()}


def test_differences_of_positions_are_inputs() -> None:
    positions = [[0.3, -0.9], [1.0, 0.2]]
    options = {"hidden": [], "max_nodes": 0, "sensor_positions": positions, "actuator_positions": positions}
    with_differences = network(2, 2, **options)
    without = network(2, 2, differences=False, **options)
    row = [0.1, 0.2, 0.3, 0.4]
    fewer = direct(without, [[*row, 0.5]] * 2)
    more = direct(with_differences, [[0.1 - 1, 0.2, 0.3 + 1, 0.4, 1.0, 0.0, 0.5]] * 2)
    found, expected = with_differences.weights(more[None]), without.weights(fewer[None])
    assert found[0].reshape(2, 3)[:, 1:] == pytest.approx(expected[0].reshape(2, 3)[:, 1:], abs=1e-6)


def test_the_distance_is_an_input() -> None:
    options = {"hidden": [], "max_nodes": 0, "threshold": 0.0, "largest_weight": 1.0, "differences": False}
    subject = network(2, 1, length=True, sensor_positions=[[3, 4], [0.0, 0.5]], **options)
    (found,) = layers(subject, direct(subject, [[0, 0, 0, 0, 0.1, 0.0], [0.0] * 6]))
    assert found[0, 1:].tolist() == pytest.approx([math.tanh(0.5), math.tanh(0.05)], abs=1e-6)


def test_weights_are_the_same_on_every_machine() -> None:
    functions = ["gaussian", "sine", "absolute", "tanh", "sigmoid", "linear"]
    subject = network(8, 2, max_nodes=12, activations=functions, add_node=0.5, length=True, leo=True)
    genome = subject.initial(Stream(1, "x"))
    for index in range(40):
        genome = subject.mutate(genome, Stream(2, "x", 0, index), severity=0.5, probability=0.5)
    assert genome[0] == 12
    weights = subject.weights(genome[np.newaxis])
    assert len({*weights[0].tolist()}) > 40
    assert (
        sha256(weights.tobytes()).hexdigest()
        == "7d5cb2d65174806f3d381ef33e8fe6a7865db9a2969733ebce6653cd4b6a7447"
    )


def test_controllers_are_layered_networks() -> None:
    subject = network(4, 1, hidden=[[3, 2]], activation="sigmoid")
    specification = subject.specification(subject.initial(Stream(1, "x")))
    assert specification["kind"] == "layered"
    assert (specification["hidden"], specification["output_range"]) == ([6], [0.0, 1.0])
    assert Controller(specification)(np.ones(4)).shape == (1,)


def test_a_large_population_is_decoded_in_parts() -> None:
    subject = network(30, 4, hidden=[[10, 4]])
    genomes = np.stack([subject.initial(Stream(1, "x", 0, index)) for index in range(9)])
    alone = [subject.weights(genome[None])[0].tolist() for genome in genomes]
    assert subject.weights(genomes).tolist() == alone


@pytest.mark.parametrize(
    ("options", "answer"),
    [
        ({"sensor_positions": [[0, 0]]}, r"controller.sensor_positions: has 1 positions for 3 sensor\(s\)"),
        ({"actuator_positions": [[0, 0]] * 3}, r"controller.actuator_positions: has 3 positions for 2"),
        ({"hidden": [[100, 100], [100, 100]]}, "controller.hidden: makes 1000.* weights, but at most"),
        ({"max_connections": 27}, "is 27, but networks start with 28 connections from 6 coordinates"),
    ],
)
def test_options_that_do_not_fit(options: dict[str, Any], answer: str) -> None:
    with pytest.raises(InputError, match=answer):
        network(**options)


def experiment(**values: Any) -> Experiment:
    method = {"kind": "neat", "population": 12, "generations": 4}
    values = {
        "simulation": "emergency_exit",
        "servers": "local",
        "controller": {"kind": "hyperneat"},
        "method": method,
        **values,
    }
    return Experiment.from_mapping({"seed": 1, **values})


def test_positions_follow_from_the_robot() -> None:
    options = experiment(simulation="arena", parameters={"robot": "foot-bot"}).controller
    assert isinstance(options, HyperneatOptions)
    assert options.sensor_positions is not None
    assert options.sensor_positions[:2] == [[1.0, 0.0], [0.9659, 0.2588]]
    assert options.actuator_positions == [[0.0, 1.0], [0.0, -1.0]]
    given = {"kind": "hyperneat", "actuator_positions": [[1, 0], [0, 0]]}
    assert vars(experiment(controller=given).controller)["actuator_positions"] == [[1, 0], [0, 0]]


def test_neat_and_others_evolve_it(tmp_path: Any) -> None:
    run = optimize(experiment(), out=tmp_path / "run")
    assert run.best.controller.specification["kind"] == "layered"
    changes = {"start_from": str(tmp_path / "run"), "method": {"kind": "nnga", "generations": 2}}
    further = run.experiment.replace(**changes)
    assert optimize(further, out=tmp_path / "further").best.fitness >= run.best.fitness
    with pytest.raises(InputError, match="cma_es"):
        experiment(method={"kind": "cma_es", "generations": 2})
