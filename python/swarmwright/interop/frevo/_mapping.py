"""The conversion of a FREVO session to the lines of an experiment.

Converts the entries of FREVO's methods to options, and those of FREVO's Emergency Exit to parameters.
"""

import json
import math
import os
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError
from swarmwright.common.yaml import parse, remove_locations
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.experiment import validation
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.importing import Imported
from swarmwright.interop.frevo._document import (
    ABSOLUTE,
    CEA2D,
    COMPLETE,
    CUCKOO_SEARCH,
    EMERGENCY_EXIT,
    FULL_TOURNAMENT,
    GA_SPECIES,
    HEBBIAN,
    MACHINE,
    MESHED,
    MULTI_SORT,
    MULTI_SWISS,
    NEAT,
    NNGA,
    NOVELTY_RANKING,
    NOVELTY_SEARCH,
    NOVELTY_SPECIES,
    PSO,
    RANDOM_SEARCH,
    SECTIONS,
    SWISS,
    TITLE,
    FieldFile,
    Line,
    Mapped,
    Section,
    Session,
    check,
    find_field,
    format_field,
    open_session,
    report_unused,
    run_all,
    to_single_line,
)
from swarmwright.interop.frevo._methods import (
    map_cuckoo_search,
    map_ga_species,
    map_novelty_ranking,
    map_novelty_search,
    map_novelty_species,
    measure_all,
)
from swarmwright.interop.frevo._representations import map_representation, omit_mutation
from swarmwright.methods import METHODS
from swarmwright.methods.rankings import RANKINGS
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import make_absolute, make_relative

PONG, SOCCER = "pong.Pong", "components.simplesoccer.SimpleSoccer"
_ENTRIES = {
    PONG: ("playersPerTeam", "paddleHeight", "paddleSpeed", "numberOfBalls", "maximumSteps"),
    SOCCER: (
        "playersPerTeam",
        "position_weight",
        "ball_distance_weight",
        "kick_weight",
        "ball_goal_weight",
        "score_weight",
        "evaluation_time",
        "max_kicks",
    ),
}
_NUMBERS = {"paddleSpeed"}
"""Entries that need not be whole."""
_WITH_MEMORY = (MESHED, COMPLETE, HEBBIAN, NEAT)


def map_game(session: Session, parameters: Collection[str], mapped: Mapped) -> None:
    """Convert the entries of a game that a simulation has parameters for, and note what differs.

    Raises InputError for an entry that is not a number.

    Args:
        session: FREVO's session; does nothing for other problems than games.
        parameters: names of the simulation's parameters.
        mapped: gets lines and notes.
    """
    problem = session.problem
    keys = [
        key for key in _ENTRIES.get(problem.class_name, ()) if key in problem.entries and key in parameters
    ]
    if not keys:
        return
    mapped.parameters += [Line(key, _take(problem, key), key) for key in keys]
    if session.representation.class_name in _WITH_MEMORY:
        mapped.notes.append(
            f"problem.class = {problem.class_name}: in this problem, FREVO's controllers forget everything "
            "in each step; recurrent ones do not here"
        )


def _take(problem: Section, key: str) -> float:
    return problem.take_number(key, 0.0) if key in _NUMBERS else problem.take_integer(key, 0)


_PAIRINGS = {
    FULL_TOURNAMENT: "frevo_full_tournament",
    SWISS: "frevo_swiss_system",
    MULTI_SWISS: "frevo_multi_swiss",
    MULTI_SORT: "random",
}


