"""Networks of FREVO's NEAT: genes for nodes and for connections."""

from typing import Any

import numpy as np

from swarmwright.common.arrays import shortest
from swarmwright.common.xml import Element
from swarmwright.interop.frevo._document import attribute_count, attribute_number, members

TAG = "NEAT"
"""Of a network in a file."""
ITERATIONS = 3
"""How often FREVO computes all nodes in a step."""
_HIDDEN, _OUTPUT, _INPUT = 0, 1, 2


def neat_network(element: Element) -> dict[str, Any]:
    """Return the specification of a network.

    FREVO subtracts biases, and multiplies sums by the sigmoid's factor where it falls: both get the other
    sign. Weights are rounded from binary64 to binary32. Connections that are disabled are left out. A node
    that is there twice has all its connections at the first one, and FREVO reads nothing from the second.

    Raises InputError for genes that do not make a network.
    """
    nodes, links = _genes(element)
    sensors, hidden, outputs = _by_type(element, nodes)
    computed = hidden + outputs
    places = {number: place for place, number in enumerate([*range(1, sensors + 1), *computed])}
    sources: dict[int, list[int]] = {number: [] for number in computed}
    weights: dict[int, list[float]] = {number: [] for number in computed}
    for link in links:
        if link.attribute("enabled") != "true":
            continue
        start, end = (_known(link, name, places) for name in ("fromID", "toID"))
        if end in sources:  # what a sensor would see has no effect
            sources[end].append(places[start])
            weights[end].append(attribute_number(link, "weight"))
    numbers: list[float] = []
    for number in computed:
        numbers += [-attribute_number(nodes[number], "bias"), *weights[number]]
        if number in outputs:
            numbers.append(-attribute_number(nodes[number], "sigmoidfactor"))
    return {
        "version": 1,
        "kind": "neat",
        "sensors": sensors,
        "actuators": len(outputs),
        "sources": list(sources.values()),
        "iterations": ITERATIONS,
        "weights": shortest(np.array(numbers, dtype=np.float32)),
    }


def _genes(element: Element) -> tuple[dict[int, Element], list[Element]]:
    """Return the nodes by id, and the connections."""
    nodes: dict[int, Element] = {}
    links: list[Element] = []
    for gene in element.one("genes").children:
        if gene.tag == "NEATNodeGene":
            nodes.setdefault(attribute_count(gene, "id"), gene)
        elif gene.tag == "NEATlinkGene":
            links.append(gene)
        elif gene.tag != "NEATFeatureGene":
            raise gene.error("found among the genes; expected <NEATNodeGene> or <NEATlinkGene>")
    return nodes, links


def _by_type(element: Element, nodes: dict[int, Element]) -> tuple[int, list[int], list[int]]:
    """Return how many sensors there are, and the ids of hidden nodes and of outputs."""
    sensors, actuators = (attribute_count(element, name) for name in ("input_nodes", "output_nodes"))
    by_type: dict[int, list[int]] = {_HIDDEN: [], _OUTPUT: [], _INPUT: []}
    for number, gene in nodes.items():
        by_type.get(attribute_count(gene, "type"), by_type[_HIDDEN]).append(number)
    if sensors < 1 or sorted(by_type[_INPUT]) != list(range(1, sensors + 1)):
        raise element.error(
            f"input_nodes {sensors}, whose ids must be 1 to {sensors}, are not so among the genes"
        )
    outputs = by_type[_OUTPUT]
    if actuators < 1 or len(outputs) != actuators:
        raise element.error(
            f"output_nodes {actuators} found, but {len(outputs)} among the genes; expected as many, at "
            "least one"
        )
    return sensors, by_type[_HIDDEN], outputs


def best_sources(root: Element) -> list[list[int]] | None:
    """Return what the nodes of the best network of a result file see; None for a session."""
    found = [element for element in members(root) if element.tag == TAG]
    if not found:
        return None
    best = max(found, key=lambda element: attribute_number(element, "fitness"))
    sources: list[list[int]] = neat_network(best)["sources"]
    return sources


def _known(link: Element, name: str, places: dict[int, int]) -> int:
    number = attribute_count(link, name)
    if number not in places:
        raise link.error(f"{name} {number} found, but there is no node with this id")
    return number
