"""Networks of a FREVO result file."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmwright.common.arrays import shortest
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
    attribute_count,
    attribute_number,
    is_single,
    java_number,
    members,
)
from swarmwright.interop.frevo._representations import (
    TAG,
    check_deterministic,
    neat_network,
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
"""What FREVO calls the networks of each representation in a file."""


@dataclass(frozen=True)
class Network:
    """A network, and the fitness that FREVO gave it.

    specification: as `swarmwright.Controller` takes it.
    """

    fitness: float
    specification: dict[str, Any]


def networks(session: Session) -> list[Network]:
    """Return every network of every population, in the file's order.

    Most of FREVO's methods write <populations> around each <population>; GASpecies, NoveltySearch and
    NoveltySpecies write one <population> alone.

    Raises InputError when the file holds none, or one that cannot be read.
    """
    root, representation = session.root, session.representation
    outer = [*root.find_all("populations"), *root.find_all("population")]
    if not outer:
        raise root.error(
            "no <populations> and no <population> inside: a session, no result; give the .zre file that "
            "FREVO wrote when it ran"
        )
    if representation.class_name == MACHINE:
        raise representation.element.error(
            f"machines of {MACHINE} cannot be scored again: FREVO looks their rows up in another way"
        )
    read = _reader(representation)
    tag = _TAGS[representation.class_name]
    result = []
    for element in members(root):
        if element.tag != tag:
            raise element.error(f"cannot be scored; what can be is <{tag}>, of {representation.class_name}")
        fitness = java_number(element.attribute("fitness"))
        if fitness is None:
            raise element.error(f"fitness {element.attribute('fitness')!r} found, expected a finite number")
        result.append(Network(fitness, read(element)))
    if not result:
        raise outer[0].error("no networks inside")
    return result


def _reader(section: Section) -> Callable[[Element], dict[str, Any]]:
    """Return what makes a specification of a network of this representation."""
    if section.class_name == THREE_LAYERS:
        return _three_layers
    if section.class_name == LAYERS:
        return _layers
    if section.class_name == NEAT:
        return neat_network
    if section.class_name == HEBBIAN:
        passes = take_passes(section)
        return lambda element: _hebbian(element, passes)
    check_deterministic(section)
    complete = section.class_name == COMPLETE
    iterations = section.take_integer("stepNumber" if complete else "iterations", 2, 1)
    activation = "clamp" if complete else take_activation(section)
    return lambda element: _meshed(element, iterations, activation)


def _meshed(element: Element, iterations: int, activation: str) -> dict[str, Any]:
    sensors, actuators, nodes = _sizes(element)
    if element.attributes.get("random_source", "false") != "false":
        raise element.error("random_source is true: controllers here draw no random numbers")
    named = element.attributes.get("activation_function")
    session_name = {"clamp": "LINEAR", "sigmoid": "SIGMOID", "relu": "RELU"}[activation]
    if named is not None and named != session_name:
        raise element.error(f"activation_function {named} found, where the session has {session_name}")
    numbers = []
    for node in _nodes(element, range(sensors, nodes), nodes):
        numbers += _genes(node, nodes, range(nodes))
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


def _hebbian(element: Element, iterations: int) -> dict[str, Any]:
    """Read a network that learns; the plasticity of its weights, which FREVO does not use, is left out."""
    sensors, actuators, nodes = _sizes(element)
    numbers = [attribute_number(element, "learningrate")]
    for node in _nodes(element, range(sensors, nodes), nodes):
        numbers += _genes(node, nodes, range(nodes))
    return {
        "version": 1,
        "kind": "hebbian",
        "sensors": sensors,
        "actuators": actuators,
        "hidden": nodes - sensors - actuators,
        "iterations": iterations,
        "weights": shortest(np.array(numbers, dtype=np.float32)),
    }


def _three_layers(element: Element) -> dict[str, Any]:
    """Read a network whose nodes have a weight from every node, of which those of the layer before count."""
    sensors, actuators, nodes = _sizes(element)
    hidden = nodes - sensors - actuators
    if hidden < 1:
        raise element.error("has no hidden nodes, and its outputs would be the same all the time")
    numbers = []
    layers = (
        (sensors, nodes - actuators, range(sensors)),
        (nodes - actuators, nodes, range(sensors, nodes - actuators)),
    )
    for start, end, before in layers:
        for node in _nodes(element, range(start, end), nodes):
            numbers += _genes(node, nodes, before)
    return _layered(sensors, [hidden], actuators, numbers)


def _layers(element: Element) -> dict[str, Any]:
    sensors, actuators, nodes = _sizes(element)
    layers, size = (attribute_count(element, key) for key in ("hidden_layers", "nodes_per_layer"))
    if layers < 1 or size < 1 or nodes != sensors + layers * size + actuators:
        raise element.error(
            f"nodes {nodes} found, expected input_nodes + hidden_layers x nodes_per_layer + output_nodes, "
            f"{sensors} + {layers} x {size} + {actuators}, with at least one hidden node"
        )
    by_layer = _by(element.find_one("hidden_nodes"), "layer", "lr")
    numbers = []
    before = sensors
    for layer in range(layers):
        found = by_layer.get(str(layer))
        if found is None:
            raise element.error(f"the layer {layer} is missing; expected 0 to {layers - 1}")
        for node in _numbered(found, range(size), size):
            numbers += _genes(node, before, range(before))
        before = size
    for node in _numbered(element.find_one("output_nodes"), range(actuators), actuators):
        numbers += _genes(node, before, range(before))
    return _layered(sensors, [size] * layers, actuators, numbers)


def _layered(sensors: int, hidden: list[int], actuators: int, numbers: list[float]) -> dict[str, Any]:
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


def _sizes(element: Element) -> tuple[int, int, int]:
    """Return inputs, outputs and all nodes."""
    sensors, actuators, nodes = (
        attribute_count(element, key) for key in ("input_nodes", "output_nodes", "nodes")
    )
    if sensors < 1 or actuators < 1 or nodes < sensors + actuators:
        raise element.error(
            f"input_nodes {sensors} and output_nodes {actuators} found among {nodes} nodes; expected at "
            "least one of each, and no more than there are nodes"
        )
    return sensors, actuators, nodes


def _nodes(element: Element, numbers: range, count: int) -> Iterator[Element]:
    yield from _numbered(element.find_one("nodes"), numbers, count, element)


def _numbered(
    parent: Element, numbers: range, count: int, blamed: Element | None = None
) -> Iterator[Element]:
    """Yield the nodes with these numbers."""
    by_number = _by(parent, "node", "nr")
    for number in numbers:
        node = by_number.get(str(number))
        if node is None:
            raise (blamed or parent).error(f"the node {number} is missing; expected 0 to {count - 1}")
        yield node


def _genes(node: Element, count: int, wanted: range) -> list[float]:
    """Return a node's bias and its weights from the wanted ones of `count` nodes."""
    weights = node.find_one("weights")
    by_source = _by(weights, "weight", "from")
    if len(by_source) != count:
        raise weights.error(f"{len(by_source)} weights found, expected {count}, one from every node")
    for source in range(count):
        if str(source) not in by_source:
            raise weights.error(f"the weight from {source} is missing")
    return [_number(node.find_one("bias")), *(_number(by_source[str(source)]) for source in wanted)]


def _by(parent: Element, tag: str, name: str) -> dict[str, Element]:
    """Return the elements of this name by one of their attributes."""
    result: dict[str, Element] = {}
    for element in parent.find_all(tag):
        key = element.attribute(name)
        if key in result:
            raise element.error(f"duplicate {name}={key!r} (first in line {result[key].line})")
        result[key] = element
    return result


def _number(element: Element) -> float:
    value = java_number(element.text)
    if value is None or not is_single(value):
        raise element.error(f"{element.text.strip()[:40]!r} found, expected a finite number")
    return value