def map_tournament(section: Section, mapped: Mapped, *, alone: bool) -> None:
    """Convert all entries. Raises InputError for an invalid entry, or a problem without opponents.

    Args:
        section: the ranking, a tournament.
        mapped: gets its lines.
        alone: whether the problem is Emergency Exit, in which candidates do not meet.
    """
    if alone:
        raise section.element.error(
            f"{section.class_name} is for candidates that meet, which Emergency Exit has not: use "
            "AbsoluteRanking, or name a simulation with two sides with --simulation"
        )
    name = section.class_name
    mapped.ranking_kind = "tournament"
    add = mapped.ranking.append
    add(Line("pairing", _PAIRINGS[name], "the pairs of this class"))
    if name == MULTI_SORT:
        add(Line("rounds", section.take_integer("evaluation_times", 10, 1), "evaluation_times"))
    add(Line("both_sides", "false", "two candidates meet once"))
    add(_score_line(name))
    if name == FULL_TOURNAMENT:
        mapped.ranking += [Line("win", 2, "FREVO's points"), Line("draw", 1, "FREVO's points")]
    elif name == SWISS:
        add(Line("win", section.take_integer("points_win", 2, 1), "points_win"))
        add(Line("draw", section.take_integer("points_tie", 1, 0), "points_tie"))
    elif name == MULTI_SWISS:
        mapped.notes.append(
            "ranking.class = MultiSwiss.MultiSwiss: games are for two; in FREVO, up to maximumCandidates of "
            "the problem play a game"
        )
    else:
        mapped.notes.append(
            "ranking.class = MultiSort.MultiSort: games are for two; FREVO takes the results of a problem "
            "for those of the players in their order, although problems name the best first"
        )


def _score_line(name: str) -> Line:
    if name == MULTI_SWISS:
        return Line("score", "frevo_multi_swiss", "the mean of 2 and 1")
    if name == MULTI_SORT:
        return Line("score", "fitness", "a mean, where FREVO has the sum")
    return Line("score", "points", "as in FREVO")


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
    GA_SPECIES: map_ga_species,
    CUCKOO_SEARCH: map_cuckoo_search,
    NOVELTY_SEARCH: map_novelty_search,
    NOVELTY_SPECIES: map_novelty_species,
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


@dataclass(frozen=True)
class Described:
    """What is known about a simulation.

    sensors: number of sensors of an agent; None if unknown. parameters, metrics: names, as far as known.
    """

    sensors: int | None
    parameters: Collection[str]
    metrics: Collection[str]


