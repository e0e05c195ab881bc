"""Modules, and machines and trees of them: states with behaviours, transitions with conditions.

A subtree of a tree is a state with one transition, of which the condition counts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

BEHAVIOURS = ("exploration", "stop", "phototaxis", "anti_phototaxis", "attraction", "repulsion")
"""In the order of their numbers."""
CONDITIONS = (
    "black_floor",
    "grey_floor",
    "white_floor",
    "neighbours",
    "few_neighbours",
    "fixed_probability",
)
"""In the order of their numbers."""
SENSORS, ACTUATORS = 9, 2
MOST_STATES, MOST_TRANSITIONS = 16, 4
MOST_SUBTREES = 4
OF_STATE, OF_TRANSITION = 4, 5
"""Weights of a state without its transitions, and of a transition."""

BEHAVIOUR_PARAMETERS: dict[str, str] = {"exploration": "rwm", "attraction": "alpha", "repulsion": "alpha"}
"""What a behaviour is set by; others by nothing."""
CONDITION_PARAMETERS: dict[str, tuple[str, ...]] = {
    name: ("xi", "eta") if "neighbours" in name else ("probability",) for name in CONDITIONS
}
"""What a condition is set by."""
RANGES: dict[str, tuple[float, float, bool]] = {
    "rwm": (1, 100, True),
    "alpha": (1, 5, True),
    "probability": (0, 1, False),
    "xi": (1, 10, True),
    "eta": (0, 20, False),
}
"""Lowest and highest value of each parameter, and whether it is an integer."""
PLACES = {"rwm": 1, "alpha": 2, "probability": 2, "xi": 3, "eta": 4}
"""In the weights of a state or of a transition."""

KIND, PYTHON_KIND = "modules", "python_modules"
"""Kinds of controllers: all modules are the engine's; some are written in Python."""

Range = tuple[float, float, bool]
"""Lowest and highest value of a parameter, and whether it is an integer."""


@dataclass(frozen=True)
class Module:
    """A behaviour or a condition: its name, and what it is set by."""

    name: str
    parameters: Mapping[str, Range]
    file: str = ""
    """Of a class that is named by its file: what this is called, without its folder."""
    sha256: str = ""
    """Of that file and of what it imports, in hexadecimal."""

    @property
    def built_in(self) -> bool:
        """Whether it is one of the engine's."""
        return not self.file and (self.name in BEHAVIOURS or self.name in CONDITIONS)

    def as_mapping(self) -> dict[str, Any]:
        """Return it as specifications hold it."""
        code = {"file": self.file, "sha256": self.sha256} if self.file else {}
        ranges = {name: list(parameter) for name, parameter in self.parameters.items()}
        return {"name": self.name, **code, "parameters": ranges}


def built_in(name: str) -> Module:
    """Return one of the engine's modules by its name."""
    if name in BEHAVIOUR_PARAMETERS:
        names: tuple[str, ...] = (BEHAVIOUR_PARAMETERS[name],)
    else:
        names = CONDITION_PARAMETERS.get(name, ())
    return Module(name, {module_name: RANGES[module_name] for module_name in names})


@dataclass(frozen=True)
class Catalogue:
    """The modules that a machine is made of, in the order of their numbers, and where their parameters are.

    Parameters of the engine's modules have the places that they have in the engine's weights. Those of
    others follow, each in a place of its own.
    """

    behaviours: tuple[Module, ...]
    conditions: tuple[Module, ...]

    @classmethod
    def of(cls, specification: Mapping[str, Any]) -> Self:
        """Return the modules of a controller; of one of the kind `modules` all of the engine's."""
        if specification.get("kind") != PYTHON_KIND:
            return cls(tuple(map(built_in, BEHAVIOURS)), tuple(map(built_in, CONDITIONS)))
        return cls(*(tuple(map(module_of, specification[key])) for key in ("behaviours", "conditions")))

    @property
    def in_python(self) -> bool:
        """Whether a module is not one of the engine's."""
        return not all(module.built_in for module in (*self.behaviours, *self.conditions))

    @cached_property
    def of_state(self) -> int:
        """Weights of a state without its transitions."""
        return OF_STATE + _own_places(self.behaviours)

    @cached_property
    def of_transition(self) -> int:
        """Weights of a transition."""
        return OF_TRANSITION + _own_places(self.conditions)

    @cached_property
    def behaviour_places(self) -> dict[str, dict[str, int]]:
        """Behaviour -> parameter -> its place among the weights of a state."""
        return _places(self.behaviours, OF_STATE)

    @cached_property
    def condition_places(self) -> dict[str, dict[str, int]]:
        """Condition -> parameter -> its place among the weights of a transition."""
        return _places(self.conditions, OF_TRANSITION)

    def behaviour(self, name: str) -> Module:
        """Return a behaviour by its name."""
        return next(module for module in self.behaviours if module.name == name)

    def condition(self, name: str) -> Module:
        """Return a condition by its name."""
        return next(module for module in self.conditions if module.name == name)


