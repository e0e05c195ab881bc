"""The conversion of FREVO's representations to Swarmwright's controllers.

FREVO's MealyFSM becomes mealy_fsm. Networks of FREVO's NEAT consist of genes for nodes and for connections.
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
    Line,
    Mapped,
    Section,
    Session,
    iterate_members,
    read_count,
    read_number,
    to_single_line,
)

TAG = "NEAT"
"""Tag of a network in a file."""
ITERATIONS = 3
"""Number of times that FREVO computes all nodes in a step."""
_HIDDEN, _OUTPUT, _INPUT = 0, 1, 2


def read_neat(element: Element, *, disabled: bool = False) -> dict[str, Any]:
    """Return the specification of a network. disabled: with its disabled connections.

    FREVO subtracts biases, and multiplies sums by the factor of a falling sigmoid: both change their sign.
    Weights are rounded from binary64 to binary32. Of nodes with the same
    id, the first has all connections; FREVO ignores the others.

    Raises InputError for genes that are not a valid network.
    """
    nodes, links = _split_genes(element)
    sensors, hidden, outputs = _classify_nodes(element, nodes)
    computed = hidden + outputs
    positions = {number: position for position, number in enumerate([*range(1, sensors + 1), *computed])}
    sources: dict[int, list[int]] = {number: [] for number in computed}
    weights: dict[int, list[float]] = {number: [] for number in computed}
    for link in links:
        if link.attribute("enabled") != "true" and not disabled:
            continue
        start, end = (_find_position(link, name, positions) for name in ("fromID", "toID"))
        if end in sources:  # connections to sensors have no effect
            sources[end].append(positions[start])
            weights[end].append(read_number(link, "weight"))
    numbers: list[float] = []
    for number in computed:
        numbers += [-read_number(nodes[number], "bias"), *weights[number]]
        if number in outputs:
            numbers.append(-read_number(nodes[number], "sigmoidfactor"))
    return {
        "version": 1,
        "kind": "neat",
        "sensors": sensors,
        "actuators": len(outputs),
        "sources": list(sources.values()),
        "iterations": ITERATIONS,
        "weights": shortest(np.array(numbers, dtype=np.float32)),
    }


def _split_genes(element: Element) -> tuple[dict[int, Element], list[Element]]:
    """Return the nodes by id, and the connections."""
    nodes: dict[int, Element] = {}
    links: list[Element] = []
    for gene in element.find_one("genes").children:
        if gene.tag == "NEATNodeGene":
            nodes.setdefault(read_count(gene, "id"), gene)
        elif gene.tag == "NEATlinkGene":
            links.append(gene)
        elif gene.tag != "NEATFeatureGene":
            raise gene.error("found among the genes; expected <NEATNodeGene> or <NEATlinkGene>")
    return nodes, links


def _classify_nodes(element: Element, nodes: dict[int, Element]) -> tuple[int, list[int], list[int]]:
    """Return the number of sensors, the ids of hidden nodes, and the ids of outputs."""
    sensors, actuators = (read_count(element, name) for name in ("input_nodes", "output_nodes"))
    by_type: dict[int, list[int]] = {_HIDDEN: [], _OUTPUT: [], _INPUT: []}
    for number, gene in nodes.items():
        by_type.get(read_count(gene, "type"), by_type[_HIDDEN]).append(number)
    if sensors < 1 or sorted(by_type[_INPUT]) != list(range(1, sensors + 1)):
        raise element.error(
            f"input_nodes {sensors} found, but the ids of the input genes are not 1 to {sensors}"
        )
    outputs = by_type[_OUTPUT]
    if actuators < 1 or len(outputs) != actuators:
        raise element.error(
            f"output_nodes {actuators} found, but {len(outputs)} output genes; expected equal numbers of at "
            "least 1"
        )
    return sensors, by_type[_HIDDEN], outputs


def find_best_sources(root: Element, *, disabled: bool) -> list[list[int]] | None:
    """Return the sources of the nodes of the best network in a result file; None for a session.

    disabled: with its disabled connections, which other networks of the file may have.
    """
    candidates = [element for element in iterate_members(root) if element.tag == TAG]
    if not candidates:
        return None
    best = max(candidates, key=lambda element: read_number(element, "fitness"))
    sources: list[list[int]] = read_neat(best, disabled=disabled)["sources"]
    return sources


def _find_position(link: Element, name: str, positions: dict[int, int]) -> int:
    number = read_count(link, name)
    if number not in positions:
        raise link.error(f"{name} {number}: no node has this id")
    return number


_MOST_LEVELS = 1001
_DEFAULTS = {
    "min_input_values": [0, 0],
    "max_input_values": [70, 70],
    "unit_input_values": [70, 70],
    "nthresholds_for_inputs": [3, 3],
}
"""FREVO's defaults, which are for two inputs in all problems."""
_FALLBACK = (0, 100, 100, 1)
"""Minimum, maximum, units and thresholds of each input if the lists do not match the number of inputs."""
_COUNTED = 4
"""Largest number of values of an input without thresholds, if `nthresholds_for_inputs` does not match the
inputs."""


