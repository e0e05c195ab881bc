"""Networks of a FREVO result file."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmwright.frevo._document import MACHINE, Session, java_number
from swarmwright.frevo._mapping import check_deterministic, take_activation
from swarmwright.frevo._xml import Element
from swarmwright.representations._base import shortest

_NETWORK = "FullyMeshedNet"
_MOST_NODES = 10_000


@dataclass(frozen=True)
class Network:
    """A network, and the fitness that FREVO gave it.

    specification: as `swarmwright.Controller` takes it.
    """

    fitness: float
    specification: dict[str, Any]


def networks(session: Session) -> list[Network]:
    """Return every network of every population, in the file's order.

    Raises InputError when the file holds none, or one that cannot be read.
    """
    found = session.root.all("populations")
    if not found:
        raise session.root.error(
            "no <populations> inside: a session, no result; give the .zre file that FREVO wrote when it ran"
        )
    if session.representation.class_name == MACHINE:
        raise session.representation.element.error(
            f"machines of {MACHINE} cannot be scored again: FREVO looks their rows up in another way"
        )
    check_deterministic(session.representation)
    iterations = session.representation.take_integer("iterations", 2, 1)
    activation = take_activation(session.representation)
    result = []
    for populations in found:
        for population in populations.all("population"):
            for element in population.children:
                if element.tag != _NETWORK:
                    raise element.error(f"cannot be scored; what can be is <{_NETWORK}>")
                result.append(_network(element, iterations, activation))
    if not result:
        raise found[0].error("no networks inside")
    return result


def _network(element: Element, iterations: int, activation: str) -> Network:
    sensors, actuators, nodes = (_count(element, key) for key in ("input_nodes", "output_nodes", "nodes"))
    if sensors < 1 or actuators < 1 or nodes < sensors + actuators:
        raise element.error(
            f"input_nodes {sensors} and output_nodes {actuators} found among {nodes} nodes; expected at "
            "least one of each, and no more than there are nodes"
        )
    if element.attributes.get("random_source", "false") != "false":
        raise element.error("random_source is true: controllers here draw no random numbers")
    named = element.attributes.get("activation_function")
    session_name = {"clamp": "LINEAR", "sigmoid": "SIGMOID"}[activation]
    if named is not None and named != session_name:
        raise element.error(f"activation_function {named} found, where the session has {session_name}")
    numbers = []
    by_number = _by(element.one("nodes"), "node", "nr")
    for number in range(sensors, nodes):
        node = by_number.get(str(number))
        if node is None:
            raise element.error(f"the node {number} is missing; expected 0 to {nodes - 1}")
        numbers.append(_number(node.one("bias")))
        weights = node.one("weights")
        by_source = _by(weights, "weight", "from")
        if len(by_source) != nodes:
            raise weights.error(f"{len(by_source)} weights found, expected {nodes}, one from every node")
        for source in range(nodes):
            if str(source) not in by_source:
                raise weights.error(f"the weight from {source} is missing")
            numbers.append(_number(by_source[str(source)]))
    fitness = java_number(element.attribute("fitness"))
    if fitness is None:
        raise element.error(f"fitness {element.attribute('fitness')!r} found, expected a finite number")
    specification = {
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
    return Network(fitness, specification)


def _count(element: Element, name: str) -> int:
    text = element.attribute(name)
    if not text.isascii() or not text.isdigit() or int(text[:9]) > _MOST_NODES:
        raise element.error(f"{name} {text[:40]!r} found, expected a whole number of at most {_MOST_NODES}")
    return int(text)


def _by(parent: Element, tag: str, name: str) -> dict[str, Element]:
    """Return the elements of this name by one of their attributes."""
    result: dict[str, Element] = {}
    for element in parent.all(tag):
        key = element.attribute(name)
        if key in result:
            raise element.error(f"{name}={key!r} stands twice (first in line {result[key].line})")
        result[key] = element
    return result


def _number(element: Element) -> float:
    value = java_number(element.text)
    if value is None or not np.isfinite(_single(value)):
        raise element.error(f"{element.text.strip()[:40]!r} found, expected a finite number")
    return value


def _single(value: float) -> np.float32:
    with np.errstate(over="ignore"):
        return np.float32(value)
