"""Checks of experiments whose simulation is a command, an FMU or a ROS system."""

import importlib.util
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.common.problems import Report, format_value
from swarmwright.common.suggestions import did_you_mean, suggest_or_list
from swarmwright.common.yaml import Path_
from swarmwright.controllers.kinds.parameter_set import ChoiceParameter, ParameterSetOptions
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.simulations import catalogue
from swarmwright.simulations.command import (
    bags,
    fmu_definition,
    logs,
    parameter_file,
    placeholders,
    process,
    work_files,
)
from swarmwright.simulations.command.checking import parse_name, read_definition
from swarmwright.simulations.command.definition import CommandOptions, Definition
from swarmwright.simulations.command.fmu_definition import FmuOptions
from swarmwright.simulations.command.placeholders import IN_A_COMMAND, Template, Values, is_choice, names_in
from swarmwright.simulations.command.ros_definition import INSTANCE_PLACEHOLDERS, RosOptions
from swarmwright.simulations.fitness import FITNESS_NAME, ExpressionError, FitnessExpression

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment

INVALID = "command"
"""Name that stands for a simulation with an invalid definition."""
_MARGIN_S = 30.0
"""Seconds added to the command's time limit for files and messages."""
_LARGEST_SCRIPT = 1 << 20
"""Size limit of files to search for the name of the parameter file, bytes."""


def name_of(
    definition: Mapping[str, Any], values: Mapping[str, Any], base: Path | None, report: Report
) -> str:
    """Return the name of the simulation that a mapping defines; `WRONG` after reporting problems.

    Args:
        definition: the mapping.
        values: values of the experiment, whose fitness applies unless the simulation has its own.
        base: the folder of relative paths; None for that of a run, whose files were checked.
        report: called with each problem.
    """
    invalid: list[Path_] = []

    def note(path: Path_, message: str) -> None:
        invalid.append(path)
        report(("simulation", *path), message)

    fields = dict(definition)
    for key, text in (("simulation", fields.get("fitness")), ("", values.get("fitness"))):
        expression = _parse_expression(text)
        if isinstance(expression, str) and key:
            note(("fitness",), expression)
        elif (
            isinstance(expression, FitnessExpression)
            and not key
            and "fitness" not in fields
            and not expression.uses_simulation_fitness
        ):
            fields["fitness"] = expression.text
    if "fmu" in fields and "actuators" not in fields and not _controls_agents(values):
        fields["actuators"] = []
    options, problems = read_definition(fields, Path(), base)
    for path, message in problems:
        note(path, message)
    unknown: list[tuple[str, str]] = []
    if isinstance(options, RosOptions):
        unknown = _find_unknown_metrics(options, list(options.metrics))
    elif isinstance(options, FmuOptions) and base is not None:
        unknown = _find_unknown_metrics(options, list(options.rebase(base).columns))
    for key, message in unknown:
        if key == "fitness" and key not in definition:  # the experiment's fitness
            invalid.append((key,))
            report((key,), message)
        else:
            note((key,), message)
    return INVALID if options is None or invalid else options.name


def _controls_agents(values: Mapping[str, Any]) -> bool:
    """Return whether the experiment's controller controls agents, as far as known."""
    controller = values.get("controller")
    kind = controller.get("kind") if isinstance(controller, Mapping) else None
    return kind not in REGISTRIES["controller"].names() or REGISTRIES["controller"].get(str(kind)).steers


def _parse_expression(text: Any) -> FitnessExpression | str | None:  # noqa: ANN401 - whatever the file says
    """Parse an expression; return it, its problem as text, or None without an expression."""
    if not isinstance(text, str):
        return None
    try:
        return FitnessExpression(text)
    except ExpressionError as error:
        return str(error)


