"""Modules, and machines and trees of them: states with behaviours, transitions with conditions.

A subtree of a tree is a state with one transition, of which only the condition is used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

BEHAVIOURS = ("exploration", "stop", "phototaxis", "anti_phototaxis", "attraction", "repulsion")
"""Names in the order of their numbers."""
CONDITIONS = (
    "black_floor",
    "grey_floor",
    "white_floor",
    "neighbours",
    "few_neighbours",
    "fixed_probability",
)
"""Names in the order of their numbers."""
SENSORS, ACTUATORS = 9, 2
MOST_STATES, MOST_TRANSITIONS = 16, 4
MOST_SUBTREES = 4
STATE_WEIGHTS, TRANSITION_WEIGHTS = 4, 5
"""Number of weights of a state without its transitions, and of a transition."""

BEHAVIOUR_PARAMETERS: dict[str, str] = {"exploration": "rwm", "attraction": "alpha", "repulsion": "alpha"}
"""Parameter of each behaviour that has one."""
CONDITION_PARAMETERS: dict[str, tuple[str, ...]] = {
    name: ("xi", "eta") if "neighbours" in name else ("probability",) for name in CONDITIONS
}
"""Parameters of each condition."""
RANGES: dict[str, tuple[float, float, bool]] = {
    "rwm": (1, 100, True),
    "alpha": (1, 5, True),
    "probability": (0, 1, False),
    "xi": (1, 10, True),
    "eta": (0, 20, False),
}
"""Lowest and highest value of each parameter, and whether it is an integer."""
COLUMNS = {"rwm": 1, "alpha": 2, "probability": 2, "xi": 3, "eta": 4}
"""Column of each parameter in the weights of a state or of a transition."""

KIND, PYTHON_KIND = "modules", "python_modules"
"""Kinds of controllers: only engine modules; with modules in Python."""

Range = tuple[float, float, bool]
"""Lowest and highest value of a parameter, and whether it is an integer."""


@dataclass(frozen=True)
class Module:
    """A behaviour or a condition: its name and its parameters."""

    name: str
    parameters: Mapping[str, Range]
    file: str = ""
    """For a class in a file: the name of the file without its folder."""
    sha256: str = ""
    """SHA-256 of that file and its imports, in hexadecimal."""

    @property
    def built_in(self) -> bool:
        """Whether the module is part of the engine."""
        return not self.file and (self.name in BEHAVIOURS or self.name in CONDITIONS)

    def as_mapping(self) -> dict[str, Any]:
        """Return the module as a mapping for specifications."""
        code = {"file": self.file, "sha256": self.sha256} if self.file else {}
        ranges = {name: list(parameter) for name, parameter in self.parameters.items()}
        return {"name": self.name, **code, "parameters": ranges}


def engine_module(name: str) -> Module:
    """Return a module of the engine by its name."""
    if name in BEHAVIOUR_PARAMETERS:
        names: tuple[str, ...] = (BEHAVIOUR_PARAMETERS[name],)
    else:
        names = CONDITION_PARAMETERS.get(name, ())
    return Module(name, {module_name: RANGES[module_name] for module_name in names})


@dataclass(frozen=True)
class Catalogue:
    """The modules of a machine, in the order of their numbers, and the columns of their parameters.

    Parameters of the engine's modules have the same columns as in the engine. Parameters of user modules
    follow, each in its own column.
    """

    behaviours: tuple[Module, ...]
    conditions: tuple[Module, ...]

    @classmethod
    def from_specification(cls, specification: Mapping[str, Any]) -> Self:
        """Return the modules of a controller; for the kind `modules`, all of the engine's."""
        if specification.get("kind") != PYTHON_KIND:
            return cls(tuple(map(engine_module, BEHAVIOURS)), tuple(map(engine_module, CONDITIONS)))
        return cls(*(tuple(map(parse_module, specification[key])) for key in ("behaviours", "conditions")))

    @property
    def in_python(self) -> bool:
        """Whether any module is not part of the engine."""
        return not all(module.built_in for module in (*self.behaviours, *self.conditions))

    @cached_property
    def state_weights(self) -> int:
        """Number of weights of a state without its transitions."""
        return STATE_WEIGHTS + _count_user_parameters(self.behaviours)

    @cached_property
    def transition_weights(self) -> int:
        """Number of weights of a transition."""
        return TRANSITION_WEIGHTS + _count_user_parameters(self.conditions)

    @cached_property
    def behaviour_columns(self) -> dict[str, dict[str, int]]:
        """Behaviour -> parameter -> column in the weights of a state."""
        return _assign_columns(self.behaviours, STATE_WEIGHTS)

    @cached_property
    def condition_columns(self) -> dict[str, dict[str, int]]:
        """Condition -> parameter -> column in the weights of a transition."""
        return _assign_columns(self.conditions, TRANSITION_WEIGHTS)

    def behaviour(self, name: str) -> Module:
        """Return a behaviour by its name."""
        return next(module for module in self.behaviours if module.name == name)

    def condition(self, name: str) -> Module:
        """Return a condition by its name."""
        return next(module for module in self.conditions if module.name == name)


