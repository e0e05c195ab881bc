"""Which of FREVO's entries becomes what, and why some become nothing."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmwright.frevo._document import MACHINE, Section, Session
from swarmwright.frevo._field import FieldFile, find_field
from swarmwright.frevo._machine import take_machine

ACTIVATIONS = {"LINEAR": "clamp", "SIGMOID": "sigmoid"}
"""FREVO's activation functions, and ours."""

_SHARES = {
    "percentage_elite": ("elite", 0.15),
    "percentage_random": ("random", 0.10),
    "percentage_mutate": ("mutate", 0.40),
    "percentage_xover": ("crossover", 0.30),
    "percentage_renew": ("renew", 0.05),
}
_RANDOM_ONLY = (
    "NumberofAgents",
    "NumberofEmergencyExits",
    "NumberofBlockades",
    "NumberofEvaluations",
    "seedforEmergencyExits",
)
_LARGEST_SEED = 2**63 - 1


@dataclass(frozen=True)
class Line:
    """A line of the experiment file: key, value, and the name that FREVO has for it."""

    key: str
    value: Any
    comment: str


@dataclass
class Mapped:
    """The lines of each section of an experiment, and what was left out of each.

    notes: what will not be as it was in FREVO, for the person who imports.
    """

    seed: Line
    method_kind: str = "nnga"
    controller_kind: str = "fully_meshed"
    parameters: list[Line] = field(default_factory=list)
    controller: list[Line] = field(default_factory=list)
    method: list[Line] = field(default_factory=list)
    ranking: list[Line] = field(default_factory=list)
    field_file: FieldFile | None = None
    not_parameters: list[str] = field(default_factory=list)
    not_controller: list[str] = field(default_factory=list)
    not_method: list[str] = field(default_factory=list)
    not_ranking: list[str] = field(default_factory=list)
    not_config: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def map_session(session: Session, field_file: Path | None) -> Mapped:
    """Map every entry. Raises InputError for one that cannot be read or has no counterpart."""
    seed = session.config.take_integer("StartingSeed", 12345, 0)
    if seed > _LARGEST_SEED:
        raise session.config.error("StartingSeed", f"{seed} found, expected at most {_LARGEST_SEED}")
    mapped = Mapped(
        Line("seed", seed, "StartingSeed; drawn from in another way, so runs differ from FREVO's")
    )
    _map_config(session.config, mapped)
    _map_problem(session, field_file, mapped)
    _map_method(session.method, mapped)
    _map_representation(session.representation, mapped)
    ranking = session.ranking
    threads = ranking.take_integer("parallelthreads", 1)
    mapped.not_ranking.append(f"parallelthreads = {threads}: servers and processors are found by themselves")
    for section, reasons in (
        (session.config, mapped.not_config),
        (session.problem, mapped.not_parameters),
        (session.method, mapped.not_method),
        (session.representation, mapped.not_controller),
        (ranking, mapped.not_ranking),
    ):
        for key in section.left:
            reason = f"{key} = {one_line(section.shown(key))}: FREVO 1.5 has no such entry"
            reasons.append(reason)
            mapped.notes.append(f"{section.name}.{reason}")
    return mapped


def one_line(text: str) -> str:
    """Return text from a file such that it can stand in a comment."""
    line = " ".join(text.split())[:80]
    return "".join(letter if letter.isprintable() else "?" for letter in line)


def _map_config(config: Section, mapped: Mapped) -> None:
    if "CustomName" in config.entries:
        mapped.not_config.append(
            f"CustomName = {one_line(config.shown('CustomName'))}: `--out` names the folder of a run"
        )
    runs = config.take_integer("NumberofRuns", 1)
    reason = f"NumberofRuns = {runs}: one run at a time; `swarmwright sweep` makes several, with other seeds"
    mapped.not_config.append(reason)
    if runs > 1:
        mapped.notes.append(f"sessionconfig.{reason}")
    if "CurrentSeed" in config.entries:
        mapped.not_config.append(f"CurrentSeed = {one_line(config.shown('CurrentSeed'))}: FREVO's own state")


