"""Checks of an experiment's values, separately and together."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import ValidationError

from swarmwright.common import suggestions
from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError, Report, format_value, problems_of
from swarmwright.common.registry import Registry
from swarmwright.common.simulation_names import is_command
from swarmwright.common.yaml import Path_, parse_path
from swarmwright.controllers import Representation
from swarmwright.controllers.kinds.hyperneat import HyperneatOptions
from swarmwright.controllers.kinds.parameter_set import ParameterSetOptions
from swarmwright.controllers.kinds.team import Team, TeamOptions, check_counts, largest_number, with_groups
from swarmwright.controllers.networks import NetworkOptions
from swarmwright.experiment import competition
from swarmwright.experiment.derived import steers_agents
from swarmwright.experiment.document import DEFAULT_KINDS, Checked, Document, Requirements
from swarmwright.experiment.evolved import iter_problems, iter_unknown
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.opponents import genomes_of
from swarmwright.experiment.ranking_checks import check_ranking
from swarmwright.experiment.start_from import samples_around_start
from swarmwright.methods import METHODS, MethodOptions
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.methods.rankings.multi_fidelity import MultiFidelityOptions
from swarmwright.methods.rankings.tournament import TournamentOptions
from swarmwright.simulations import catalogue
from swarmwright.simulations.catalogue import steers_itself, titles
from swarmwright.simulations.fitness import FitnessExpression
from swarmwright.simulations.parameters import ParameterMistake
from swarmwright.simulations.positions import positions


def check_parameters(simulation: str | None, parameters: dict[str, Any], report: Report) -> None:
    """Check that parameters can be sent as JSON, and that the simulation accepts them.

    Args:
        simulation: to ask; None if it is not available here.
        parameters: parameters of the experiment.
        report: called with each problem.
    """
    for path, problem in _iter_unsendable(parameters, ("parameters",)):
        report(path, problem)
        return
    if simulation is None:
        return
    names = catalogue.parameter_names(simulation)
    for key, problem in iter_unknown(simulation, parameters):
        report(("parameters", key), problem)
    everything = catalogue.takes_any(simulation)
    checkable = {key: value for key, value in parameters.items() if everything or key in names}
    for mistake in catalogue.parameter_mistakes(simulation, checkable):
        _report_parameter(mistake, checkable, report)


def _report_parameter(mistake: ParameterMistake, parameters: Mapping[str, Any], report: Report) -> None:
    """Report why a parameter is refused, with its position in the file."""
    if mistake.field == "mission.robots" and _has_own_radius(parameters):
        mistake = ParameterMistake("robot.radius", f"{mistake.reason}, or a smaller radius")
    if mistake.parameter in parameters:
        report(("parameters", *parse_path(mistake.field)), mistake.reason)
    else:  # its default conflicts with other parameters
        report(("parameters", mistake.parameter), f"parameter {mistake}")


def _has_own_radius(parameters: Mapping[str, Any]) -> bool:
    """Whether the arena's robots have an explicit radius, in a mission given by name."""
    robot, mission = parameters.get("robot"), parameters.get("mission")
    return isinstance(robot, Mapping) and "radius" in robot and not isinstance(mission, Mapping)


