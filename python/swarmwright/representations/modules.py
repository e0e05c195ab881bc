"""Probabilistic finite-state machines, and behaviour trees, of given behaviours and conditions."""

import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from swarmwright.core import modules
from swarmwright.core.automode import machine_of
from swarmwright.core.errors import InputError
from swarmwright.core.modules import OF_STATE, OF_TRANSITION, RANGES
from swarmwright.core.options import Options
from swarmwright.core.random_numbers import Stream, Streams
from swarmwright.core.yaml import read
from swarmwright.representations._base import Representation, in_parts
from swarmwright.typing import Genome, Genomes, Limits

_MOST_CHANGES = 8
"""Of one mutation."""
_BEHAVIOURS, _CONDITIONS = len(modules.BEHAVIOURS), len(modules.CONDITIONS)
_HAS_RWM, _HAS_ALPHA = (
    np.array([modules.BEHAVIOUR_PARAMETERS.get(one) == name for one in modules.BEHAVIOURS])
    for name in ("rwm", "alpha")
)
_COUNTS_NEIGHBOURS = np.array(["xi" in modules.CONDITION_PARAMETERS[one] for one in modules.CONDITIONS])


class ModulesOptions(Options):
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
    transitions: int = Field(default=4, ge=1, le=modules.MOST_TRANSITIONS)
    """Transitions that a state has at most. Of a tree: 1."""
    machine: dict[str, Any] | str | None = None
    """A machine to start from: {states: [{behaviour, transitions: [{to, condition}]}]}, with the parameters
    of each behaviour and condition beside it; the path of a YAML file with that, as `swarmwright export --to
    machine` writes it; or the text that AutoMoDe's programs are called with, --nstates 2 --s0 4 --att0 5 ..
    A tree is {subtrees: [{condition, behaviour}]}, or such a file. Evolution begins with it and with mutants
    of it, of up to 8 changes each. Default: random ones."""

    @model_validator(mode="before")
    @classmethod
    def _one_condition(cls, values: Any) -> Any:  # noqa: ANN401 - whatever the file says
        if isinstance(values, Mapping) and values.get("form") == "tree" and "transitions" not in values:
            return {**values, "transitions": 1}
        return values

    @field_validator("machine", mode="before")
    @classmethod
    def _plain(cls, value: Any) -> Any:  # noqa: ANN401 - whatever the file says
        if isinstance(value, str) and not value.lstrip().startswith("--"):
            try:
                value = read(Path(value)).values
            except InputError as error:
                raise ValueError(
                    f"{error}; expected a mapping, such a file, or AutoMoDe's --nstates .."
                ) from None
        return json.loads(json.dumps(value)) if isinstance(value, dict) else value

    @model_validator(mode="after")
    def _valid(self) -> "ModulesOptions":
        if self.form == "tree" and self.states > modules.MOST_SUBTREES:
            raise ValueError(
                f"states: a tree has {modules.MOST_SUBTREES} subtrees at most, not {self.states}"
            )
        if self.form == "tree" and self.transitions != 1:
            raise ValueError("transitions: a subtree has one condition; leave it out")
        try:
            self.start()
        except InputError as error:
            raise ValueError(f"machine: {error}") from None
        return self

    def start(self) -> tuple[modules.State, ...] | None:
        """Return the machine to start from. Raises InputError when it is wrong."""
        if self.machine is None:
            return None
        if self.form == "tree":
            if isinstance(self.machine, str):
                raise InputError("AutoMoDe's command describes a machine; a tree is a mapping or a file")
            return modules.subtrees_from(self.machine, self.states)
        machine = machine_of(self.machine) if isinstance(self.machine, str) else self.machine
        states = modules.states_from(machine, self.states, self.transitions)
        for index, state in enumerate(states):
            for k, one in enumerate(state.transitions):
                if one.target == index:
                    where = f"states[{index}].transitions[{k}].to"
                    raise InputError(f"{where}: a transition must lead to another state")
        return states