def check(checked: dict[str, Any], values: Mapping[str, Any], report: Report) -> None:
    """Check that an experiment's other keys match its command; fill in the time limit of a step.

    values: values of the file.
    """
    name = checked["simulation"]
    definition = parse_name(name)
    options = definition.as_command()
    _check_controller(options, checked, report)
    if isinstance(definition, RosOptions):
        _check_ros(definition, checked, report)
        reports_fitness = False
    elif isinstance(definition, FmuOptions):
        reports_fitness = definition.reports_fitness
    else:
        _check_placeholders(options, checked, report)
        reports_fitness = options.controller == "stepwise"
    announced = catalogue.description(name)["metrics"]
    if options.fitness is None and checked["fitness"] is None and not reports_fitness:
        measured = list(options.metrics) or list(announced)
        if measured and FITNESS_NAME not in measured:
            report(
                ("fitness",),
                f"is missing; write an expression over the metrics {', '.join(measured)}, such as "
                f'fitness: "-{measured[0]}" (higher is better)',
            )
    waits = values.get("timeouts")
    if not (isinstance(waits, Mapping) and waits.get("step") is not None):
        timeouts = checked["timeouts"]
        step = max(timeouts.step, options.timeout + _MARGIN_S)
        checked["timeouts"] = timeouts.model_copy(update={"step": step})


def find_missing(name: str) -> str | None:
    """Return a requirement of a simulation's command that this machine lacks, "key: reason", or None."""
    definition = parse_name(name)
    if isinstance(definition, FmuOptions):
        return fmu_definition.explain_missing(definition)
    options = definition.as_command()
    if isinstance(definition, RosOptions) and definition.connection == "dds":
        if importlib.util.find_spec("cyclonedds") is None:
            return "middleware: dds needs Cyclone DDS; run pip install 'swarmwright[ros2]'"
        return None
    folder = Path(options.folder)
    problem = process.explain_missing_program(options.command, folder) or process.explain_missing_script(
        options.command, folder, work_files.resolve_files(options.files, folder)
    )
    if problem is not None:
        return f"{'python' if isinstance(definition, RosOptions) else 'command'}: {problem}"
    reasons = (
        bags.explain_missing_library(logs.choose_format(log, options.log_format)) for log in options.log
    )
    reason = next(filter(None, reasons), None)
    return None if reason is None else f"log: {reason}"


def _check_controller(options: CommandOptions, checked: Mapping[str, Any], report: Report) -> None:
    controller = checked.get("controller")
    if controller is None:
        return
    steers = REGISTRIES["controller"].get(controller.kind).steers
    if steers and options.controller == "none":
        report(
            ("controller", "kind"),
            f"{controller.kind} controls agents, but the command receives no controller. To evolve "
            "parameters "
            "of the command, write controller: {kind: parameter_set, parameters: {NAME: {type: real, range: "
            "[0, 1]}}}; to pass controllers to it, set simulation.controller, for example to json or "
            "stepwise",
        )
    elif steers:
        for name in ("sensors", "actuators"):
            if getattr(options, name) is None:
                report(("simulation", name), f"is missing; give the number of {name} of an agent")
    elif not steers and options.takes_controller:
        report(
            ("simulation", "controller"),
            f"{controller.kind} has no controller to write as a file; leave the key out",
        )
    if options.takes_controller and checked["mode"] in {"stepwise", "batched"}:
        report(
            ("mode",),
            f"{checked['mode']} keeps controllers in this process, but the command receives its "
            "controller as a file; leave the key out",
        )


