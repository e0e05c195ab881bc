"""What an experiment says of machines and trees of modules."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, ModelWrapValidatorHandler, ValidationInfo, field_validator, model_validator

from swarmwright.common import machine_mappings, modules
from swarmwright.common.errors import InputError
from swarmwright.common.yaml import path_of, read
from swarmwright.controllers._base import RepresentationOptions
from swarmwright.controllers.automode import is_command_line, machine_of, tree_of
from swarmwright.controllers.modules.registered import module

_BUILT_IN = frozenset({*modules.BEHAVIOURS, *modules.CONDITIONS})


def _placed(machine: object, problem: str) -> str:
    """Return what is wrong with a machine, with its line where it is in a file."""
    if not isinstance(machine, str) or is_command_line(machine):
        return problem
    place, _, reason = problem.partition(": ")
    return read(Path(machine)).place(path_of(place.removeprefix("machine."))) + reason


class ModulesOptions(RepresentationOptions):
    """A machine (AutoMoDe-Chocolate) or a tree (AutoMoDe-Maple) of given behaviours and conditions.

    For robots with two wheels that sense what the preset e-puck-rm1.2 of `arena` does.
    """

    kind: Literal["modules"] = "modules"
    form: Literal["machine", "tree"] = "machine"
    """machine: a probabilistic finite-state machine. tree: a behaviour tree, whose root is a sequence with
    memory of subtrees; each selects between a condition and a behaviour. If the condition of a subtree holds,
    the next one is tried in the same step, else its behaviour acts, and the next step begins with it. After
    the last one the robot stops for a step and begins again."""
    states: int = Field(default=4, ge=1, le=modules.MOST_STATES)
    """States that a machine has at most; every episode begins in the first. Of a tree: subtrees, up to 4."""
    transitions: int | None = Field(default=None, ge=1, le=modules.MOST_TRANSITIONS)
    """Transitions that a state has at most, by default 4. Of a tree: 1."""
    behaviours: list[str] | None = Field(default=None, min_length=1)
    """Those that machines are made of, in the order of their genes: exploration, stop, phototaxis,
    anti_phototaxis, attraction and repulsion, by default all of them; those of installed packages; and
    classes in Python, path/to/file.py:Class (relative to this file). With one of these, or such a condition,
    machines are evaluated in Python, in this process or on servers that have the code."""
    conditions: list[str] | None = Field(default=None, min_length=1)
    """Those of transitions: black_floor, grey_floor, white_floor, neighbours, few_neighbours and
    fixed_probability, by default all of them; those of installed packages; and path/to/file.py:Class."""
    machine: dict[str, Any] | str | None = None
    """A machine to start from: {states: [{behaviour, transitions: [{to, condition}]}]}, with the parameters
    of each behaviour and condition beside it; the path of a YAML file with that, as `swarmwright export --to
    machine` writes it; or the text that AutoMoDe's programs are called with, --nstates 2 --s0 4 --att0 5 ..,
    also with all that stands before it, automode_main -c mission.argos --fsm-config ..
    A tree is {subtrees: [{condition, behaviour}]}, such a file, or AutoMoDe's --nroot 3 --nchildroot 2 .. The
    text may be in a file, too. Evolution begins with it and with mutants of it, of up to 8 changes each, or
    around it where a method samples from a distribution. Default: random ones."""

    @property
    def most_transitions(self) -> int:
        """Transitions that a state has at most."""
        if self.transitions is not None:
            return self.transitions
        return 1 if self.form == "tree" else 4

    @field_validator("machine", mode="before")
    @classmethod
    def _plain(cls, value: Any) -> Any:  # noqa: ANN401 - whatever the file says
        if isinstance(value, str) and not is_command_line(value):
            try:
                source = read(Path(value))
            except InputError as error:
                raise ValueError(
                    f"{error}; expected a mapping, such a file, or AutoMoDe's --nstates .. or --nroot .."
                ) from None
            if source.problems:
                raise ValueError("; ".join(f"{value}:{line}: {what}" for _, line, what in source.problems))
            if not source.values:
                raise ValueError(f"{value}: is empty; `swarmwright export --to machine` writes such files")
            value = source.values
        return json.loads(json.dumps(value)) if isinstance(value, dict) else value

    @model_validator(mode="after")
    def _valid(self, info: ValidationInfo) -> "ModulesOptions":
        if self.form == "tree" and self.states > modules.MOST_SUBTREES:
            raise ValueError(
                f"states: a tree has {modules.MOST_SUBTREES} subtrees at most, not {self.states}"
            )
        if self.form == "tree" and self.most_transitions != 1:
            raise ValueError("transitions: a subtree has one condition; leave it out")
        for name in ("behaviours", "conditions"):
            given = [modules.label_of(one) for one in getattr(self, name) or []]
            twice = [one for one in given if given.count(one) > 1]
            if twice:
                raise ValueError(f"{name}: {twice[0]!r} is given twice")
            for one in getattr(self, name) or []:
                if modules.is_in_file(one) and modules.label_of(one) in _BUILT_IN:
                    raise ValueError(f"{name}: {one}: the engine has a module of this name; rename the class")
        if self.in_files and not (info.context or {}).get("ask", True):
            return self  # of a run, which is read without importing its code
        for name, what in (("behaviours", "behaviour"), ("conditions", "condition")):
            for one in getattr(self, name) or []:
                try:
                    module(what, one)
                except InputError as error:
                    raise ValueError(f"{name}: {error}") from None
        catalogue = self.catalogue
        both = {name for one in catalogue.behaviours for name in one.parameters}
        both &= {name for one in catalogue.conditions for name in one.parameters}
        if both and self.form == "tree":
            raise ValueError(
                f"conditions: {min(both)!r} is a parameter of a behaviour and of a condition, which stand "
                "beside each other in a subtree; rename one of the two"
            )
        return self

    @model_validator(mode="wrap")
    @classmethod
    def _with_start(
        cls,
        values: Any,  # noqa: ANN401 - whatever the file says
        handler: ModelWrapValidatorHandler[Self],
        info: ValidationInfo,
    ) -> Self:
        options = handler(values)
        if options.in_files and not (info.context or {}).get("ask", True):
            return options
        try:
            options.start()
        except InputError as error:
            given = values.get("machine") if isinstance(values, Mapping) else None
            raise ValueError(f"machine: {_placed(given, str(error))}") from None
        return options

    @property
    def in_python(self) -> bool:
        """Whether a module is written in Python, so that controllers are evaluated there."""
        return bool(self.plug_ins)

    @property
    def in_files(self) -> bool:
        """Whether a module is named by its file."""
        return any(modules.is_in_file(name) for _, name in self.plug_ins)

    @property
    def plug_ins(self) -> tuple[tuple[str, str], ...]:
        """The modules in Python, as behaviour or condition and name."""
        parts = (("behaviour", self.behaviours or ()), ("condition", self.conditions or ()))
        return tuple((what, one) for what, many in parts for one in many if one not in _BUILT_IN)

    @property
    def catalogue(self) -> modules.Catalogue:
        """The modules of which machines are made. Raises InputError for an unknown one."""
        return modules.Catalogue(
            tuple(module("behaviour", one) for one in self.behaviours or modules.BEHAVIOURS),
            tuple(module("condition", one) for one in self.conditions or modules.CONDITIONS),
        )

    def start(self) -> tuple[modules.State, ...] | None:
        """Return the machine to start from. Raises InputError when it is wrong."""
        if self.machine is None:
            return None
        if self.form == "tree":
            tree = tree_of(self.machine) if isinstance(self.machine, str) else self.machine
            return machine_mappings.subtrees_from(tree, self.states, self.catalogue)
        machine = machine_of(self.machine) if isinstance(self.machine, str) else self.machine
        states = machine_mappings.states_from(machine, self.states, self.most_transitions, self.catalogue)
        for index, state in enumerate(states):
            for k, one in enumerate(state.transitions):
                if one.target == index:
                    where = f"states[{index}].transitions[{k}].to"
                    raise InputError(f"{where}: a transition must lead to another state")
        return states
