"""From a FREVO session to the lines of an experiment.

FREVO's methods: their entries as options of Swarmwright.

FREVO's Emergency Exit: its entries as parameters of Swarmwright.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from swarmwright.interop.frevo._document import (
    CEA2D,
    MACHINE,
    MESHED,
    NNGA,
    PSO,
    RANDOM_SEARCH,
    Section,
    Session,
    all_of,
    check,
)
from swarmwright.interop.frevo._field import FieldFile, find_field
from swarmwright.interop.frevo._mapped import Line, Mapped, not_used, one_line
from swarmwright.interop.frevo._representations import leave_mutation_out, map_representation
from swarmwright.methods import METHODS

_RANDOM_ONLY = (
    "NumberofAgents",
    "NumberofEmergencyExits",
    "NumberofBlockades",
    "NumberofEvaluations",
    "seedforEmergencyExits",
)


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
    # FREVO silently takes fewer; here more are refused.
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


def map_problem(session: Session, field_file: Path | None, mapped: Mapped) -> None:
    """Map every entry. Raises InputError for one that cannot be read or has no counterpart."""
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
        mapped.not_parameters.append("width, height: those of the field are used")
        for key in _RANDOM_ONLY:
            if key in problem.entries:
                unused = one_line(problem.shown(key))
                mapped.not_parameters.append(f"{key} = {unused}: not used by FREVO with FIELD_FROM_FILE")


_SHARES = {
    "percentage_elite": ("elite", 0.15),
    "percentage_random": ("random", 0.10),
    "percentage_mutate": ("mutate", 0.40),
    "percentage_xover": ("crossover", 0.30),
    "percentage_renew": ("renew", 0.05),
}
_LARGEST_VELOCITY = 2.0
"""Largest step of a weight or bias in one generation of FREVO's PSO."""


def map_method(session: Session, mapped: Mapped) -> None:
    """Map every entry. Raises InputError for one that cannot be read or has no counterpart."""
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
            "method.percentage_..: whole numbers are percentages, as early versions of FREVO wrote them; "
            "FREVO 1.5 takes them for shares, and 15 for 1500 %"
        )
    if abs(rest - shares["elite"]) > 1e-6:
        comments["elite"] += f" = {shares['elite']!r}; FREVO gives the elite what the others leave"
        shares["elite"] = round(rest, 9)
    mapped.method += [Line(name, share, comments[name]) for name, share in shares.items()]
    add(Line("severity", method.take_number("mutationseverity", 0.3), "mutationseverity"))
    add(Line("probability", method.take_number("mutationprobability", 1.0), "mutationprobability"))
    crossover = method.take_integer("xoverMethod", 1)
    if crossover != 1 and session.representation.class_name != MACHINE:
        raise method.error("xoverMethod", f"{crossover} found; FREVO's networks know 1 only")
    mapped.not_method.append(f"xoverMethod = {crossover}: crossovers take runs of nodes, or of table rows")
    add(Line("populations", method.take_integer("populationnumber", 1, 1), "populationnumber"))
    every = method.take_integer("interXover_frequency", 10)
    # Java's remainder, which FREVO uses, is 0 for the same generations whatever the sign.
    add(Line("exchange_interval", abs(every), "interXover_frequency"))
    interval = method.take_integer("saveinterval", 0)
    improvements = method.take_flag("saveImprovements", True)
    mapped.not_method.append(
        f"saveinterval = {interval}, saveImprovements = {str(improvements).lower()}: "
        "the record of a run holds every evaluation"
    )
    number = method.take_integer("mutationMethod", 1)
    # FREVO takes any other number for 1.
    name = "proportional" if number == 2 else "uniform"
    mapped.mutation = Line("mutation", name, f"mutationMethod = {number}")


def _share(method: Section, key: str, default: float) -> float:
    """Return a share of the population, 0 to 1."""
    value = method.take_number(key, default)
    return value / 100 if _is_percentage(method, key) else value


def _is_percentage(method: Section, key: str) -> bool:
    """Return whether a share is written as a percentage, which early versions of FREVO did."""
    return key in method.entries and method.entries[key].attributes.get("type") == "INT"


def _map_random_search(session: Session, mapped: Mapped) -> None:
    mapped.method_kind = "random_search"
    method = session.method
    mapped.method += [
        Line("population", method.take_integer("populationsize", 50, 1), "populationsize"),
        Line("generations", method.take_integer("generations", 200, 1), "generations"),
    ]
    mapped.not_method.append(
        "the best candidate takes a place in FREVO's next population; here all are new, and the best is kept "
        "in the record"
    )


