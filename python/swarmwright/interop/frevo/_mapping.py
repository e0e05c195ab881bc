"""The conversion of a FREVO session to the lines of an experiment.

Converts the entries of FREVO's methods to options, and those of FREVO's Emergency Exit to parameters.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from swarmwright.interop.frevo._document import (
    ABSOLUTE,
    CEA2D,
    EMERGENCY_EXIT,
    MACHINE,
    MESHED,
    NNGA,
    PSO,
    RANDOM_SEARCH,
    Section,
    Session,
    check,
    run_all,
)
from swarmwright.interop.frevo._field import FieldFile, find_field
from swarmwright.interop.frevo._games import map_game
from swarmwright.interop.frevo._mapped import Line, Mapped, report_unused, to_single_line
from swarmwright.interop.frevo._representations import map_representation, omit_mutation
from swarmwright.interop.frevo._tournaments import map_tournament
from swarmwright.methods import METHODS

_RANDOM_ONLY = (
    "NumberofAgents",
    "NumberofEmergencyExits",
    "NumberofBlockades",
    "NumberofEvaluations",
    "seedforEmergencyExits",
)


def convert_problem(
    session: Session, field_file: Path | None
) -> tuple[list[Line], FieldFile | None, list[Line], list[str]]:
    """Return the parameters, the field if it is in a file, the ranking, and notes."""
    problem = session.problem
    source = problem.take_text("fieldsource", "FIELD_FROM_FILE", ("FIELD_FROM_FILE", "RANDOM_FIELD"))
    lines = [
        Line("steps", problem.take_integer("steps", 50, 1), "steps"),
        Line("stepSize", problem.take_integer("length_of_timestep_ms", 200, 0), "length_of_timestep_ms"),
    ]
    width, height = (problem.take_integer(key, 20, 1) for key in ("width", "height"))
    if source == "FIELD_FROM_FILE":
        field = find_field(problem, session.path, field_file)
        notes = []
        if (field.value["width"], field.value["height"]) != (width, height):
            notes.append(
                f"problem.width, problem.height: FREVO puts a wall around {width} x {height} cells; here the "
                f"field has the {field.value['width']} x {field.value['height']} cells of {field.path.name}"
            )
        return lines, field, [Line("episodes", 1, "a field in a file has a single episode")], notes
    agents = problem.take_integer("NumberofAgents", 10, 1)
    exits = problem.take_integer("NumberofEmergencyExits", 5, 1)
    comments = {"NumberofAgents": "NumberofAgents", "NumberofEmergencyExits": "NumberofEmergencyExits"}
    # FREVO reduces larger numbers without a message; Swarmwright refuses them.
    if agents > max(width, height):
        comments["NumberofAgents"] += f" = {agents}, limited by FREVO to the larger of width and height"
        agents = max(width, height)
    if exits > width * height:
        comments["NumberofEmergencyExits"] += f" = {exits}, limited by FREVO to width x height"
        exits = width * height
    lines += [
        Line("width", width, "width"),
        Line("height", height, "height"),
        Line("numAgents", agents, comments["NumberofAgents"]),
        Line("numExits", exits, comments["NumberofEmergencyExits"]),
        Line("numBlockades", problem.take_integer("NumberofBlockades", 20, 0), "NumberofBlockades"),
        Line(
            "seed", problem.take_integer("seedforEmergencyExits", 0, 0), "seedforEmergencyExits, of episode 0"
        ),
    ]
    episodes = Line("episodes", problem.take_integer("NumberofEvaluations", 10, 1), "NumberofEvaluations")
    return lines, None, [episodes, Line("aggregate", "sum", "FREVO adds the episodes up")], []


def map_problem(session: Session, field_file: Path | None, mapped: Mapped) -> None:
    """Convert all entries. Raises InputError for an invalid entry, or one without counterpart."""
    problem = session.problem
    mapped.parameters, mapped.field_file, mapped.ranking, notes = convert_problem(session, field_file)
    mapped.notes += notes
    if mapped.field_file is None:
        mapped.not_parameters.append(
            "fieldsource = RANDOM_FIELD: without the parameter field, the field is random"
        )
        if "Filename" in problem.entries:
            unused = to_single_line(problem.take_raw("Filename"))
            mapped.not_parameters.append(f"Filename = {unused}: not used by FREVO with RANDOM_FIELD")
    else:
        mapped.not_parameters.append("fieldsource = FIELD_FROM_FILE: implied by the parameter field")
        mapped.not_parameters.append("width, height: the field has its own")
        for key in _RANDOM_ONLY:
            if key in problem.entries:
                unused = to_single_line(problem.take_raw(key))
                mapped.not_parameters.append(f"{key} = {unused}: not used by FREVO with FIELD_FROM_FILE")


_SHARES = {
    "percentage_elite": ("elite", 0.15),
    "percentage_random": ("random", 0.10),
    "percentage_mutate": ("mutate", 0.40),
    "percentage_xover": ("crossover", 0.30),
    "percentage_renew": ("renew", 0.05),
}
_LARGEST_VELOCITY = 2.0
"""Largest change of a weight or bias in a generation of FREVO's PSO."""