def map_session(
    session: Session,
    field_file: Path | None,
    replacements: Replacements,
    described: Described,
) -> Mapped:
    """Convert all entries.

    Args:
        session: FREVO's session.
        field_file: the field of Emergency Exit; None: the file that the session names.
        replacements: replacements of components.
        described: what is known about the simulation.

    Raises:
        InputError: an entry is invalid or has no counterpart; the message lists the problems of all
            sections, a line each.
    """
    mapped = Mapped(Line("seed", 0, ""))
    steps: list[Callable[[], None]] = [
        lambda: _map_config(session.config, mapped),
        lambda: _map_simulation(session, field_file, replacements.simulation, described.parameters, mapped),
        lambda: _map_method(session, replacements.method, mapped),
        lambda: _map_controller(session, described.sensors, replacements.controller, mapped),
        lambda: _map_ranking(session, replacements, mapped),
        lambda: measure_all(session, described.metrics, mapped),
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
        if section.class_name == NOVELTY_RANKING:
            map_novelty_ranking(section, mapped)
        elif section.class_name != ABSOLUTE:
            alone = replacements.simulation is None and session.problem.class_name == EMERGENCY_EXIT
            map_tournament(section, mapped, alone=alone)
        return
    mapped.ranking_kind = replacement
    mapped.not_ranking += report_unused(section, f"an entry of {to_single_line(section.class_name)}")
    mapped.notes.append(f"ranking.class = {to_single_line(section.class_name)}: {replacement} replaces it")


@check_arguments
def load(
    path: str | PathLike[str],
    *,
    field: str | PathLike[str] | None = None,
    folder: str | PathLike[str] = ".",
    simulation: str | None = None,
    method: str | None = None,
    controller: str | None = None,
    ranking: str | None = None,
) -> Imported:
    """Convert a FREVO session file (.zse), or the session in a result file (.zre), to an experiment.

    Args:
        path: the file.
        field: the field of Emergency Exit as JSON or as FREVO's .ser; default: the file beside the session
            that the session names.
        folder: folder of the experiment file; the path of a field in the experiment is relative to it.
        simulation: replaces FREVO's problem; a title, a class (the path of its file is relative to the
            current folder) or an environment, as in an experiment.
        method: kind of the method that replaces FREVO's, with its defaults and FREVO's numbers of candidates
            and generations.
        controller: kind of the controller that replaces FREVO's representation, with its defaults.
        ranking: kind of the ranking that replaces FREVO's, with its defaults.

    Raises:
        InputError: the file is not a FREVO session, or contains components without counterpart in
            Swarmwright; the message lists the problems of all sections with file, line and component or
            entry, a line each.
    """
    session = open_session(Path(path))
    absolute_name = None if simulation is None else make_absolute(simulation)
    METHODS.check("method", method)
    REPRESENTATIONS.check("controller", controller)
    RANKINGS.check("ranking", ranking)
    mapped = map_session(
        session,
        None if field is None else Path(field),
        Replacements(absolute_name, method, controller, ranking),
        _describe(absolute_name or TITLE),
    )
    text = _format_experiment(session, mapped, Path(folder))
    # The path of the field is relative to the folder of this name; the file does not exist.
    name = str(Path(folder) / "imported.yaml")
    try:
        experiment = Experiment(**validation.check(parse(text, name)))
    except InputError as error:
        problems = remove_locations(str(error), name)
        raise InputError(f"{path}: does not result in a valid experiment:\n{problems}") from error
    return Imported(text, experiment, tuple(mapped.notes))


def _describe(simulation: str) -> Described:
    """Return what is known about a simulation: nothing if it is not on this computer."""
    if not catalogue.is_local(simulation):
        return Described(None, (), ())
    described = catalogue.description(simulation)
    return Described(int(described["sensors"]), list(described["parameters"]), list(described["metrics"]))


def _format_experiment(session: Session, mapped: Mapped, folder: Path) -> str:
    problem, method, representation, ranking = (getattr(session, name) for name in SECTIONS)
    simulation = _format_simulation(mapped.simulation, folder)
    lines = [
        f"# Converted from the FREVO session {to_single_line(session.path.name)} by `swarmwright import`.",
        "# The comment of a line is the name of its entry in FREVO.",
        "",
        f"simulation: {simulation}  # {to_single_line(problem.class_name)}",
        "",
        "parameters:",
        *_format_block(mapped.parameters),
    ]
    if mapped.field_file is not None:
        lines += _format_field_lines(mapped.field_file, folder)
    lines += _format_omissions(mapped.not_parameters)
    lines += ["", "controller:", *_format_kind(mapped.controller_kind, representation)]
    lines += [*_format_block(mapped.controller), *_format_omissions(mapped.not_controller)]
    lines += ["", "method:", *_format_kind(mapped.method_kind, method)]
    lines += [*_format_block(mapped.method), *_format_omissions(mapped.not_method)]
    lines += ["", "ranking:", *_format_kind(mapped.ranking_kind, ranking)]
    lines += [*_format_block(mapped.ranking), *_format_omissions(mapped.not_ranking)]
    lines += ["", *_format_block([mapped.seed], ""), *_format_omissions(mapped.not_config, "")]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _format_kind(kind: str, section: Section) -> list[str]:
    return _format_block([Line("kind", kind, to_single_line(section.class_name))])


def _format_simulation(simulation: str, folder: Path) -> str:
    """Return the name of a simulation in an experiment file in this folder."""
    simulation = make_relative(simulation, folder)
    plain = re.fullmatch(r"[A-Za-z_][\w.-]*(:\w[\w.-]*)?", simulation)
    return simulation if plain else json.dumps(simulation, ensure_ascii=False)


def _relative_path(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return path.absolute().as_posix()


def _format_block(lines: list[Line], indent: str = "  ") -> list[str]:
    return [
        f"{indent}{line.key}: {_format_scalar(line.value)}".ljust(30) + f"  # {line.comment}"
        for line in lines
    ]


def _format_omissions(reasons: list[str], indent: str = "  ") -> list[str]:
    return [f"{indent}# not imported: {reason}" for reason in reasons]


def _format_field_lines(field: FieldFile, folder: Path) -> list[str]:
    if not field.is_json:
        return [
            f"  field:  # Filename, read from {to_single_line(field.path.name)}",
            *(f"    {x}" for x in format_field(field.value)),
        ]
    return [f"  field: {json.dumps(_relative_path(field.path, folder), ensure_ascii=False)}  # Filename"]


def _format_scalar(value: Any) -> str:  # noqa: ANN401 - bool, int, float or word
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)
