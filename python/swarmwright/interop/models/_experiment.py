"""Conversion of a model to an experiment, with comments that name the source of each line."""

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Self

from swarmwright.common.errors import InputError
from swarmwright.common.groups import DeclaredGroup
from swarmwright.common.simulation_names import SIMULATORS
from swarmwright.common.suggestions import alike, did_you_mean, nearest
from swarmwright.common.untrusted import escape_line
from swarmwright.common.yaml import dump, parse, remove_locations
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.controllers.scxml import StateMachine
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.importing import Imported
from swarmwright.experiment.start_from import make_entry
from swarmwright.experiment.validation import check
from swarmwright.interop.models._files import list_files
from swarmwright.interop.models._files import load as load_part
from swarmwright.interop.models._parts import (
    Location,
    Member,
    OptimisedParameter,
    Part,
    Problems,
    Property,
    SimulationParameters,
    find_title,
)
from swarmwright.methods import METHODS
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import make_absolute, make_relative


@dataclass(frozen=True)
class Model:
    """The combined content of a model's files."""

    parts: list[Part]

    @classmethod
    def from_parts(cls, parts: list[Part]) -> Self:
        """Combine parts. Raises InputError without parts, or if files overlap or contradict each other."""
        if not parts:
            raise InputError("no files; name at least one file of a model")
        first: dict[str, Path] = {}
        problems = []
        for part in parts:
            for words in part.describe_contents():
                if words in first:
                    problems.append(
                        f"{part.path}: {words} is also described by {first[words]}; remove one of the files"
                    )
                first.setdefault(words, part.path)
        model = cls(parts)
        problems += model._find_contradictions()
        if problems:
            raise InputError("\n".join(problems))
        return model

    def _find_contradictions(self) -> list[str]:
        problems = []
        for name in ("sensors", "actuators"):
            counted = [(part, getattr(part, name)) for part in self.parts if getattr(part, name) is not None]
            for part, number in counted[1:]:
                before, expected = counted[0]
                if number != expected:
                    problems.append(f"{part.path}: has {number} {name}, but {before.path} has {expected}")
        return problems

    def _collect(self, name: str) -> list[Any]:
        return [item for part in self.parts for item in getattr(part, name)]

    def _first_value(self, name: str) -> Any:  # noqa: ANN401 - of the field's type
        return next((value for part in self.parts if (value := getattr(part, name)) is not None), None)

    @property
    def titles(self) -> list[str]:
        """Candidate names of the simulation."""
        return self._collect("titles")

    @property
    def properties(self) -> list[Property]:
        """Parameters with a fixed value."""
        return self._collect("properties")

    @property
    def optimised(self) -> list[OptimisedParameter]:
        """Parameters to optimise."""
        return self._collect("optimised")

    @property
    def members(self) -> list[Member]:
        """Kinds of agents."""
        return self._collect("members")

    @property
    def has_groups(self) -> bool:
        """Whether the kinds of agents differ in sensors or actuators."""
        return any(part.has_groups for part in self.parts)

    @property
    def sensors(self) -> int | None:
        """Number of sensor values of an agent."""
        number: int | None = self._first_value("sensors")
        return number

    @property
    def actuators(self) -> int | None:
        """Number of actuator values of an agent."""
        number: int | None = self._first_value("actuators")
        return number

    @property
    def behaviour(self) -> StateMachine | None:
        """The state machine of the agents."""
        machine: StateMachine | None = self._first_value("behaviour")
        return machine

    @property
    def sensor_names(self) -> list[str]:
        """Names of sensors, in order; empty if no file has them."""
        return self._collect("sensor_names")

    @property
    def actuator_names(self) -> list[str]:
        """Names of actuators, in order; empty if no file has them."""
        return self._collect("actuator_names")

    def file_of(self, words: str) -> Path:
        """Return the file with a content, see `Part.describe_contents`."""
        return next(part.path for part in self.parts if words in part.describe_contents())

    def check_numbers(self, simulation: SimulationParameters) -> None:
        """Raise InputError unless the simulation has the same numbers of sensors and actuators."""
        if simulation.description is None or simulation.description.get("varies"):
            return
        problems = []
        for part in self.parts:
            for name in ("sensors", "actuators"):
                number, expected = getattr(part, name), simulation.description.get(name)
                if number is not None and expected is not None and number != expected:
                    problems.append(
                        f"{part.path}: has {number} {name}, but {simulation.simulation} has {expected}"
                    )
        if problems:
            raise InputError("\n".join(problems))