class Modules(Representation):
    """A machine of at most `states` states with at most `transitions` transitions each.

    Genes: the number of states (1 to states + 1, the whole part counts); for each state its behaviour (0 to
    6), rwm, alpha, the number of its transitions (0 to transitions + 1); for each of these its target, its
    condition (0 to 6), probability, xi and eta. A target counts the other states: with n states, those
    beyond n - 1 begin again with the first. A machine of one state has no transitions. Genes of states and
    transitions that a machine does not have mean nothing until it has them. Any numbers are a machine, so
    that methods that compute with genes evolve them, too. Random machines have a transition from each state.

    A mutation makes a change with `probability`, and after each change another one with probability severity,
    at most 8: another behaviour, another condition, another target, a parameter that moves by up to severity
    times its range, one transition or one state more or less. A crossover takes a run of states from the
    father. The distance counts behaviours, targets and conditions that differ, and shares of the ranges of
    all other genes.

    A tree has the same genes, of one transition for each state: a state is a subtree, and of its transition
    the condition counts. What there is of targets and numbers of transitions means nothing.

    Sources: Francesca et al., "AutoMoDe-Chocolate: automatic design of control software for robot swarms",
    Swarm Intelligence 9(2-3), 2015; Kuckling, Ligot, Bozhinoski and Birattari, "Behavior trees as a control
    architecture in the automatic modular design of robot swarms", ANTS 2018. Where AutoMoDe's tree comes back
    to an exploration that it left while the robot turned, the turn goes on; here it does not.
    """

    kind: ClassVar[str] = "modules"
    options_model = ModulesOptions
    options: ModulesOptions
    shape: ClassVar[tuple[int, int] | None] = (modules.SENSORS, modules.ACTUATORS)

    def __init__(self, options: Options, *, sensors: int, actuators: int) -> None:
        """Raise InputError for other sensors and actuators than these machines have."""
        super().__init__(options, sensors=sensors, actuators=actuators)
        if (sensors, actuators) != self.shape:
            raise InputError(
                f"controller.kind: modules needs {modules.SENSORS} sensors (proximity x and y, light x and "
                "y, ground, number of neighbours, attraction x and y, a random number) and "
                f"{modules.ACTUATORS} actuators (left and right wheel), but the simulation has {sensors} and "
                f"{actuators}; take a robot such as e-puck-rm1.2 of arena, or another kind of controller"
            )

    @property
    def _width(self) -> int:
        return OF_STATE + self._most * OF_TRANSITION

    @property
    def _tree(self) -> bool:
        return self.options.form == "tree"

    @property
    def _most(self) -> int:
        """Transitions of a state for which there are genes."""
        return self.options.transitions

    @property
    def genome_size(self) -> int:
        """Number of genes."""
        return 1 + self.options.states * self._width

    @cached_property
    def bounds(self) -> Limits:
        """From the lowest to one more than the highest value of what is counted, else to the highest."""
        most, others = self._most, max(1, self.options.states - 1)
        ranges = {name: (low, high + 1 if whole else high) for name, (low, high, whole) in RANGES.items()}
        transition = [(0, others), (0, _CONDITIONS), ranges["probability"], ranges["xi"], ranges["eta"]]
        state = [(0, _BEHAVIOURS), ranges["rwm"], ranges["alpha"], (0, most + 1), *(transition * most)]
        both = np.array([(1, self.options.states + 1), *(state * self.options.states)], dtype=np.float64)
        return both[:, 0].copy(), both[:, 1].copy()

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {
            "version": 1,
            "kind": self.kind,
            **({"form": "tree"} if self._tree else {}),
            "sensors": self.sensors,
            "actuators": self.actuators,
            "states": self.options.states,
            "transitions": self._most,
        }

    def weights(self, genomes: Genomes) -> NDArray[np.float32]:
        """Return the machines that genomes encode, see the class."""
        lower, upper = self.bounds
        weights = np.clip(genomes.astype(np.float64), lower, upper)
        rows = self._rows_of(weights)
        states = self._whole(weights[..., 0], 1, self.options.states)
        weights[..., 0] = states
        for place, most in ((0, _BEHAVIOURS - 1), (1, RANGES["rwm"][1]), (2, RANGES["alpha"][1])):
            rows[..., place] = self._whole(rows[..., place], 0, most)
        alone = (states == 1)[..., np.newaxis]
        rows[..., 3] = np.where(alone, 0, self._whole(rows[..., 3], 0, self._most))
        parts = rows[..., OF_STATE:].reshape(*rows.shape[:-1], self._most, OF_TRANSITION)
        others = np.maximum(states - 1, 1)[..., np.newaxis, np.newaxis]
        target = np.floor(parts[..., 0]) % others
        own = np.arange(self.options.states)[:, np.newaxis]
        parts[..., 0] = np.where(alone[..., np.newaxis], 0, target + (target >= own))
        if self._tree:
            rows[..., 3], parts[..., 0] = 1, 0
        parts[..., 1] = self._whole(parts[..., 1], 0, _CONDITIONS - 1)
        parts[..., 3] = self._whole(parts[..., 3], 1, RANGES["xi"][1])
        rows[..., OF_STATE:] = parts.reshape(*rows.shape[:-1], self._width - OF_STATE)
        weights[..., 1:] = rows.reshape(*weights.shape[:-1], self.genome_size - 1)
        return weights.astype(np.float32)

    def _rows_of(self, genomes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a copy of the genes of states, (.., states, width)."""
        return genomes[..., 1:].reshape(*genomes.shape[:-1], self.options.states, self._width).copy()

    @staticmethod
    def _whole(values: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
        found: NDArray[np.float64] = np.clip(np.floor(values), low, high)
        return found

    def states(self, genome: Genome) -> tuple[modules.State, ...]:
        """Return the states of the machine that a genome encodes."""
        return modules.states_of(self.specification(genome))

    @cached_property
    def start(self) -> Genome | None:
        """The genome of the machine to start from; None without one."""
        start = self.options.start()
        if start is None:
            return None
        lower, upper = self.bounds
        genome = lower + (upper - lower) / 2
        weights = np.array(modules.weights_of(start, self.options.states, self._most))
        genome[0] = weights[0] + 0.5
        for index, state in enumerate(start):
            at = 1 + index * self._width
            genome[at] = weights[at] + 0.5
            for name, value in state.parameters.items():
                genome[at + (1 if name == "rwm" else 2)] = value + 0.5
            genome[at + 3] = weights[at + 3] + 0.5
            for k, one in enumerate(state.transitions):
                here = at + OF_STATE + k * OF_TRANSITION
                genome[here] = one.target - (one.target > index) + 0.5
                genome[here + 1] = weights[here + 1] + 0.5
                for name, value in one.parameters.items():
                    place = {"probability": 2, "xi": 3, "eta": 4}[name]
                    genome[here + place] = value + (0.5 if name == "xi" else 0.0)
        return np.clip(genome, lower, upper).astype(np.float32)

    def initial(self, stream: Stream) -> Genome:
        """Return a random machine, or the given one after 0 to 8 changes."""
        if self.start is not None:
            genome = self.start.astype(np.float64)
            for _ in range(stream.integer(_MOST_CHANGES + 1)):
                self._change(genome, stream, 0.3)
            return genome.astype(np.float32)
        lower, upper = self.bounds
        genome = lower + (upper - lower) * stream.unit(self.genome_size)
        # Of so many states as there are, all are equally likely targets.
        others = max(1, int(self._whole(genome[:1], 1, self.options.states)[0]) - 1)
        targets = self._targets()
        share = (genome[targets] - lower[targets]) / (upper[targets] - lower[targets])
        genome[targets] = np.minimum(share * others, upper[targets])
        counts = 1 + self._width * np.arange(self.options.states) + 3
        genome[counts] = 1 + genome[counts] / upper[counts] * self._most
        return genome.astype(np.float32)

    def _targets(self) -> NDArray[np.intp]:
        """Return where the targets of all transitions are in a genome."""
        rows = 1 + self._width * np.arange(self.options.states)[:, np.newaxis]
        found: NDArray[np.intp] = rows + OF_STATE + OF_TRANSITION * np.arange(self._most)
        return found.ravel()

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy after a few changes, see the class."""
        mutant = genome.astype(np.float64)
        chance = probability
        for _ in range(_MOST_CHANGES):
            if stream.unit(1)[0] >= chance:
                break
            self._change(mutant, stream, severity)
            chance = severity
        return mutant.astype(np.float32)

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
        made = []
        rows = zip(parents, streams, spread.tolist(), fresh.tolist(), strict=True)
        for parent, stream, severity, chance in rows:
            genome = parent.astype(np.float64)
            for _ in range(_MOST_CHANGES):
                self._change(genome, stream, severity)
                if stream.unit(1)[0] >= chance:
                    break
            made.append(genome.astype(np.float32))
        return self._rows(made)

    def likeness(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return the machines' numbers in units of their ranges, choices as they are, those not used as 0."""
        weights = self.weights(genomes).astype(np.float64)
        lower, upper = self.bounds
        ranges = upper - lower
        ranges[self._choices] = 1.0
        used = np.zeros(weights.shape, dtype=np.bool_)
        used[:, 0] = True
        rows = self._rows_of(weights)
        there = np.arange(self.options.states) < weights[:, :1]
        parts = used[:, 1:].reshape(len(weights), self.options.states, self._width)
        behaviours = rows[..., 0].astype(np.int64)
        parts[..., 0] = parts[..., 3] = there
        parts[..., 1] = there & _HAS_RWM[behaviours]
        parts[..., 2] = there & _HAS_ALPHA[behaviours]
        for k in range(self._most):
            at = OF_STATE + k * OF_TRANSITION
            taken = there & (rows[..., 3] > k)
            neighbours = _COUNTS_NEIGHBOURS[rows[..., at + 1].astype(np.int64)]
            parts[..., at] = parts[..., at + 1] = taken
            parts[..., at + 2] = taken & ~neighbours
            parts[..., at + 3] = parts[..., at + 4] = taken & neighbours
        return np.where(used, weights / ranges, 0.0)

    def _change(self, genome: NDArray[np.float64], stream: Stream, severity: float) -> None:
        """Make one change, in place: one of all that are possible."""
        states = max(1, self._count(genome[0], self.options.states))
        changes: list[tuple[str, int, int]] = []
        if self.options.states > 1:
            changes += [("more", 0, self.options.states)] * (states < self.options.states)
            changes += [("less", 0, self.options.states)] * (states > 1)
        for index in range(states):
            at = 1 + index * self._width
            changes.append(("choice", at, _BEHAVIOURS))
            behaviour = modules.BEHAVIOURS[min(int(genome[at]), _BEHAVIOURS - 1)]
            parameter = modules.BEHAVIOUR_PARAMETERS.get(behaviour)
            if parameter is not None:
                changes.append(("move", at + (1 if parameter == "rwm" else 2), 0))
            if states > 1 or self._tree:
                changes += self._of_transitions(genome, at, states)
        kind, at, most = changes[stream.integer(len(changes))]
        lower, upper = (float(limit[at]) for limit in self.bounds)
        if kind == "move":
            self._move(genome, at, stream, severity)
        elif kind in {"more", "less"}:
            genome[at] = max(1, self._count(genome[at], most) + (1 if kind == "more" else -1)) + 0.5
        else:
            value = int(genome[at]) % most
            genome[at] = (value + 1 + stream.integer(most - 1)) % most + 0.5
        genome[at] = min(max(genome[at], lower), upper)

    def _of_transitions(
        self, genome: NDArray[np.float64], at: int, states: int
    ) -> list[tuple[str, int, int]]:
        """Return what can be changed at the transitions of the state whose genes begin at `at`."""
        most = self._most
        count = 1 if self._tree else self._count(genome[at + 3], most)
        changes: list[tuple[str, int, int]] = []
        if not self._tree:
            changes = [("more", at + 3, most)] * (count < most) + [("less", at + 3, most)] * (count > 1)
        for k in range(count):
            here = at + OF_STATE + k * OF_TRANSITION
            if states > 2 and not self._tree:
                changes.append(("choice", here, states - 1))
            changes.append(("choice", here + 1, _CONDITIONS))
            condition = modules.CONDITIONS[min(int(genome[here + 1]), _CONDITIONS - 1)]
            places = (3, 4) if "xi" in modules.CONDITION_PARAMETERS[condition] else (2,)
            changes += [("move", here + place, 0) for place in places]
        return changes

    @staticmethod
    def _count(gene: float, most: int) -> int:
        return min(max(int(gene), 0), most)

    def _move(self, genome: NDArray[np.float64], at: int, stream: Stream, severity: float) -> None:
        """Move a parameter uniformly, reflected at its limits; what is counted moves by 1 at least."""
        lower, upper = (float(limit[at]) for limit in self.bounds)
        step = float(stream.uniform(np.array([min(severity, 1.0) * (upper - lower)]))[0])
        if self._counted(at) and abs(step) < 1:
            step = 1.0 if step >= 0 else -1.0
        value = genome[at] + step
        if value > upper:
            value = 2 * upper - value
        if value < lower:
            value = 2 * lower - value
        genome[at] = value

    def _counted(self, at: int) -> bool:
        """Return whether the whole part of a parameter counts: of all but probability and eta."""
        place = (at - 1) % self._width
        return place < OF_STATE or (place - OF_STATE) % OF_TRANSITION == 3

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with a run of states of `father`, at least one and not all."""
        units, unit, begin = (
            (self.options.states, self._width, 1) if self.options.states > 1 else (self.genome_size, 1, 0)
        )
        count = stream.integer(units - 1) + 1
        first = stream.integer(units)
        cut = slice(begin + first * unit, begin + min(first + count, units) * unit)
        child = mother.copy()
        child[cut] = father[cut]
        return child

    def distance(self, one: Genome, other: Genome) -> float:
        """Return behaviours, targets and conditions that differ, and shares of ranges, added in order."""
        return float(self.distances(one, other[np.newaxis])[0])

    def distances(self, one: Genome, others: Genomes) -> NDArray[np.float64]:
        """Return the distance of one genome to each row of others, (k, D) to (k,)."""
        weights = self.weights(np.concatenate([one[np.newaxis], others])).astype(np.float64)
        return self._distances(weights[0], weights[1:])

    def distances_among(
        self, genomes: Genomes, ones: NDArray[np.int64], others: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the distances of genomes that are named by their index."""
        weights = self.weights(genomes).astype(np.float64)
        found = np.empty(others.shape)
        for part in in_parts(len(ones), others.shape[1] * self.genome_size):
            found[part] = self._distances(weights[ones[part]][:, np.newaxis], weights[others[part]])
        return found

    def _distances(self, ones: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distances of weights."""
        lower, upper = self.bounds
        differences = np.abs(ones - others) / (upper - lower)
        # Of what is chosen, all differences count the same.
        chosen = self._choices
        differences[..., chosen] = differences[..., chosen] != 0
        # accumulate adds strictly one after another; sum() would add in an order that NumPy chooses.
        sums: NDArray[np.float64] = np.add.accumulate(differences, axis=-1)[..., -1]
        return sums

    @cached_property
    def _choices(self) -> NDArray[np.intp]:
        """Where behaviours, targets and conditions are in a genome."""
        rows = np.arange(self.options.states) * self._width + 1
        return np.concatenate([rows, self._targets(), self._targets() + 1])