def problem_parameters(
    session: Session, field_file: Path | None
) -> tuple[list[Line], FieldFile | None, list[Line], list[str]]:
    """Return parameters, the field if it comes from a file, the ranking, and notes."""
    problem = session.problem
    source = problem.take_text("fieldsource", "FIELD_FROM_FILE", ("FIELD_FROM_FILE", "RANDOM_FIELD"))
    lines = [
        Line("steps", problem.take_integer("steps", 50, 1), "steps"),
        Line("stepSize", problem.take_integer("length_of_timestep_ms", 200, 0), "length_of_timestep_ms"),
    ]
    width, height = (problem.take_integer(key, 20, 1) for key in ("width", "height"))
    if source == "FIELD_FROM_FILE":
        found = find_field(problem, session.path, field_file)
        notes = []
        if (found.value["width"], found.value["height"]) != (width, height):
            notes.append(
                f"problem.width, problem.height: FREVO walls the field in at {width} x {height}; here it has "
                f"the {found.value['width']} x {found.value['height']} cells of {found.path.name}"
            )
        return lines, found, [Line("episodes", 1, "a field from a file is run once")], notes
    agents = problem.take_integer("NumberofAgents", 10, 1)
    exits = problem.take_integer("NumberofEmergencyExits", 5, 1)
    shown = {"NumberofAgents": "NumberofAgents", "NumberofEmergencyExits": "NumberofEmergencyExits"}
    # FREVO takes fewer without a word; here more are refused.
    if agents > max(width, height):
        shown["NumberofAgents"] += f" = {agents}, of which FREVO takes the larger of width and height"
        agents = max(width, height)
    if exits > width * height:
        shown["NumberofEmergencyExits"] += f" = {exits}, of which FREVO takes width x height"
        exits = width * height
    lines += [
        Line("width", width, "width"),
        Line("height", height, "height"),
        Line("numAgents", agents, shown["NumberofAgents"]),
        Line("numExits", exits, shown["NumberofEmergencyExits"]),
        Line("numBlockades", problem.take_integer("NumberofBlockades", 20, 0), "NumberofBlockades"),
        Line(
            "seed", problem.take_integer("seedforEmergencyExits", 0, 0), "seedforEmergencyExits, of episode 0"
        ),
    ]
    episodes = Line("episodes", problem.take_integer("NumberofEvaluations", 10, 1), "NumberofEvaluations")
    return lines, None, [episodes, Line("aggregate", "sum", "FREVO adds them up")], []


def _map_problem(session: Session, field_file: Path | None, mapped: Mapped) -> None:
    problem = session.problem
    mapped.parameters, mapped.field_file, mapped.ranking, notes = problem_parameters(session, field_file)
    mapped.notes += notes
    if mapped.field_file is None:
        mapped.not_parameters.append("fieldsource = RANDOM_FIELD: without the parameter field it is random")
        if "Filename" in problem.entries:
            unused = one_line(problem.shown("Filename"))
            mapped.not_parameters.append(f"Filename = {unused}: not used by FREVO with RANDOM_FIELD")
    else:
        mapped.not_parameters.append("fieldsource = FIELD_FROM_FILE: the parameter field says so")
        mapped.not_parameters.append("width, height: the field has its own")
        for key in _RANDOM_ONLY:
            if key in problem.entries:
                unused = one_line(problem.shown(key))
                mapped.not_parameters.append(f"{key} = {unused}: not used by FREVO with FIELD_FROM_FILE")


def _map_method(method: Section, mapped: Mapped) -> None:
    from swarmwright.frevo._cea2d import map_cea2d

    if method.class_name == "CEA2D.CEA2D":
        mapped.method_kind = "cea2d"
        map_cea2d(method, mapped)
    else:
        _map_nnga(method, mapped)