def module_of(entry: Mapping[str, Any]) -> Module:
    """Return a module as specifications hold it."""
    ranges = {name: (low, high, bool(whole)) for name, (low, high, whole) in entry["parameters"].items()}
    return Module(str(entry["name"]), ranges, str(entry.get("file", "")), str(entry.get("sha256", "")))


def _own_places(modules: Sequence[Module]) -> int:
    return sum(len(module.parameters) for module in modules if not module.built_in)


def _places(modules: Sequence[Module], first: int) -> dict[str, dict[str, int]]:
    places: dict[str, dict[str, int]] = {}
    for module in modules:
        if module.built_in:
            places[module.name] = {name: PLACES[name] for name in module.parameters}
        else:
            places[module.name] = {name: first + index for index, name in enumerate(module.parameters)}
            first += len(module.parameters)
    return places


BUILT_IN = Catalogue(tuple(map(built_in, BEHAVIOURS)), tuple(map(built_in, CONDITIONS)))
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
    """Return whether a controller of the kind `modules` is a behaviour tree."""
    return specification.get("form") == "tree"


def is_modules(specification: Mapping[str, Any]) -> bool:
    """Return whether a controller is a machine or a tree of modules."""
    return specification.get("kind") in {KIND, PYTHON_KIND}


def weight_count(architecture: Mapping[str, Any]) -> int:
    """Return how many weights controllers of an architecture have."""
    catalogue = Catalogue.of(architecture)
    each = catalogue.of_state + int(architecture["transitions"]) * catalogue.of_transition
    return 1 + int(architecture["states"]) * each


def states_of(specification: Mapping[str, Any]) -> tuple[State, ...]:
    """Return the states of a controller of the kind `modules`, state 0 first; of a tree the subtrees."""
    tree, catalogue = is_tree(specification), Catalogue.of(specification)
    weights = [float(weight) for weight in specification["weights"]]
    most = int(specification["transitions"])
    first, each = catalogue.of_state, catalogue.of_transition
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
        parameters = _parameters(row, behaviour, catalogue.behaviour_places)
        states.append(State(behaviour.name, parameters, transitions))
    return tuple(states)


def _transition(row: Sequence[float], states: int, catalogue: Catalogue) -> Transition:
    condition = catalogue.conditions[_whole(row[1], 0, len(catalogue.conditions) - 1)]
    target = _whole(row[0], 0, states - 1)
    return Transition(target, condition.name, _parameters(row, condition, catalogue.condition_places))


def _parameters(
    row: Sequence[float], module: Module, places: Mapping[str, Mapping[str, int]]
) -> dict[str, float]:
    parameters: dict[str, float] = {}
    for name, (low, high, whole) in module.parameters.items():
        value = min(max(row[places[module.name][name]], low), high)
        parameters[name] = int(value) if whole else value
    return parameters


def _whole(weight: float, low: int, high: int) -> int:
    return int(min(max(weight, low), high))


def weights_of(
    states: Sequence[State], most_states: int, most_transitions: int, catalogue: Catalogue = BUILT_IN
) -> list[float]:
    """Return the weights of a controller with these states; places that are not used are 0."""
    first, each = catalogue.of_state, catalogue.of_transition
    weights = [float(len(states))]
    for state in states:
        row = [0.0] * first
        row[0] = float(catalogue.behaviours.index(catalogue.behaviour(state.behaviour)))
        row[3] = float(len(state.transitions))
        for name, value in state.parameters.items():
            row[catalogue.behaviour_places[state.behaviour][name]] = float(value)
        for transition in state.transitions:
            part = [0.0] * each
            part[0] = float(transition.target)
            part[1] = float(catalogue.conditions.index(catalogue.condition(transition.condition)))
            for name, value in transition.parameters.items():
                part[catalogue.condition_places[transition.condition][name]] = float(value)
            row += part
        weights += row + [0.0] * (first + most_transitions * each - len(row))
    return weights + [0.0] * ((most_states - len(states)) * (first + most_transitions * each))
