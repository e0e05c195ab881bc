"""FREVO's representations: their entries as options of Swarmwright's controllers."""

from swarmwright.interop.frevo._components import (
    COMPLETE,
    HEBBIAN,
    LAYERS,
    MACHINE,
    MESHED,
    NEAT,
    THREE_LAYERS,
)
from swarmwright.interop.frevo._document import Section, Session
from swarmwright.interop.frevo._machine import take_machine
from swarmwright.interop.frevo._mapped import Line, Mapped, one_line
from swarmwright.interop.frevo._neat import ITERATIONS, best_sources

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