@dataclass(frozen=True)
class MachineOptions:
    """Options of mealy_fsm, FREVO's entries that are omitted, and notes for the user."""

    states: int
    levels: list[list[float]]
    output_levels: int
    omitted: list[str]
    notes: list[str]


def read_machine(section: Section, sensors: int | None) -> MachineOptions:
    """Read all entries of a MealyFSM.

    sensors: number of inputs of the problem; None: the number in the entries.

    Raises InputError for an invalid entry, or a list that does not match the number of inputs.
    """
    states = section.take_integer("num_of_states", 6, 1)
    inputs, notes = _read_inputs(section, sensors)
    for index, (low, high, _, _) in enumerate(inputs):
        if low >= high:
            raise section.error(
                "max_input_values", f"{high} found for input {index}, expected more than the minimum {low}"
            )
    output_units = section.take_integer("output_units", 100, 1)
    output_levels = output_units + 1 if output_units < _MOST_LEVELS else 0
    fixed = "thresholds are evenly spaced between minimum and maximum, and do not evolve"
    omitted = [f"threshold_units = {section.take_raw('threshold_units', '100,100')}: {fixed}"]
    own_rows = "FREVO selects rows by a product of intervals, so several inputs share a row"
    notes += [
        f"representation.nthresholds_for_inputs: {fixed}",
        f"representation.class = fsm.MealyFSM: {own_rows}; here each has its own row",
    ]
    if section.take_flag("state_num_change_allowed", False):
        notes.append("representation.state_num_change_allowed = true: the number of states is fixed")
    omitted += [
        f"{key} = {section.take_raw(key)}: Swarmwright has a single way to start and vary machines"
        for key in ("state_num_change_allowed", "generation_mode", "distance_calc_method")
        if key in section.entries
    ]
    rates = [key for key in section.entries if key.startswith("mutate_")]
    if rates:
        shown = ", ".join(f"{key} = {section.take_raw(key)}" for key in rates)
        omitted.append(f"{shown}: replaced by the severity and probability of the method")
    levels = [_compute_thresholds(*values) for values in inputs]
    return MachineOptions(states, levels, output_levels, omitted, notes)


def _read_inputs(section: Section, sensors: int | None) -> tuple[list[tuple[int, int, int, int]], list[str]]:
    """Return the minimum, maximum, units and thresholds of each input, and notes."""
    specified = {key: _read_numbers(section, key, sensors) for key in _DEFAULTS if key in section.entries}
    lengths = {key: len(numbers) for key, numbers in specified.items()}
    count = sensors if sensors is not None else max(lengths.values(), default=2)
    for key, length in lengths.items():
        if length != count:
            raise section.error(key, f"{length} numbers found, but another list has {count}")
    lists = {key: specified.get(key, default) for key, default in _DEFAULTS.items()}
    values = [lists[key] for key in _DEFAULTS if key != "nthresholds_for_inputs"]
    missing = ", ".join(key for key in _DEFAULTS if key not in specified)
    if any(len(numbers) != count for numbers in values):
        low, high, _, thresholds = _FALLBACK
        note = (
            f"representation.{missing}: missing, so FREVO takes every input for a number from {low} "
            f"to {high} with {thresholds} threshold, which sensors may never reach; see controller.levels"
        )
        return [_FALLBACK] * count, [note]
    counts = lists["nthresholds_for_inputs"]
    if len(counts) != count:  # the default, for another number of inputs
        counts = [0 if units + 1 <= _COUNTED else counts[-1] for units in lists["unit_input_values"]]
    return list(zip(*values, counts, strict=True)), []