def _map_pso(session: Session, mapped: Mapped) -> None:
    mapped.method_kind = "pso"
    method, representation = session.method, session.representation
    add = mapped.method.append
    add(Line("population", method.take_integer("populationsize", 100, 3), "populationsize"))
    add(Line("generations", method.take_integer("generations", 200, 1), "generations"))
    for ours, key, default in (("inertia", "W", 0.7), ("own", "C1", 2.4), ("social", "C2", 2.1)):
        add(Line(ours, method.take_number(key, default), key))
    add(Line("adaptive", "false", "FREVO's inertia and pulls stay as they are"))
    add(Line("perturb", "false", "FREVO moves the best particle as all others"))
    # Both are looked at again with the representation: what is read twice is taken once.
    reach = representation.take_number("weight_range", 2.0)
    fastest = min(_LARGEST_VELOCITY / (2 * reach), 1.0) if reach > 0 else 1.0
    add(Line("reach", 1.0, "FREVO holds weights within weight_range, biases within bias_range"))
    add(Line("fastest", fastest, "FREVO moves nothing by more than 2; as a share of the range"))
    mapped.notes.append(
        "method.class = pso.PSO: another one; in FREVO the best place of a particle is always the "
        "one where it is, so that C1 pulls nothing, and fitness below 0 ends the run with an error"
    )
    if representation.class_name != MESHED:
        mapped.notes.append(
            f"method.class = pso.PSO: FREVO moves only {MESHED}; here {representation.class_name} moves, too"
        )


_MAPS: dict[str, Callable[[Session, Mapped], None]] = {
    NNGA: _map_nnga,
    CEA2D: _map_cea2d,
    PSO: _map_pso,
    RANDOM_SEARCH: _map_random_search,
}


_PATTERNS = (1, 2, 3)
_PATTERN_SIZE = 10  # cells in either direction that a pattern of obstacles takes


def map_cea2d(method: Section, mapped: Mapped) -> None:
    """Map every entry. Raises InputError for one that cannot be read or has no counterpart."""
    add = mapped.method.append
    add(Line("generations", method.take_integer("generations", 200, 1), "generations"))
    width = method.take_integer("populationsize_width", 10, 1)
    height = method.take_integer("populationsize_height", 10, 1)
    add(Line("width", width, "populationsize_width"))
    add(Line("height", height, "populationsize_height"))
    mode = method.take_integer("neighbourhoodmode", 1)
    # FREVO takes any other number for 1.
    add(Line("neighbourhood", "random" if mode == 2 else "grid", f"neighbourhoodmode = {mode}"))
    _map_obstacles(method, mapped, min(width, height))
    _map_shares(method, mapped)
    add(Line("severity", method.take_number("mutationseverity", 0.3), "mutationseverity"))
    add(Line("probability", method.take_number("mutationprobability", 1.0), "mutationprobability"))
    interval = method.take_integer("saveinterval", 0)
    mapped.not_method.append(f"saveinterval = {interval}: the record of a run holds every evaluation")
    mapped.mutation = Line("mutation", "uniform", "CEA2D knows no other")


def _map_obstacles(method: Section, mapped: Mapped, side: int) -> None:
    pattern = method.take_integer("obstacle-pattern", 0)
    obstacles = method.take_integer("random obstacles", 0, 0)
    if pattern in _PATTERNS and side >= _PATTERN_SIZE:
        raise method.error(
            "obstacle-pattern", f"{pattern} found; obstacles here are random ones: set it to 4 in FREVO"
        )
    if pattern in _PATTERNS:  # FREVO omits it for lack of space
        obstacles = 0
    mapped.method.append(Line("obstacles", obstacles, f"random obstacles; obstacle-pattern = {pattern}"))


def _map_shares(method: Section, mapped: Mapped) -> None:
    """Map shares of a hundred: FREVO gives renewal what elite, mutation and crossover leave."""
    left = 100
    for ours, key, default in (
        ("elite", "percentelite", 11),
        ("mutate", "percentmutateelite", 59),
        ("crossover", "percentxoverelite", 30),
    ):
        given = method.take_integer(key, default, 0)
        share = min(given, left)
        left -= share
        comment = key if share == given else f"{key} = {given}, of which FREVO takes what is left of 100"
        mapped.method.append(Line(ours, share / 100, comment))
    mapped.method.append(Line("renew", left / 100, "what the others leave"))


_LARGEST_SEED = 2**63 - 1