@dataclass
class Parameters:
    """Parameters of the simulation by name, with the source of each."""

    fixed: dict[str, tuple[Any, str]] = field(default_factory=dict)
    evolved: dict[str, tuple[dict[str, Any], str]] = field(default_factory=dict)
    omitted: list[str] = field(default_factory=list)
    """Comments on parameters that the simulation does not have."""
    notes: list[str] = field(default_factory=list)
    agents: int = 0
    """Largest number of agents of the model; 0 if unknown."""

    @classmethod
    def from_model(cls, model: Model, simulation: SimulationParameters, *, evolved: bool) -> Self:
        """Return the parameters of a model.

        evolved: whether its optimised parameters are evolved; else they keep the simulation's defaults.

        Raises InputError for an optimised parameter that the simulation does not have, for two that are the
        same parameter, and for ambiguous names.
        """
        parameters = cls()
        parameters._take_properties(model, simulation)
        if model.has_groups and simulation.parameters is not None:
            parameters._take_groups(model, simulation, evolved=evolved)
        else:
            parameters._take_members(model, simulation)
        if evolved:
            parameters._take_optimised(model, simulation)
        elif model.optimised:
            names = ", ".join(parameter.name for parameter in model.optimised)
            parameters.notes.append(
                f"the optimised parameters {names} are not evolved; the controller is evolved instead"
            )
        return parameters

    def _take_properties(self, model: Model, simulation: SimulationParameters) -> None:
        problems = Problems()
        names = [(property_.name, property_.location) for property_ in model.properties]
        if simulation.agents is None:
            names += [(member.name, member.location) for member in model.members]
        for name, location in names:
            if simulation.is_ambiguous(name):
                problems.add(location, simulation.describe_problem(name))
        problems.stop()
        for property_ in model.properties:
            parameter = simulation.find(property_.name)
            if parameter is None:
                assignment = f"{escape_line(property_.name)} = {escape_line(str(property_.value))}"
                self.omitted.append(f"{assignment}: {simulation.describe_problem(property_.name)}")
            else:
                self.fixed[parameter] = (
                    property_.value,
                    f"{property_.name}, {property_.location.file.name}:{property_.location.line}",
                )

    def _take_members(self, model: Model, simulation: SimulationParameters) -> None:
        if not model.members:
            return
        self.agents = sum(member.number for member in model.members)
        counts = [(member.name, member.number, member) for member in model.members]
        location = model.members[0].location
        source = (
            f"{' + '.join(member.name for member in model.members)}, {location.file.name}:{location.line}"
        )
        if simulation.agents is not None:
            previous = self.fixed.get(simulation.agents)
            if previous is not None and previous[0] != self.agents:
                self.notes.append(
                    f"{simulation.agents}: {previous[1]} says {previous[0]}, but the swarm has "
                    f"{self.agents}, which is used"
                )
            self.fixed[simulation.agents] = self.agents, source
            if len(model.members) > 1:
                names = ", ".join(member.name for member in model.members)
                self.notes.append(
                    f"{simulation.simulation} has one kind of agents: {names} become {self.agents} agents"
                )
            return
        for name, number, member in counts:
            parameter = simulation.find(name)
            if parameter is None:
                self.omitted.append(f"{escape_line(name)} = {number}: {simulation.describe_problem(name)}")
            else:
                self.fixed[parameter] = (
                    number,
                    f"{member.launch_file or name}, {location.file.name}:{member.location.line}",
                )

    def _take_groups(self, model: Model, simulation: SimulationParameters, *, evolved: bool) -> None:
        """Take the numbers of agents of each kind; those without a parameter are written into the team.

        Raises InputError if agents control themselves and the simulation has no parameter for their number.
        """
        problems = Problems()
        self.agents = sum(member.number for member in model.members)
        for member in model.members:
            parameter = simulation.find_agents_of(member.name)
            if parameter is not None:
                source = f"{member.name}, {member.location.file.name}:{member.location.line}"
                self.fixed[parameter] = member.number, source
            elif evolved:
                problems.add(
                    member.location,
                    "its sensors or actuators differ from those of other agents, but "
                    f"{simulation.simulation} has no parameter for the number of these agents",
                )
        problems.stop()

    def _take_optimised(self, model: Model, simulation: SimulationParameters) -> None:
        problems = Problems()
        names = [member.name for member in model.members]
        for parameter in model.optimised:
            matches = alike(parameter.name, names)
            if len(matches) > 1:
                candidates = " or ".join(repr(names[index]) for index in matches)
                problems.add(
                    parameter.location,
                    f"{parameter.name!r} is ambiguous: {candidates}; write one of these names",
                )
                continue
            member = model.members[matches[0]] if matches else None
            name = simulation.find(parameter.name)
            if member is not None and len(model.members) == 1:
                name = simulation.agents or name  # the number of agents is optimised
            elif member is not None and model.has_groups:
                name = simulation.find_agents_of(member.name)
            if name is None:
                problems.add(parameter.location, simulation.describe_problem(parameter.name))
                continue
            if name in self.evolved:
                problems.add(
                    parameter.location,
                    f"{parameter.name} is the parameter {name}, which is already optimised; remove one of "
                    "them",
                )
                continue
            if member is not None and self.agents:
                self.agents += max(0, int(parameter.range[1]) - member.number)
            self.fixed.pop(name, None)
            self.evolved[name] = _options(parameter), _describe_source(parameter)
        problems.stop()


