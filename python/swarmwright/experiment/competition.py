"""Competitions: the sides of matches, and the populations whose candidates play them.

In an experiment, a competition is a `team` with a group for each side, whose controllers come from one or
several populations, and a ranking `tournament` with the fitness of each side.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from swarmwright.common.arrays import Genome
from swarmwright.common.engine_types import SideFields
from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.problems import FieldError, Report, format_value, problems_of
from swarmwright.common.random_numbers import Stream
from swarmwright.common.simulation_names import is_python
from swarmwright.common.suggestions import unknown
from swarmwright.common.untrusted import escape_line
from swarmwright.common.yaml import Path_
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.controllers.kinds.team import Team, TeamOptions
from swarmwright.controllers.teams import TEAM
from swarmwright.experiment.document import AUTO, DEFAULT_KINDS, Checked, PopulationSection
from swarmwright.experiment.opponents import Opponent, check_fits, genomes_of, load_opponent
from swarmwright.experiment.unavailable import method_of, options_with_code
from swarmwright.methods import METHODS, Method, MethodOptions
from swarmwright.methods.competition import Competition, Population
from swarmwright.methods.rankings.pairings import PAIRINGS
from swarmwright.methods.rankings.tournament import BETWEEN_POPULATIONS, ONLY_OPPONENTS, TournamentOptions
from swarmwright.simulations import catalogue
from swarmwright.simulations.fitness import FITNESS_NAME, FitnessExpression

if TYPE_CHECKING:
    from swarmwright.controllers import Representation
    from swarmwright.experiment.experiment import Experiment

TOURNAMENT = "tournament"
"""Kind of the ranking of every competition."""
_NEGATIVE = f"-{FITNESS_NAME}"
"""Fitness of the second side by default."""
_LIMITS = ("generations", "evaluations", "seconds", "target")
"""Options of the run's method that its populations cannot have."""


def expand(values: dict[str, Any], is_available: bool, report: Report) -> tuple[dict[str, Any], Report]:
    """Write the controllers of a competition as a team; return the values and a report in the file's terms.

    Args:
        values: values of an experiment file.
        is_available: whether the simulation can be asked.
        report: called with each problem.
    """
    ranking, populations = values.get("ranking", {}), values.get("populations") or {}
    kind = ranking.get("kind") if isinstance(ranking, Mapping) else None
    if not isinstance(populations, Mapping) or not (populations or kind == TOURNAMENT):
        return values, report
    if kind is None and isinstance(ranking, Mapping):
        values = {**values, "ranking": {"kind": TOURNAMENT, **ranking}}
    elif kind != TOURNAMENT:
        report(
            ("ranking", "kind"),
            f"must be {TOURNAMENT} in an experiment with populations, not {format_value(kind)}; leave it out",
        )
        return values, report
    controller = values.get("controller", {})
    if not isinstance(controller, Mapping):
        return values, report
    if controller.get("kind") == TEAM:
        return values, report
    names = _name_sides(values, is_available, report)
    if not names:
        return values, report
    groups = {}
    for name in names:
        section = populations.get(name, {})
        own = section.get("controller") if isinstance(section, Mapping) else None
        groups[name] = own if isinstance(own, Mapping) and own else dict(controller)
    values = {**values, "controller": {"kind": TEAM, "groups": groups}}
    only = _name_sides_of_opponents(values)
    if only and not _copy_controllers(only, values, report):
        return values, report
    return values, _wrap(report, populations)


def _name_sides_of_opponents(values: Mapping[str, Any]) -> list[str]:
    """Return the sides without a population, which opponents alone play."""
    populations, opponents = values.get("populations"), values["ranking"].get("opponents")
    if not populations or not isinstance(opponents, Mapping):
        return []
    return [str(side) for side in opponents if side not in populations]


def _copy_controllers(sides: Sequence[str], values: dict[str, Any], report: Report) -> bool:
    """Give sides without a population the controller of their first opponent; return whether that worked.

    `opponents_of` compares the architecture of all of them with it.
    """
    groups = values["controller"]["groups"]
    for side in sides:
        entries = values["ranking"]["opponents"][side]
        if not isinstance(entries, list) or not entries or not entries[0]:  # is reported elsewhere
            return False
        try:
            architecture = load_opponent(entries[0]).playing(side).architecture
        except SwarmwrightError as error:
            report(("ranking", "opponents", side), str(error))
            return False
        groups[side] = REPRESENTATIONS.get(architecture["kind"]).options_of(architecture)
    return True