def parse_module(entry: Mapping[str, Any]) -> Module:
    """Parse a module of a specification."""
    ranges = {name: (low, high, bool(whole)) for name, (low, high, whole) in entry["parameters"].items()}
    return Module(str(entry["name"]), ranges, str(entry.get("file", "")), str(entry.get("sha256", "")))


def _count_user_parameters(modules: Sequence[Module]) -> int:
    return sum(len(module.parameters) for module in modules if not module.built_in)


def _assign_columns(modules: Sequence[Module], first: int) -> dict[str, dict[str, int]]:
    columns: dict[str, dict[str, int]] = {}
    for module in modules:
        if module.built_in:
            columns[module.name] = {name: COLUMNS[name] for name in module.parameters}
        else:
            columns[module.name] = {name: first + index for index, name in enumerate(module.parameters)}
            first += len(module.parameters)
    return columns


BUILT_IN = Catalogue(tuple(map(engine_module, BEHAVIOURS)), tuple(map(engine_module, CONDITIONS)))
"""All modules of the engine."""


@dataclass(frozen=True)
class Transition:
    """A transition. target: number of a state. parameters: those of its condition."""

    target: int
    condition: str
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class State:
    """A state. parameters: those of its behaviour."""

    behaviour: str
    parameters: Mapping[str, float]
    transitions: tuple[Transition, ...]


def is_tree(specification: Mapping[str, Any]) -> bool:
    """Whether a controller of the kind `modules` is a behaviour tree."""
    return specification.get("form") == "tree"


def is_modules(specification: Mapping[str, Any]) -> bool:
    """Whether a controller is a machine or a tree of modules."""
    return specification.get("kind") in {KIND, PYTHON_KIND}


def count_weights(architecture: Mapping[str, Any]) -> int:
    """Return the number of weights of an architecture."""
    catalogue = Catalogue.from_specification(architecture)
    each = catalogue.state_weights + int(architecture["transitions"]) * catalogue.transition_weights
    return 1 + int(architecture["states"]) * each


def states_of(specification: Mapping[str, Any]) -> tuple[State, ...]:
    """Return the states of a controller of the kind `modules`, state 0 first; the subtrees of a tree."""
    tree, catalogue = is_tree(specification), Catalogue.from_specification(specification)
    weights = [float(weight) for weight in specification["weights"]]
    most = int(specification["transitions"])
    first, each = catalogue.state_weights, catalogue.transition_weights
    width = first + most * each
    count = _whole(weights[0], 1, int(specification["states"]))
    states = []
    for index in range(count):
        row = weights[1 + index * width :][:width]
        behaviour = catalogue.behaviours[_whole(row[0], 0, len(catalogue.behaviours) - 1)]
        transitions = tuple(
            _transition(row[first + k * each :][:each], count, catalogue)
            for k in range(1 if tree else _whole(row[3], 0, most))
        )
        if tree:
            transitions = (Transition(0, transitions[0].condition, transitions[0].parameters),)
        parameters = _parameters(row, behaviour, catalogue.behaviour_columns)
        states.append(State(behaviour.name, parameters, transitions))
    return tuple(states)


def _transition(row: Sequence[float], states: int, catalogue: Catalogue) -> Transition:
    condition = catalogue.conditions[_whole(row[1], 0, len(catalogue.conditions) - 1)]
    target = _whole(row[0], 0, states - 1)
    return Transition(target, condition.name, _parameters(row, condition, catalogue.condition_columns))


def _parameters(
    row: Sequence[float], module: Module, columns: Mapping[str, Mapping[str, int]]
) -> dict[str, float]:
    parameters: dict[str, float] = {}
    for name, (low, high, whole) in module.parameters.items():
        value = min(max(row[columns[module.name][name]], low), high)
        parameters[name] = int(value) if whole else value
    return parameters


def _whole(weight: float, low: int, high: int) -> int:
    return int(min(max(weight, low), high))


def weights_of(
    states: Sequence[State], most_states: int, most_transitions: int, catalogue: Catalogue = BUILT_IN
) -> list[float]:
    """Return the weights of a controller with these states; unused weights are 0."""
    first, each = catalogue.state_weights, catalogue.transition_weights
    weights = [float(len(states))]
    for state in states:
        row = [0.0] * first
        row[0] = float(catalogue.behaviours.index(catalogue.behaviour(state.behaviour)))
        row[3] = float(len(state.transitions))
        for name, value in state.parameters.items():
            row[catalogue.behaviour_columns[state.behaviour][name]] = float(value)
        for transition in state.transitions:
            part = [0.0] * each
            part[0] = float(transition.target)
            part[1] = float(catalogue.conditions.index(catalogue.condition(transition.condition)))
            for name, value in transition.parameters.items():
                part[catalogue.condition_columns[transition.condition][name]] = float(value)
            row += part
        weights += row + [0.0] * (first + most_transitions * each - len(row))
    return weights + [0.0] * ((most_states - len(states)) * (first + most_transitions * each))