def _options(parameter: OptimisedParameter) -> dict[str, Any]:
    return {"type": "integer" if parameter.whole else "real", "range": parameter.range}


def _describe_source(parameter: OptimisedParameter) -> str:
    scaled = (
        "" if parameter.scale == 1 else f", {parameter.low} to {parameter.high} times {parameter.scale:g}"
    )
    return f"{parameter.meta}{scaled}, {parameter.location.file.name}:{parameter.location.line}"


Groups = dict[str, tuple[dict[str, Any], Location]]
"""Options of the groups of a team by name, with their sources."""


def build_groups(
    model: Model, simulation: SimulationParameters, parameters: Mapping[str, Any], kind: str
) -> Groups:
    """Return the groups of a model's team.

    Args:
        model: with several kinds of agents.
        simulation: its simulation. If it declares groups, their names are used and numbers of agents, sensors
            and
            actuators are checked; else the options contain these numbers.
        parameters: parameters of the simulation.
        kind: kind of the controllers.

    Raises:
        InputError: the groups do not match the simulation, or agents lack sensors or actuators.
    """
    problems = Problems()
    for member in model.members:
        for name, direction, names in (
            ("sensors", "in", member.sensors),
            ("actuators", "out", member.actuators),
        ):
            if not names:
                problems.add(
                    member.location,
                    f"has no {name} ({direction}); add at least one, which a controller needs",
                )
    problems.stop()
    declared: list[DeclaredGroup] = []
    if simulation.description is not None:
        with suppress(InputError):  # invalid parameters are reported with the experiment
            declared = catalogue.groups(simulation.simulation, dict(parameters))
    if not declared:
        return {member.name: ({"kind": kind, **_counts(member)}, member.location) for member in model.members}
    groups = _match_groups(model, simulation.simulation, declared)
    return {group.name: ({"kind": kind}, groups[group.name].location) for group in declared}