def _name_sides(values: Mapping[str, Any], is_available: bool, report: Report) -> list[str]:
    """Return the names of the sides in the file, or else those of the simulation; empty after a report."""
    groups = _name_groups(values) if is_available else []
    populations, sides = values.get("populations") or {}, values["ranking"].get("sides")
    named = [*populations, *_name_sides_of_opponents(values)]
    if not populations and isinstance(sides, list | tuple | Mapping):
        named = [*sides]
    names = list(dict.fromkeys(map(str, named or groups)))
    path: Path_ = ("populations",) if populations else ("ranking", "sides")
    if len(names) < 2:
        if is_available and len(groups) < 2:
            subject = f"{values['simulation']} has only one kind of agents with these parameters"
            report(path, f"{subject}, so there are no sides that could meet")
        elif populations or not named:  # else the ranking reports it
            hint = ", or list opponents for it: ranking.opponents: {SIDE: [..]}" if populations else ""
            report(path, f"a match needs at least two sides; name them all{hint}")
        return []
    for name in names:
        if groups and name not in groups:
            above: Path_ = path if name in populations else ("ranking", "opponents")
            report((*above, name) if populations else path, unknown("side", name, groups))
            return []
    return names


def _name_groups(values: Mapping[str, Any]) -> list[str]:
    """Return the names of the simulation's groups; empty if all agents are alike, or after a mistake."""
    try:
        groups = catalogue.groups(values["simulation"], dict(values.get("parameters", {})))
    except (InputError, TypeError, ValueError):  # is reported elsewhere
        return []
    return [group.name for group in groups]


def _wrap(report: Report, populations: Mapping[str, Any]) -> Report:
    """Wrap a report, so that problems of the team's groups are those of the file's controllers."""
    reported = set()

    def report_side(path: Path_, message: str) -> None:
        if path[:2] == ("controller", "groups") and len(path) > 2:
            own = populations.get(str(path[2]), {})
            has_own = isinstance(own, Mapping) and own.get("controller")
            before: Path_ = ("populations", path[2], "controller") if has_own else ("controller",)
            if populations and str(path[2]) not in populations:
                path = ("ranking", "opponents", path[2])
            else:
                path = (*before, *path[3:])
        elif path[:2] == ("controller", "groups"):
            path = ("populations",) if populations else ("ranking", "sides")
        if (path, message) not in reported:  # both sides may have the same controller
            reported.add((path, message))
            report(path, message)

    return report_side


def resolve(checked: Checked, values: Mapping[str, Any], is_available: bool, report: Report) -> None:
    """Fill in the fitness of each side and the methods of the populations, and check them.

    Args:
        checked: values of the experiment, checked by themselves.
        values: the same as written.
        is_available: whether the simulation can be asked.
        report: called with each problem.
    """
    populations: Mapping[str, PopulationSection] = checked.get("populations") or {}
    checked["populations"] = {}
    ranking, controller = checked.get("ranking"), checked.get("controller")
    if not isinstance(ranking, TournamentOptions):
        return
    if ranking.pairing == ONLY_OPPONENTS and not ranking.opponents:
        report(("ranking", "opponents"), "missing; with pairing: opponents, candidates meet nobody else")
    if not populations:
        _check_method(checked.get("method"), ("method",), report)
    if not isinstance(controller, TeamOptions):
        return
    names = list(controller.groups)
    if not _check_names(names, populations, ranking, report):
        return
    if populations:
        if len(populations) < len(names) and "pairing" not in values.get("ranking", {}):
            ranking = checked["ranking"] = ranking.model_copy(update={"pairing": ONLY_OPPONENTS})
        _check_populations(populations, names, ranking, report)
        checked["populations"] = {
            name: options
            for name in names
            if name in populations
            and (options := _method_of(name, populations[name], values, report)) is not None
        }
    else:
        _check_mirrored(controller, report)
    sides = _find_fitness(checked, populations, names, is_available, report)
    if sides is not None:
        checked["ranking"] = ranking.model_copy(update={"sides": sides})
        checked["fitness"] = sides[names[0]] if sides[names[0]] != FITNESS_NAME else checked.get("fitness")
    validate = checked.get("validate")
    # Fitness depends on the opponents, not only on seeds.
    if validate is not None and validate.episodes == AUTO:
        checked["validate"] = validate.model_copy(update={"episodes": 0})
    if checked.get("start_from") is not None:
        report(("start_from",), "is not possible in a competition; leave it out")