def _check_placeholders(options: CommandOptions, checked: Mapping[str, Any], report: Report) -> None:
    """Check the placeholders, as far as parameters are known."""
    controller = checked.get("controller")
    evolved = controller.parameters if isinstance(controller, ParameterSetOptions) else {}
    parameters = [*catalogue.parameter_names(checked["simulation"]), *checked["parameters"], *evolved]
    if options.controller == "stepwise":
        parameters = []
    names = [*IN_A_COMMAND, *parameters]
    templates: list[tuple[Path_, Template]] = [
        (("simulation", key), word)
        for key, words in (
            ("command", options.command),
            ("compile", options.compile),
            ("visual", options.visual),
        )
        for word in placeholders.command(tuple(words or ()), key)
    ]
    templates += [
        (("simulation", "environment", name), placeholders.variable(name, text))
        for name, text in options.environment.items()
    ]
    for path, template in templates:
        for name in template.names:
            if name not in names:
                hint = suggest_or_list(name, names)
                report(path, f"{{{name}}} is neither a placeholder nor a parameter{hint}")
    if options.controller != "stepwise":
        files: list[tuple[Path_, Template]] = [
            (("simulation", "files"), placeholders.file(path, text)) for path, text in _read_files(options)
        ]
        _check_text(checked, [*templates, *files], IN_A_COMMAND, options.choices, report)
        used = {name for _, template in [*templates, *files] for name in template.names}
        paths: list[Path_] = [("parameters", name) for name in checked["parameters"]]
        paths += [("controller", "parameters", name) for name in evolved]
        for path in paths:
            name = str(path[-1])
            if name in used and name != "seed" and name in IN_A_COMMAND:
                report(
                    path,
                    f"{{{name}}} stands for {IN_A_COMMAND[name]} in commands, files and the environment, not "
                    f"for this parameter; rename the parameter or remove {{{name}}}",
                )


def _check_text(
    checked: Mapping[str, Any],
    templates: Sequence[tuple[Path_, Template]],
    reserved: Iterable[str],
    choices: Mapping[str, Sequence[Any]],
    report: Report,
) -> None:
    """Check that values are among the declared choices, and that text appears only in safe positions.

    own: names that never stand for parameters.
    """
    controller = checked.get("controller")
    evolved = controller.parameters if isinstance(controller, ParameterSetOptions) else {}
    values: list[tuple[Path_, str, Any]] = [
        (("parameters", name), name, value) for name, value in checked["parameters"].items()
    ]
    values += [
        (("controller", "parameters", name, "choices"), name, choice)
        for name, parameter in evolved.items()
        if isinstance(parameter, ChoiceParameter)
        for choice in parameter.choices
    ]
    parameters = catalogue.description(checked["simulation"])["parameters"]
    declared = {name: declared_parameter["default"] for name, declared_parameter in parameters.items()}
    explicit = {name for _, name, _ in values} | set(evolved)
    defaults = [
        (("simulation", "parameters"), name, problem)
        for name, problem in declared.items()
        if name not in explicit
    ]
    for path, name, value in [*values, *defaults]:
        if name in choices and not is_choice(value, choices[name]):
            listed = ", ".join(map(format_value, choices[name]))
            report(path, f"must be one of {listed} (simulation.choices.{name}), not {format_value(value)}")
            continue
        replacements = Values(dict.fromkeys(reserved), {name: value}, choices, declared)
        problems = [
            template.problem(name, replacements)
            for _, template in templates
            if name in template.names and name not in replacements.built_in
        ]
        reason = next(filter(None, problems), None)
        if reason is not None:
            report(path, reason)


def _read_files(options: CommandOptions) -> Iterator[tuple[str, str]]:
    """Yield the readable files of the work folder with their texts."""
    return work_files.iterate_texts(options.files, Path(options.folder))


def find_warning(experiment: "Experiment") -> str | None:
    """Return a warning before a command's episodes, or None."""
    options = parse_name(experiment.simulation)
    return (
        options.uneven_steps if isinstance(options, FmuOptions) else _warn_about_unused(experiment, options)
    )


def _warn_about_unused(experiment: "Experiment", options: Definition) -> str | None:
    """Return a warning about parameters that do not reach a simulation's command, or None."""
    if not isinstance(options, CommandOptions) or options.controller == "stepwise":
        return None
    texts = [*options.command, *options.environment.values(), *(options.compile or ())]
    texts += [text for _, text in _read_files(options)]
    used = {name for text in texts for name in names_in(text)}
    file = parameter_file.FILES[options.parameters_format]
    if "parameters" in used or _is_named(file, options):
        return None
    controller = experiment.controller
    evolved = controller.parameters if isinstance(controller, ParameterSetOptions) else {}
    unused = [name for name in dict.fromkeys([*experiment.parameters, *evolved, "seed"]) if name not in used]
    if options.determinism == "bitwise" and "seed" in unused:
        unused.remove("seed")  # declared deterministic, so it needs no seed
    if not unused:
        return None
    placeholders = ", ".join(f"{{{name}}}" for name in unused)
    pronoun = "it" if len(unused) == 1 else "them"
    text = (
        f"command: contains neither {placeholders} nor {{parameters}} (the path of {file}), so the program "
        f"receives {pronoun} only if it opens {file} in its work folder"
    )
    if unused == ["seed"]:
        text += "; for a program without random numbers, set simulation.determinism: bitwise"
    return text


