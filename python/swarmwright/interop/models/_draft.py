"""The text of an experiment file that is made of a model."""

from functools import cached_property
from pathlib import Path
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SIMULATORS
from swarmwright.common.suggestions import nearest
from swarmwright.common.untrusted import one_line
from swarmwright.common.yaml import dump
from swarmwright.interop.models._groups import Groups, groups_of
from swarmwright.interop.models._model import Model
from swarmwright.interop.models._names import Known
from swarmwright.interop.models._parameters import Parameters
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import relative_name

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
        files = ", ".join(one_line(part.path.name) for part in self.model.parts)
        lines = [
            f"# Made by `swarmwright import` of {files}.",
            "",
            f"simulation: {_text(relative_name(self.simulation, self.folder))}",
            *self._announced(),
            "",
            "parameters:" if self.parameters.fixed else "parameters: {}",
        ]
        lines += [_line(name, value, where) for name, (value, where) in self.parameters.fixed.items()]
        lines += [f"  # not taken over: {one_line(reason)}" for reason in self.parameters.left_out]
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
            lines if machine is None else [*lines, "", f"start_from: {_text(machine)}  # {one_line(where)}"]
        )


def _numbered(what: str, count: int) -> list[str]:
    return [f"{what}[{index}]" for index in range(count)]


def _text(value: Any) -> str:  # noqa: ANN401 - any plain value
    return dump({"x": [value]})[4:-2]


def _line(name: str, value: Any, where: str, indent: str = "  ") -> str:  # noqa: ANN401 - any plain value
    key = dump({name: 0}).removesuffix(": 0\n")
    return f"{indent}{key}: {_text(value)}".ljust(40) + f"  # {one_line(where)}"