@dataclass(frozen=True)
class Instead:
    """What is taken in the place of FREVO's components; None where FREVO's is taken over.

    simulation: as experiments name it. method, controller, ranking: kinds.
    """

    simulation: str | None = None
    method: str | None = None
    controller: str | None = None
    ranking: str | None = None


def map_session(session: Session, field_file: Path | None, instead: Instead, sensors: int | None) -> Mapped:
    """Map every entry.

    Args:
        session: what FREVO was to do.
        field_file: the field of Emergency Exit; None: the one that the session names.
        instead: what is taken in the place of components.
        sensors: what an agent senses, where that is known.

    Raises:
        InputError: an entry cannot be read, or something has no counterpart here; with the problems of all
            sections, a line each.
    """
    mapped = Mapped(Line("seed", 0, ""))
    steps: list[Callable[[], None]] = [
        lambda: _map_config(session.config, mapped),
        lambda: _map_simulation(session, field_file, instead.simulation, mapped),
        lambda: _map_method(session, instead.method, mapped),
        lambda: _map_controller(session, sensors, instead.controller, mapped),
        lambda: _map_ranking(session.ranking, instead.ranking, mapped),
    ]
    all_of(*steps)
    for section, reasons in (
        (session.config, mapped.not_config),
        (session.problem, mapped.not_parameters),
        (session.method, mapped.not_method),
        (session.representation, mapped.not_controller),
        (session.ranking, mapped.not_ranking),
    ):
        for key in section.unfilled:
            value = section.entries[key].attribute("value")
            mapped.notes.append(f"{section.name}.{key} = {value}: to be filled in; FREVO's default is taken")
        for reason in not_used(section, "FREVO 1.5 has no such entry"):
            reasons.append(reason)
            mapped.notes.append(f"{section.name}.{reason}")
    return mapped


def _map_config(config: Section, mapped: Mapped) -> None:
    seed = config.take_integer("StartingSeed", 12345, 0)
    if seed > _LARGEST_SEED:
        raise config.error("StartingSeed", f"{seed} found, expected at most {_LARGEST_SEED}")
    mapped.seed = Line("seed", seed, "StartingSeed; drawn from in another way, so runs differ from FREVO's")
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
        mapped.not_config.append(f"CurrentSeed = {one_line(config.shown('CurrentSeed'))}: state of FREVO")


def _map_simulation(session: Session, field_file: Path | None, instead: str | None, mapped: Mapped) -> None:
    problem = session.problem
    if instead is None:
        check(problem, replaceable=True)
        map_problem(session, field_file, mapped)
        return
    mapped.simulation = instead
    mapped.not_parameters += not_used(problem, f"an entry of {one_line(problem.class_name)}")
    mapped.notes.append(f"problem.class = {one_line(problem.class_name)}: {instead} is taken in its place")


def _map_method(session: Session, instead: str | None, mapped: Mapped) -> None:
    method = session.method
    if instead is None:
        check(method, replaceable=True)
        map_method(session, mapped)
        return
    mapped.method_kind = instead
    has = METHODS.get(instead).options_model.model_fields
    for ours, key, default in (("population", "populationsize", 50), ("generations", "generations", 200)):
        if ours in has and key in method.entries:
            mapped.method.append(Line(ours, method.take_integer(key, default, 1), key))
    mapped.not_method += not_used(method, f"an entry of {one_line(method.class_name)}")
    mapped.notes.append(f"method.class = {one_line(method.class_name)}: {instead} is taken in its place")


def _map_controller(session: Session, sensors: int | None, instead: str | None, mapped: Mapped) -> None:
    section = session.representation
    if instead is None:
        check(section, replaceable=True)
        map_representation(session, sensors, mapped)
        return
    mapped.controller_kind = instead
    leave_mutation_out(mapped)
    mapped.not_controller += not_used(section, f"an entry of {one_line(section.class_name)}")
    mapped.notes.append(
        f"representation.class = {one_line(section.class_name)}: {instead} is taken in its place"
    )


def _map_ranking(section: Section, instead: str | None, mapped: Mapped) -> None:
    threads = one_line(section.shown("parallelthreads", "1"))
    mapped.not_ranking.append(f"parallelthreads = {threads}: servers and processors are found by themselves")
    if instead is None:
        check(section, replaceable=True)
        return
    mapped.ranking_kind = instead
    mapped.not_ranking += not_used(section, f"an entry of {one_line(section.class_name)}")
    mapped.notes.append(f"ranking.class = {one_line(section.class_name)}: {instead} is taken in its place")