def _map_nnga(method: Section, mapped: Mapped) -> None:
    add = mapped.method.append
    add(Line("population", method.take_integer("populationsize", 50, 2), "populationsize"))
    add(Line("generations", method.take_integer("generations", 200, 1), "generations"))
    shares = {ours: method.take_number(key, default) for key, (ours, default) in _SHARES.items()}
    rest = 1 - math.fsum(share for name, share in shares.items() if name != "elite")
    comments = {ours: key for key, (ours, _) in _SHARES.items()}
    if abs(rest - shares["elite"]) > 1e-6:
        comments["elite"] += f" = {shares['elite']!r}; FREVO gives the elite what the others leave"
        shares["elite"] = round(rest, 9)
    mapped.method += [Line(name, share, comments[name]) for name, share in shares.items()]
    add(Line("severity", method.take_number("mutationseverity", 0.3), "mutationseverity"))
    add(Line("probability", method.take_number("mutationprobability", 1.0), "mutationprobability"))
    crossover = method.take_integer("xoverMethod", 1)
    if crossover != 1:
        raise method.error("xoverMethod", f"{crossover} found; FREVO's FullyMeshedNet knows 1 only")
    mapped.not_method.append("xoverMethod = 1: the only one, runs of nodes")
    add(Line("populations", method.take_integer("populationnumber", 1, 1), "populationnumber"))
    every = method.take_integer("interXover_frequency", 10)
    # Java's remainder, which FREVO asks, is 0 for the same generations whatever the sign.
    add(Line("exchange_interval", abs(every), "interXover_frequency"))
    interval = method.take_integer("saveinterval", 0)
    improvements = method.take_flag("saveImprovements", True)
    mapped.not_method.append(
        f"saveinterval = {interval}, saveImprovements = {str(improvements).lower()}: "
        "the record of a run holds every evaluation"
    )
    _map_mutation(method, mapped)


def _map_mutation(method: Section, mapped: Mapped) -> None:
    number = method.take_integer("mutationMethod", 1)
    if number == 2:
        comment = "mutationMethod = 2; biases move like weights, not within +-10"
        mapped.controller.append(Line("mutation", "proportional", comment))
        mapped.notes.append(
            "method.mutationMethod = 2: biases move within a fifth of their size, not within +-10"
        )
    else:  # FREVO takes any other number for 1
        mapped.controller.append(Line("mutation", "uniform", f"mutationMethod = {number}"))


def _map_machine(section: Section, mapped: Mapped) -> None:
    machine = take_machine(section)
    mapped.controller_kind = "mealy_fsm"
    # What the method says of mutations is about networks.
    mapped.controller = [
        Line("states", machine.states, "num_of_states"),
        Line("levels", machine.levels, "min_input_values, max_input_values, nthresholds_for_inputs"),
        Line("output_levels", machine.output_levels, "output_units, and both ends count"),
    ]
    mapped.not_controller += machine.not_taken
    mapped.notes = [note for note in mapped.notes if "mutationMethod" not in note] + machine.notes


def _map_representation(section: Section, mapped: Mapped) -> None:
    if section.class_name == MACHINE:
        _map_machine(section, mapped)
    else:
        _map_network(section, mapped)


def _map_network(section: Section, mapped: Mapped) -> None:
    check_deterministic(section)
    mapped.controller[:0] = [
        Line("hidden", section.take_integer("hiddenNodes", 2, 0), "hiddenNodes"),
        Line("activation", take_activation(section), "activationFunction"),
        Line("iterations", section.take_integer("iterations", 2, 1), "iterations"),
        Line("weight_range", section.take_number("weight_range", 2.0), "weight_range"),
        Line("bias_range", section.take_number("bias_range", 2.0), "bias_range"),
    ]
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


def check_deterministic(section: Section) -> None:
    """Raise InputError when networks draw random numbers, which no controller here does."""
    if section.take_flag("random_source", False):
        raise section.error(
            "random_source", "true found: controllers here draw no random numbers; set it to false in FREVO"
        )


def take_activation(section: Section) -> str:
    """Return our name of the activation function. Raises InputError when there is none."""
    named = section.take_text("activationFunction", "LINEAR", ("LINEAR", "SIGMOID", "RELU"))
    if named not in ACTIVATIONS:
        raise section.error(
            "activationFunction",
            "RELU found: its outputs have no upper limit, and FREVO's agents stand still above 1.25, where "
            "actuators here end at 1; set it to LINEAR or SIGMOID in FREVO",
        )
    return ACTIVATIONS[named]
