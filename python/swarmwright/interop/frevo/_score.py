"""The evaluation of the networks of FREVO's result files."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright import _engine
from swarmwright.common.arguments import check_arguments
from swarmwright.common.arrays import shortest
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.files import first_character
from swarmwright.common.xml import Element
from swarmwright.interop.frevo._document import (
    COMPLETE,
    HEBBIAN,
    LAYERS,
    MACHINE,
    MESHED,
    NEAT,
    THREE_LAYERS,
    Section,
    Session,
    check,
    is_single,
    iterate_members,
    open_session,
    parse_java_number,
    read_count,
    read_number,
    run_all,
)
from swarmwright.interop.frevo._mapping import convert_problem
from swarmwright.interop.frevo._representations import (
    RELU,
    SIGMOID,
    TAG,
    check_deterministic,
    read_neat,
    take_activation,
    take_passes,
)

_TAGS = {
    MESHED: "FullyMeshedNet",
    COMPLETE: "completenetwork",
    THREE_LAYERS: "ThreeLayerNetwork",
    LAYERS: "ThreeLayerNetwork",
    HEBBIAN: "hebbnet",
    NEAT: TAG,
}
"""Tag of the networks of each representation in a file."""


@dataclass(frozen=True)
class Network:
    """A network and its fitness in FREVO.

    specification: see `swarmwright.Controller`.
    """

    fitness: float
    specification: dict[str, Any]


def read_networks(session: Session) -> list[Network]:
    """Return the networks of all populations, in file order.

    Most of FREVO's methods write <populations> around each <population>; GASpecies, NoveltySearch and
    NoveltySpecies write a single <population>.

    Raises InputError if the file contains no network, or an invalid one.
    """
    root, representation = session.root, session.representation
    outer = [*root.find_all("populations"), *root.find_all("population")]
    if not outer:
        raise root.error(
            "no <populations> and no <population> inside: a session, no result; give the .zre file that "
            "FREVO wrote during the run"
        )
    if representation.class_name == MACHINE:
        raise representation.element.error(
            f"machines of {MACHINE} cannot be scored again, because FREVO selects their rows differently"
        )
    read = _select_reader(representation)
    tag = _TAGS[representation.class_name]
    result = []
    for element in iterate_members(root):
        if element.tag != tag:
            raise element.error(f"cannot be scored; expected <{tag}> of {representation.class_name}")
        fitness = parse_java_number(element.attribute("fitness"))
        if fitness is None:
            raise element.error(f"fitness {element.attribute('fitness')!r} found, expected a finite number")
        result.append(Network(fitness, read(element)))
    if not result:
        raise outer[0].error("no networks inside")
    return result


def _select_reader(section: Section) -> Callable[[Element], dict[str, Any]]:
    """Return a function that reads the specification of a network of this representation."""
    if section.class_name == THREE_LAYERS:
        return _read_three_layers
    if section.class_name == LAYERS:
        return _read_layers
    if section.class_name == NEAT:
        return read_neat
    if section.class_name == HEBBIAN:
        passes = take_passes(section)
        return lambda element: _read_hebbian(element, passes)
    check_deterministic(section)
    complete = section.class_name == COMPLETE
    iterations = section.take_integer("stepNumber" if complete else "iterations", 2, 1)
    activation = "clamp" if complete else take_activation(section)
    return lambda element: _read_meshed(element, iterations, activation)


def _read_meshed(element: Element, iterations: int, activation: str) -> dict[str, Any]:
    sensors, actuators, nodes = _read_sizes(element)
    if element.attributes.get("random_source", "false") != "false":
        raise element.error("random_source is true, but controllers of Swarmwright draw no random numbers")
    function = element.attributes.get("activation_function")
    expected = {"clamp": "LINEAR", "sigmoid": "SIGMOID", "relu": "RELU"}[activation]
    if function is not None and function != expected:
        raise element.error(f"activation_function {function} found, but the session has {expected}")
    numbers = []
    for node in _iterate_nodes(element, range(sensors, nodes), nodes):
        numbers += _read_genes(node, nodes, range(nodes))
    return {
        "version": 1,
        "kind": "fully_meshed",
        "sensors": sensors,
        "actuators": actuators,
        "hidden": nodes - sensors - actuators,
        "activation": activation,
        "iterations": iterations,
        "output_range": [0, 1],
        "weights": shortest(np.array(numbers, dtype=np.float32)),
    }


def _read_hebbian(element: Element, iterations: int) -> dict[str, Any]:
    """Read a network that learns, without the plasticity of its weights, which FREVO does not use."""
    sensors, actuators, nodes = _read_sizes(element)
    numbers = [read_number(element, "learningrate")]
    for node in _iterate_nodes(element, range(sensors, nodes), nodes):
        numbers += _read_genes(node, nodes, range(nodes))
    return {
        "version": 1,
        "kind": "hebbian",
        "sensors": sensors,
        "actuators": actuators,
        "hidden": nodes - sensors - actuators,
        "iterations": iterations,
        "weights": shortest(np.array(numbers, dtype=np.float32)),
    }


def _read_three_layers(element: Element) -> dict[str, Any]:
    """Read a network whose nodes store a weight from every node; only those from the previous layer count."""
    sensors, actuators, nodes = _read_sizes(element)
    hidden = nodes - sensors - actuators
    if hidden < 1:
        raise element.error("has no hidden nodes, so its outputs would be constant")
    numbers = []
    layers = (
        (sensors, nodes - actuators, range(sensors)),
        (nodes - actuators, nodes, range(sensors, nodes - actuators)),
    )
    for start, end, previous in layers:
        for node in _iterate_nodes(element, range(start, end), nodes):
            numbers += _read_genes(node, nodes, previous)
    return _specify_layered(sensors, [hidden], actuators, numbers)


def _read_layers(element: Element) -> dict[str, Any]:
    sensors, actuators, nodes = _read_sizes(element)
    layers, size = (read_count(element, key) for key in ("hidden_layers", "nodes_per_layer"))
    if layers < 1 or size < 1 or nodes != sensors + layers * size + actuators:
        raise element.error(
            f"nodes {nodes} found, expected input_nodes + hidden_layers x nodes_per_layer + output_nodes, "
            f"{sensors} + {layers} x {size} + {actuators}, with at least one hidden node"
        )
    by_layer = _index_by_attribute(element.find_one("hidden_nodes"), "layer", "lr")
    numbers = []
    previous = sensors
    for layer in range(layers):
        elements = by_layer.get(str(layer))
        if elements is None:
            raise element.error(f"the layer {layer} is missing; expected 0 to {layers - 1}")
        for node in _find_nodes(elements, range(size), size):
            numbers += _read_genes(node, previous, range(previous))
        previous = size
    for node in _find_nodes(element.find_one("output_nodes"), range(actuators), actuators):
        numbers += _read_genes(node, previous, range(previous))
    return _specify_layered(sensors, [size] * layers, actuators, numbers)


def _specify_layered(sensors: int, hidden: list[int], actuators: int, numbers: list[float]) -> dict[str, Any]:
    return {
        "version": 1,
        "kind": "layered",
        "sensors": sensors,
        "actuators": actuators,
        "hidden": hidden,
        "activation": "sigmoid",
        "output_range": [0, 1],
        "weights": shortest(np.array(numbers, dtype=np.float32)),
    }


def _read_sizes(element: Element) -> tuple[int, int, int]:
    """Return the numbers of inputs, outputs and all nodes."""
    sensors, actuators, nodes = (read_count(element, key) for key in ("input_nodes", "output_nodes", "nodes"))
    if sensors < 1 or actuators < 1 or nodes < sensors + actuators:
        raise element.error(
            f"input_nodes {sensors} and output_nodes {actuators} found among {nodes} nodes; expected at "
            "least one of each, and no more than all nodes"
        )
    return sensors, actuators, nodes


def _iterate_nodes(element: Element, numbers: range, count: int) -> Iterator[Element]:
    yield from _find_nodes(element.find_one("nodes"), numbers, count, element)


def _find_nodes(
    parent: Element, numbers: range, count: int, error_element: Element | None = None
) -> Iterator[Element]:
    """Yield the nodes with these numbers."""
    by_number = _index_by_attribute(parent, "node", "nr")
    for number in numbers:
        node = by_number.get(str(number))
        if node is None:
            raise (error_element or parent).error(f"the node {number} is missing; expected 0 to {count - 1}")
        yield node


def _read_genes(node: Element, count: int, selection: range) -> list[float]:
    """Return the bias of a node and its weights from a selection of `count` nodes."""
    weights = node.find_one("weights")
    by_source = _index_by_attribute(weights, "weight", "from")
    if len(by_source) != count:
        raise weights.error(f"{len(by_source)} weights found, expected {count}, one from every node")
    for source in range(count):
        if str(source) not in by_source:
            raise weights.error(f"the weight from {source} is missing")
    return [
        _parse_number(node.find_one("bias")),
        *(_parse_number(by_source[str(source)]) for source in selection),
    ]


def _index_by_attribute(parent: Element, tag: str, name: str) -> dict[str, Element]:
    """Return the elements with this tag by the value of an attribute."""
    result: dict[str, Element] = {}
    for element in parent.find_all(tag):
        key = element.attribute(name)
        if key in result:
            raise element.error(f"duplicate {name}={key!r} (first in line {result[key].line})")
        result[key] = element
    return result


def _parse_number(element: Element) -> float:
    value = parse_java_number(element.text)
    if value is None or not is_single(value):
        raise element.error(f"{element.text.strip()[:40]!r} found, expected a finite number")
    return value


_MOST_EPISODES = 100_000
"""Largest number of episodes, as in experiments."""
_NEAT = (
    "NEAT: in FREVO, children share their genes with their parents, and mutations change both: a network in "
    "the file may differ from the network with this fitness. Weights are rounded to 32 bits"
)


@dataclass(frozen=True)
class Score:
    """A candidate: its index in the file, its fitness in Swarmwright, and its fitness in FREVO.

    specification: its network, see `swarmwright.Controller`.
    """

    index: int
    fitness: float
    frevo: float
    specification: dict[str, Any] = field(repr=False)

    @property
    def difference(self) -> float:
        """The absolute difference between both fitness values."""
        return abs(self.fitness - self.frevo)


@dataclass(frozen=True)
class Scores:
    """All candidates of a result file, in file order. notes: why they may differ from FREVO's."""

    candidates: tuple[Score, ...]
    notes: tuple[str, ...]

    def __iter__(self) -> Iterator[Score]:
        return iter(self.candidates)

    def __len__(self) -> int:
        return len(self.candidates)

    @property
    def best(self) -> Score:
        """The candidate with the highest fitness in Swarmwright; the first of several."""
        return max(self.candidates, key=lambda candidate: candidate.fitness)

    @property
    def max_difference(self) -> float:
        """The largest difference from FREVO's fitness."""
        return max(candidate.difference for candidate in self.candidates)


