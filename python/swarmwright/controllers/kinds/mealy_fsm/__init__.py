"""Mealy machines: finite-state machines over sensor values that are cut into intervals."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema

from swarmwright.common.arrays import Genome, Genomes, Limits, shortest
from swarmwright.common.problems import FieldError, format_value
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers._base import MANY, Representation, RepresentationOptions, split_rows

_MOST_LEVELS = 1000
_LARGEST_TABLE = 1_000_000
"""Largest number of values in a table, as in the engine."""


def _level(value: Any) -> int | list[float]:  # noqa: ANN401 - whatever the file says
    if isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= _MOST_LEVELS:
        return value
    if isinstance(value, list | tuple) and all(_is_number(number) for number in value):
        thresholds = [float(number) for number in value]
        if all(float(np.float32(low)) < float(np.float32(high)) for low, high in pairwise(thresholds)):
            return thresholds
    raise ValueError(
        f"must be a number of intervals, 1 to {_MOST_LEVELS}, or a list of ascending thresholds, "
        f"not {format_value(value)}"
    )


def _is_number(value: Any) -> bool:  # noqa: ANN401 - whatever the file says
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= float(np.finfo(np.float32).max)
    )


def _levels(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if not isinstance(value, list | tuple):
        return _level(value)
    try:
        return [_level(level) for level in value]
    except ValueError as error:
        raise ValueError(f"an entry {error}") from None


def _output_levels(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value == 1:
        raise ValueError("must be 0 or at least 2: a single level leaves no choice")
    return value


_COUNT = {"type": "integer", "minimum": 1, "maximum": _MOST_LEVELS}
_ENTRY = {"anyOf": [_COUNT, {"type": "array", "items": {"type": "number"}}]}
Levels = Annotated[
    Any,
    BeforeValidator(_levels),
    WithJsonSchema({"anyOf": [_COUNT, {"type": "array", "items": _ENTRY}]}),
]


class MealyFsmOptions(RepresentationOptions):
    """A finite-state machine: state and thresholded sensors select the actuators and the next state.

    A mutation changes the share severity x probability of the table; give nnga a small probability, such as
    0.1.
    """

    kind: Literal["mealy_fsm"] = "mealy_fsm"
    states: int = Field(default=4, ge=1, le=1000)
    """Number of states; every episode begins in the first."""
    levels: Levels = 2
    """Number of equal intervals of the range -1..1 of each sensor; 2 tests whether it is above 0, 1 ignores
    it. A list has an entry for each sensor: a number of intervals, or its thresholds. The table has states
    times the product of all intervals rows.
    """
    output_levels: Annotated[int, BeforeValidator(_output_levels)] = Field(default=5, ge=0, le=1001)
    """Values of an actuator, equally spaced from -1 to 1 (3: -1, 0 and 1); 0 for any number in -1..1."""


class MealyFsm(Representation):
    """A Mealy machine (G. H. Mealy, "A method for synthesizing sequential circuits", 1955), as a table.

    Thresholds are fixed; what evolves is the table. It has a row for every state and every combination of
    intervals, in mixed radix: the state is the most significant digit, then the first sensor, and the last
    sensor's interval changes from row to row. Genes: row after row, the next state (0 to states - 1), then an
    output in -1..1 for each actuator. Any finite number is a valid gene: a next state is rounded down and
    limited to the states, an output is rounded to the nearest level.

    A mutation changes a next state, or an output that has levels, with `probability` times `severity`, to
    another value, all equally likely: there are no small changes of a choice, so severity controls how much
    of the table changes. An output without levels is moved with `probability`, uniformly within +-severity,
    and reflected at -1 and 1. A crossover takes a run of neighbouring rows from the father, as with the nodes
    of networks. The distance counts next states that differ, plus half of each difference of outputs.
    """

    kind: ClassVar[str] = "mealy_fsm"
    options_model = MealyFsmOptions
    options: MealyFsmOptions
    continuous: ClassVar[bool] = False

    @classmethod
    def options_of(cls, architecture: Mapping[str, Any]) -> dict[str, Any]:
        """Return options with the thresholds of an architecture, and outputs of any value."""
        levels = {"levels": architecture["thresholds"], "output_levels": 0}
        return {**super().options_of(architecture), **levels}

    def __init__(self, options: RepresentationOptions, *, sensors: int, actuators: int) -> None:
        """Raise InputError when `levels` does not match the sensors, or the table is too large."""
        super().__init__(options, sensors=sensors, actuators=actuators)
        levels = self.options.levels
        if isinstance(levels, list) and len(levels) != sensors:
            raise FieldError(
                ("controller", "levels"),
                f"{len(levels)} entries for {sensors} sensors; give an entry for each sensor, or one number "
                "for all",
            )
        intervals = [len(edges) + 1 for edges in self.thresholds]
        numbers = math.prod(intervals) * self.options.states * self._width
        if numbers > _LARGEST_TABLE:
            product = " x ".join(map(str, intervals))
            raise FieldError(
                ("controller", "levels"),
                f"{product} combinations of intervals in {self.options.states} states "
                f"make a table of {numbers} numbers (a next state and {actuators} outputs in each row), more "
                f"than {_LARGEST_TABLE}; use fewer levels: 2 for sensors that are 0 or 1, 1 for sensors that "
                "are not needed",
            )

    @cached_property
    def thresholds(self) -> list[list[float]]:
        """Upper bounds of the intervals of each sensor, ascending, as float32 numbers."""
        levels = self.options.levels
        entries: Sequence[Any] = levels if isinstance(levels, list) else [levels] * self.sensors
        return [shortest(np.array(_thresholds(entry), dtype=np.float32)) for entry in entries]

    @property
    def _width(self) -> int:
        return 1 + self.actuators

    @cached_property
    def rows(self) -> int:
        """Rows of the table."""
        return self.options.states * math.prod(len(edges) + 1 for edges in self.thresholds)

    @property
    def genome_size(self) -> int:
        """Number of genes: in each row a next state and the outputs."""
        return self.rows * self._width

    @property
    def bounds(self) -> Limits:
        """0 to states for a next state, so that all states are equally wide; -1 to 1 for an output."""
        lower, upper = np.full((2, self.rows, self._width), [[[-1.0]], [[1.0]]])
        lower[:, 0], upper[:, 0] = 0.0, self.options.states
        return lower.ravel(), upper.ravel()

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {
            "version": 1,
            "kind": self.kind,
            "sensors": self.sensors,
            "actuators": self.actuators,
            "states": self.options.states,
            "thresholds": self.thresholds,
        }

    def weights(self, genomes: Genomes) -> NDArray[np.float32]:
        """Return the tables that genomes encode, see the class."""
        tables = self._tables(genomes)
        states, outputs = tables[..., :1], tables[..., 1:]
        np.clip(np.floor(states), 0, self.options.states - 1, out=states)
        np.clip(outputs, -1, 1, out=outputs)
        if self.options.output_levels:
            steps = self.options.output_levels - 1
            outputs[...] = self._value(np.floor((outputs + 1) * (steps / 2) + 0.5))
        return tables.reshape(genomes.shape).astype(np.float32)

    def initial(self, stream: Stream) -> Genome:
        """Return a table in which every next state and every output is equally likely."""
        return self._initial(stream.unit(self.genome_size))

    def initials(self, streams: Streams) -> Genomes:
        """Return a random table for each stream."""
        if len(streams) * self.genome_size > MANY:
            return super().initials(streams)
        return self._initial(streams.units(self.genome_size))

    def _initial(self, drawn: NDArray[np.float64]) -> Genomes:
        """Return tables of (.., genome_size) numbers that are uniform in [0, 1)."""
        tables = self._tables(drawn)
        tables[..., 0] = np.floor(tables[..., 0] * self.options.states)
        if self.options.output_levels:
            tables[..., 1:] = self._value(np.floor(tables[..., 1:] * self.options.output_levels))
        else:
            tables[..., 1:] = tables[..., 1:] * 2 - 1
        return tables.reshape(drawn.shape).astype(np.float32)

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which a part of the table is changed, see the class."""
        drawn = [stream.unit(self.genome_size) for _ in range(2)]
        return self._mutate_tables(genome, *drawn, severity=severity, probability=probability)

    def mutations(
        self, parents: Genomes, streams: Streams, *, severity: float, probability: float
    ) -> Genomes:
        """Return a mutated copy of each parent."""
        options = {"severity": severity, "probability": probability}
        if parents.size > MANY:
            return super().mutations(parents, streams, **options)
        chosen, drawn = (streams.units(self.genome_size) for _ in range(2))
        mutants = np.empty_like(parents)
        for part in split_rows(len(parents), self.genome_size):
            mutants[part] = self._mutate_tables(parents[part], chosen[part], drawn[part], **options)
        return mutants

    def _mutate_tables(
        self,
        genomes: Genomes,
        rate_units: NDArray[np.float64],
        value_units: NDArray[np.float64],
        *,
        severity: float,
        probability: float,
    ) -> Genomes:
        """Return mutated copies, (.., genome_size), from two numbers for each gene, uniform in [0, 1)."""
        before = self.weights(genomes)
        tables, chosen, drawn = self._tables(before), self._tables(rate_units), self._tables(value_units)
        rare = chosen < probability * severity
        states, outputs, drawn_outputs = tables[..., 0], tables[..., 1:], drawn[..., 1:]
        another = _another(states, self.options.states, drawn[..., 0])
        states[...] = np.where(rare[..., 0], another, states)
        if self.options.output_levels:
            steps = self.options.output_levels - 1
            level = np.floor((outputs + 1) * (steps / 2) + 0.5)
            changed = self._value(_another(level, steps + 1, drawn_outputs))
            outputs[...] = np.where(rare[..., 1:], changed, outputs)
        else:
            moved = outputs + (drawn_outputs * 2 - 1) * severity
            moved = np.where(moved > 1, 2 - moved, np.where(moved < -1, -2 - moved, moved))
            outputs[...] = np.where(chosen[..., 1:] < probability, np.clip(moved, -1, 1), outputs)
        mutants = tables.reshape(genomes.shape).astype(np.float32)
        # Genes without a change keep their exact value, even if it decodes to a rounded one.
        return np.where(self.weights(mutants) == before, genomes, mutants).astype(np.float32)

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with a run of rows of `father`, at least one and not all."""
        unit = self._width if self.rows > 1 else 1
        units = self.genome_size // unit
        count = stream.integer(units - 1) + 1
        first = stream.integer(units)
        cut = slice(first * unit, min(first + count, units) * unit)
        child = mother.copy()
        child[cut] = father[cut]
        return child

    def crossovers(self, mothers: Genomes, fathers: Genomes, streams: Streams) -> Genomes:
        """Return a child of each pair."""
        unit = self._width if self.rows > 1 else 1
        units = self.genome_size // unit
        counts = streams.integers(units - 1, 1) + 1
        firsts = streams.integers(units, 1)
        row = np.arange(self.genome_size) // unit
        return np.where((row >= firsts) & (row < firsts + counts), fathers, mothers)

    def distance(self, genome: Genome, other: Genome) -> float:
        """Return the number of next states that differ plus half of each difference of outputs."""
        return float(self._distances(self._tables(self.weights(genome)), self._tables(self.weights(other))))

    def distances(self, genome: Genome, others: Genomes) -> NDArray[np.float64]:
        """Return the distance of one genome to each row of others, (k, D) to (k,)."""
        return self._distances(self._tables(self.weights(genome)), self._tables(self.weights(others)))

    def distances_among(
        self, genomes: Genomes, indices: NDArray[np.int64], others: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the distances between genomes, given by their indices."""
        weights = self.weights(genomes)
        distances = np.empty(others.shape)
        for part in split_rows(len(indices), others.shape[1] * self.genome_size):
            mothers = self._tables(weights[indices[part]])[:, np.newaxis]
            distances[part] = self._distances(mothers, self._tables(weights[others[part]]))
        return distances

    def _distances(
        self, tables: NDArray[np.float64], other_tables: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the distances of tables."""
        differences = np.abs(other_tables - tables)
        differences[..., 0] = differences[..., 0] > 0
        differences[..., 1:] *= 0.5
        # accumulate adds strictly one after another; sum() would add in an order that NumPy chooses.
        rows = differences.reshape(*differences.shape[:-2], self.genome_size)
        sums: NDArray[np.float64] = np.add.accumulate(rows, axis=-1)[..., -1]
        return sums

    def _tables(self, numbers: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return a float64 copy of shape (.., rows, 1 + actuators)."""
        return numbers.astype(np.float64).reshape(*numbers.shape[:-1], self.rows, self._width)

    def _value(self, level: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the actuator value of a level, rounded to float32."""
        values: NDArray[np.float32] = (level * 2 / (self.options.output_levels - 1) - 1).astype(np.float32)
        return values.astype(np.float64)


def _thresholds(entry: int | list[float]) -> list[float]:
    return [2 * k / entry - 1 for k in range(1, entry)] if isinstance(entry, int) else entry


def _another(current: NDArray[np.float64], choices: int, drawn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return one of the other choices, all equally likely; `drawn` is uniform in [0, 1)."""
    if choices == 1:
        return current
    return (current + 1 + np.floor(drawn * (choices - 1))) % choices