def _counts(member: Member) -> dict[str, int]:
    return {
        "agents": member.number,
        "sensors": len(member.sensors),
        "actuators": len(member.actuators),
    }


def _match_groups(model: Model, simulation: str, declared: list[DeclaredGroup]) -> dict[str, Member]:
    """Match kinds of agents with the simulation's groups. Raises InputError for mismatches."""
    problems, members = Problems(), dict[str, Member]()
    names = [declaration.name for declaration in declared]
    for member in model.members:
        index = next(iter(alike(member.name, names)), None)
        if index is None:
            problems.add(
                member.location,
                f"{simulation} has no such group of agents{did_you_mean(member.name, names) or ';'} its "
                f"groups: {', '.join(names)}",
            )
            continue
        group = declared[index]
        if group.name in members:
            problems.add(
                member.location, f"is the same group as {members[group.name].name}; keep one of them"
            )
        members[group.name] = member
        for noun, number in _counts(member).items():
            expected = getattr(group, noun)
            if number != expected:
                problems.add(
                    member.location, f"has {number} {noun}, but {group.name} of {simulation} have {expected}"
                )
    missing = [name for name in names if name not in members]
    if missing and not problems.lines:
        problems.add(
            model.members[0].location,
            f"{' and '.join(missing)} of {simulation} missing; add a part with this name for each",
        )
    problems.stop()
    return members


_STEERING = ("steering", "rule")
"""The parameter of Minisim, and its value, by which agents control themselves."""
_SET, _MACHINE, _TEAM = "parameter_set", "mealy_fsm", "team"