def map_method(session: Session, mapped: Mapped) -> None:
    """Convert all entries. Raises InputError for an invalid entry, or one without counterpart."""
    _MAPS[session.method.class_name](session, mapped)


def _map_cea2d(session: Session, mapped: Mapped) -> None:
    mapped.method_kind = "cea2d"
    map_cea2d(session.method, mapped)


def _map_nnga(session: Session, mapped: Mapped) -> None:
    method, add = session.method, mapped.method.append
    add(Line("population", method.take_integer("populationsize", 50, 2), "populationsize"))
    add(Line("generations", method.take_integer("generations", 200, 1), "generations"))
    shares = {ours: _share(method, key, default) for key, (ours, default) in _SHARES.items()}
    rest = 1 - math.fsum(share for name, share in shares.items() if name != "elite")
    comments = {ours: key for key, (ours, _) in _SHARES.items()}
    if any(_is_percentage(method, key) for key in _SHARES):
        mapped.notes.append(
            "method.percentage_..: whole numbers are read as percentages, as in early versions of FREVO; "
            "FREVO 1.5 reads them as shares, 15 as 1500 %"
        )
    if abs(rest - shares["elite"]) > 1e-6:
        comments["elite"] += f" = {shares['elite']!r}; FREVO gives the elite the remainder"
        shares["elite"] = round(rest, 9)
    mapped.method += [Line(name, share, comments[name]) for name, share in shares.items()]
    add(Line("severity", method.take_number("mutationseverity", 0.3), "mutationseverity"))
    add(Line("probability", method.take_number("mutationprobability", 1.0), "mutationprobability"))
    crossover = method.take_integer("xoverMethod", 1)
    if crossover != 1 and session.representation.class_name != MACHINE:
        raise method.error(
            "xoverMethod", f"{crossover} found, expected 1, the only method of FREVO's networks"
        )
    mapped.not_method.append(
        f"xoverMethod = {crossover}: crossovers exchange sequences of nodes or of table rows"
    )
    add(Line("islands", method.take_integer("populationnumber", 1, 1), "populationnumber"))
    every = method.take_integer("interXover_frequency", 10)
    # Java's remainder is 0 in the same generations for either sign.
    add(Line("exchange_interval", abs(every), "interXover_frequency"))
    interval = method.take_integer("saveinterval", 0)
    improvements = method.take_flag("saveImprovements", True)
    mapped.not_method.append(
        f"saveinterval = {interval}, saveImprovements = {str(improvements).lower()}: "
        "the record of a run contains all evaluations"
    )
    number = method.take_integer("mutationMethod", 1)
    # FREVO treats other numbers as 1.
    name = "proportional" if number == 2 else "uniform"
    mapped.mutation = Line("mutation", name, f"mutationMethod = {number}")


def _share(method: Section, key: str, default: float) -> float:
    """Return a share of the population, 0 to 1."""
    value = method.take_number(key, default)
    return value / 100 if _is_percentage(method, key) else value


def _is_percentage(method: Section, key: str) -> bool:
    """Return whether a share is a percentage, as in early versions of FREVO."""
    return key in method.entries and method.entries[key].attributes.get("type") == "INT"


def _map_random_search(session: Session, mapped: Mapped) -> None:
    mapped.method_kind = "random_search"
    method = session.method
    mapped.method += [
        Line("population", method.take_integer("populationsize", 50, 1), "populationsize"),
        Line("generations", method.take_integer("generations", 200, 1), "generations"),
    ]
    mapped.not_method.append(
        "in FREVO the best candidate is a member of the next population; here all members are new, and the "
        "record contains the best candidate"
    )