def _read_numbers(section: Section, key: str, expected: int | None) -> list[int]:
    text = section.take_raw(key)
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    least = 0 if key == "nthresholds_for_inputs" else -(2**24)
    is_complete = len(numbers) == expected if expected is not None else bool(numbers)
    if not is_complete or not all(least <= number <= 2**24 for number in numbers):
        count = "" if expected is None else f"{expected} "
        raise section.error(
            key, f"{text!r} found, expected {count}whole numbers separated by commas, one for each input"
        )
    return numbers


def _compute_thresholds(low: int, high: int, units: int, count: int) -> list[float]:
    """Return the ends of intervals: 0.5 below FREVO's thresholds, which belong to the upper interval."""
    parts, last = (count + 1, count) if count else (max(units, 1), max(units, 1))
    return sorted({math.ceil(low + (high - low) * k / parts) - 0.5 for k in range(1, last + 1)})


ACTIVATIONS = {"LINEAR": "clamp", "SIGMOID": "sigmoid", "RELU": "relu"}
"""FREVO's activation functions -> Swarmwright's."""
RELU = (
    "RELU: outputs have no upper limit in FREVO, and agents of Emergency Exit stand still if one exceeds "
    "1.25; actuators in Swarmwright are limited to 1"
)
LEARNING_RATE = (
    "representation: the learning rate of a HebbNet is mutated and crossed over; in FREVO, which rounds the "
    "range of its change to 0, it keeps its initial value"
)
_TOPOLOGY = "weights, biases and slopes evolve too, whose mutations have no effect in FREVO"
_NEAT = {
    **dict.fromkeys(("disjoint_coeff", "excess_coeff", "weight_coeff"), "distances are sums of differences"),
    **dict.fromkeys(
        ("max_perturbation", "max_bias_perturbation", "mutate_node_weight_replaced_prob",
         "mutate_node_sf_prob", "mutate_node_bias_prob", "mutate_link_weight_prob"),
        "replaced by the severity and probability of the method",
    ),
    **dict.fromkeys(
        ("feature_selection", "mutate_link_toggle_prob", "mutate_feature_prob"), "features do not evolve"
    ),
}  # fmt: skip
"""Entries of FREVO's NEAT without counterpart, and why."""
_SPARE_NODES = 10
"""Hidden nodes that an imported network may grow."""
SIGMOID = "computed to 1e-7 here, so single steps may differ"