class Draft:
    """An experiment file under construction.

    Args:
        model: the model.
        simulation: its name in experiments.
        folder: folder of the experiment file.
        method: kind of the method.
        controller: kind of the controller; None: derived from the model.

    Raises InputError when the model does not match the simulation or the kind of controller.
    """

    def __init__(
        self, model: Model, simulation: str, folder: Path, method: str, controller: str | None
    ) -> None:
        self.model, self.simulation, self.folder, self.method = model, simulation, folder, method
        self.known_parameters = SimulationParameters(simulation)
        self.notes = [note for part in model.parts for note in part.notes]
        model.check_numbers(self.known_parameters)
        self.kind = controller or self._kind()
        self._check_kind()
        self.parameters = Parameters.from_model(
            model, self.known_parameters, evolved=self.kind == _SET and bool(model.optimised)
        )
        self.notes += self.parameters.notes
        self.groups = self._groups()
        if self.kind == _SET and self._can_steer:
            self.parameters.fixed.setdefault(_STEERING[0], (_STEERING[1], "agents control themselves"))
        if self.known_parameters.description is None:
            closest = nearest(simulation, (*catalogue.titles(), *SIMULATORS))
            hint = "" if closest in {None, simulation} else f" (did you mean '{closest}'?)"
            self.notes.append(
                f"{simulation} is not a built-in simulation{hint}. Start a simulation server that offers it, "
                "or name another simulation with --simulation"
            )
        if model.behaviour is not None and self.kind != _MACHINE:
            self.notes.append(
                f"{model.behaviour.path}: the behaviour is not used because the controller is {self.kind}; "
                f"use --controller {_MACHINE} to evolve it"
            )

    def _groups(self) -> Groups:
        """Return the groups of a team; empty if all agents share one controller."""
        if not self.model.has_groups or self.kind == _SET:
            return {}
        kind = "layered" if self.kind == _TEAM else self.kind
        fixed = {name: value for name, (value, _) in self.parameters.fixed.items()}
        return build_groups(self.model, self.known_parameters, fixed, kind)

    @property
    def _can_steer(self) -> bool:
        """Whether a parameter of the simulation lets agents control themselves."""
        return (
            self.known_parameters.parameters is not None and _STEERING[0] in self.known_parameters.parameters
        )

    def _kind(self) -> str:
        steered = self.simulation in catalogue.titles() and not self._can_steer
        if self.model.optimised and not (steered and self.model.behaviour is not None):
            return _SET
        return "layered" if self.model.behaviour is None else _MACHINE

    def _check_kind(self) -> None:
        steered = self.simulation in catalogue.titles() and not self._can_steer
        if self.kind == _SET and self.model.optimised and steered:
            raise InputError(
                f"{self.model.file_of('optimised parameters')}: parameters can only be evolved if agents "
                f"control themselves, but {self.simulation} needs a controller; use --controller layered, or "
                "another simulation"
            )
        if self.kind == _MACHINE and self.model.behaviour is not None and self.model.has_groups:
            raise InputError(
                f"{self.model.behaviour.path}: a behaviour applies to one kind of agents, but the model "
                "has several with different sensors or actuators; remove the behaviour, or use --controller "
                "layered"
            )

    @cached_property
    def behaviour(self) -> dict[str, Any] | None:
        """The controller from which evolution starts; None without one.

        Raises InputError when its sensors and actuators do not match the simulation.
        """
        if self.model.behaviour is None or self.kind != _MACHINE:
            return None
        sensors, actuators = self.model.sensor_names, self.model.actuator_names
        if self.known_parameters.description is not None:
            fixed = {name: value for name, (value, _) in self.parameters.fixed.items()}
            described = catalogue.description(self.simulation, fixed)
            sensors = list(described["sensor_names"]) or _number_names("sensors", described["sensors"])
            actuators = list(described["actuator_names"]) or _number_names(
                "actuators", described["actuators"]
            )
        elif not sensors and self.model.sensors is not None and not self.model.behaviour.sensors:
            sensors = _number_names("sensors", self.model.sensors)
        return self.model.behaviour.specification(sensors, actuators)

    def text(self, machine: str | None) -> str:
        """Return the experiment file; machine: name of the file with the behaviour beside it."""
        files = ", ".join(escape_line(part.path.name) for part in self.model.parts)
        lines = [
            f"# Made by `swarmwright import` of {files}.",
            "",
            f"simulation: {_text(make_relative(self.simulation, self.folder))}",
            *self._format_requirements(),
            "",
            "parameters:" if self.parameters.fixed else "parameters: {}",
        ]
        lines += [_line(name, value, source) for name, (value, source) in self.parameters.fixed.items()]
        lines += [f"  # not imported: {escape_line(reason)}" for reason in self.parameters.omitted]
        lines += ["", "controller:", f"  kind: {_TEAM if self.groups else self.kind}"]
        if self.groups:
            lines.append("  groups:")
            lines += [
                _line(name, options, f"{location.element}, {location.file.name}:{location.line}", "    ")
                for name, (options, location) in self.groups.items()
            ]
        if self.parameters.evolved:
            lines.append("  parameters:")
            lines += [
                _line(name, value, where, "    ") for name, (value, where) in self.parameters.evolved.items()
            ]
        if self.behaviour is not None:
            lines += self._format_machine(self.behaviour, machine)
        lines += ["", "method:", f"  kind: {self.method}"]
        if self.kind == _MACHINE and self.method == "nnga":
            lines.append("  probability: 0.1  # a mutation changes a part of the machine")
        lines += ["", "ranking:", "  kind: absolute", "", "seed: 1"]
        return "\n".join(line.rstrip() for line in lines) + "\n"

    def _format_requirements(self) -> list[str]:
        """Return the requirements for servers of an unknown simulation."""
        if self.known_parameters.description is not None:
            return []
        lines = []
        if self.parameters.agents:
            lines.append(f"requirements: {{dimensions: 2, max_agents: {self.parameters.agents}}}")
        behaviour = self.behaviour or {}
        for key, number in (("sensors", self.model.sensors), ("actuators", self.model.actuators)):
            if number is not None or key in behaviour:
                lines.append(f"{key}: {behaviour.get(key, number)}")
        return lines

    def _format_machine(self, behaviour: dict[str, Any], machine: str | None) -> list[str]:
        levels = [ends or 1 for ends in behaviour["thresholds"]]
        source = self.model.file_of("a behaviour").name
        lines = [
            _line("states", behaviour["states"], source),
            _line("levels", levels, "thresholds of the conditions"),
            _line("output_levels", 0, "any number"),
        ]
        return (
            lines
            if machine is None
            else [*lines, "", f"start_from: {_text(machine)}  # {escape_line(source)}"]
        )