def _map_pso(session: Session, mapped: Mapped) -> None:
    mapped.method_kind = "pso"
    method, representation = session.method, session.representation
    add = mapped.method.append
    add(Line("population", method.take_integer("populationsize", 100, 3), "populationsize"))
    add(Line("generations", method.take_integer("generations", 200, 1), "generations"))
    for ours, key, default in (("inertia", "W", 0.7), ("own", "C1", 2.4), ("social", "C2", 2.1)):
        add(Line(ours, method.take_number(key, default), key))
    add(Line("adaptive", "false", "FREVO's inertia and attractions are constant"))
    add(Line("perturb", "false", "FREVO moves the best particle like all others"))
    # The representation reads the entry, too.
    reach = representation.take_number("weight_range", 2.0)
    fastest = min(_LARGEST_VELOCITY / (2 * reach), 1.0) if reach > 0 else 1.0
    add(Line("reach", 1.0, "FREVO limits weights by weight_range, biases by bias_range"))
    add(Line("fastest", fastest, "FREVO limits steps to 2; as a share of the range"))
    mapped.notes.append(
        "method.class = pso.PSO: this is a different PSO. In FREVO the best position of a particle is always "
        "its current position, so C1 has no effect, and a fitness below 0 ends the run with an error"
    )
    if representation.class_name != MESHED:
        mapped.notes.append(
            f"method.class = pso.PSO: FREVO moves only {MESHED}; Swarmwright moves "
            f"{representation.class_name}, too"
        )


_MAPS: dict[str, Callable[[Session, Mapped], None]] = {
    NNGA: _map_nnga,
    CEA2D: _map_cea2d,
    PSO: _map_pso,
    RANDOM_SEARCH: _map_random_search,
}


_PATTERNS = (1, 2, 3)
_PATTERN_SIZE = 10  # cells, width and height of a pattern of obstacles


def map_cea2d(method: Section, mapped: Mapped) -> None:
    """Convert all entries. Raises InputError for an invalid entry, or one without counterpart."""
    add = mapped.method.append
    add(Line("generations", method.take_integer("generations", 200, 1), "generations"))
    width = method.take_integer("populationsize_width", 10, 1)
    height = method.take_integer("populationsize_height", 10, 1)
    add(Line("width", width, "populationsize_width"))
    add(Line("height", height, "populationsize_height"))
    mode = method.take_integer("neighbourhoodmode", 1)
    # FREVO treats other numbers as 1.
    add(Line("neighbourhood", "random" if mode == 2 else "grid", f"neighbourhoodmode = {mode}"))
    _map_obstacles(method, mapped, min(width, height))
    _map_shares(method, mapped)
    add(Line("severity", method.take_number("mutationseverity", 0.3), "mutationseverity"))
    add(Line("probability", method.take_number("mutationprobability", 1.0), "mutationprobability"))
    interval = method.take_integer("saveinterval", 0)
    mapped.not_method.append(f"saveinterval = {interval}: the record of a run contains all evaluations")
    mapped.mutation = Line("mutation", "uniform", "the only one of CEA2D")


def _map_obstacles(method: Section, mapped: Mapped, side: int) -> None:
    pattern = method.take_integer("obstacle-pattern", 0)
    obstacles = method.take_integer("random obstacles", 0, 0)
    if pattern in _PATTERNS and side >= _PATTERN_SIZE:
        raise method.error(
            "obstacle-pattern", f"{pattern} found; obstacles here are random: set it to 4 in FREVO"
        )
    if pattern in _PATTERNS:  # FREVO omits the pattern for lack of space
        obstacles = 0
    mapped.method.append(Line("obstacles", obstacles, f"random obstacles; obstacle-pattern = {pattern}"))


def _map_shares(method: Section, mapped: Mapped) -> None:
    """Convert percentages: FREVO gives renewal the remainder of elite, mutation and crossover."""
    remainder = 100
    for ours, key, default in (
        ("elite", "percentelite", 11),
        ("mutate", "percentmutateelite", 59),
        ("crossover", "percentxoverelite", 30),
    ):
        percentage = method.take_integer(key, default, 0)
        share = min(percentage, remainder)
        remainder -= share
        comment = (
            key if share == percentage else f"{key} = {percentage}, limited by FREVO to the remainder of 100"
        )
        mapped.method.append(Line(ours, share / 100, comment))
    mapped.method.append(Line("renew", remainder / 100, "the remainder"))


_LARGEST_SEED = 2**63 - 1


@dataclass(frozen=True)
class Replacements:
    """Replacements of FREVO's components; None to convert FREVO's.

    simulation: its name in the experiment. method, controller, ranking: kinds.
    """

    simulation: str | None = None
    method: str | None = None
    controller: str | None = None
    ranking: str | None = None