def _iter_unsendable(value: Any, path: Path_) -> Iterator[tuple[Path_, str]]:  # noqa: ANN401 - any value of a file
    """Yield values that JSON cannot represent."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if isinstance(key, str):
                yield from _iter_unsendable(inner, (*path, key))
            else:
                yield path, f"a key must be text, not {format_value(key)}"
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from _iter_unsendable(inner, (*path, index))
    elif isinstance(value, float) and not math.isfinite(value):
        yield path, f"must be a finite number, not {value}"
    elif not (value is None or isinstance(value, bool | int | float | str)):
        yield path, f"a value of the type {type(value).__name__} cannot be sent to a simulation"


def check_values(
    values: dict[str, Any],
    is_available: bool,
    report: Report,
    *,
    ask: bool,
    unread: bool = False,
) -> Checked:
    """Check the values of an experiment.

    Args:
        values: values of the file, with the contents of files that it names.
        is_available: whether the simulation can be asked.
        report: called with each problem.
        ask: whether code named in the file may be imported.
        unread: whether the file of a parameter could not be read, so that the simulation cannot be asked.

    Returns the checked values; invalid sections are missing or None.
    """
    checked: Checked = {}
    try:
        document = Document.model_validate(values)
        checked = {
            field.alias or name: getattr(document, name) for name, field in Document.model_fields.items()
        }
    except ValidationError as error:
        for path, message in problems_of(error, Document):
            form = _suggest_form(path, values)
            report(path, f"{message}{form}" if form else message)
    for name, registry in REGISTRIES.items():
        section = values.get(name, {})
        if isinstance(section, Mapping):
            checked[name] = _check_section(name, dict(section), registry, report, ask=ask)
    check_ranking(checked, report)
    parameters = values.get("parameters", {})
    if isinstance(parameters, Mapping) and isinstance(values.get("simulation"), str):
        check_parameters(values["simulation"] if is_available else None, dict(parameters), report)
    if "simulation" in checked:
        _check_measured(checked["simulation"] if is_available and ask else None, report)
        if unread:
            checked["controller"] = None
        else:
            _fill_in(checked, is_available, report)
            _check_groups(checked, is_available, report)
        competition.resolve(checked, values, is_available, report)
        reads_code = not ask and getattr(checked.get("controller"), "in_files", False)
        representation = None if reads_code else _check_representation(checked, report)
        _check_method(checked, representation, is_available, report)
        _check_evolved(checked, is_available, report)
        if is_available and is_command(checked["simulation"]):
            from swarmwright.experiment import commands  # noqa: PLC0415 - only where there is a command

            commands.check(checked, values, report)
        _check_start(checked, representation, report)
    return checked


def _check_start(checked: Checked, representation: Representation | None, report: Report) -> None:
    """Check that the controllers to start from match the experiment and the method."""
    start_from, method = checked.get("start_from"), checked.get("method")
    if not start_from or method is None:
        return
    kind, count = METHODS.get(method.kind), len(start_from)
    problem = kind.no_start(method, count) or kind.surplus(method, count)
    if problem is None and representation is not None:
        try:
            genomes_of(start_from, representation)
        except InputError as error:
            problem = str(error)
    if problem is not None:
        report(("start_from",), problem)


def _suggest_form(path: Path_, values: Mapping[str, Any]) -> str:
    """Return how to write a section that consists only of its kind: `method: cma_es`."""
    if len(path) != 1 or path[0] not in REGISTRIES:
        return ""
    kind, names = values.get(str(path[0])), REGISTRIES[str(path[0])].names()
    if not isinstance(kind, str):
        return ""
    if kind.endswith(".py") and REGISTRIES[str(path[0])].in_files:
        return f"; for a class in a file, write {kind}:Class"
    suggestion = suggestions.nearest(kind, names)
    return "" if suggestion is None else f"; write {{kind: {suggestion}}}"


def _check_section(
    name: str, section: dict[str, Any], registry: Registry[Any], report: Report, *, ask: bool
) -> Options | None:
    kind = section.get("kind", DEFAULT_KINDS[name])
    if not isinstance(kind, str):
        report(
            (name, "kind"),
            f"must be text, not {format_value(kind)}; available: {', '.join(registry.names())}",
        )
        return None
    try:
        model: type[Options] = registry.get(kind).options_model
    except InputError as error:
        report((name, "kind"), str(error))
        return None
    try:
        return model.model_validate(section, context={"ask": ask})
    except ValidationError as error:
        for path, message in problems_of(error, model, (name,), {name: section}):
            report(path, message)
        return None


def _check_measured(simulation: str | None, report: Report) -> None:
    """Check that a Python class measures the metrics that it announces.

    simulation: None if it is not available here, or its code must not be imported.
    """
    problem = None if simulation is None else catalogue.explain_missing_measure(simulation)
    if problem is not None:
        report(("simulation",), problem)


def _check_needed_metrics(checked: Checked, available: list[str] | None, title: str, report: Report) -> None:
    """Check that the metrics that the method needs besides fitness are given and exist.

    available: metrics of the simulation; None if only its servers know them.
    """
    method = checked.get("method")
    if not isinstance(method, MethodOptions):
        return
    kind: str = method.kind
    option = method.metrics_option
    if option is None:
        return
    names = method.needed_metrics
    if available is not None and not available:
        report(("method", option), f"{kind} needs metrics beside the fitness, but {title} reports none")
        return
    if not getattr(method, option):
        source = (
            "the simulation's metrics"
            if available is None
            else f"the metrics of {title}: {', '.join(available)}"
        )
        report(("method", option), f"is missing; name at least one of {source}")
    for name in names:
        if available is not None and name not in available:
            problem = suggestions.unknown("metric", name, available)
            if (option, name) == ("objectives", "fitness"):
                problem = "fitness is always the first objective and is maximized; leave it out"
            report(("method", method.option_of(name) or option, name), problem)


def _check_groups(checked: Checked, is_available: bool, report: Report) -> None:
    """Fill in the groups of a team that the simulation declares, and compare them with the file."""
    options = checked.get("controller")
    if not isinstance(options, TeamOptions):
        return
    try:
        declared = catalogue.groups(checked["simulation"], checked["parameters"]) if is_available else []
    except InputError:  # has been reported
        checked["controller"] = None
        return
    try:
        if declared:
            checked["controller"] = with_groups(options, declared, checked["simulation"])
            return
        if is_available and catalogue.find_built_in(checked["simulation"]) is not None:
            raise FieldError(("controller", "kind"), _explain_missing_groups(checked["simulation"]))
        if is_available or not catalogue.has_description(checked["simulation"]):
            check_counts(options)
        for name in ("sensors", "actuators"):
            if checked[name] is None:
                checked[name] = largest_number(options, name)
    except FieldError as error:
        report(error.path, error.reason)
        checked["controller"] = None


def _explain_missing_groups(simulation: str) -> str:
    """Return why a team cannot control the agents of a built-in simulation with these parameters."""
    hint = {
        "minisim": "set the parameter defenderSteering: controller to control defenders, too",
        "arena": "make the parameter robots a list of kinds of robots",
    }.get(catalogue.find_built_in(simulation) or "", "all its agents are alike")
    return (
        f"a team needs several kinds of agents, but {simulation} has one kind with these "
        f"parameters; {hint}, or use another kind of controller"
    )


def _check_representation(checked: Checked, report: Report) -> Representation | None:
    """Check that the controller matches the sensors and actuators; return it, or None if they are unknown."""
    options, sensors, actuators = (checked.get(name) for name in ("controller", "sensors", "actuators"))
    if options is None:
        return None
    component = REGISTRIES["controller"].get(options.kind)
    if not component.steers:
        sensors, actuators = sensors or 0, actuators or 0
    if sensors is None or actuators is None:
        return None
    try:
        representation: Representation = component(options, sensors=sensors, actuators=actuators)
    except FieldError as error:
        report(error.path, error.reason)
        return None
    except InputError as error:
        report(("controller",), str(error))
        return None
    return representation


def _check_method(
    checked: Checked, representation: Representation | None, is_available: bool, report: Report
) -> None:
    """Check that the method supports the representation and the operation.

    If sensors and actuators are unknown, this is checked when a server has announced them.
    """
    method = checked.get("method")
    if isinstance(checked.get("ranking"), TournamentOptions):
        if isinstance(representation, Team):
            competition.check_representations(checked, representation, is_available, report)
    elif method is not None:
        component = REGISTRIES["method"].get(method.kind)
        for name, reason in component.problems(method, representation).items():
            report(("method", name), reason)


def _check_evolved(checked: Checked, is_available: bool, report: Report) -> None:
    """Check that evolved parameters are not fixed ones and match the simulation."""
    options, parameters = checked.get("controller"), checked["parameters"]
    if isinstance(options, ParameterSetOptions):
        is_available = is_available and not any(_iter_unsendable(parameters, ()))
        for path, message in iter_problems(
            checked["simulation"], parameters, options.parameters, is_available=is_available
        ):
            report(path, message)


def _fill_in_positions(checked: Checked) -> None:
    """Fill in positions of sensors and actuators."""
    options = checked.get("controller")
    if isinstance(options, HyperneatOptions):
        sensors, actuators = positions(checked["simulation"], checked["parameters"])
        checked["controller"] = options.with_positions(sensors, actuators)


def _fill_in(checked: Checked, is_available: bool, report: Report) -> None:
    """Fill in values that the simulation announces; check that the file does not contradict them."""
    if not is_available:
        checked["requirements"] = checked["requirements"] or Requirements(dimensions=2)
        _check_needed_metrics(checked, None, "", report)
        return
    try:
        announced = catalogue.description(checked["simulation"], checked["parameters"])
    except InputError:  # has been reported
        return
    for name in ("sensors", "actuators"):
        if checked[name] is None:
            checked[name] = announced[name] or None
        elif checked[name] != announced[name]:
            report(
                (name,),
                f"{announced['title']} has {announced[name]}, not {checked[name]}; leave the key out",
            )
    _fill_in_positions(checked)
    options = checked.get("controller")
    if options is not None and not announced["sensors"] and REGISTRIES["controller"].get(options.kind).steers:
        report(
            ("controller", "kind"),
            f"{options.kind} controls agents, but agents of {announced['title']} control themselves (they "
            "have no sensors); use parameter_set",
        )
    checked["requirements"] = checked["requirements"] or Requirements(dimensions=announced["dimensions"])
    metrics = list(announced["metrics"])
    _check_needed_metrics(checked, metrics, announced["title"], report)
    for name in checked["constraints"]:
        if name not in metrics:
            report(("constraints", name), _explain_unknown_metric(name, metrics, announced["title"]))
    if checked["fitness"] is not None:
        problem = FitnessExpression(checked["fitness"]).unknown(metrics, announced["title"])
        if problem is not None:
            if is_command(checked["simulation"]):
                problem += "; list the metrics of a command in simulation.metrics: [NAME, ..]"
            report(("fitness",), problem)


def _explain_unknown_metric(name: str, metrics: list[str], title: str) -> str:
    if not metrics:
        return f"constraints need metrics, but {title} reports none"
    return suggestions.unknown("metric", name, metrics)


_OUTPUT_RANGES = {"tanh": (-1.0, 1.0), "sigmoid": (0.0, 1.0), "clamp": (0.0, 1.0), "relu": (0.0, math.inf)}
"""Lowest and highest output of a node, by activation; other activations are unlimited."""


def find_setting_warnings(experiment: Experiment) -> list[str]:
    """Return warnings about changed keys without effect or with an undesired effect."""
    method, validate = experiment.method, experiment.validate
    warnings = []
    if method.operation != "steady_state":
        warnings += [
            f"method.{key} has no effect with operation: {method.operation}"
            for key in _iter_changed(method, "in_flight")
        ]
    if not validate.transfers:
        warnings += [
            f"validate.{key} has no effect without validate.to, validate.vary or validate.pseudo_reality"
            for key in _iter_changed(validate, "seeds", "random")
        ]
    if experiment.start_from is not None and samples_around_start(experiment) and validate.episodes == 0:
        warnings.append(
            f"start_from: {method.kind} samples around the controller without keeping it; with validate: "
            "false, the run does not show whether its best is better"
        )
    ranking = experiment.ranking
    if method.needed_metrics and ranking.seeds == "new" and not getattr(method, "reevaluate", 0):
        episodes = ranking.episodes
        warnings.append(
            f"ranking.seeds: new makes {method.kind} compare candidates across seeds, so that those with "
            f"easy seeds survive; use seeds: same with more episodes (ranking.episodes is {episodes}), and "
            "evaluate the result on held-out seeds"
        )
    if isinstance(ranking, MultiFidelityOptions) and ranking.seeds == "new" and (ranking.memory or 1) > 1:
        warnings.append(
            f"ranking.memory: {ranking.memory} with seeds: new corrects fitness by differences on other "
            "seeds; leave it out, or use seeds: same"
        )
    return [*warnings, *_iter_constant_fitness(experiment)]


def _iter_constant_fitness(experiment: Experiment) -> Iterator[str]:
    """Yield warnings about settings with which all controllers have the same fitness."""
    simulation, parameters, controller = experiment.simulation, experiment.parameters, experiment.controller
    if steers_agents(experiment) and simulation in titles() and steers_itself(simulation, parameters):
        yield (
            f"controller: {controller.kind} controls agents, but agents of {simulation} control "
            "themselves with "
            "these parameters, so all candidates have the same fitness; change the parameters, or evolve "
            "them with controller: {kind: parameter_set}"
        )
    if isinstance(controller, NetworkOptions) and controller.last_activation in _OUTPUT_RANGES:
        (low, high), (least, most) = controller.outputs, _OUTPUT_RANGES[controller.last_activation]
        if most <= low or high <= least:
            reached = f"{least:g} to {most:g}" if math.isfinite(most) else f"{least:g} or more"
            yield (
                f"controller.output_range: [{low:g}, {high:g}] is outside the outputs of "
                f"{controller.last_activation}, {reached}, so actuators are constant for all controllers"
            )
    mission = parameters.get("mission")
    metrics = mission.get("metrics") if isinstance(mission, Mapping) else None
    for name, metric in metrics.items() if isinstance(metrics, Mapping) else ():
        if isinstance(metric, Mapping) and metric.get("kind") == "returns":
            sources = metric.get("sources")
            if isinstance(sources, list) and metric.get("nest") in sources:
                yield (
                    f"parameters.mission.metrics.{name}: its nest {metric['nest']!r} is also one of its "
                    "sources, so no robot is counted; use another patch"
                )


def _iter_changed(options: Options, *keys: str) -> Iterator[str]:
    """Yield the keys whose values differ from the defaults."""
    fields = type(options).model_fields
    return (key for key in keys if getattr(options, key) != fields[key].default)
