"""FREVO's representations: their entries as options of Swarmwright's controllers.

FREVO's MealyFSM as the controller mealy_fsm.

Networks of FREVO's NEAT: genes for nodes and for connections.
"""

import math
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
    members,
)
from swarmwright.interop.frevo._mapped import Line, Mapped, one_line

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
    for gene in element.find_one("genes").children:
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


_MOST_LEVELS = 1001
_DEFAULTS = {
    "min_input_values": [0, 0],
    "max_input_values": [70, 70],
    "unit_input_values": [70, 70],
    "nthresholds_for_inputs": [3, 3],
}
"""What FREVO has where an entry is left out: for two inputs, whatever the problem has."""
_FALLBACK = (0, 100, 100, 1)
"""Smallest and largest value, units and thresholds of each input where the lists do not fit their number."""
_COUNTED = 4
"""Values of an input up to which it has no thresholds where `nthresholds_for_inputs` does not fit."""


@dataclass(frozen=True)
class MachineOptions:
    """Options of mealy_fsm, entries of FREVO's that are not taken over, and notes for the user."""

    states: int
    levels: list[list[float]]
    output_levels: int
    not_taken: list[str]
    notes: list[str]


def take_machine(section: Section, sensors: int | None) -> MachineOptions:
    """Read every entry of a MealyFSM.

    sensors: inputs of the problem; None where that is not known and the entries say it.

    Raises InputError for one that cannot be read, or lists of another length than there are inputs.
    """
    states = section.take_integer("num_of_states", 6, 1)
    inputs, notes = _inputs(section, sensors)
    for index, (low, high, _, _) in enumerate(inputs):
        if low >= high:
            raise section.error(
                "max_input_values", f"{high} found for input {index}, expected more than the smallest, {low}"
            )
    output_units = section.take_integer("output_units", 100, 1)
    output_levels = output_units + 1 if output_units < _MOST_LEVELS else 0
    fixed = "thresholds lie evenly between smallest and largest value, and do not evolve"
    not_taken = [f"threshold_units = {section.shown('threshold_units', '100,100')}: {fixed}"]
    own_rows = "FREVO looks rows up by a product of intervals, so that several inputs share one"
    notes += [
        f"representation.nthresholds_for_inputs: {fixed}",
        f"representation.class = fsm.MealyFSM: {own_rows}; here each has its own",
    ]
    if section.take_flag("state_num_change_allowed", False):
        notes.append("representation.state_num_change_allowed = true: the number of states is fixed")
    not_taken += [
        f"{key} = {section.shown(key)}: machines begin and vary in one way"
        for key in ("state_num_change_allowed", "generation_mode", "distance_calc_method")
        if key in section.entries
    ]
    rates = [key for key in section.entries if key.startswith("mutate_")]
    if rates:
        shown = ", ".join(f"{key} = {section.shown(key)}" for key in rates)
        not_taken.append(f"{shown}: the method's severity and probability say how much is changed")
    levels = [_thresholds(*of_one) for of_one in inputs]
    return MachineOptions(states, levels, output_levels, not_taken, notes)


def _inputs(section: Section, sensors: int | None) -> tuple[list[tuple[int, int, int, int]], list[str]]:
    """Return smallest and largest value, units and thresholds of each input, and what is to be known."""
    given = {key: _numbers(section, key, sensors) for key in _DEFAULTS if key in section.entries}
    lengths = {key: len(numbers) for key, numbers in given.items()}
    count = sensors if sensors is not None else max(lengths.values(), default=2)
    for key, length in lengths.items():
        if length != count:
            raise section.error(key, f"{length} numbers found, where another list has {count}")
    lists = {key: given.get(key, default) for key, default in _DEFAULTS.items()}
    values = [lists[key] for key in _DEFAULTS if key != "nthresholds_for_inputs"]
    left_out = ", ".join(key for key in _DEFAULTS if key not in given)
    if any(len(numbers) != count for numbers in values):
        low, high, _, thresholds = _FALLBACK
        note = (
            f"representation.{left_out}: left out, and then FREVO takes every input for a number from {low} "
            f"to {high} with {thresholds} threshold; what is sensed may not reach it: see controller.levels"
        )
        return [_FALLBACK] * count, [note]
    counts = lists["nthresholds_for_inputs"]
    if len(counts) != count:  # two numbers for another number of inputs
        counts = [0 if units + 1 <= _COUNTED else counts[-1] for units in lists["unit_input_values"]]
    return list(zip(*values, counts, strict=True)), []


