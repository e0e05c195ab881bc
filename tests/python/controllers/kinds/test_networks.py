"""Both network representations: their layout and FREVO's genetic operators."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError

from swarmwright import Controller, Experiment, InputError, _engine
from swarmwright.common.arrays import Genome
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.controllers.kinds import describe_controller
from swarmwright.controllers.kinds.layered import Layered, LayeredOptions
from swarmwright.controllers.networks import NodeNetwork

KINDS = ["layered", "fully_meshed"]
SIZES = st.integers(1, 6)
SEEDS = st.integers(0, 2**63)


def network(kind: str, sensors: int = 4, actuators: int = 1, **options: Any) -> NodeNetwork:
    component = REPRESENTATIONS.get(kind)
    made = component(component.options_model(**options), sensors=sensors, actuators=actuators)
    assert isinstance(made, NodeNetwork)
    return made


def starts(subject: NodeNetwork) -> NDArray[np.intp]:
    """Where each node begins, and the end of the last one."""
    return np.cumsum([0, *(size + 1 for size in subject.node_sizes())])


def ranges(subject: NodeNetwork) -> NDArray[np.float64]:
    """The range of each gene."""
    result = np.full(subject.genome_size, subject.options.weight_range)
    result[starts(subject)[:-1]] = subject.options.bias_range
    return result


def mutant(
    subject: NodeNetwork, genome: Genome, stream: Stream, severity: float, probability: float
) -> Genome:
    """The mutation as it is described, in NumPy."""
    chosen = stream.unit(subject.genome_size) < probability
    if subject.options.mutation == "uniform":
        border = ranges(subject) * severity
    else:
        border = np.maximum(np.abs(genome.astype(np.float64)) * 0.2, 0.1)
    moved = genome.astype(np.float64) + stream.uniform(border)
    return np.where(chosen, moved, genome).astype(np.float32)


def child(subject: NodeNetwork, mother: Genome, father: Genome, stream: Stream) -> Genome:
    """The crossover as it is described, in NumPy."""
    begins = starts(subject) if len(subject.node_sizes()) > 1 else np.arange(subject.genome_size + 1)
    units = len(begins) - 1
    count = stream.integer(units - 1) + 1
    first = stream.integer(units)
    cut = slice(begins[first], begins[min(first + count, units)])
    result = mother.copy()
    result[cut] = father[cut]
    return result


@pytest.mark.parametrize("mutation", ["uniform", "proportional"])
@pytest.mark.parametrize("kind", KINDS)
@given(SIZES, SIZES, SEEDS, st.floats(0, 2), st.sampled_from([0.0, 0.1, 0.9, 1.0]))
def test_operators_do_what_is_described_to_the_last_bit(
    kind: str, mutation: str, sensors: int, actuators: int, seed: int, severity: float, probability: float
) -> None:
    subject = network(kind, sensors, actuators, mutation=mutation, weight_range=0.5, bias_range=3.0)
    mother, father = (subject.initial(Stream(seed, name)) for name in ("mother", "father"))
    drawn = Stream(seed, "mother").uniform(ranges(subject)).astype(np.float32)
    assert mother.tobytes() == drawn.tobytes()
    one, other = Stream(seed, "mutate"), Stream(seed, "mutate")
    found = subject.mutate(mother, one, severity=severity, probability=probability)
    assert found.tobytes() == mutant(subject, mother, other, severity, probability).tobytes()
    assert one.raw(2).tolist() == other.raw(2).tolist()
    found = subject.crossover(mother, father, Stream(seed, "x"))
    assert found.tobytes() == child(subject, mother, father, Stream(seed, "x")).tobytes()


@pytest.mark.parametrize(
    ("hidden", "sensors", "actuators", "size"),
    [([8], 4, 1, 8 * 5 + 9), ([], 4, 1, 5), ([3, 2], 4, 2, 3 * 5 + 2 * 4 + 2 * 3), ([1], 1, 1, 4)],
)
def test_genome_sizes_of_layered_networks(hidden: list[int], sensors: int, actuators: int, size: int) -> None:
    assert network("layered", sensors, actuators, hidden=hidden).genome_size == size


@pytest.mark.parametrize(
    ("hidden", "sensors", "actuators", "size"), [(2, 10, 2, 4 * 15), (0, 4, 1, 6), (2, 4, 1, 3 * 8)]
)
def test_genome_sizes_of_fully_meshed_networks(hidden: int, sensors: int, actuators: int, size: int) -> None:
    # FREVO: each of hidden + outputs has a bias and a weight from every node.
    assert network("fully_meshed", sensors, actuators, hidden=hidden).genome_size == size


def test_specifications_hold_the_genes_in_order_as_shortest_decimals() -> None:
    genome = np.array([0.1, -2, 1e-7, 0.33, 1 / 3], dtype=np.float32)
    assert network("layered", hidden=[]).specification(genome) == {
        "version": 1,
        "kind": "layered",
        "sensors": 4,
        "actuators": 1,
        "hidden": [],
        "activation": "tanh",
        "output_range": [-1.0, 1.0],
        "weights": [0.1, -2.0, 1e-7, 0.33, 0.33333334],
    }


@given(st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), min_size=6, max_size=6))
def test_decimals_read_back_as_the_same_binary32(genes: list[float]) -> None:
    genome = np.array(genes, dtype=np.float32)
    subject = network("fully_meshed", hidden=0)
    weights = subject.specification(genome)["weights"]
    assert np.array(weights, dtype=np.float32).tobytes() == genome.tobytes()


@pytest.mark.parametrize("activation", ["clamp", "sigmoid"])
@pytest.mark.parametrize("kind", KINDS)
def test_outputs_from_zero_to_one_are_declared(kind: str, activation: str) -> None:
    subject = network(kind, activation=activation)
    assert subject.specification(subject.initial(Stream(1, "x")))["output_range"] == [0.0, 1.0]


@pytest.mark.parametrize("kind", KINDS)
def test_the_range_of_outputs_can_be_given(kind: str) -> None:
    subject = network(kind, sensors=1, activation="relu", hidden=0 if kind == "fully_meshed" else [])
    ranged = network(
        kind, sensors=1, activation="relu", hidden=subject.options.model_dump()["hidden"], output_range=[0, 4]
    )
    # A bias of 1 and no weights: the output is 1.
    genome = np.zeros(subject.genome_size, dtype=np.float32)
    genome[0] = 1
    outputs = [Controller(each.specification(genome))([[0.5]]).tolist() for each in (subject, ranged)]
    assert outputs == [[[1.0]], [[-0.5]]]


def test_an_activation_of_the_outputs() -> None:
    """They are not limited by tanh, and their default range is that of their own activation."""
    genome = np.array([0.0, 100.0, 0.25, 0.5], np.float32)  # tanh(100 s) = 1, then 0.25 + 0.5
    outputs = {
        output: network("layered", 1, hidden=[1], output_activation=output).specification(genome)
        for output in (None, "linear", "sigmoid")
    }
    assert {name: each["output_range"] for name, each in outputs.items()} == {
        None: [-1, 1],
        "linear": [-1, 1],
        "sigmoid": [0, 1],
    }
    assert "output_activation" not in outputs[None]
    found = {name: Controller(each)([[1.0]]).item() for name, each in outputs.items()}
    assert found["linear"] == 0.75
    assert found[None] == pytest.approx(np.tanh(0.75))
    assert found["sigmoid"] == pytest.approx(np.tanh(0.75 / 2))
    assert describe_controller(outputs["linear"]) == "layered, 1-1-1, tanh, linear outputs"


@pytest.mark.parametrize("value", [[1, 0], [0.5, 0.5], [0, 1e39], [0]])
def test_a_range_of_outputs_that_is_none(value: list[float]) -> None:
    with pytest.raises(ValidationError, match="output_range"):
        LayeredOptions(output_range=value)


@pytest.mark.parametrize("kind", KINDS)
@given(SIZES, SIZES, SEEDS)
def test_initial_genes_fill_their_own_ranges(kind: str, sensors: int, actuators: int, seed: int) -> None:
    subject = network(kind, sensors, actuators, weight_range=0.5, bias_range=3.0)
    genome = subject.initial(Stream(seed, "initial"))
    biases = np.zeros(subject.genome_size, dtype=bool)
    biases[starts(subject)[:-1]] = True
    assert (np.abs(genome[~biases]) <= 0.5).all()
    assert (np.abs(genome[biases]) <= 3.0).all()


@pytest.mark.parametrize("kind", KINDS)
@given(seed=SEEDS, severity=st.floats(0, 2), probability=st.floats(0, 1))
def test_mutation_moves_each_gene_within_severity(
    kind: str, seed: int, severity: float, probability: float
) -> None:
    subject = network(kind, weight_range=0.5, bias_range=3.0)
    genome = subject.initial(Stream(seed, "initial"))
    moved = subject.mutate(genome, Stream(seed, "mutate"), severity=severity, probability=probability)
    # The last bits: the sum is rounded to binary32.
    border = ranges(subject) * severity + 1e-6
    assert (np.abs(moved.astype(np.float64) - genome) <= border).all()


def test_mutation_changes_the_share_of_genes_that_probability_says() -> None:
    subject = network("layered", hidden=[1000])
    genome = subject.initial(Stream(1, "initial"))
    moved = subject.mutate(genome, Stream(1, "mutate"), severity=0.3, probability=0.25)
    assert (moved != genome).mean() == pytest.approx(0.25, abs=0.02)


def test_proportional_mutation_goes_by_the_size_of_the_gene() -> None:
    subject = network("layered", hidden=[1000], mutation="proportional")
    genome = np.full(subject.genome_size, -50, dtype=np.float32)
    genome[::2] = 0.01
    steps = np.abs(
        subject.mutate(genome, Stream(1, "mutate"), severity=0, probability=1).astype(np.float64) - genome
    )
    assert steps[1::2].max() == pytest.approx(10, rel=0.01)
    assert steps[::2].max() == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("kind", KINDS)
@given(SIZES, SIZES, SEEDS)
def test_crossover_takes_a_run_of_whole_nodes(kind: str, sensors: int, actuators: int, seed: int) -> None:
    subject = network(kind, sensors, actuators)
    mother = np.zeros(subject.genome_size, dtype=np.float32)
    father = np.ones(subject.genome_size, dtype=np.float32)
    mixed = subject.crossover(mother, father, Stream(seed, "x"))
    nodes = [mixed[begin:end] for begin, end in pairwise(starts(subject))]
    if len(nodes) > 1:
        assert all(len(set(node.tolist())) == 1 for node in nodes)
        taken = "".join(str(int(node[0])) for node in nodes)
        # One run of ones, at least one node, never all.
        assert taken.strip("0").strip("1") == ""
        assert 1 <= taken.count("1") < len(nodes)
    else:
        assert 0 < mixed.sum() < len(mixed)


def test_distance_is_the_sum_of_absolute_differences() -> None:
    subject = network("layered", hidden=[])
    one = np.array([1, 2, 3, 4, 5], dtype=np.float32)
    assert subject.distance(one, np.zeros(5, dtype=np.float32)) == 15
    assert subject.distance(one, -one) == 30


def test_genomes_that_do_not_fit_are_refused() -> None:
    subject = network("layered", hidden=[])
    streams = Streams(1, "x", 0, [0, 1])
    genomes = np.zeros((3, 5), dtype=np.float32)
    with pytest.raises(_engine.InputError, match=r"parents: have the shape \[3, 5\], expected \[2, 5\]"):
        subject.mutations(genomes, streams, severity=1, probability=1)
    with pytest.raises(_engine.InputError, match="genome: has 3 genes, expected 5"):
        subject.mutate(genomes[0, :3], streams[0], severity=1, probability=1)
    with pytest.raises(_engine.InputError, match="genome 3 does not exist; there are 3 genomes"):
        subject.distances_among(genomes, np.array([0]), np.array([[1, 3]]))


def test_matings_follow_a_subclass_that_measures_otherwise() -> None:
    class Contrary(Layered):
        def distance(self, genome: Genome, other: Genome) -> float:
            return -float(np.abs(genome - other).sum())

    kinds = (Layered, Contrary)
    subjects = [kind(LayeredOptions(hidden=[2]), sensors=3, actuators=1) for kind in kinds]
    genomes = subjects[0].initials(Streams(1, "x", 0, range(3)))
    far = int(np.argmax(subjects[0].distances(genomes[0], genomes[1:]))) + 1
    for subject, father in zip(subjects, (far, 3 - far), strict=True):
        found = subject.matings(genomes, np.array([0]), np.array([[1, 2]]), Streams(1, "y", 0, [0]))
        child = subject.crossover(genomes[0], genomes[father], Stream(1, "y"))
        assert found[0].tobytes() == child.tobytes()


def test_matings_refuse_what_does_not_fit() -> None:
    subject = network("layered")
    genomes = subject.initials(Streams(1, "x", 0, range(3)))
    streams = Streams(1, "y", 0, [0])
    with pytest.raises(_engine.InputError, match="genome 3 does not exist; there are 3 genomes"):
        subject.matings(genomes, np.array([0]), np.array([[1, 3]]), streams)
    with pytest.raises(_engine.InputError, match="genome -1 does not exist; there are 3 genomes"):
        subject.matings(genomes, np.array([-1]), np.array([[1, 2]]), streams)
    with pytest.raises(_engine.InputError, match="at least one partner"):
        subject.matings(genomes, np.array([0]), np.empty((1, 0), dtype=np.int64), streams)
    with pytest.raises(_engine.InputError, match="a stream for each child"):
        subject.matings(genomes, np.array([0, 1]), np.array([[1], [2]]), streams)


@pytest.mark.parametrize(
    ("genome", "words"),
    [
        ([1.0], r"genome: has the shape \(1,\); expected \(5,\)"),
        (np.zeros((2, 5)), r"genome: has the shape \(2, 5\)"),
        ([np.nan] * 5, "not finite"),
        ("best", "genome: is 'best'; expected 5 numbers"),
    ],
)
def test_what_is_no_genome(genome: Any, words: str) -> None:
    values = {"simulation": "minisim", "controller": {"kind": "layered", "hidden": []}}
    representation = Experiment.from_mapping(values).representation()
    with pytest.raises(InputError, match=words):
        representation.specification(genome)
    assert representation.specification([0.5] * 5)["weights"] == [0.5] * 5  # type: ignore[arg-type]