def map_session(
    session: Session,
    field_file: Path | None,
    replacements: Replacements,
    sensors: int | None,
    parameters: Collection[str] = (),
) -> Mapped:
    """Convert all entries.

    Args:
        session: FREVO's session.
        field_file: the field of Emergency Exit; None: the file that the session names.
        replacements: replacements of components.
        sensors: number of sensors of an agent, if known.
        parameters: names of the simulation's parameters, as far as known.

    Raises:
        InputError: an entry is invalid or has no counterpart; the message lists the problems of all
            sections, a line each.
    """
    mapped = Mapped(Line("seed", 0, ""))
    steps: list[Callable[[], None]] = [
        lambda: _map_config(session.config, mapped),
        lambda: _map_simulation(session, field_file, replacements.simulation, parameters, mapped),
        lambda: _map_method(session, replacements.method, mapped),
        lambda: _map_controller(session, sensors, replacements.controller, mapped),
        lambda: _map_ranking(session, replacements, mapped),
    ]
    run_all(*steps)
    for section, reasons in (
        (session.config, mapped.not_config),
        (session.problem, mapped.not_parameters),
        (session.method, mapped.not_method),
        (session.representation, mapped.not_controller),
        (session.ranking, mapped.not_ranking),
    ):
        for key in section.unfilled:
            value = section.entries[key].attribute("value")
            mapped.notes.append(f"{section.name}.{key} = {value}: a placeholder; FREVO's default is used")
        for reason in report_unused(section, "unknown to FREVO 1.5"):
            reasons.append(reason)
            mapped.notes.append(f"{section.name}.{reason}")
    return mapped


def _map_config(config: Section, mapped: Mapped) -> None:
    seed = config.take_integer("StartingSeed", 12345, 0)
    if seed > _LARGEST_SEED:
        raise config.error("StartingSeed", f"{seed} found, expected at most {_LARGEST_SEED}")
    mapped.seed = Line("seed", seed, "StartingSeed; random numbers differ from FREVO's")
    if "CustomName" in config.entries:
        mapped.not_config.append(
            f"CustomName = {to_single_line(config.take_raw('CustomName'))}: name the folder of a run with "
            "`--out`"
        )
    runs = config.take_integer("NumberofRuns", 1)
    reason = (
        f"NumberofRuns = {runs}: a single run; `swarmwright sweep` executes several runs with different seeds"
    )
    mapped.not_config.append(reason)
    if runs > 1:
        mapped.notes.append(f"sessionconfig.{reason}")
    if "CurrentSeed" in config.entries:
        mapped.not_config.append(
            f"CurrentSeed = {to_single_line(config.take_raw('CurrentSeed'))}: a state of FREVO"
        )


def _map_simulation(
    session: Session,
    field_file: Path | None,
    replacement: str | None,
    parameters: Collection[str],
    mapped: Mapped,
) -> None:
    problem = session.problem
    if replacement is None:
        check(problem, replaceable=True)
        map_problem(session, field_file, mapped)
        return
    mapped.simulation = replacement
    map_game(session, parameters, mapped)
    mapped.not_parameters += report_unused(problem, f"an entry of {to_single_line(problem.class_name)}")
    mapped.notes.append(f"problem.class = {to_single_line(problem.class_name)}: {replacement} replaces it")


def _map_method(session: Session, replacement: str | None, mapped: Mapped) -> None:
    method = session.method
    if replacement is None:
        check(method, replaceable=True)
        map_method(session, mapped)
        return
    mapped.method_kind = replacement
    options = METHODS.get(replacement).options_model.model_fields
    for ours, key, default in (("population", "populationsize", 50), ("generations", "generations", 200)):
        if ours in options and key in method.entries:
            mapped.method.append(Line(ours, method.take_integer(key, default, 1), key))
    mapped.not_method += report_unused(method, f"an entry of {to_single_line(method.class_name)}")
    mapped.notes.append(f"method.class = {to_single_line(method.class_name)}: {replacement} replaces it")


def _map_controller(session: Session, sensors: int | None, replacement: str | None, mapped: Mapped) -> None:
    section = session.representation
    if replacement is None:
        check(section, replaceable=True)
        map_representation(session, sensors, mapped)
        return
    mapped.controller_kind = replacement
    omit_mutation(mapped)
    mapped.not_controller += report_unused(section, f"an entry of {to_single_line(section.class_name)}")
    mapped.notes.append(
        f"representation.class = {to_single_line(section.class_name)}: {replacement} replaces it"
    )


def _map_ranking(session: Session, replacements: Replacements, mapped: Mapped) -> None:
    section, replacement = session.ranking, replacements.ranking
    threads = to_single_line(section.take_raw("parallelthreads", "1"))
    mapped.not_ranking.append(f"parallelthreads = {threads}: Swarmwright finds servers and processors itself")
    if replacement is None:
        check(section, replaceable=True)
        if section.class_name != ABSOLUTE:
            alone = replacements.simulation is None and session.problem.class_name == EMERGENCY_EXIT
            map_tournament(section, mapped, alone=alone)
        return
    mapped.ranking_kind = replacement
    mapped.not_ranking += report_unused(section, f"an entry of {to_single_line(section.class_name)}")
    mapped.notes.append(f"ranking.class = {to_single_line(section.class_name)}: {replacement} replaces it")