def _numbers(section: Section, key: str, expected: int | None) -> list[int]:
    text = section.shown(key)
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    least = 0 if key == "nthresholds_for_inputs" else -(2**24)
    right = len(numbers) == expected if expected is not None else bool(numbers)
    if not right or not all(least <= number <= 2**24 for number in numbers):
        many = "" if expected is None else f"{expected} "
        raise section.error(
            key, f"{text!r} found, expected {many}whole numbers with commas between, one for each input"
        )
    return numbers


def _thresholds(low: int, high: int, units: int, count: int) -> list[float]:
    """Return where intervals end: half below FREVO's thresholds, as whole numbers at these are above them."""
    parts, last = (count + 1, count) if count else (max(units, 1), max(units, 1))
    return sorted({math.ceil(low + (high - low) * k / parts) - 0.5 for k in range(1, last + 1)})


ACTIVATIONS = {"LINEAR": "clamp", "SIGMOID": "sigmoid", "RELU": "relu"}
"""FREVO's activation functions -> Swarmwright's."""
RELU = (
    "RELU: outputs have no upper limit in FREVO, whose agents of Emergency Exit stand still where one is "
    "above 1.25; actuators here end at 1"
)
LEARNING_RATE = (
    "representation: the learning rate of a HebbNet is mutated and crossed over; in FREVO, which rounds the "
    "range of its change to 0, it keeps what it was drawn as"
)
_TOPOLOGY = (
    "neither connections nor nodes are added. Weights, biases and slopes evolve; FREVO crosses them over, "
    "and its mutations of them have no effect"
)
_NEAT = (
    "disjoint_coeff", "excess_coeff", "weight_coeff", "recursive", "feature_selection", "max_perturbation",
    "max_bias_perturbation", "add_node_prob", "add_link_prob", "mutate_node_weight_replaced_prob",
    "mutate_link_toggle_prob", "mutate_node_sf_prob", "mutate_feature_prob", "mutate_node_bias_prob",
    "mutate_link_weight_prob",
)  # fmt: skip
"""Entries of FREVO's NEAT."""
SIGMOID = "computed to 1e-7 here, so that single steps may differ"


def map_representation(session: Session, sensors: int | None, mapped: Mapped) -> None:
    """Map every entry.

    sensors: what an agent senses, where that is known.

    Raises InputError for an entry that cannot be read or has no counterpart.
    """
    section = session.representation
    if section.class_name == MACHINE:
        _map_machine(section, sensors, mapped)
        return
    if section.class_name == NEAT:
        _map_neat(session, mapped)
        return
    if section.class_name in (MESHED, COMPLETE):
        _map_meshed(section, mapped)
    elif section.class_name == HEBBIAN:
        _map_hebbian(section, mapped)
    else:
        _map_layers(section, mapped)
    mapped.controller += [
        Line("weight_range", section.take_number("weight_range", 2.0), "weight_range"),
        Line("bias_range", section.take_number("bias_range", 2.0), "bias_range"),
    ]
    if mapped.mutation is not None:
        _map_mutation(section, mapped.mutation, mapped)


def _map_mutation(section: Section, line: Line, mapped: Mapped) -> None:
    if line.value == "proportional":
        which = "biases move" if section.class_name == MESHED else "weights and biases move"
        line = Line(line.key, line.value, f"{line.comment}; {which} by their size, not within +-10")
        mapped.notes.append(f"method.mutationMethod = 2: {which} within a fifth of their size, not +-10")
    mapped.controller.append(line)


def _map_meshed(section: Section, mapped: Mapped) -> None:
    complete = section.class_name == COMPLETE
    activation = "clamp" if complete else take_activation(section)
    comment = f"{COMPLETE} has no other" if complete else "activationFunction"
    key = "stepNumber" if complete else "iterations"
    mapped.controller += [
        Line("hidden", section.take_integer("hiddenNodes", 2, 0), "hiddenNodes"),
        Line("activation", activation, comment),
        Line("iterations", section.take_integer(key, 2, 1), key),
    ]
    if activation == "relu":
        mapped.controller.append(Line("output_range", [0, 1], "what FREVO's problem makes -1 to 1"))
        mapped.notes.append(f"representation.activationFunction = {RELU}")
    if not complete:
        _leave_out(section, mapped)