def _check_names(
    names: list[str], populations: Mapping[str, PopulationSection], ranking: TournamentOptions, report: Report
) -> bool:
    """Return whether populations and sides have the names of the groups; report if they do not."""
    if len(names) < 2:
        report(("ranking", "sides"), f"a match needs at least two sides, but there is only {names[0]}")
        return False
    opponents = ranking.opponents if isinstance(ranking.opponents, Mapping) else {}
    for key, written in (
        ("populations", populations),
        ("ranking.sides", ranking.sides or {}),
        ("ranking.opponents", opponents),
    ):
        for name in written:
            if name not in names:
                report((*key.split("."), name), unknown("side", name, names))
                return False
        played = opponents if written is populations else ()
        missing = [name for name in names if name not in written and name not in played]
        if written and missing and written is not opponents:
            report(tuple(key.split(".")), f"{', '.join(missing)} missing; name all sides: {', '.join(names)}")
            return False
    return True


def _find_fitness(
    checked: Checked,
    populations: Mapping[str, PopulationSection],
    names: list[str],
    is_available: bool,
    report: Report,
) -> dict[str, str] | None:
    """Return the fitness of each side as an expression; None after a report."""
    announced = _find_announced_fitness(checked) if is_available else {}
    written = checked["ranking"].sides or {}
    sides: dict[str, str] = {}
    first = names[0]
    for name in names:
        own = populations[name].fitness if name in populations else None
        text = own or written.get(name) or announced.get(name)
        if text is None and name == first:
            text = checked.get("fitness") or FITNESS_NAME
        if text is None and len(names) == 2:
            text = _NEGATIVE
        if text is None:
            field = ("populations", name, "fitness") if populations else ("ranking", "sides", name)
            report(
                field, f"missing; only a match of two sides has the negative fitness of {first} by default"
            )
            return None
        sides[name] = text
        field = ("populations", name, "fitness") if own else ("ranking", "sides", name)
        try:
            expression = FitnessExpression(text)
        except ValueError as error:
            report(field, str(error))
            return None
        if is_available:
            described = catalogue.description(checked["simulation"], checked["parameters"])
            problem = expression.unknown(list(described["metrics"]), described["title"])
            if problem is not None:
                report(field, problem)
                return None
    return sides


def _find_announced_fitness(checked: Checked) -> dict[str, str]:
    """Return the metric that is the fitness of each group's side, where the simulation announces one."""
    try:
        sides = catalogue.sides(checked["simulation"], checked["parameters"])
    except InputError:  # has been reported
        return {}
    return {group: side.fitness for side in sides for group in side.groups if side.fitness is not None}


def _check_mirrored(controller: TeamOptions, report: Report) -> None:
    """Check that candidates of one population can play all sides."""
    groups = list(controller.groups.items())
    name, first = groups[0]
    for other, group in groups[1:]:
        if group.options != first.options:
            report(
                ("controller", "groups", other),
                f"differs from that of {name}; one population has one kind of controller: use populations",
            )
            return
        for noun in ("sensors", "actuators"):
            counts = getattr(first, noun), getattr(group, noun)
            if counts[0] != counts[1]:
                report(
                    ("ranking", "sides"),
                    f"{name} has {counts[0]} {noun} and {other} has {counts[1]}, so one controller cannot "
                    "play both; use populations with a controller for each side",
                )
                return
    if len(groups) != 2:
        report(("ranking", "sides"), f"one population plays two sides, not {len(groups)}; use populations")