def map_representation(session: Session, sensors: int | None, mapped: Mapped) -> None:
    """Convert all entries.

    sensors: number of sensors of an agent, if known.

    Raises InputError for an invalid entry, or one without counterpart.
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
        change = "biases move" if section.class_name == MESHED else "weights and biases move"
        line = Line(
            line.key, line.value, f"{line.comment}; {change} in proportion to their size, not by +-10"
        )
        mapped.notes.append(
            f"method.mutationMethod = 2: {change} by up to a fifth of their size, not by +-10"
        )
    mapped.controller.append(line)


def _map_meshed(section: Section, mapped: Mapped) -> None:
    complete = section.class_name == COMPLETE
    activation = "clamp" if complete else take_activation(section)
    comment = f"the only one of {COMPLETE}" if complete else "activationFunction"
    key = "stepNumber" if complete else "iterations"
    mapped.controller += [
        Line("hidden", section.take_integer("hiddenNodes", 2, 0), "hiddenNodes"),
        Line("activation", activation, comment),
        Line("iterations", section.take_integer(key, 2, 1), key),
    ]
    if activation == "relu":
        mapped.controller.append(Line("output_range", [0, 1], "FREVO's problem scales it to -1 to 1"))
        mapped.notes.append(f"representation.activationFunction = {RELU}")
    if not complete:
        _omit_mutation_options(section, mapped)


def _omit_mutation_options(section: Section, mapped: Mapped) -> None:
    check_deterministic(section)
    rate = section.take_number("mutation_rate", 0.2)
    random_range = section.take_number("random_bias_range", 0.2)
    variable = section.take_flag("variable_mutation_rate", False)
    reason = f"variable_mutation_rate = {str(variable).lower()}: the severity of mutations is constant"
    mapped.not_controller.append(reason)
    if variable:
        mapped.notes.append(f"representation.{reason}")
    mapped.not_controller.append(f"mutation_rate = {rate!r}: used with variable_mutation_rate only")
    mapped.not_controller.append(
        f"random_source = false, random_bias_range = {random_range!r}: controllers draw no random numbers"
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
        Line("activation", "sigmoid", f"the only one of {section.class_name}; {SIGMOID}"),
    ]
    steps = section.take_integer("stepNumber", steps)
    mapped.not_controller.append(
        f"stepNumber = {steps}: without feedback all passes compute the same outputs"
    )


def _map_hebbian(section: Section, mapped: Mapped) -> None:
    mapped.controller_kind = "hebbian"
    mapped.controller += [
        Line("hidden", section.take_integer("hiddenNodes", 2, 0), "hiddenNodes"),
        Line("iterations", take_passes(section), "stepNumber"),
    ]
    mapped.not_controller.append("plasticity of weights: FREVO evolves it, but does not use it")
    mapped.notes.append(LEARNING_RATE)


def _map_neat(session: Session, mapped: Mapped) -> None:
    section, add = session.representation, mapped.controller.append
    mapped.controller_kind = "neat"
    grows = mapped.mutation is not None
    sources = find_best_sources(session.root, disabled=grows)
    if grows:
        add(Line("frevo", True, "connections and nodes grow"))
    if sources is not None:
        add(Line("sources", sources, "connections of the best network in the file, disabled ones, too"))
    if grows:
        add(Line("max_nodes", _count_hidden(session.root) + _SPARE_NODES, "of the largest network, and more"))
        add(Line("add_node", section.take_number("add_node_prob", 0.03), "add_node_prob"))
        add(Line("add_connection", section.take_number("add_link_prob", 0.05), "add_link_prob"))
    add(Line("iterations", ITERATIONS, "the only value of NEAT"))
    if mapped.mutation is not None:
        _map_mutation(section, mapped.mutation, mapped)
    if not section.take_flag("recursive", True):
        mapped.notes.append("representation.recursive = false: connections may form cycles here")
    for key, reason in _NEAT.items():
        if key in section.entries:
            mapped.not_controller.append(f"{key} = {to_single_line(section.take_raw(key))}: {reason}")
    origin = "those of the file's best network" if sources else "from every sensor to every actuator"
    growth = "grow from there" if grows else f"are constant: {mapped.method_kind} adds none"
    mapped.notes.append(f"representation: NEAT's connections are {origin}, and {growth}; {_TOPOLOGY}")


def _count_hidden(root: Element) -> int:
    """Return the number of hidden nodes of the largest network in a result file; 0 for a session."""
    networks = [element for element in iterate_members(root) if element.tag == TAG]
    return max(
        (len(_classify_nodes(element, _split_genes(element)[0])[1]) for element in networks), default=0
    )


def _map_machine(section: Section, sensors: int | None, mapped: Mapped) -> None:
    machine = read_machine(section, sensors)
    mapped.controller_kind = "mealy_fsm"
    omit_mutation(mapped)
    mapped.controller = [
        Line("states", machine.states, "num_of_states"),
        Line("levels", machine.levels, "min_input_values, max_input_values, nthresholds_for_inputs"),
        Line("output_levels", machine.output_levels, "output_units, and both limits are levels"),
    ]
    mapped.not_controller += machine.omitted
    mapped.notes += machine.notes


def omit_mutation(mapped: Mapped) -> None:
    """List the mutation of FREVO's method as omitted."""
    if mapped.mutation is not None and mapped.mutation.comment.startswith("mutationMethod"):
        mapped.not_method.append(
            f"{mapped.mutation.comment}: {mapped.controller_kind} mutates in a different way"
        )


def check_deterministic(section: Section) -> None:
    """Raise InputError if networks draw random numbers, unlike controllers of Swarmwright."""
    if section.class_name == MESHED and section.take_flag("random_source", False):
        raise section.error(
            "random_source",
            "true found, but controllers of Swarmwright draw no random numbers; set it to false in FREVO",
        )


def take_passes(section: Section) -> int:
    """Return the number of passes of a HebbNet in a step; FREVO treats numbers below 1 as 1."""
    return max(1, section.take_integer("stepNumber", 2))


def take_activation(section: Section) -> str:
    """Return Swarmwright's name of the activation function of a FullyMeshedNet."""
    return ACTIVATIONS[section.take_text("activationFunction", "LINEAR", tuple(ACTIVATIONS))]