def _leave_out(section: Section, mapped: Mapped) -> None:
    check_deterministic(section)
    rate = section.take_number("mutation_rate", 0.2)
    random_range = section.take_number("random_bias_range", 0.2)
    variable = section.take_flag("variable_mutation_rate", False)
    reason = f"variable_mutation_rate = {str(variable).lower()}: mutations keep their severity"
    mapped.not_controller.append(reason)
    if variable:
        mapped.notes.append(f"representation.{reason}")
    mapped.not_controller.append(f"mutation_rate = {rate!r}: with variable_mutation_rate only")
    mapped.not_controller.append(
        f"random_source = false, random_bias_range = {random_range!r}: nothing is drawn between steps"
    )


def _map_layers(section: Section, mapped: Mapped) -> None:
    mapped.controller_kind = "layered"
    steps = 2 if section.class_name == THREE_LAYERS else 1
    if section.class_name == LAYERS:
        layers = section.take_integer("hidden_layers", 2, 1)
        sizes = [section.take_integer("nodes_per_layer", 2, 1)] * layers
        comment = "nodes_per_layer, hidden_layers times"
    else:
        sizes = [section.take_integer("hiddenNodes", 2, 1)]
        comment = "hiddenNodes"
    mapped.controller += [
        Line("hidden", sizes, comment),
        Line("activation", "sigmoid", f"{section.class_name} has no other; {SIGMOID}"),
    ]
    steps = section.take_integer("stepNumber", steps)
    mapped.not_controller.append(f"stepNumber = {steps}: without feedback every pass gives the same")


def _map_hebbian(section: Section, mapped: Mapped) -> None:
    mapped.controller_kind = "hebbian"
    mapped.controller += [
        Line("hidden", section.take_integer("hiddenNodes", 2, 0), "hiddenNodes"),
        Line("iterations", take_passes(section), "stepNumber"),
    ]
    mapped.not_controller.append("plasticity of weights: FREVO evolves it, and does not use it")
    mapped.notes.append(LEARNING_RATE)


def _map_neat(session: Session, mapped: Mapped) -> None:
    section = session.representation
    mapped.controller_kind = "neat"
    sources = best_sources(session.root)
    if sources is not None:
        mapped.controller.append(Line("sources", sources, "connections of the best network in the file"))
    mapped.controller.append(Line("iterations", ITERATIONS, "NEAT has no other"))
    if mapped.mutation is not None:
        _map_mutation(section, mapped.mutation, mapped)
    for key in _NEAT:
        if key in section.entries:
            reason = "connections, nodes and species do not evolve"
            mapped.not_controller.append(f"{key} = {one_line(section.shown(key))}: {reason}")
    which = "those of the file's best network" if sources else "from every sensor to every actuator"
    mapped.notes.append(f"representation: NEAT's connections are {which}, and stay: {_TOPOLOGY}")


def _map_machine(section: Section, sensors: int | None, mapped: Mapped) -> None:
    machine = take_machine(section, sensors)
    mapped.controller_kind = "mealy_fsm"
    leave_mutation_out(mapped)
    mapped.controller = [
        Line("states", machine.states, "num_of_states"),
        Line("levels", machine.levels, "min_input_values, max_input_values, nthresholds_for_inputs"),
        Line("output_levels", machine.output_levels, "output_units, and both ends count"),
    ]
    mapped.not_controller += machine.not_taken
    mapped.notes += machine.notes


def leave_mutation_out(mapped: Mapped) -> None:
    """Say that the way in which FREVO's method mutates networks is not taken over."""
    if mapped.mutation is not None and mapped.mutation.comment.startswith("mutationMethod"):
        mapped.not_method.append(
            f"{mapped.mutation.comment}: {mapped.controller_kind} mutates in a different way"
        )


def check_deterministic(section: Section) -> None:
    """Raise InputError when networks draw random numbers, which no controller here does."""
    if section.class_name == MESHED and section.take_flag("random_source", False):
        raise section.error(
            "random_source", "true found: controllers here draw no random numbers; set it to false in FREVO"
        )


def take_passes(section: Section) -> int:
    """Return how often the nodes of a HebbNet are computed in a step; FREVO takes less than 1 for 1."""
    return max(1, section.take_integer("stepNumber", 2))


def take_activation(section: Section) -> str:
    """Return Swarmwright's name of the activation function of a FullyMeshedNet."""
    return ACTIVATIONS[section.take_text("activationFunction", "LINEAR", tuple(ACTIVATIONS))]