def _check_populations(
    populations: Mapping[str, PopulationSection],
    names: Sequence[str],
    ranking: TournamentOptions,
    report: Report,
) -> None:
    if ranking.pairing not in BETWEEN_POPULATIONS:
        report(
            ("ranking", "pairing"),
            f"{ranking.pairing} is for one population; use {', '.join(sorted(BETWEEN_POPULATIONS))}",
        )
    if ranking.score not in {None, "fitness", "points"}:
        report(("ranking", "score"), f"{ranking.score} is for one population; use fitness or points")
    only = [name for name in names if name not in populations]
    if only and len(names) > 2:
        report(
            ("populations",),
            f"{', '.join(only)} missing; only of two sides, one may be played by opponents alone",
        )
    elif only and ranking.pairing != ONLY_OPPONENTS:
        report(
            ("ranking", "pairing"),
            f"{ranking.pairing} needs a population of {only[0]}; leave the key out, as opponents alone play "
            f"{only[0]}",
        )


def _method_of(
    name: str, population: PopulationSection, values: Mapping[str, Any], report: Report
) -> MethodOptions | None:
    """Return the options of a population's method, without limits; None after a report."""
    path: Path_ = ("populations", name, "method")
    own = dict(population.method)
    for key in _LIMITS:
        if key in own:
            report((*path, key), "limits are those of the whole run; move it to method")
            return None
    common = values.get("method", {})
    common = dict(common) if isinstance(common, Mapping) else {}
    if own.get("kind", common.get("kind")) != common.get("kind"):
        common = {}
    section = {**{key: value for key, value in common.items() if key not in _LIMITS}, **own}
    kind = section.get("kind", DEFAULT_KINDS["method"])
    if not isinstance(kind, str):
        report((*path, "kind"), f"must be text, not {format_value(kind)}")
        return None
    if METHODS.is_in_file(kind):
        report(
            (*path, "kind"), f"{kind} is a class in a file; install it as a plug-in, or use one population"
        )
        return None
    try:
        model = METHODS.get(kind).options_model
    except InputError as error:
        report((*path, "kind"), str(error))
        return None
    try:
        options: MethodOptions = model.model_validate(section, context={"ask": True})
    except ValidationError as error:
        for inner, message in problems_of(error, model, path, {"populations": {name: {"method": section}}}):
            report(inner, message)
        return None
    _check_method(options, path, report)
    return options


def _check_method(options: object, path: Path_, report: Report) -> None:
    """Check that a method can evolve a population of a competition."""
    if not isinstance(options, MethodOptions):
        return
    if options.operation == "steady_state":
        report((*path, "operation"), "a competition has generations; leave the key out")
    elif METHODS.get(options.kind).by_instance or options.needed_metrics:
        kind: str = options.kind
        report((*path, "kind"), f"{kind} cannot evolve a population of a competition; use another method")


def check_representations(checked: Checked, representation: Team, is_available: bool, report: Report) -> None:
    """Check that each population's method can evolve its controllers, and that opponents fit.

    Args:
        checked: values of the experiment.
        representation: of the joined genomes.
        is_available: whether the simulation can be asked.
        report: called with each problem.
    """
    populations: Mapping[str, MethodOptions] = checked.get("populations") or {}
    simulation = checked["simulation"]
    is_known = is_available or not is_python(simulation)
    try:
        opponents_of(checked["ranking"], representation, populations, simulation if is_known else "")
    except FieldError as error:
        report(error.path, error.reason)
    for name, part in representation.parts.items():
        if populations and name not in populations:
            continue
        options = populations.get(name, checked.get("method"))
        path: Path_ = ("populations", name, "method") if name in populations else ("method",)
        if isinstance(options, MethodOptions):
            kind = METHODS.get(options.kind)
            for key, reason in kind.problems(options, part).items():
                report((*path, key), reason)
            ranking = checked["ranking"]
            meets_others = populations or ranking.opponents or ranking.pairing not in PAIRINGS
            if not meets_others and kind.first_generation(options, part) == 1:
                report(path, f"has a single candidate, but {ranking.pairing} lets candidates meet; use more")
        if not populations:
            break


