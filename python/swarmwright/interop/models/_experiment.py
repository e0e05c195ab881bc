"""From the parts of a model to an experiment, with a comment on where each line comes from.

Kinds of agents with different sensors or actuators, as the groups of a team.

Parameters of a model as parameters of its simulation: those with a value, and those that are evolved.
"""

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
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.importing import Imported
from swarmwright.experiment.start_from import entry_of
from swarmwright.experiment.validation import check
from swarmwright.interop.models._files import files_of
from swarmwright.interop.models._files import load as load_part
from swarmwright.interop.models._model import Model
from swarmwright.interop.models._names import Known, title_of
from swarmwright.interop.models._parts import Member, Optimised, Place, Problems
from swarmwright.methods import METHODS
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import make_absolute, make_relative


@dataclass
class Parameters:
    """By the name that the simulation has for each, with where it comes from."""

    fixed: dict[str, tuple[Any, str]] = field(default_factory=dict)
    evolved: dict[str, tuple[dict[str, Any], str]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    """Comments on what the simulation does not have."""
    notes: list[str] = field(default_factory=list)
    agents: int = 0
    """How many agents the model has at most; 0 if it does not say."""

    @classmethod
    def of(cls, model: Model, known: Known, *, evolved: bool) -> Self:
        """Return the parameters of a model.

        evolved: whether its optimised parameters are evolved; else they keep the simulation's defaults.

        Raises InputError when an optimised parameter is none of the simulation's, two are the same one, or a
        name may stand for several.
        """
        found = cls()
        found._take_properties(model, known)
        if model.differ and known.parameters is not None:
            found._take_groups(model, known, evolved=evolved)
        else:
            found._take_members(model, known)
        if evolved:
            found._take_optimised(model, known)
        elif model.optimised:
            names = ", ".join(parameter.name for parameter in model.optimised)
            found.notes.append(f"the optimised parameters {names} are not evolved, but the controller is")
        return found

    def _take_properties(self, model: Model, known: Known) -> None:
        problems = Problems()
        named = [(property_.name, property_.place) for property_ in model.properties]
        if known.agents is None:
            named += [(member.name, member.place) for member in model.members]
        for name, place in named:
            if known.is_ambiguous(name):
                problems.add(place, known.missing(name))
        problems.stop()
        for property_ in model.properties:
            own = known.name(property_.name)
            if own is None:
                given = f"{escape_line(property_.name)} = {escape_line(str(property_.value))}"
                self.left_out.append(f"{given}: {known.missing(property_.name)}")
            else:
                self.fixed[own] = (
                    property_.value,
                    f"{property_.name}, {property_.place.file.name}:{property_.place.line}",
                )

    def _take_members(self, model: Model, known: Known) -> None:
        if not model.members:
            return
        self.agents = sum(member.number for member in model.members)
        counts = [(member.name, member.number, member) for member in model.members]
        place = model.members[0].place
        where = f"{' + '.join(member.name for member in model.members)}, {place.file.name}:{place.line}"
        if known.agents is not None:
            before = self.fixed.get(known.agents)
            if before is not None and before[0] != self.agents:
                self.notes.append(
                    f"{known.agents}: {before[1]} says {before[0]}, the swarm has {self.agents}, which "
                    "is taken"
                )
            self.fixed[known.agents] = self.agents, where
            if len(model.members) > 1:
                names = ", ".join(member.name for member in model.members)
                self.notes.append(
                    f"{known.simulation} has agents of one kind: {names} are {self.agents} of them"
                )
            return
        for name, number, member in counts:
            own = known.name(name)
            if own is None:
                self.left_out.append(f"{escape_line(name)} = {number}: {known.missing(name)}")
            else:
                self.fixed[own] = (
                    number,
                    f"{member.launch_file or name}, {place.file.name}:{member.place.line}",
                )

    def _take_groups(self, model: Model, known: Known, *, evolved: bool) -> None:
        """Take the numbers of agents of each kind; in a team, groups state those without a parameter.

        Raises InputError when agents that steer themselves are of a kind that the simulation does not have.
        """
        problems = Problems()
        self.agents = sum(member.number for member in model.members)
        for member in model.members:
            own = known.number_of(member.name)
            if own is not None:
                where = f"{member.name}, {member.place.file.name}:{member.place.line}"
                self.fixed[own] = member.number, where
            elif evolved:
                problems.add(
                    member.place,
                    f"senses or does other things than other agents, but {known.simulation} has no parameter "
                    "with the number of agents of this kind",
                )
        problems.stop()

    def _take_optimised(self, model: Model, known: Known) -> None:
        problems = Problems()
        names = [member.name for member in model.members]
        for parameter in model.optimised:
            found = alike(parameter.name, names)
            if len(found) > 1:
                which = " or ".join(repr(names[index]) for index in found)
                problems.add(
                    parameter.place, f"{parameter.name!r} may be the agents {which}; write one of these names"
                )
                continue
            member = model.members[found[0]] if found else None
            name = known.name(parameter.name)
            if member is not None and len(model.members) == 1:
                name = known.agents or name  # the number of agents is what is optimised
            elif member is not None and model.differ:
                name = known.number_of(member.name)
            if name is None:
                problems.add(parameter.place, known.missing(parameter.name))
                continue
            if name in self.evolved:
                problems.add(
                    parameter.place, f"{parameter.name} is the same parameter as another one, {name}"
                )
                continue
            if member is not None and self.agents:
                self.agents += max(0, int(parameter.range[1]) - member.number)
            self.fixed.pop(name, None)
            self.evolved[name] = _options(parameter), _where(parameter)
        problems.stop()


def _options(parameter: Optimised) -> dict[str, Any]:
    return {"type": "integer" if parameter.whole else "real", "range": parameter.range}


def _where(parameter: Optimised) -> str:
    scaled = (
        "" if parameter.scale == 1 else f", {parameter.low} to {parameter.high} times {parameter.scale:g}"
    )
    return f"{parameter.meta}{scaled}, {parameter.place.file.name}:{parameter.place.line}"


Groups = dict[str, tuple[dict[str, Any], Place]]
"""Options of the groups of a team by name, with what each comes from."""


def groups_of(model: Model, known: Known, parameters: Mapping[str, Any], kind: str) -> Groups:
    """Return the groups of a model's team.

    Args:
        model: with several kinds of agents.
        known: its simulation. Where it declares groups, they have its names, and numbers of agents, sensors
            and actuators are checked; else they state these numbers.
        parameters: of the simulation.
        kind: of the controllers.

    Raises:
        InputError: the groups are not those of the simulation, or agents cannot have a controller.
    """
    problems = Problems()
    for member in model.members:
        for what, ways, names in (("sensors", "in", member.sensors), ("actuators", "out", member.actuators)):
            if not names:
                problems.add(
                    member.place, f"has no {what} ({ways}); agents with a controller need at least one"
                )
    problems.stop()
    declared: list[DeclaredGroup] = []
    if known.description is not None:
        with suppress(InputError):  # parameters that the simulation refuses are reported with the experiment
            declared = catalogue.groups(known.simulation, dict(parameters))
    if not declared:
        return {member.name: ({"kind": kind, **_counts(member)}, member.place) for member in model.members}
    groups = _matched(model, known.simulation, declared)
    return {group.name: ({"kind": kind}, groups[group.name].place) for group in declared}


def _counts(member: Member) -> dict[str, int]:
    return {
        "agents": member.number,
        "sensors": len(member.sensors),
        "actuators": len(member.actuators),
    }


def _matched(model: Model, simulation: str, declared: list[DeclaredGroup]) -> dict[str, Member]:
    """Return the kinds of agents by the names of the simulation's groups. Raises InputError."""
    problems, found = Problems(), dict[str, Member]()
    names = [declaration.name for declaration in declared]
    for member in model.members:
        index = next(iter(alike(member.name, names)), None)
        if index is None:
            problems.add(
                member.place,
                f"is no group of agents of {simulation}{did_you_mean(member.name, names) or ';'} its groups: "
                f"{', '.join(names)}",
            )
            continue
        group = declared[index]
        if group.name in found:
            problems.add(member.place, f"is the same group as {found[group.name].name}; keep one")
        found[group.name] = member
        for what, number in _counts(member).items():
            expected = getattr(group, what)
            if number != expected:
                problems.add(
                    member.place, f"has {number} {what}, but {group.name} of {simulation} have {expected}"
                )
    missing = [name for name in names if name not in found]
    if missing and not problems.lines:
        problems.add(
            model.members[0].place,
            f"{simulation} has {' and '.join(missing)}, too; add a part with this name for each",
        )
    problems.stop()
    return found


_STEERING = ("steering", "rule")
"""The parameter of Minisim, and its value with which agents steer themselves."""
_SET, _MACHINE, _TEAM = "parameter_set", "mealy_fsm", "team"


class Draft:
    """What is evolved of a model, and how that is written.

    Args:
        model: all its files.
        simulation: as experiments name it.
        folder: of the experiment file.
        method: kind of the method.
        controller: kind of the controller; None: as the model says.

    Raises InputError when the model does not fit the simulation, or the kind of controller.
    """

    def __init__(
        self, model: Model, simulation: str, folder: Path, method: str, controller: str | None
    ) -> None:
        self.model, self.simulation, self.folder, self.method = model, simulation, folder, method
        self.known = Known(simulation)
        self.notes = [note for part in model.parts for note in part.notes]
        model.check_numbers(self.known)
        self.kind = controller or self._kind()
        self._check_kind()
        self.parameters = Parameters.of(
            model, self.known, evolved=self.kind == _SET and bool(model.optimised)
        )
        self.notes += self.parameters.notes
        self.groups = self._groups()
        if self.kind == _SET and self._can_steer:
            self.parameters.fixed.setdefault(_STEERING[0], (_STEERING[1], "agents steer themselves"))
        if self.known.description is None:
            near = nearest(simulation, (*catalogue.titles(), *SIMULATORS))
            hint = "" if near in {None, simulation} else f" (did you mean '{near}'?)"
            self.notes.append(
                f"no built-in simulation is called {simulation}{hint}. A simulation server has to offer it, "
                "or name another one with --simulation"
            )
        if model.behaviour is not None and self.kind != _MACHINE:
            self.notes.append(
                f"{model.behaviour.path}: the behaviour is not used, since the controller is {self.kind}; "
                f"--controller {_MACHINE} evolves it"
            )

    def _groups(self) -> Groups:
        """Return the groups of a team; empty where all agents have the same controller."""
        if not self.model.differ or self.kind == _SET:
            return {}
        kind = "layered" if self.kind == _TEAM else self.kind
        fixed = {name: value for name, (value, _) in self.parameters.fixed.items()}
        return groups_of(self.model, self.known, fixed, kind)

    @property
    def _can_steer(self) -> bool:
        """Whether agents steer themselves by a parameter of the simulation."""
        return self.known.parameters is not None and _STEERING[0] in self.known.parameters

    def _kind(self) -> str:
        steered = self.simulation in catalogue.titles() and not self._can_steer
        if self.model.optimised and not (steered and self.model.behaviour is not None):
            return _SET
        return "layered" if self.model.behaviour is None else _MACHINE

    def _check_kind(self) -> None:
        steered = self.simulation in catalogue.titles() and not self._can_steer
        if self.kind == _SET and self.model.optimised and steered:
            raise InputError(
                f"{self.model.file_of('optimised parameters')}: parameters are evolved where agents steer "
                f"themselves, but {self.simulation} is steered by a controller; name another one with "
                "--controller layered, or another simulation"
            )
        if self.kind == _MACHINE and self.model.behaviour is not None and self.model.differ:
            raise InputError(
                f"{self.model.behaviour.path}: the behaviour is that of one kind of agents, but there are "
                f"several with different sensors or actuators; leave it out, or name another controller with "
                "--controller layered"
            )

    @cached_property
    def behaviour(self) -> dict[str, Any] | None:
        """The controller that evolution starts from; None without one.

        Raises InputError when its sensors and actuators are not those of the simulation.
        """
        if self.model.behaviour is None or self.kind != _MACHINE:
            return None
        sensors, actuators = self.model.sensor_names, self.model.actuator_names
        if self.known.description is not None:
            fixed = {name: value for name, (value, _) in self.parameters.fixed.items()}
            described = catalogue.description(self.simulation, fixed)
            sensors = list(described["sensor_names"]) or _numbered("sensors", described["sensors"])
            actuators = list(described["actuator_names"]) or _numbered("actuators", described["actuators"])
        elif not sensors and self.model.sensors is not None and not self.model.behaviour.sensors:
            sensors = _numbered("sensors", self.model.sensors)
        return self.model.behaviour.specification(sensors, actuators)

    def text(self, machine: str | None) -> str:
        """Return the experiment file; machine: the name of the file with the behaviour, beside it."""
        files = ", ".join(escape_line(part.path.name) for part in self.model.parts)
        lines = [
            f"# Made by `swarmwright import` of {files}.",
            "",
            f"simulation: {_text(make_relative(self.simulation, self.folder))}",
            *self._announced(),
            "",
            "parameters:" if self.parameters.fixed else "parameters: {}",
        ]
        lines += [_line(name, value, where) for name, (value, where) in self.parameters.fixed.items()]
        lines += [f"  # not taken over: {escape_line(reason)}" for reason in self.parameters.left_out]
        lines += ["", "controller:", f"  kind: {_TEAM if self.groups else self.kind}"]
        if self.groups:
            lines.append("  groups:")
            lines += [
                _line(name, options, f"{place.what}, {place.file.name}:{place.line}", "    ")
                for name, (options, place) in self.groups.items()
            ]
        if self.parameters.evolved:
            lines.append("  parameters:")
            lines += [
                _line(name, value, where, "    ") for name, (value, where) in self.parameters.evolved.items()
            ]
        if self.behaviour is not None:
            lines += self._machine(self.behaviour, machine)
        lines += ["", "method:", f"  kind: {self.method}"]
        if self.kind == _MACHINE and self.method == "nnga":
            lines.append("  probability: 0.1  # a mutation changes a part of the machine")
        lines += ["", "ranking:", "  kind: absolute", "", "seed: 1"]
        return "\n".join(line.rstrip() for line in lines) + "\n"

    def _announced(self) -> list[str]:
        """Return what servers of an unknown simulation are asked for."""
        if self.known.description is not None:
            return []
        lines = []
        if self.parameters.agents:
            lines.append(f"requirements: {{dimensions: 2, max_agents: {self.parameters.agents}}}")
        behaviour = self.behaviour or {}
        for key, number in (("sensors", self.model.sensors), ("actuators", self.model.actuators)):
            if number is not None or key in behaviour:
                lines.append(f"{key}: {behaviour.get(key, number)}")
        return lines

    def _machine(self, behaviour: dict[str, Any], machine: str | None) -> list[str]:
        levels = [ends or 1 for ends in behaviour["thresholds"]]
        where = self.model.file_of("a behaviour").name
        lines = [
            _line("states", behaviour["states"], where),
            _line("levels", levels, "where conditions compare sensors"),
            _line("output_levels", 0, "any number"),
        ]
        return (
            lines
            if machine is None
            else [*lines, "", f"start_from: {_text(machine)}  # {escape_line(where)}"]
        )


def _numbered(what: str, count: int) -> list[str]:
    return [f"{what}[{index}]" for index in range(count)]


def _text(value: Any) -> str:  # noqa: ANN401 - any plain value
    return dump({"x": [value]})[4:-2]


def _line(name: str, value: Any, where: str, indent: str = "  ") -> str:  # noqa: ANN401 - any plain value
    key = dump({name: 0}).removesuffix(": 0\n")
    return f"{indent}{key}: {_text(value)}".ljust(40) + f"  # {escape_line(where)}"


def load(
    paths: Iterable[str | PathLike[str]],
    *,
    target: str | PathLike[str] | None = None,
    simulation: str | None = None,
    method: str | None = None,
    controller: str | None = None,
) -> Imported:
    """Make an experiment of the files of a model.

    Args:
        paths: the files, or folders with them; each is recognised by what it holds.
        target: the experiment file that will be written; paths in it are relative to its folder.
        simulation: as an experiment names it; default: the one of the problem description.
        method: kind of the method, with its defaults; default: nnga.
        controller: kind of the controller, with its defaults; default: `parameter_set` where the model has
            optimised parameters and agents may steer themselves, else `mealy_fsm` where it has a behaviour,
            which evolution then starts from, else `layered`.

    Raises:
        InputError: a file is of no known kind, or wrong, or two contradict each other; the message names file
            and line of every problem.
    """
    METHODS.check("method", method)
    REPRESENTATIONS.check("controller", controller)
    model = Model.of(_parts(paths))
    folder = Path() if target is None else Path(target).parent
    draft = Draft(model, _simulation(model, simulation), folder, method or "nnga", controller)
    machine = None if draft.behaviour is None or target is None else f"{Path(target).stem}.controller.json"
    text = draft.text(machine)
    # The name says what paths are relative to; there is no such file.
    name = str(folder / "imported.yaml")
    try:
        source = parse(text, name)
        if draft.behaviour is not None:
            source.values["start_from"] = entry_of(draft.behaviour, machine or "behaviour")
        experiment = Experiment(**check(source))
    except InputError as error:
        files = ", ".join(str(part.path) for part in model.parts)
        verb = "does" if len(model.parts) == 1 else "do"
        problems = remove_locations(str(error), name)
        raise InputError(f"{files}: {verb} not make a valid experiment:\n{problems}") from error
    if draft.behaviour is not None and machine is None:
        raise InputError(
            f"{model.file_of('a behaviour')}: becomes a file beside the experiment; name the experiment: "
            "--output FILE.yaml"
        )
    files_beside = {} if machine is None else {machine: json.dumps(draft.behaviour, indent=2) + "\n"}
    return Imported(text, experiment, tuple(draft.notes), files_beside)


def _parts(paths: Iterable[str | PathLike[str]]) -> list[Any]:
    parts, problems = [], []
    for path in files_of(map(Path, paths)):
        try:
            parts.append(load_part(path))
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise InputError("\n".join(problems))
    return parts


def _simulation(model: Model, named: str | None) -> str:
    """Return the simulation, as experiments name it."""
    if named is not None:
        return make_absolute(named)
    if not model.titles:
        raise InputError(
            f"{', '.join(str(part.path) for part in model.parts)}: no file names the simulation; add the "
            "problem description (<icomponent>), or name one: --simulation minisim"
        )
    return title_of(model.titles) or model.titles[0]
