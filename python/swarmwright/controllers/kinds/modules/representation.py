"""Probabilistic finite-state machines, and behaviour trees, of given behaviours and conditions."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common import modules
from swarmwright.common.errors import InputError
from swarmwright.common.modules import RANGES
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.common.typing import Genome, Genomes, Limits
from swarmwright.controllers._base import Representation, RepresentationOptions, in_parts
from swarmwright.controllers.kinds.modules.changes import Changes, Layout
from swarmwright.controllers.kinds.modules.options import ModulesOptions

__all__ = ["Modules", "ModulesOptions"]

_MOST_CHANGES = 8
"""Of one mutation."""


def _single(genomes: Genomes) -> Genome:
    """Return the one genome that there is."""
    found: Genome = genomes[0]
    return found


def _limits(
    names: tuple[str, ...], chosen: tuple[modules.Module, ...], places: Mapping[str, Mapping[str, int]]
) -> dict[int, modules.Range]:
    """Return the limits of parameters by their places: of the engine's, whether chosen or not, and others."""
    found = {modules.PLACES[name]: RANGES[name] for name in names}
    for one in chosen:
        found |= {places[one.name][name]: limits for name, limits in one.parameters.items()}
    return dict(sorted(found.items()))


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

    def __init__(self, options: RepresentationOptions, *, sensors: int, actuators: int) -> None:
        """Raise InputError for other sensors and actuators than these machines have."""
        super().__init__(options, sensors=sensors, actuators=actuators)
        if (sensors, actuators) != self.shape:
            raise InputError(
                f"controller.kind: modules needs {modules.SENSORS} sensors (proximity x and y, light x and "
                "y, ground, number of neighbours, attraction x and y, a random number) and "
                f"{modules.ACTUATORS} actuators (left and right wheel), but the simulation has {sensors} and "
                f"{actuators}; take a robot such as e-puck-rm1.2 of arena for all agents, or another kind of "
                "controller"
            )

    @cached_property
    def catalogue(self) -> modules.Catalogue:
        """The modules of which machines are made; genes count them from 0."""
        return self.options.catalogue

    @cached_property
    def _first(self) -> int:
        """Where the genes of transitions begin among those of a state."""
        return self.catalogue.of_state

    @cached_property
    def _each(self) -> int:
        """Genes of a transition."""
        return self.catalogue.of_transition

    @cached_property
    def _width(self) -> int:
        return self._first + self._most * self._each

    @property
    def _tree(self) -> bool:
        return self.options.form == "tree"

    @property
    def _most(self) -> int:
        """Transitions of a state for which there are genes."""
        return self.options.most_transitions

    @property
    def genome_size(self) -> int:
        """Number of genes."""
        return 1 + self.options.states * self._width

    @cached_property
    def bounds(self) -> Limits:
        """From the lowest to one more than the highest value of what is counted, else to the highest."""
        most, others = self._most, max(1, self.options.states - 1)

        def limits(one: modules.Range) -> tuple[float, float]:
            low, high, whole = one
            return low, high + 1 if whole else high

        transition: list[tuple[float, float]] = [(0, others), (0, len(self.catalogue.conditions))]
        transition += [limits(self._conditions[place]) for place in range(2, self._each)]
        state: list[tuple[float, float]] = [(0, len(self.catalogue.behaviours)), limits(self._behaviours[1])]
        state += [limits(self._behaviours[2]), (0, most + 1)]
        state += [limits(self._behaviours[place]) for place in range(4, self._first)]
        state += transition * most
        both = np.array([(1, self.options.states + 1), *(state * self.options.states)], dtype=np.float64)
        return both[:, 0].copy(), both[:, 1].copy()

    @cached_property
    def _behaviours(self) -> dict[int, modules.Range]:
        """Limits of the parameters of behaviours, by their places in a state."""
        return _limits(("rwm", "alpha"), self.catalogue.behaviours, self.catalogue.behaviour_places)

    @cached_property
    def _conditions(self) -> dict[int, modules.Range]:
        """Limits of the parameters of conditions, by their places in a transition."""
        names = ("probability", "xi", "eta")
        return _limits(names, self.catalogue.conditions, self.catalogue.condition_places)

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {
            "version": 1,
            "kind": modules.PYTHON_KIND if self.catalogue.in_python else modules.KIND,
            **({"form": "tree"} if self._tree else {}),
            "sensors": self.sensors,
            "actuators": self.actuators,
            "states": self.options.states,
            "transitions": self._most,
            **self._named,
        }

    @property
    def _named(self) -> dict[str, Any]:
        """What controllers whose modules are not all of the engine say of these."""
        if not self.catalogue.in_python:
            return {}
        return {
            "behaviours": [one.as_mapping() for one in self.catalogue.behaviours],
            "conditions": [one.as_mapping() for one in self.catalogue.conditions],
        }

    def weights(self, genomes: Genomes) -> NDArray[np.float32]:
        """Return the machines that genomes encode, see the class."""
        weights = self._limited(genomes)
        if not self.catalogue.in_python:
            # What is counted among the modules that were chosen becomes the engine's number.
            weights = weights.copy()
            rows = weights[..., 1:].reshape(*weights.shape[:-1], self.options.states, self._width)
            rows[..., 0] = self._behaviour_numbers[rows[..., 0].astype(np.int64)]
            parts = rows[..., self._first + 1 :: self._each]
            parts[...] = self._condition_numbers[parts.astype(np.int64)]
        return weights.astype(np.float32)

    @cached_property
    def _behaviour_numbers(self) -> NDArray[np.float64]:
        names = [one.name for one in self.catalogue.behaviours]
        return np.array([modules.BEHAVIOURS.index(name) for name in names], dtype=np.float64)

    @cached_property
    def _condition_numbers(self) -> NDArray[np.float64]:
        names = [one.name for one in self.catalogue.conditions]
        return np.array([modules.CONDITIONS.index(name) for name in names], dtype=np.float64)

    def _limited(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return weights whose behaviours and conditions are counted among those that were chosen."""
        lower, upper = self.bounds
        weights = np.clip(genomes.astype(np.float64), lower, upper)
        rows = self._rows_of(weights)
        states = self._whole(weights[..., 0], 1, self.options.states)
        weights[..., 0] = states
        rows[..., 0] = self._whole(rows[..., 0], 0, len(self.catalogue.behaviours) - 1)
        for place, (low, high, whole) in self._behaviours.items():
            if whole:
                rows[..., place] = self._whole(rows[..., place], low, high)
        alone = (states == 1)[..., np.newaxis]
        rows[..., 3] = np.where(alone, 0, self._whole(rows[..., 3], 0, self._most))
        parts = rows[..., self._first :].reshape(*rows.shape[:-1], self._most, self._each)
        others = np.maximum(states - 1, 1)[..., np.newaxis, np.newaxis]
        target = np.floor(parts[..., 0]) % others
        own = np.arange(self.options.states)[:, np.newaxis]
        parts[..., 0] = np.where(alone[..., np.newaxis], 0, target + (target >= own))
        if self._tree:
            rows[..., 3], parts[..., 0] = 1, 0
        parts[..., 1] = self._whole(parts[..., 1], 0, len(self.catalogue.conditions) - 1)
        for place, (low, high, whole) in self._conditions.items():
            if whole:
                parts[..., place] = self._whole(parts[..., place], low, high)
        rows[..., self._first :] = parts.reshape(*rows.shape[:-1], self._width - self._first)
        weights[..., 1:] = rows.reshape(*weights.shape[:-1], self.genome_size - 1)
        return weights

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
        catalogue = self.catalogue
        weights = np.array(
            modules.weights_of(start, self.options.states, self._most, catalogue), dtype=np.float64
        )
        genome[0] = weights[0] + 0.5
        for index, state in enumerate(start):
            at = 1 + index * self._width
            genome[at] = weights[at] + 0.5
            for name, place in catalogue.behaviour_places[state.behaviour].items():
                genome[at + place] = state.parameters[name] + (0.5 if self._counted(at + place) else 0.0)
            genome[at + 3] = weights[at + 3] + 0.5
            for k, one in enumerate(state.transitions):
                here = at + self._first + k * self._each
                genome[here] = one.target - (one.target > index) + 0.5
                genome[here + 1] = weights[here + 1] + 0.5
                for name, place in catalogue.condition_places[one.condition].items():
                    genome[here + place] = one.parameters[name] + (0.5 if self._counted(here + place) else 0)
        return np.clip(genome, lower, upper).astype(np.float32)

    @property
    def given(self) -> Genome | None:
        """The genome of the machine to start from; None without one."""
        return self.start

    def initial(self, stream: Stream) -> Genome:
        """Return a random machine, or the given one after 0 to 8 changes."""
        if self.start is not None:
            return _single(self._near_start([stream]))
        return _single(self._random(stream.unit(self.genome_size)[np.newaxis]))

    def initials(self, streams: Streams) -> Genomes:
        """Return a machine for each stream, see `initial`."""
        if self.start is not None:
            return self._near_start(list(streams))
        return self._random(streams.units(self.genome_size))

    def _random(self, units: NDArray[np.float64]) -> Genomes:
        """Return machines made of numbers of 0 to 1, (n, genes)."""
        lower, upper = self.bounds
        genomes = lower + (upper - lower) * units
        # Of so many states as there are, all are equally likely targets.
        others = np.maximum(self._whole(genomes[:, :1], 1, self.options.states) - 1, 1)
        targets = self._targets()
        share = (genomes[:, targets] - lower[targets]) / (upper[targets] - lower[targets])
        genomes[:, targets] = np.minimum(share * others, upper[targets])
        counts = 1 + self._width * np.arange(self.options.states) + 3
        genomes[:, counts] = 1 + genomes[:, counts] / upper[counts] * self._most
        return genomes.astype(np.float32)

    def _near_start(self, streams: list[Stream]) -> Genomes:
        """Return the given machine after 0 to 8 changes, for each stream."""
        assert self.start is not None
        genomes = np.repeat(self.start[np.newaxis].astype(np.float64), len(streams), axis=0)
        left = np.array([stream.integer(_MOST_CHANGES + 1) for stream in streams], dtype=np.int64)
        for done in range(_MOST_CHANGES):
            self._change_some(genomes, streams, np.flatnonzero(left > done), np.full(len(streams), 0.3))
        return genomes.astype(np.float32)

    def _targets(self) -> NDArray[np.intp]:
        """Return where the targets of all transitions are in a genome."""
        rows = 1 + self._width * np.arange(self.options.states)[:, np.newaxis]
        found: NDArray[np.intp] = rows + self._first + self._each * np.arange(self._most)
        return found.ravel()

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy after a few changes, see the class."""
        return _single(
            self._mutated(genome[np.newaxis], [stream], severity=severity, probability=probability)
        )

    def mutations(
        self, parents: Genomes, streams: Streams, *, severity: float, probability: float
    ) -> Genomes:
        """Return a copy of each parent after a few changes."""
        return self._mutated(parents, list(streams), severity=severity, probability=probability)

    def _mutated(
        self, parents: Genomes, streams: list[Stream], *, severity: float, probability: float
    ) -> Genomes:
        genomes = parents.astype(np.float64)
        severities = np.full(len(genomes), severity)
        going = np.arange(len(genomes))
        for done in range(_MOST_CHANGES):
            chance = severity if done else probability
            going = going[[streams[row].unit(1)[0] < chance for row in going]]
            self._change_some(genomes, streams, going, severities)
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
            self._change_some(genomes, each, going, spread)
            going = going[[each[row].unit(1)[0] < fresh[row] for row in going]]
        return genomes.astype(np.float32)

    def _change_some(
        self,
        genomes: NDArray[np.float64],
        streams: list[Stream],
        rows: NDArray[np.intp],
        severities: NDArray[np.float64],
    ) -> None:
        """Change the genomes in these rows once, in place."""
        if len(rows):
            some = genomes[rows]
            self._changes.make(some, [streams[row] for row in rows], severities[rows])
            genomes[rows] = some

    @cached_property
    def _changes(self) -> Changes:
        lower, upper = self.bounds
        counted = np.zeros(self.genome_size, dtype=np.bool_)
        rows = counted[1:].reshape(self.options.states, self._width)
        rows[:, [place for place, one in self._behaviours.items() if one[2]]] = True
        for place, one in self._conditions.items():
            rows[:, self._first + place :: self._each] = one[2]
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
        """Return the machines' numbers in units of their ranges, choices as they are, those not used as 0."""
        weights = self._counts(genomes)
        lower, upper = self.bounds
        ranges = upper - lower
        ranges[self._choices] = 1.0
        used = np.zeros(weights.shape, dtype=np.bool_)
        used[:, 0] = True
        rows = self._rows_of(weights)
        there = np.arange(self.options.states) < weights[:, :1]
        parts = used[:, 1:].reshape(len(weights), self.options.states, self._width)
        parts[..., : self._first] = self._sets_state[rows[..., 0].astype(np.int64)] & there[..., np.newaxis]
        for k in range(self._most):
            at = self._first + k * self._each
            taken = there & (rows[..., 3] > k)
            sets = self._sets_transition[rows[..., at + 1].astype(np.int64)]
            parts[..., at : at + self._each] = sets & taken[..., np.newaxis]
        return np.where(used, weights / ranges, 0.0)

    def _counts(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return the numbers of machines, behaviours and conditions counted among those that were chosen."""
        return self._limited(genomes).astype(np.float32).astype(np.float64)

    @cached_property
    def _sets_state(self) -> NDArray[np.bool_]:
        """Of each behaviour, which genes of a state count: also the behaviour and how many transitions."""
        found = np.zeros((len(self.catalogue.behaviours), self._first), dtype=np.bool_)
        found[:, [0, 3]] = True
        for index, places in enumerate(self.catalogue.behaviour_places.values()):
            found[index, list(places.values())] = True
        return found

    @cached_property
    def _sets_transition(self) -> NDArray[np.bool_]:
        """Of each condition, which genes of a transition count: also the target and the condition."""
        found = np.zeros((len(self.catalogue.conditions), self._each), dtype=np.bool_)
        found[:, [0, 1]] = True
        for index, places in enumerate(self.catalogue.condition_places.values()):
            found[index, list(places.values())] = True
        return found

    def _counted(self, at: int) -> bool:
        """Return whether the whole part of a parameter counts."""
        place = (at - 1) % self._width
        if place < self._first:
            return self._behaviours[place][2]
        return self._conditions[(place - self._first) % self._each][2]

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with a run of states of `father`, at least one and not all."""
        units = self._units[0]
        count = stream.integer(units - 1) + 1
        first = stream.integer(units)
        runs = np.array([[count - 1, first]])
        return _single(self._crossed(mother[np.newaxis], father[np.newaxis], runs))

    def crossovers(self, mothers: Genomes, fathers: Genomes, streams: Streams) -> Genomes:
        """Return a child of each pair, see `crossover`."""
        units = self._units[0]
        drawn = [(stream.integer(units - 1), stream.integer(units)) for stream in streams]
        return self._crossed(mothers, fathers, np.array(drawn, dtype=np.int64).reshape(len(drawn), 2))

    @property
    def _units(self) -> tuple[int, int, int]:
        """What runs are made of: how many there are, genes of each, and where they begin."""
        if self.options.states > 1:
            return self.options.states, self._width, 1
        return self.genome_size, 1, 0

    def _crossed(self, mothers: Genomes, fathers: Genomes, runs: NDArray[np.int64]) -> Genomes:
        """Return children. runs: (n, 2), units of the father but one, and the first of them."""
        units, each, begin = self._units
        first = runs[:, 1:]
        last = np.minimum(first + runs[:, :1] + 1, units)
        genes = np.arange(self.genome_size)
        of_father = (genes >= begin + first * each) & (genes < begin + last * each)
        return np.where(of_father, fathers, mothers)

    def distance(self, one: Genome, other: Genome) -> float:
        """Return behaviours, targets and conditions that differ, and shares of ranges, added in order."""
        return float(self.distances(one, other[np.newaxis])[0])

    def distances(self, one: Genome, others: Genomes) -> NDArray[np.float64]:
        """Return the distance of one genome to each row of others, (k, D) to (k,)."""
        weights = self._counts(np.concatenate([one[np.newaxis], others]))
        return self._distances(weights[0], weights[1:])

    def distances_among(
        self, genomes: Genomes, ones: NDArray[np.int64], others: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the distances of genomes that are named by their index."""
        weights = self._counts(genomes)
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