def opponents_of(
    options: TournamentOptions, representation: Team, populations: Collection[str], simulation: str = ""
) -> dict[str, dict[int, Genome]]:
    """Return the genomes of the external opponents that play each side, by their number.

    They are numbered from 0 in the order of the file, those of a mapping side by side.

    Args:
        options: with the opponents.
        representation: of the joined genomes.
        populations: sides with a population; none if one plays all sides.
        simulation: in which the opponents must have been evolved, as far as that is known; empty for any.

    Raises FieldError if an opponent does not fit, or if a population meets no opponent and nobody else.
    """
    entries, parts = options.opponents or {}, representation.parts
    chosen: dict[str, dict[int, Genome]] = {name: {} for name in parts}
    titles = (catalogue.title(simulation),) if simulation else ()

    def find_problem(side: str, number: int, opponent: Opponent) -> str | None:
        """Let an opponent play a side; return why it cannot."""
        part = parts[side]
        try:
            controller = opponent.playing(side)
            check_fits(controller, part.sensors, part.actuators, simulation, titles=titles)
            chosen[side][number] = genomes_of([controller.entry], part)[0]
        except InputError as error:
            return str(error)
        return None

    if isinstance(entries, Mapping):  # in the order of the sides, as numbers must be those of any reading
        listed = [
            (side, number, entry) for side in parts for number, entry in enumerate(entries.get(side, ()))
        ]
    else:
        listed = [("", number, entry) for number, entry in enumerate(entries)]
    if not all(entry for _, _, entry in listed):  # one could not be read, which has been reported
        return chosen
    for index, (side, number, entry) in enumerate(listed):
        opponent = load_opponent(entry)
        problems = [find_problem(name, index, opponent) for name in ([side] if side else parts)]
        if None not in problems:
            raise FieldError(("ranking", "opponents", *filter(None, (side,)), number), str(problems[0]))
    for side in populations if options.pairing == ONLY_OPPONENTS else ():
        if not any(chosen[name] for name in parts if name != side):
            raise FieldError(
                ("ranking", "opponents"),
                f"{side} would meet nobody; list opponents for another side, or choose another pairing",
            )
    return chosen


def check_announced(experiment: "Experiment", announced: Iterable[tuple[int, Sequence[SideFields]]]) -> None:
    """Check that the experiment uses the fitness of sides that servers announce.

    announced: each server with its sides.

    Raises InputError if the experiment has the default fitness, as the servers were not asked before.
    """
    ranking = experiment.ranking
    if not isinstance(ranking, TournamentOptions):
        return
    for server, sides in announced:
        fitness = {group: text for side in sides if (text := side.get("fitness")) for group in side["groups"]}
        if any(ranking.sides.get(name) in {FITNESS_NAME, _NEGATIVE} for name in fitness):
            written = ", ".join(f"{name}: {fitness.get(name, text)}" for name, text in ranking.sides.items())
            raise InputError(
                f"ranking.sides: server {server} announces a fitness for each side; use it, "
                f"sides: {{{escape_line(written)}}}, or write another expression for each"
            )


def new_competition(experiment: "Experiment", representation: "Representation") -> Competition:
    """Return the method of a competition in its initial state.

    representation: of the joined genomes.
    """
    assert isinstance(representation, Team)
    assert isinstance(experiment.ranking, TournamentOptions)
    parts = representation.parts
    names = list(parts)
    opponents = opponents_of(experiment.ranking, representation, experiment.populations)
    limit = {"generations": experiment.method.generations}
    if experiment.populations:
        chosen: list[tuple[str, MethodOptions, tuple[int, ...]]] = [
            (name, experiment.populations[name], (side,))
            for side, name in enumerate(names)
            if name in experiment.populations
        ]
    else:
        chosen = [(names[0], experiment.method, tuple(range(len(names))))]
    populations = []
    for number, (name, options, sides) in enumerate(chosen):
        unlimited = options_with_code("method", options).model_copy(
            update={**limit, "evaluations": None, "seconds": None, "target": None}
        )
        seed = experiment.seed
        if number:  # another one for each population, unrelated to those of other experiments
            seed = int(Stream(seed, "competition.population", 0, number).raw(1)[0]) % 2**63
        method: Method = method_of(unlimited)(unlimited, parts[name], seed=seed)
        populations.append(Population(name, method, sides))
    return Competition(
        experiment.method,
        representation,
        populations=populations,
        opponents=[opponents[name] for name in names],
        sizes=[part.genome_size for part in parts.values()],
        tournament=experiment.ranking,
        seed=experiment.seed,
    )


def needed_metrics(options: TournamentOptions) -> tuple[str, ...]:
    """Return the metrics that the fitness of the sides needs."""
    expressions = [FitnessExpression(text) for text in (options.sides or {}).values() if text]
    return tuple(dict.fromkeys(name for each in expressions for name in each.metrics))
