"""The networks of NEAT, fixed and growing, as a representation."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from swarmwright import Controller, InputError
from swarmwright.common.arrays import Genome
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.controllers.kinds.growing.genes import read
from swarmwright.controllers.kinds.neat import FixedNeat, FrevoNeat, GrowingNeat, NeatOptions
from swarmwright.testing import check_representation

DIRECT = [[0, 1, 2], [0, 1, 2]]


def network(**options: Any) -> FixedNeat | GrowingNeat:
    """A network of the form that experiments get."""
    component = REPRESENTATIONS.get("neat")
    subject = component(NeatOptions.model_validate(options), sensors=3, actuators=2)
    assert isinstance(subject, FixedNeat | GrowingNeat)
    return subject


def test_it_is_a_representation() -> None:
    check_representation("neat")
    check_representation("neat", {"recurrent": True, "max_nodes": 0, "weight_range": 4.0, "toggle": 1.0})
    check_representation("neat", {"frevo": True, "max_nodes": 0})
    check_representation("neat", {"frevo": True, "max_nodes": 4, "add_node": 0.2, "add_connection": 0.2})


def test_initial_ranges_of_fixed_networks() -> None:
    subject = network(sources=DIRECT)
    assert isinstance(subject, FixedNeat)
    assert subject.genome_size == 2 * (1 + 3 + 1)
    genomes = network(sources=DIRECT, weight_range=3.0, bias_range=0.5).initials(
        Streams(1, "x", 0, range(300))
    )
    reach = np.abs(genomes).max(axis=0)
    assert (reach[[0, 5]] < 0.5).all()
    assert (reach[[1, 4, 6, 9]] > 2.9).all(), "slopes are in the range of weights"


def test_each_connection_has_an_effect() -> None:
    """A hidden node sees itself, and an actuator the other one."""
    subject = network(sources=[[0, 3], [3, 1], [4, 2, 2]])
    weights = [0.1, 1.0, 0.7, 0.0, 1.5, 0.4, 2.0, -0.2, 0.8, 0.3, 0.3, -1.0]
    assert subject.genome_size == len(weights)
    readings = np.random.default_rng(1).uniform(-1, 1, (6, 3)).astype(np.float32)

    def outputs(changed: list[float]) -> list[list[float]]:
        controller = Controller(subject.specification(np.array(changed, np.float32)))
        return [controller(reading).tolist() for reading in readings]

    expected = outputs(weights)
    for place in range(len(weights)):
        changed = [weight + (index == place) * 0.25 for index, weight in enumerate(weights)]
        found = outputs(changed)
        assert found != expected
        first = [row[0] for row in found] == [row[0] for row in expected]
        assert first == (place >= 7), "the second actuator comes after the first"
    swapped = [*weights[:9], weights[10], weights[9], weights[11]]
    assert outputs(swapped) == expected, "two connections from the same node"


@pytest.mark.parametrize(
    ("sources", "answer"),
    [
        ([[0]], r"controller.sources: 1 lists for 2 actuators"),
        (
            [[0], [5], [6]],
            r"controller.sources\[2\]: node 6 does not exist; with 3 sensors the last node is 5",
        ),
    ],
)
def test_connections_that_do_not_fit(sources: list[list[int]], answer: str) -> None:
    with pytest.raises(InputError, match=answer):
        network(sources=sources)


@pytest.mark.parametrize(
    "options",
    [
        {"sources": []},
        {"sources": [[-1]]},
        {"iterations": 0},
        {"bias_range": 0},
        {"iterations": 2},
        {"recurrent": True, "sources": DIRECT},
        {"activations": []},
        {"output_activation": "step"},
        {"add_node": 1.5},
    ],
)
def test_options_that_cannot_be(options: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match=next(iter(options))):
        NeatOptions.model_validate(options)


def grown(subject: Representation, mutations: int = 40, seed: int = 1) -> Genome:
    genome = subject.initial(Stream(seed, "initial"))
    for generation in range(mutations):
        stream = Stream(seed, "mutate", generation)
        genome = subject.mutate(genome, stream, severity=0.5, probability=0.5)
    return genome


@pytest.mark.parametrize("recurrent", [False, True])
def test_networks_grow_up_to_their_limits(recurrent: bool) -> None:
    subject = network(recurrent=recurrent, max_nodes=5, max_connections=25, add_node=0.5, add_connection=0.5)
    assert isinstance(subject, GrowingNeat)
    assert subject.genome_size == 1 + 2 + 3 * 5 + 3 * 25
    first, last = (read(subject.specification(grown(subject, count))) for count in (0, 200))
    assert (first.hidden, len(first.weights)) == (0, 8)
    assert last.hidden == 5
    assert 8 < len(last.weights) <= 25
    backwards = [
        source
        for rank, node in enumerate(last.nodes)
        for source in node.sources
        if source - 4 >= rank  # three sensors and the bias come first
    ]
    assert bool(backwards) == recurrent


def test_a_controller_computes_the_nodes_in_their_order() -> None:
    """XOR, by hand."""
    options = NeatOptions(max_nodes=1, max_connections=6, output_activation="clamp", activations=["relu"])
    subject = GrowingNeat(options, sensors=2, actuators=1)
    hidden = [1.0, 3.0, 3.0]  # relu, three inputs
    connections = [0, 1, 1, 1, 1, 1, 2, -1, 1, 0, 1, 1, 1, 1, 1, 4, -2, 1]
    genome = np.array([1.0, 3.0, 77.0, *hidden[1:], *connections], np.float32)
    controller = Controller(subject.specification(genome))
    cases = [([0, 0], -1.0), ([0, 1], 1.0), ([1, 0], 1.0), ([1, 1], -1.0)]
    assert [float(controller(np.array(case, np.float32))[0]) for case, _ in cases] == [
        out for _, out in cases
    ]


def test_too_few_connections_are_refused() -> None:
    with pytest.raises(InputError, match=r"controller.max_connections: is 7, but networks start with 8 conn"):
        network(max_connections=7)
    with pytest.raises(InputError, match=r"controller.max_connections: makes \d+ genes, but at most 1000000"):
        GrowingNeat(NeatOptions(), sensors=1000, actuators=400)


def test_a_step_of_a_recurrent_network_takes_the_outputs_before() -> None:
    options = NeatOptions(max_nodes=0, max_connections=4, recurrent=True, output_activation="linear")
    subject = GrowingNeat(options, sensors=1, actuators=2)
    # The first actuator copies the sensor, the second one the first one.
    genome = np.array([0, 1, 1, 0, 1, 1, 2, 1, 1, *[0] * 6], np.float32)
    controller = Controller(subject.specification(genome))
    rows = [controller(np.array([value], np.float32)).tolist() for value in (0.5, -0.25, 0.0)]
    assert rows == [[0.5, 0.0], [-0.25, 0.5], [0.0, -0.25]]
    controller.reset()
    assert controller(np.array([1.0], np.float32)).tolist() == [1.0, 0.0]


def frevo(**options: Any) -> FrevoNeat:
    subject = network(frevo=True, **options)
    assert isinstance(subject, FrevoNeat)
    return subject


def test_frevos_networks_split_connections() -> None:
    subject = frevo(max_nodes=3, add_node=1.0)
    parent = subject.initial(Stream(1, "x"))
    assert (parent != 0).sum() == 2 * (1 + 3 + 1), "two actuators with bias, weights and slope"
    splits: dict[int, set[tuple[int, ...]]] = {}
    for index in range(50):
        child = subject.mutate(parent, Stream(2, "x", 0, index), severity=0.3, probability=1.0)
        (lost,) = np.flatnonzero((parent != 0) & (child == 0))
        added = np.flatnonzero((parent == 0) & (child != 0))
        assert sorted(child[added]) == sorted([1.0, parent[lost]])
        splits.setdefault(int(lost), set()).add(tuple(added.tolist()))
    assert len(splits) == 6
    assert all(len(nodes) == 1 for nodes in splits.values()), "the same node splits the same connection"
    grown = parent
    for index in range(3):
        grown = subject.mutate(grown, Stream(3, "x", 0, index), severity=0.3, probability=1.0)
    assert (grown != 0).sum() == (parent != 0).sum() + 3
    full = subject.mutate(grown, Stream(4, "x"), severity=0.3, probability=1.0)
    assert ((full != 0) == (grown != 0)).sum() >= len(full) - 3, "no node is left; numbers change instead"
    assert (full != grown).any()


def test_frevos_networks_connect_nodes_until_all_are_connected() -> None:
    subject = frevo(max_nodes=1, add_connection=1.0)
    genome = subject.initial(Stream(1, "x"))
    for index in range(4):
        child = subject.mutate(genome, Stream(2, "x", 0, index), severity=0.3, probability=1.0)
        assert ((child != 0) & (genome == 0)).sum() == 1
        assert ((child == genome) | (genome == 0)).all()
        genome = child
    assert not genome[: 1 + 3 + 1 + 2].any(), "the hidden node does not exist"
    moved = subject.mutate(genome, Stream(2, "x", 0, 9), severity=0.3, probability=1.0)
    assert ((moved != 0) == (genome != 0)).all()
    assert (moved != genome).sum() == (genome != 0).sum()


def test_frevos_networks_are_crossed_where_both_have_genes() -> None:
    subject = frevo(max_nodes=2, add_node=1.0, add_connection=0.0)
    mother = subject.initial(Stream(1, "x"))
    father = subject.mutate(subject.initial(Stream(2, "x")), Stream(3, "x"), severity=0.3, probability=1.0)
    both = (mother != 0) & (father != 0)
    for index in range(20):
        child = subject.crossover(mother, father, Stream(4, "x", 0, index))
        assert (child[~both] == mother[~both]).all()
    assert (child[both] != mother[both]).any()


def test_room_for_frevos_networks() -> None:
    with pytest.raises(InputError, match=r"controller.max_nodes: is 0, but sources has 1 hidden nodes"):
        frevo(max_nodes=0, sources=[[0], [3], [3]])
    with pytest.raises(ValidationError, match="recurrent is not an option of FREVO's networks"):
        frevo(recurrent=True)