def _number_names(noun: str, count: int) -> list[str]:
    return [f"{noun}[{index}]" for index in range(count)]


def _text(value: Any) -> str:  # noqa: ANN401 - any plain value
    return dump({"x": [value]})[4:-2]


def _line(name: str, value: Any, source: str, indent: str = "  ") -> str:  # noqa: ANN401 - any plain value
    key = dump({name: 0}).removesuffix(": 0\n")
    return f"{indent}{key}: {_text(value)}".ljust(40) + f"  # {escape_line(source)}"


def load(
    paths: Iterable[str | PathLike[str]],
    *,
    target: str | PathLike[str] | None = None,
    simulation: str | None = None,
    method: str | None = None,
    controller: str | None = None,
) -> Imported:
    """Convert the files of a model to an experiment.

    Args:
        paths: the files, or folders with them; their kind is recognised by content.
        target: the experiment file that will be written; paths in it are relative to its folder.
        simulation: its name in experiments; default: that of the problem description.
        method: kind of the method, with its defaults; default: nnga.
        controller: kind of the controller, with its defaults; default: `parameter_set` if the model has
            optimised parameters and agents may control themselves, else `mealy_fsm` if it has a behaviour,
            from which evolution then starts, else `layered`.

    Raises:
        InputError: a file is invalid or of an unknown kind, or files contradict each other; the message names
            file and line of every problem.
    """
    METHODS.check("method", method)
    REPRESENTATIONS.check("controller", controller)
    model = Model.from_parts(_parts(paths))
    folder = Path() if target is None else Path(target).parent
    draft = Draft(model, _simulation(model, simulation), folder, method or "nnga", controller)
    machine = None if draft.behaviour is None or target is None else f"{Path(target).stem}.controller.json"
    text = draft.text(machine)
    # Paths are relative to the folder of this name; the file does not exist.
    name = str(folder / "imported.yaml")
    try:
        source = parse(text, name)
        if draft.behaviour is not None:
            source.values["start_from"] = make_entry(draft.behaviour, machine or "behaviour")
        experiment = Experiment(**check(source))
    except InputError as error:
        files = ", ".join(str(part.path) for part in model.parts)
        verb = "does" if len(model.parts) == 1 else "do"
        problems = remove_locations(str(error), name)
        raise InputError(f"{files}: {verb} not result in a valid experiment:\n{problems}") from error
    if draft.behaviour is not None and machine is None:
        raise InputError(
            f"{model.file_of('a behaviour')}: is written to a file beside the experiment; set the name of "
            "the experiment with --output FILE.yaml"
        )
    files_beside = {} if machine is None else {machine: json.dumps(draft.behaviour, indent=2) + "\n"}
    return Imported(text, experiment, tuple(draft.notes), files_beside)


def _parts(paths: Iterable[str | PathLike[str]]) -> list[Any]:
    parts, problems = [], []
    for path in list_files(map(Path, paths)):
        try:
            parts.append(load_part(path))
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise InputError("\n".join(problems))
    return parts


def _simulation(model: Model, name: str | None) -> str:
    """Return the name of the simulation in experiments."""
    if name is not None:
        return make_absolute(name)
    if not model.titles:
        raise InputError(
            f"{', '.join(str(part.path) for part in model.parts)}: the simulation is missing; add the "
            "problem description (<icomponent>), or name the simulation, e.g. --simulation minisim"
        )
    return find_title(model.titles) or model.titles[0]
