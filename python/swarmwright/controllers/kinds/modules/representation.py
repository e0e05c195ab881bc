"""Probabilistic finite-state machines and behaviour trees of predefined behaviours and conditions."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    Field,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from swarmwright.common.arrays import Genome, Genomes, Limits
from swarmwright.common.errors import InputError
from swarmwright.common.problems import FieldError, problems_of
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.common.simulation_names import is_in_file, label_of
from swarmwright.common.yaml import read
from swarmwright.controllers._base import Representation, RepresentationOptions, split_rows
from swarmwright.controllers.kinds.modules.automode import is_command_line, parse_machine, parse_tree
from swarmwright.controllers.modules import grammar, machine_mappings
from swarmwright.controllers.modules.grammar import RANGES
from swarmwright.controllers.modules.registered import module

_BUILT_IN = frozenset({*grammar.BEHAVIOURS, *grammar.CONDITIONS})


def _locate_error(machine: object, error: InputError) -> FieldError:
    """Return the error of a machine, with file and line if it is in a file."""
    path, reason = (error.path, error.reason) if isinstance(error, FieldError) else ((), str(error))
    if isinstance(machine, str) and not is_command_line(machine):
        return FieldError("machine", read(Path(machine)).locate(path) + reason)
    return FieldError(("machine", *path), reason)


class ModulesOptions(RepresentationOptions):
    """A machine (AutoMoDe-Chocolate) or a tree (AutoMoDe-Maple) of predefined behaviours and conditions.

    For two-wheeled robots with the sensors of the preset e-puck-rm1.2 of `arena`.
    """

    kind: Literal["modules"] = "modules"
    form: Literal["machine", "tree"] = "machine"
    """machine: a probabilistic finite-state machine. tree: a behaviour tree, a sequence with memory of
    subtrees, each a selector between a condition and a behaviour. If the condition holds, the next subtree
    is tried in the same step; else the behaviour acts, and the next step begins with it. After the last
    subtree the robot stops for a step.
    """
    states: int = Field(default=4, ge=1, le=grammar.MOST_STATES)
    """Largest number of states of a machine; every episode begins in the first. For a tree: of subtrees, up
    to 4."""
    transitions: int | None = Field(default=None, ge=1, le=grammar.MOST_TRANSITIONS)
    """Largest number of transitions of a state, by default 4. For a tree: 1."""
    behaviours: list[str] | None = Field(default=None, min_length=1)
    """Behaviours, in the order of their genes: exploration, stop, phototaxis, anti_phototaxis, attraction and
    repulsion (the default), those of installed packages, and classes in Python, path/to/file.py:Class
    (relative to this file). Machines with parts in Python are evaluated in Python, in this process or on
    servers that have the code.
    """
    conditions: list[str] | None = Field(default=None, min_length=1)
    """Conditions of transitions: black_floor, grey_floor, white_floor, neighbours, few_neighbours and
    fixed_probability (the default), those of installed packages, and path/to/file.py:Class.
    """
    machine: dict[str, Any] | str | None = None
    """A machine to start from: {states: [{behaviour, transitions: [{to, condition}]}]}, with the parameters
    of each behaviour and condition beside it; a tree is {subtrees: [{condition, behaviour}]}. Or the path
    of a YAML file with this mapping, as written by `swarmwright export --to machine`; or the arguments of
    AutoMoDe's programs, --nstates 2 --s0 4 --att0 5 .. or --nroot 3 --nchildroot 2 .., also as a whole
    command line or in a file. Evolution begins with this machine and mutants of up to 8 changes, or around
    it. Default: random machines.
    """

    @property
    def most_transitions(self) -> int:
        """Largest number of transitions of a state."""
        if self.transitions is not None:
            return self.transitions
        return 1 if self.form == "tree" else 4

    @field_validator("machine", mode="before")
    @classmethod
    def _read_machine(cls, value: Any) -> Any:  # noqa: ANN401 - whatever the file says
        if isinstance(value, str) and not is_command_line(value):
            try:
                source = read(Path(value))
            except InputError as error:
                raise ValueError(
                    f"{error}; expected a mapping, a YAML file, or AutoMoDe's --nstates .. or --nroot .."
                ) from None
            if source.problems:
                raise ValueError(
                    "; ".join(f"{value}:{line}: {problem}" for _, line, problem in source.problems)
                )
            if not source.values:
                raise ValueError(f"{value}: is empty; write a machine with `swarmwright export --to machine`")
            value = source.values
        return json.loads(json.dumps(value)) if isinstance(value, dict) else value

    @model_validator(mode="after")
    def _check_modules(self, info: ValidationInfo) -> "ModulesOptions":
        if self.form == "tree" and self.states > grammar.MOST_SUBTREES:
            raise FieldError(
                "states", f"a tree has at most {grammar.MOST_SUBTREES} subtrees, not {self.states}"
            )
        if self.form == "tree" and self.most_transitions != 1:
            raise FieldError("transitions", "a subtree has one condition; remove this key")
        for name in ("behaviours", "conditions"):
            modules = getattr(self, name) or []
            labels = [label_of(module_name) for module_name in modules]
            duplicates = [label for label in labels if labels.count(label) > 1]
            if duplicates:
                raise FieldError(name, f"{duplicates[0]!r} occurs twice")
            for module_name in modules:
                if is_in_file(module_name) and label_of(module_name) in _BUILT_IN:
                    raise FieldError(
                        name, f"{module_name}: the engine has a module of this name; rename the class"
                    )
        if self.in_files and not (info.context or {}).get("ask", True):
            return self  # runs are read without importing their code
        for name, role in (("behaviours", "behaviour"), ("conditions", "condition")):
            for module_name in getattr(self, name) or []:
                try:
                    module(role, module_name)
                except InputError as error:
                    raise FieldError(name, str(error)) from None
        catalogue = self.catalogue
        both = {name for behaviour in catalogue.behaviours for name in behaviour.parameters}
        both &= {name for condition in catalogue.conditions for name in condition.parameters}
        if both and self.form == "tree":
            raise FieldError(
                "conditions",
                f"{min(both)!r} is a parameter of a behaviour and of a condition, which share "
                "the keys of a subtree; rename one of them",
            )
        return self

    @model_validator(mode="wrap")
    @classmethod
    def _check_machine(
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
            machine = values.get("machine") if isinstance(values, Mapping) else None
            raise _locate_error(machine, error) from None
        return options

    @property
    def in_python(self) -> bool:
        """Whether a module is written in Python, so that controllers are evaluated in Python."""
        return bool(self.plug_ins)

    @property
    def in_files(self) -> bool:
        """Whether a module is named by its file."""
        return any(is_in_file(name) for _, name in self.plug_ins)

    @property
    def plug_ins(self) -> tuple[tuple[str, str], ...]:
        """The modules in Python: role (behaviour or condition) and name."""
        parts = (("behaviour", self.behaviours or ()), ("condition", self.conditions or ()))
        return tuple((role, name) for role, names in parts for name in names if name not in _BUILT_IN)

    @property
    def catalogue(self) -> grammar.Catalogue:
        """The modules of the machines. Raises InputError for an unknown module."""
        return grammar.Catalogue(
            tuple(module("behaviour", behaviour) for behaviour in self.behaviours or grammar.BEHAVIOURS),
            tuple(module("condition", condition) for condition in self.conditions or grammar.CONDITIONS),
        )

    def start(self) -> tuple[grammar.State, ...] | None:
        """Return the machine to start from. Raises InputError when it is invalid."""
        if self.machine is None:
            return None
        if self.form == "tree":
            tree = parse_tree(self.machine) if isinstance(self.machine, str) else self.machine
            return machine_mappings.parse_subtrees(tree, self.states, self.catalogue)
        machine = parse_machine(self.machine) if isinstance(self.machine, str) else self.machine
        states = machine_mappings.parse_states(machine, self.states, self.most_transitions, self.catalogue)
        for index, state in enumerate(states):
            for k, transition in enumerate(state.transitions):
                if transition.target == index:
                    path = f"states[{index}].transitions[{k}].to"
                    raise InputError(f"{path}: a transition must lead to another state")
        return states


_MOVE, _MORE, _LESS, _CHOICE = range(4)
_Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class Layout:
    """Positions and meaning of the genes of machines.

    sets_state, sets_transition: for each behaviour and each condition, whether it uses each gene of a state
    or of a transition. counted: for each gene, whether it is rounded down to an integer. lower, upper:
    bounds.
    """

    states: int
    transitions: int
    tree: bool
    sets_state: NDArray[np.bool_]
    sets_transition: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    lower: _Numbers
    upper: _Numbers


class Changes:
    """All changes of a machine: kind and gene of each."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._behaviours, self._first = layout.sets_state.shape
        self._conditions, self._transition_size = layout.sets_transition.shape
        self._width = self._first + layout.transitions * self._transition_size
        slots = [(_MORE, 0, layout.states), (_LESS, 0, layout.states)]
        for state in range(layout.states):
            slots += self._state_slots(1 + state * self._width)
        self._kinds, self._genes, self._most = (np.array(part) for part in zip(*slots, strict=True))
        self._moved = [column for column in range(1, self._first) if column != 3]
        """Columns of the behaviours' parameters in a state; the conditions' parameters begin at column 2."""

    def _state_slots(self, at: int) -> list[tuple[int, int, int]]:
        most = self._layout.transitions
        slots = [(_CHOICE, at, self._behaviours)]
        slots += [(_MOVE, at + column, 0) for column in range(1, self._first) if column != 3]
        slots += [(_MORE, at + 3, most), (_LESS, at + 3, most)]
        for k in range(most):
            start = at + self._first + k * self._transition_size
            slots += [(_CHOICE, start, 0), (_CHOICE, start + 1, self._conditions)]
            slots += [(_MOVE, start + column, 0) for column in range(2, self._transition_size)]
        return slots

    def make(self, genomes: _Numbers, streams: Sequence[Stream], severities: _Numbers) -> None:
        """Apply a random possible change to each genome, in place.

        Args:
            genomes: (n, genes).
            streams: one for each genome, drawn from in turn.
            severities: (n,).
        """
        states = np.clip(genomes[:, 0].astype(np.int64), 1, self._layout.states)
        possible = self._find_possible(genomes, states)
        # Indices of all possible changes, genome after genome.
        slots = np.flatnonzero(possible)
        ends = np.cumsum(possible.sum(axis=1))
        begin = 0
        for row, (stream, end) in enumerate(zip(streams, ends.tolist(), strict=True)):
            if end > begin:
                slot = int(slots[begin + stream.integer(end - begin)]) - row * possible.shape[1]
                self._apply(genomes[row], slot, stream, float(severities[row]), int(states[row]))
            begin = end

    def _find_possible(self, genomes: _Numbers, states: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which changes are possible, (n, changes)."""
        layout, count = self._layout, len(genomes)
        possible = np.zeros((count, len(self._kinds)), dtype=np.bool_)
        if layout.states > 1:
            possible[:, 0], possible[:, 1] = states < layout.states, states > 1
        rows = genomes[:, 1:].reshape(count, layout.states, self._width)
        parts = possible[:, 2:].reshape(count, layout.states, -1)
        exists = np.arange(layout.states) < states[:, np.newaxis]
        parts[..., 0] = exists & (self._behaviours > 1)
        behaviours = np.minimum(rows[..., 0].astype(np.int64), self._behaviours - 1)
        after = 1 + len(self._moved)
        parts[..., 1:after] = layout.sets_state[behaviours][..., self._moved] & exists[..., np.newaxis]
        exists &= (states > 1)[:, np.newaxis] | layout.tree
        used_transitions = np.ones(exists.shape, dtype=np.int64)
        if not layout.tree:
            used_transitions = np.clip(rows[..., 3].astype(np.int64), 0, layout.transitions)
            parts[..., after] = exists & (used_transitions < layout.transitions)
            parts[..., after + 1] = exists & (used_transitions > 1)
        transitions = rows[..., self._first :].reshape(
            count, layout.states, layout.transitions, self._transition_size
        )
        inner = parts[..., after + 2 :].reshape(
            count, layout.states, layout.transitions, self._transition_size
        )
        used = exists[..., np.newaxis] & (np.arange(layout.transitions) < used_transitions[..., np.newaxis])
        inner[..., 0] = used & ((states > 2) & (not layout.tree))[:, np.newaxis, np.newaxis]
        inner[..., 1] = used & (self._conditions > 1)
        conditions = np.minimum(transitions[..., 1].astype(np.int64), self._conditions - 1)
        inner[..., 2:] = layout.sets_transition[conditions][..., 2:] & used[..., np.newaxis]
        parts[..., after + 2 :] = inner.reshape(*parts.shape[:2], -1)
        possible[:, 2:] = parts.reshape(count, -1)
        return possible

    def _apply(self, genome: _Numbers, slot: int, stream: Stream, severity: float, states: int) -> None:
        """Apply a change, in place."""
        kind, gene, most = int(self._kinds[slot]), int(self._genes[slot]), int(self._most[slot])
        lower, upper = float(self._layout.lower[gene]), float(self._layout.upper[gene])
        value = float(genome[gene])
        if kind == _MOVE:
            value = self._move(value, gene, stream, severity)
        elif kind == _CHOICE:
            most = most or states - 1  # of a target
            value = (int(value) % most + 1 + stream.integer(most - 1)) % most + 0.5
        else:
            whole = min(max(int(value), 0), most)
            value = max(1, whole + (1 if kind == _MORE else -1)) + 0.5
        genome[gene] = min(max(value, lower), upper)

    def _move(self, value: float, gene: int, stream: Stream, severity: float) -> float:
        """Move a parameter uniformly, reflected at its limits; by at least 1 if it is an integer."""
        lower, upper = float(self._layout.lower[gene]), float(self._layout.upper[gene])
        step = float(stream.uniform(np.array([min(severity, 1.0) * (upper - lower)]))[0])
        if self._layout.counted[gene] and abs(step) < 1:
            step = 1.0 if step >= 0 else -1.0
        value += step
        if value > upper:
            value = 2 * upper - value
        if value < lower:
            value = 2 * lower - value
        return value


__all__ = ["Modules", "ModulesOptions"]

_MOST_CHANGES = 8
"""Largest number of changes of a mutation."""


def _single(genomes: Genomes) -> Genome:
    """Return the only genome."""
    genome: Genome = genomes[0]
    return genome


def _limits(
    names: tuple[str, ...], chosen: tuple[grammar.Module, ...], columns: Mapping[str, Mapping[str, int]]
) -> dict[int, grammar.Range]:
    """Return the limits of parameters by column: all of the engine's, and those of chosen user modules."""
    limits_by_column = {grammar.COLUMNS[name]: RANGES[name] for name in names}
    for chosen_module in chosen:
        limits_by_column |= {
            columns[chosen_module.name][name]: limits for name, limits in chosen_module.parameters.items()
        }
    return dict(sorted(limits_by_column.items()))


class Modules(Representation):
    """A machine of at most `states` states with at most `transitions` transitions each.

    Genes: the number of states (1 to states + 1, rounded down); for each state its behaviour (0 to
    6), rwm, alpha, the number of its transitions (0 to transitions + 1); for each of these its target, its
    condition (0 to 6), probability, xi and eta. A target is an index among the other states: with n states,
    indices beyond n - 1 start again at the first. A machine of one state has no transitions. Genes of unused
    states and transitions have no effect. Any numbers encode a machine, so that methods that compute with
    genes can evolve them, too. Random machines have a transition from each state.

    A mutation makes a change with `probability`, and after each change another with probability severity, at
    most 8: another behaviour, another condition, another target, a parameter that moves by up to severity
    times its range, or one transition or state more or less. A crossover takes a run of states from the
    father. The distance is the number of behaviours, targets and conditions that differ, plus the differences
    of all other genes in units of their ranges.

    A tree has the same genes with one transition for each state: a state is a subtree, and only the condition
    of its transition is used. Targets and numbers of transitions have no effect.

    Sources: Francesca et al., "AutoMoDe-Chocolate: automatic design of control software for robot swarms",
    Swarm Intelligence 9(2-3), 2015; Kuckling, Ligot, Bozhinoski and Birattari, "Behavior trees as a control
    architecture in the automatic modular design of robot swarms", ANTS 2018. When AutoMoDe's tree returns to
    an exploration that it left while the robot turned, the turn continues; here it does not.
    """

    kind: ClassVar[str] = "modules"
    options_model = ModulesOptions
    options: ModulesOptions
    shape: ClassVar[tuple[int, int] | None] = (grammar.SENSORS, grammar.ACTUATORS)

    def __init__(self, options: RepresentationOptions, *, sensors: int, actuators: int) -> None:
        """Raise InputError for other numbers of sensors and actuators."""
        super().__init__(options, sensors=sensors, actuators=actuators)
        if (sensors, actuators) != self.shape:
            raise FieldError(
                ("controller", "kind"),
                f"modules needs {grammar.SENSORS} sensors (proximity x and y, light x and "
                "y, ground, number of neighbours, attraction x and y, a random number) and "
                f"{grammar.ACTUATORS} actuators (left and right wheel), but the simulation has {sensors} and "
                f"{actuators}; use a robot such as e-puck-rm1.2 of arena for all agents, or another kind of "
                "controller",
            )

    @cached_property
    def catalogue(self) -> grammar.Catalogue:
        """The modules of the machines; genes number them from 0."""
        return self.options.catalogue

    @cached_property
    def _first(self) -> int:
        """Column of the first transition among the genes of a state."""
        return self.catalogue.state_weights

    @cached_property
    def _transition_size(self) -> int:
        """Number of genes of a transition."""
        return self.catalogue.transition_weights

    @cached_property
    def _width(self) -> int:
        return self._first + self._most * self._transition_size

    @property
    def _tree(self) -> bool:
        return self.options.form == "tree"

    @property
    def _most(self) -> int:
        """Number of transitions of a state in the genome."""
        return self.options.most_transitions

    @property
    def genome_size(self) -> int:
        """Number of genes."""
        return 1 + self.options.states * self._width

    @cached_property
    def bounds(self) -> Limits:
        """Lowest and highest values; integers end one above their highest value."""
        most, other_states = self._most, max(1, self.options.states - 1)

        def limits(limits_of: grammar.Range) -> tuple[float, float]:
            low, high, whole = limits_of
            return low, high + 1 if whole else high

        transition: list[tuple[float, float]] = [(0, other_states), (0, len(self.catalogue.conditions))]
        transition += [limits(self._conditions[column]) for column in range(2, self._transition_size)]
        state: list[tuple[float, float]] = [(0, len(self.catalogue.behaviours)), limits(self._behaviours[1])]
        state += [limits(self._behaviours[2]), (0, most + 1)]
        state += [limits(self._behaviours[column]) for column in range(4, self._first)]
        state += transition * most
        pairs = np.array([(1, self.options.states + 1), *(state * self.options.states)], dtype=np.float64)
        return pairs[:, 0].copy(), pairs[:, 1].copy()

    @cached_property
    def _behaviours(self) -> dict[int, grammar.Range]:
        """Limits of the behaviours' parameters, by column in a state."""
        return _limits(("rwm", "alpha"), self.catalogue.behaviours, self.catalogue.behaviour_columns)

    @cached_property
    def _conditions(self) -> dict[int, grammar.Range]:
        """Limits of the conditions' parameters, by column in a transition."""
        names = ("probability", "xi", "eta")
        return _limits(names, self.catalogue.conditions, self.catalogue.condition_columns)

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {
            "version": 1,
            "kind": grammar.PYTHON_KIND if self.catalogue.in_python else grammar.KIND,
            **({"form": "tree"} if self._tree else {}),
            "sensors": self.sensors,
            "actuators": self.actuators,
            "states": self.options.states,
            "transitions": self._most,
            **self._module_entries,
        }

    @property
    def _module_entries(self) -> dict[str, Any]:
        """The modules in the specification; empty if all are the engine's."""
        if not self.catalogue.in_python:
            return {}
        return {
            "behaviours": [behaviour.as_mapping() for behaviour in self.catalogue.behaviours],
            "conditions": [condition.as_mapping() for condition in self.catalogue.conditions],
        }

    def weights(self, genomes: Genomes) -> NDArray[np.float32]:
        """Return the machines that genomes encode, see the class."""
        weights = self._limit_weights(genomes)
        if not self.catalogue.in_python:
            # Indices among the chosen modules become the engine's numbers.
            weights = weights.copy()
            rows = weights[..., 1:].reshape(*weights.shape[:-1], self.options.states, self._width)
            rows[..., 0] = self._behaviour_numbers[rows[..., 0].astype(np.int64)]
            parts = rows[..., self._first + 1 :: self._transition_size]
            parts[...] = self._condition_numbers[parts.astype(np.int64)]
        return weights.astype(np.float32)

    @cached_property
    def _behaviour_numbers(self) -> NDArray[np.float64]:
        names = [behaviour.name for behaviour in self.catalogue.behaviours]
        return np.array([grammar.BEHAVIOURS.index(name) for name in names], dtype=np.float64)

    @cached_property
    def _condition_numbers(self) -> NDArray[np.float64]:
        names = [condition.name for condition in self.catalogue.conditions]
        return np.array([grammar.CONDITIONS.index(name) for name in names], dtype=np.float64)

    def _limit_weights(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return weights within their limits; behaviours and conditions are indices among the chosen ones."""
        lower, upper = self.bounds
        weights = np.clip(genomes.astype(np.float64), lower, upper)
        rows = self._rows_of(weights)
        states = self._floor_clip(weights[..., 0], 1, self.options.states)
        weights[..., 0] = states
        rows[..., 0] = self._floor_clip(rows[..., 0], 0, len(self.catalogue.behaviours) - 1)
        for column, (low, high, whole) in self._behaviours.items():
            if whole:
                rows[..., column] = self._floor_clip(rows[..., column], low, high)
        alone = (states == 1)[..., np.newaxis]
        rows[..., 3] = np.where(alone, 0, self._floor_clip(rows[..., 3], 0, self._most))
        parts = rows[..., self._first :].reshape(*rows.shape[:-1], self._most, self._transition_size)
        other_states = np.maximum(states - 1, 1)[..., np.newaxis, np.newaxis]
        target = np.floor(parts[..., 0]) % other_states
        indices = np.arange(self.options.states)[:, np.newaxis]
        parts[..., 0] = np.where(alone[..., np.newaxis], 0, target + (target >= indices))
        if self._tree:
            rows[..., 3], parts[..., 0] = 1, 0
        parts[..., 1] = self._floor_clip(parts[..., 1], 0, len(self.catalogue.conditions) - 1)
        for column, (low, high, whole) in self._conditions.items():
            if whole:
                parts[..., column] = self._floor_clip(parts[..., column], low, high)
        rows[..., self._first :] = parts.reshape(*rows.shape[:-1], self._width - self._first)
        weights[..., 1:] = rows.reshape(*weights.shape[:-1], self.genome_size - 1)
        return weights

    def _rows_of(self, genomes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a copy of the genes of states, (.., states, width)."""
        return genomes[..., 1:].reshape(*genomes.shape[:-1], self.options.states, self._width).copy()

    @staticmethod
    def _floor_clip(values: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
        clipped: NDArray[np.float64] = np.clip(np.floor(values), low, high)
        return clipped

    def states(self, genome: Genome) -> tuple[grammar.State, ...]:
        """Return the states of the machine that a genome encodes."""
        return grammar.states_of(self.specification(genome))

    @cached_property
    def start(self) -> Genome | None:
        """The genome of the machine to start from; None without one."""
        start = self.options.start()
        if start is None:
            return None
        lower, upper = self.bounds
        genome = lower + (upper - lower) / 2
        catalogue = self.catalogue
        weights = np.array(
            grammar.weights_of(start, self.options.states, self._most, catalogue), dtype=np.float64
        )
        genome[0] = weights[0] + 0.5
        for index, state in enumerate(start):
            at = 1 + index * self._width
            genome[at] = weights[at] + 0.5
            for name, column in catalogue.behaviour_columns[state.behaviour].items():
                genome[at + column] = state.parameters[name] + (0.5 if self._is_integer(at + column) else 0.0)
            genome[at + 3] = weights[at + 3] + 0.5
            for k, transition in enumerate(state.transitions):
                start_gene = at + self._first + k * self._transition_size
                genome[start_gene] = transition.target - (transition.target > index) + 0.5
                genome[start_gene + 1] = weights[start_gene + 1] + 0.5
                for name, column in catalogue.condition_columns[transition.condition].items():
                    genome[start_gene + column] = transition.parameters[name] + (
                        0.5 if self._is_integer(start_gene + column) else 0
                    )
        return np.clip(genome, lower, upper).astype(np.float32)

    @property
    def start_genome(self) -> Genome | None:
        """The genome of the machine to start from; None without one."""
        return self.start

    def initial(self, stream: Stream) -> Genome:
        """Return a random machine, or the machine to start from after 0 to 8 changes."""
        if self.start is not None:
            return _single(self._vary_start([stream]))
        return _single(self._decode_units(stream.unit(self.genome_size)[np.newaxis]))

    def initials(self, streams: Streams) -> Genomes:
        """Return a machine for each stream, see `initial`."""
        if self.start is not None:
            return self._vary_start(list(streams))
        return self._decode_units(streams.units(self.genome_size))

    def _decode_units(self, units: NDArray[np.float64]) -> Genomes:
        """Return machines from uniform numbers in 0..1, (n, genes)."""
        lower, upper = self.bounds
        genomes = lower + (upper - lower) * units
        # All existing states are equally likely targets.
        other_states = np.maximum(self._floor_clip(genomes[:, :1], 1, self.options.states) - 1, 1)
        targets = self._targets()
        share = (genomes[:, targets] - lower[targets]) / (upper[targets] - lower[targets])
        genomes[:, targets] = np.minimum(share * other_states, upper[targets])
        counts = 1 + self._width * np.arange(self.options.states) + 3
        genomes[:, counts] = 1 + genomes[:, counts] / upper[counts] * self._most
        return genomes.astype(np.float32)

    def _vary_start(self, streams: list[Stream]) -> Genomes:
        """Return the machine to start from after 0 to 8 changes, for each stream."""
        assert self.start is not None
        genomes = np.repeat(self.start[np.newaxis].astype(np.float64), len(streams), axis=0)
        change_counts = np.array([stream.integer(_MOST_CHANGES + 1) for stream in streams], dtype=np.int64)
        for done in range(_MOST_CHANGES):
            self._change_rows(
                genomes, streams, np.flatnonzero(change_counts > done), np.full(len(streams), 0.3)
            )
        return genomes.astype(np.float32)

    def _targets(self) -> NDArray[np.intp]:
        """Return the positions of all transitions' targets in a genome."""
        rows = 1 + self._width * np.arange(self.options.states)[:, np.newaxis]
        targets: NDArray[np.intp] = rows + self._first + self._transition_size * np.arange(self._most)
        return targets.ravel()

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy after a few changes, see the class."""
        return _single(
            self._mutate_rows(genome[np.newaxis], [stream], severity=severity, probability=probability)
        )

    def mutations(
        self, parents: Genomes, streams: Streams, *, severity: float, probability: float
    ) -> Genomes:
        """Return a copy of each parent after a few changes."""
        return self._mutate_rows(parents, list(streams), severity=severity, probability=probability)

    def _mutate_rows(
        self, parents: Genomes, streams: list[Stream], *, severity: float, probability: float
    ) -> Genomes:
        genomes = parents.astype(np.float64)
        severities = np.full(len(genomes), severity)
        going = np.arange(len(genomes))
        for done in range(_MOST_CHANGES):
            chance = severity if done else probability
            going = going[[streams[row].unit(1)[0] < chance for row in going]]
            self._change_rows(genomes, streams, going, severities)
        return genomes.astype(np.float32)

    def perturbations(
        self,
        parents: Genomes,
        streams: Streams,
        *,
        spread: NDArray[np.float64],
        fresh: NDArray[np.float64],
    ) -> Genomes:
        """Return each machine after 1 to 8 changes.

        After a change there is another one with the probability `fresh`, and parameters move by up to
        `spread` times their range.
        """
        genomes, each = parents.astype(np.float64), list(streams)
        going = np.arange(len(genomes))
        for _ in range(_MOST_CHANGES):
            self._change_rows(genomes, each, going, spread)
            going = going[[each[row].unit(1)[0] < fresh[row] for row in going]]
        return genomes.astype(np.float32)

    def _change_rows(
        self,
        genomes: NDArray[np.float64],
        streams: list[Stream],
        rows: NDArray[np.intp],
        severities: NDArray[np.float64],
    ) -> None:
        """Change the genomes in these rows once, in place."""
        if len(rows):
            changed = genomes[rows]
            self._changes.make(changed, [streams[row] for row in rows], severities[rows])
            genomes[rows] = changed

    @cached_property
    def _changes(self) -> Changes:
        lower, upper = self.bounds
        counted = np.zeros(self.genome_size, dtype=np.bool_)
        rows = counted[1:].reshape(self.options.states, self._width)
        rows[:, [column for column, behaviour in self._behaviours.items() if behaviour[2]]] = True
        for column, condition in self._conditions.items():
            rows[:, self._first + column :: self._transition_size] = condition[2]
        return Changes(
            Layout(
                states=self.options.states,
                transitions=self._most,
                tree=self._tree,
                sets_state=self._sets_state,
                sets_transition=self._sets_transition,
                counted=counted,
                lower=lower,
                upper=upper,
            )
        )

    def likeness(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return weights in units of their ranges; choices are not scaled, unused weights are 0."""
        weights = self._round_weights(genomes)
        lower, upper = self.bounds
        ranges = upper - lower
        ranges[self._choices] = 1.0
        used = np.zeros(weights.shape, dtype=np.bool_)
        used[:, 0] = True
        rows = self._rows_of(weights)
        exists = np.arange(self.options.states) < weights[:, :1]
        parts = used[:, 1:].reshape(len(weights), self.options.states, self._width)
        parts[..., : self._first] = self._sets_state[rows[..., 0].astype(np.int64)] & exists[..., np.newaxis]
        for k in range(self._most):
            at = self._first + k * self._transition_size
            used_transitions = exists & (rows[..., 3] > k)
            sets = self._sets_transition[rows[..., at + 1].astype(np.int64)]
            parts[..., at : at + self._transition_size] = sets & used_transitions[..., np.newaxis]
        return np.where(used, weights / ranges, 0.0)

    def _round_weights(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return the limited weights, rounded to float32."""
        return self._limit_weights(genomes).astype(np.float32).astype(np.float64)

    @cached_property
    def _sets_state(self) -> NDArray[np.bool_]:
        """For each behaviour, the genes of a state that are in use."""
        used = np.zeros((len(self.catalogue.behaviours), self._first), dtype=np.bool_)
        used[:, [0, 3]] = True
        for index, columns in enumerate(self.catalogue.behaviour_columns.values()):
            used[index, list(columns.values())] = True
        return used

    @cached_property
    def _sets_transition(self) -> NDArray[np.bool_]:
        """For each condition, the genes of a transition that are in use."""
        used = np.zeros((len(self.catalogue.conditions), self._transition_size), dtype=np.bool_)
        used[:, [0, 1]] = True
        for index, columns in enumerate(self.catalogue.condition_columns.values()):
            used[index, list(columns.values())] = True
        return used

    def _is_integer(self, gene: int) -> bool:
        """Whether a parameter is rounded down to an integer."""
        column = (gene - 1) % self._width
        if column < self._first:
            return self._behaviours[column][2]
        return self._conditions[(column - self._first) % self._transition_size][2]

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with a run of states of `father`, at least one and not all."""
        units = self._units[0]
        count = stream.integer(units - 1) + 1
        first = stream.integer(units)
        runs = np.array([[count - 1, first]])
        return _single(self._cross_rows(mother[np.newaxis], father[np.newaxis], runs))

    def crossovers(self, mothers: Genomes, fathers: Genomes, streams: Streams) -> Genomes:
        """Return a child of each pair, see `crossover`."""
        units = self._units[0]
        drawn = [(stream.integer(units - 1), stream.integer(units)) for stream in streams]
        return self._cross_rows(mothers, fathers, np.array(drawn, dtype=np.int64).reshape(len(drawn), 2))

    @property
    def _units(self) -> tuple[int, int, int]:
        """Units of a crossover: their number, their genes, and the first gene."""
        if self.options.states > 1:
            return self.options.states, self._width, 1
        return self.genome_size, 1, 0

    def _cross_rows(self, mothers: Genomes, fathers: Genomes, runs: NDArray[np.int64]) -> Genomes:
        """Return children. runs: (n, 2), number of the father's units minus 1, and the first of them."""
        units, each, begin = self._units
        first = runs[:, 1:]
        last = np.minimum(first + runs[:, :1] + 1, units)
        genes = np.arange(self.genome_size)
        of_father = (genes >= begin + first * each) & (genes < begin + last * each)
        return np.where(of_father, fathers, mothers)

    def distance(self, genome: Genome, other: Genome) -> float:
        """Return the number of choices that differ plus the relative differences of parameters."""
        return float(self.distances(genome, other[np.newaxis])[0])

    def distances(self, genome: Genome, others: Genomes) -> NDArray[np.float64]:
        """Return the distance of one genome to each row of others, (k, D) to (k,)."""
        weights = self._round_weights(np.concatenate([genome[np.newaxis], others]))
        return self._distances(weights[0], weights[1:])

    def distances_among(
        self, genomes: Genomes, indices: NDArray[np.int64], others: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the distances between genomes, given by their indices."""
        weights = self._round_weights(genomes)
        distances = np.empty(others.shape)
        for part in split_rows(len(indices), others.shape[1] * self.genome_size):
            distances[part] = self._distances(weights[indices[part]][:, np.newaxis], weights[others[part]])
        return distances

    def _distances(
        self, weights: NDArray[np.float64], other_weights: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the distances of weights."""
        lower, upper = self.bounds
        differences = np.abs(weights - other_weights) / (upper - lower)
        # All differences of choices count the same.
        chosen = self._choices
        differences[..., chosen] = differences[..., chosen] != 0
        # accumulate adds strictly one after another; sum() would add in an order that NumPy chooses.
        sums: NDArray[np.float64] = np.add.accumulate(differences, axis=-1)[..., -1]
        return sums

    @cached_property
    def _choices(self) -> NDArray[np.intp]:
        """Indices of behaviours, targets and conditions in a genome."""
        rows = np.arange(self.options.states) * self._width + 1
        return np.concatenate([rows, self._targets(), self._targets() + 1])


_SENSORS, _ACTUATORS = 9, 2  # of the preset e-puck-rm1.2


def read_specification(file: Path) -> dict[str, Any]:
    """Return the specification of the machine, or of the tree, that a YAML file holds.

    Raises InputError, with file and line, for other files.
    """
    values = read(file).values
    form = "tree" if isinstance(values, Mapping) and "subtrees" in values else "machine"
    parts = values.get("subtrees" if form == "tree" else "states") if isinstance(values, Mapping) else None
    if not isinstance(parts, list) or not parts:
        raise InputError(
            f"{file}: is not a controller; expected a machine, states: "
            f"[{{behaviour: .., transitions: [..]}}], "
            "or a tree, subtrees: [{condition: .., behaviour: ..}]"
        )
    used = [len(part["transitions"]) for part in parts if _has_transitions(part)]
    most = min(max([*used, 1]), grammar.MOST_TRANSITIONS) if form == "machine" else None
    states = min(len(parts), grammar.MOST_STATES if form == "machine" else grammar.MOST_SUBTREES)
    try:
        options = ModulesOptions.model_validate(
            {"form": form, "states": states, "transitions": most, "machine": str(file)}
        )
    except ValidationError as error:
        messages = [message for _, message in problems_of(error, ModulesOptions)]
        raise InputError("\n".join(messages)) from None
    representation = Modules(options, sensors=_SENSORS, actuators=_ACTUATORS)
    assert representation.start_genome is not None
    return representation.specification(representation.start_genome)


def _has_transitions(part: object) -> bool:
    return isinstance(part, Mapping) and isinstance(part.get("transitions"), list)