@check_arguments
def score(path: str | PathLike[str], *, field: str | PathLike[str] | None = None) -> Scores:
    """Evaluate all candidates of a FREVO result file (.zre) again, in this process.

    Method and ranking of the file are not used and need no counterpart.

    Args:
        path: the file.
        field: see `load`.

    Raises:
        InputError: the file is not a FREVO result, or its problem or representation has no counterpart in
            Swarmwright; the message names file, line and element.
    """
    if first_character(Path(path)) not in ("<", ""):
        raise InputError(
            f"{path}: is not a result of FREVO (.zre), which is XML; evaluate a controller with "
            "`swarmwright evaluate EXPERIMENT --controller FILE --episodes N`"
        )
    session = open_session(Path(path))
    run_all(
        lambda: check(session.problem, replaceable=False),
        lambda: check(session.representation, replaceable=False),
    )
    networks = read_networks(session)
    lines, field_file, ranking, notes = convert_problem(session, None if field is None else Path(field))
    parameters = {line.key: line.value for line in lines}
    if field_file is not None:
        parameters["field"] = field_file.value
    notes += _describe_differences(session.representation)
    first: int = parameters.pop("seed", 0)
    episodes = next(line.value for line in ranking if line.key == "episodes")
    if episodes > _MOST_EPISODES:
        raise session.problem.error(
            "NumberofEvaluations", f"{episodes} found, expected a whole number of at most {_MOST_EPISODES}"
        )
    results = np.empty((len(networks), episodes))
    try:
        with engine_errors():
            seeds = range(first, first + episodes)
            for architecture, indices in _group_by_architecture(networks):
                weights = [networks[index].specification["weights"] for index in indices]
                genomes = np.array(weights, dtype=np.float32)
                results[indices], _ = _engine.evaluate(
                    "emergency_exit", parameters, architecture, genomes, seeds
                )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    # Add in sequence, like FREVO: sum() rounds differently.
    totals = np.add.accumulate(results, axis=1)[:, -1] + 0.0
    pairs = zip(totals.tolist(), networks, strict=True)
    scores = tuple(
        Score(index, total, network.fitness, network.specification)
        for index, (total, network) in enumerate(pairs)
    )
    return Scores(scores, tuple(notes))


def _describe_differences(representation: Section) -> list[str]:
    """Return reasons for which networks may behave differently than in FREVO."""
    if representation.class_name in (THREE_LAYERS, LAYERS):
        return [f"{representation.class_name}: its sigmoid is {SIGMOID}"]
    if representation.class_name == NEAT:
        return [_NEAT]
    activation = representation.take_text("activationFunction", "LINEAR")
    return {
        "SIGMOID": [f"activationFunction = SIGMOID: {SIGMOID}"],
        "RELU": [f"activationFunction = {RELU}"],
    }.get(activation, [])


def _group_by_architecture(networks: Sequence[Network]) -> Iterable[tuple[dict[str, Any], list[int]]]:
    """Return the specifications without weights, each with the indices of its networks."""
    groups: dict[str, tuple[dict[str, Any], list[int]]] = {}
    for index, network in enumerate(networks):
        common = {key: value for key, value in network.specification.items() if key != "weights"}
        groups.setdefault(json.dumps(common), (common, []))[1].append(index)
    return groups.values()