def _is_named(file: str, options: CommandOptions) -> bool:
    """Whether the command or one of its files mentions a file."""
    if any(file in word for word in options.command):
        return True
    for word in {word for _, words in options.list_named_files() for word in words}:
        with suppress(OSError, ValueError):
            path = Path(options.folder) / word
            small = path.is_file() and path.stat().st_size < _LARGEST_SCRIPT
            if small and file.encode() in path.read_bytes():
                return True
    return False


def _find_unknown_metrics(options: RosOptions | FmuOptions, names: list[str]) -> list[tuple[str, str]]:
    """Return the problems of expressions over these metrics: key and message."""
    unknown_metrics = []
    for key, text in (("done", options.done), ("fitness", options.fitness)):
        expression = _parse_expression(text)
        if isinstance(expression, str) and key == "done":
            unknown_metrics.append((key, expression))
        elif isinstance(expression, FitnessExpression):
            used = (*expression.metrics, *([FITNESS_NAME] if expression.uses_simulation_fitness else []))
            for name in used:
                if name not in names:
                    hint = did_you_mean(name, names)
                    available = hint or f"; available: {', '.join(names) or 'none'}"
                    unknown_metrics.append((key, f"{name!r} is not a metric{available}"))
    return unknown_metrics


def _check_ros(options: RosOptions, checked: dict[str, Any], report: Report) -> None:
    """Check the placeholders, and that parameters reach the simulation."""
    if options.is_shared and checked.get("broker") is None:
        if checked["servers"] == "auto":
            checked["servers"] = 1
        elif checked["servers"] not in (1, "in-process"):
            report(
                ("servers",),
                "only one server can drive the robots; write servers: 1, or set simulation.start to a "
                "command that starts a simulator for each server",
            )
    controller = checked.get("controller")
    evolved = controller.parameters if isinstance(controller, ParameterSetOptions) else {}
    parameters = [*checked["parameters"], *evolved]
    of_reset = [*parameters, "seed"]
    at_start = INSTANCE_PLACEHOLDERS
    fields: list[tuple[Path_, str, list[str]]] = [
        (("simulation", "environment", name), text, list(at_start))
        for name, text in options.environment.items()
    ]
    fields += [(("simulation", "start"), word, list(at_start)) for word in options.start or ()]
    reset = options.reset.command or ()
    fields += [(("simulation", "reset", "command"), word, [*at_start, *of_reset]) for word in reset]
    for path, text, names in fields:
        for name in names_in(text):
            if name not in names:
                hint = suggest_or_list(name, names)
                report(path, f"{{{name}}} is not a placeholder{hint}")
    used = {name for word in reset for name in names_in(word)}
    words = [
        (("simulation", "reset", "command"), word)
        for word in placeholders.command(tuple(reset), "reset.command")
    ]
    _check_text(checked, words, (*at_start, "seed"), options.choices, report)
    for name in parameters:
        if name in at_start and name in used:
            report(
                ("parameters" if name in checked["parameters"] else "controller", name),
                f"{{{name}}} in simulation.reset.command does not stand for this parameter; rename the "
                "parameter",
            )
        if options.reset.parameters is None and name not in used:
            section = "parameters" if name in checked["parameters"] else "controller"
            report(
                (section, *(("parameters",) if section == "controller" else ()), name),
                "does not reach the simulation; set simulation.reset.parameters to the node with ROS "
                "parameters, or use {" + name + "} in simulation.reset.command",
            )
