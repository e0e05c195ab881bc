"""Named parameters of simulations that control their agents themselves."""

from collections.abc import Mapping, Sequence
from decimal import Decimal, localcontext
from functools import cached_property
from hashlib import sha256
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from swarmwright.common.arrays import Genome, Genomes, Limits, shortest
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError, format_value
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers._base import Representation, RepresentationOptions, sample_around, split_rows
from swarmwright.controllers.kinds.parameter_set.combinations import Combinations
from swarmwright.controllers.kinds.parameter_set.conditions import Variable

_LARGEST_INTEGER = 1 << 24
"""Largest integer up to which every integer is a float32."""
_LARGEST_REAL = float(np.finfo(np.float32).max)
_RESERVED = frozenset({"server", "simulation", "simulation_hash", "seed"})
"""Other keys of a parameters message, and the seed, which changes with every episode."""
_LN_2 = 0.6931471805599453
_ATTEMPTS = 100
"""Attempts to replace a forbidden combination; then an allowed one is used that does not depend on it."""
_PART, _PARTS = 100, 10
"""Random combinations to find an allowed one among, at a time, and how often."""

Numbers = NDArray[np.float64]


def _range(value: Any, whole: bool) -> Any:  # noqa: ANN401 - whatever the file says
    kinds, largest = ((int,), _LARGEST_INTEGER) if whole else ((int, float), _LARGEST_REAL)

    def is_number(bound: Any) -> bool:  # noqa: ANN401 - whatever the file says
        return isinstance(bound, kinds) and not isinstance(bound, bool) and bound == bound  # NaN is not

    if not (isinstance(value, list | tuple) and len(value) == 2 and all(map(is_number, value))):
        expected = f"whole numbers within +-{largest}" if whole else "numbers"
        raise ValueError(f"must be [lowest, highest], two {expected}, not {format_value(value)}")
    low, high = value
    for bound in value:
        if abs(bound) > largest:
            reason = "where every whole number is a 32-bit float" if whole else "the range of 32-bit floats"
            limits = f"-{largest} to {largest}" if whole else f"-{largest:g} to {largest:g}"
            raise ValueError(f"{format_value(bound)} is outside {limits}, {reason}")
    if low > high:
        raise ValueError(f"must be [lowest, highest], but {low} is above {high}; write [{high}, {low}]")
    if np.float32(low) == np.float32(high):
        same = "the same number" if low == high else "the same 32-bit float"
        raise ValueError(
            f"must contain at least two values, but {low} and {high} are {same}; put a constant parameter "
            "under the experiment's key parameters"
        )
    return [low, high]


def _pair(kind: str) -> WithJsonSchema:
    return WithJsonSchema({"type": "array", "items": {"type": kind}, "minItems": 2, "maxItems": 2})


class _Parameter(Options):
    when: str | None = Field(default=None, min_length=1)
    """Condition under which the parameter is active: `algorithm == "acs" and ants > 10`. Default: always."""


class _NumberParameter(_Parameter):
    range: list[float]
    scale: Literal["linear", "log"] = "linear"
    """log: steps are multiplicative, for ranges over orders of magnitude; both limits must be above 0."""
    inactive: float | None = None
    """Value that is sent while `when` is not true. Default: the lowest."""

    @property
    def fallback(self) -> float:
        """The value while it is inactive."""
        return float(self.range[0] if self.inactive is None else self.inactive)

    @model_validator(mode="after")
    def _check_inactive(self) -> "_NumberParameter":
        low, high = self.range
        if not low <= self.fallback <= high:
            raise FieldError("inactive", f"must be in the range [{low:g}, {high:g}], not {self.fallback:g}")
        if isinstance(self, IntegerParameter) and not self.fallback.is_integer():
            raise FieldError("inactive", f"must be a whole number, not {self.fallback:g}")
        return self

    @model_validator(mode="after")
    def _check_scale(self) -> "_NumberParameter":
        if self.scale == "log" and self.range[0] <= 0:
            raise FieldError("scale", f"log needs a range above 0, not {format_value(self.range)}")
        return self


class RealParameter(_NumberParameter):
    """A number."""

    type: Literal["real"]
    """A number with a fraction."""
    range: Annotated[Any, BeforeValidator(lambda value: _range(value, whole=False)), _pair("number")]
    """Lowest and highest value, inclusive."""
    digits: int | None = Field(default=None, ge=0, le=15)
    """Decimal places to which values are rounded. Default: none."""


class IntegerParameter(_NumberParameter):
    """A whole number."""

    type: Literal["integer"]
    """A number without a fraction."""
    range: Annotated[Any, BeforeValidator(lambda value: _range(value, whole=True)), _pair("integer")]
    """Lowest and highest value, inclusive."""


def _choices(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if not (
        isinstance(value, list | tuple)
        and len(value) >= 2
        and (_are_all(value, str) or _are_all(value, bool) or _are_all(value, int, float))
        and len(set(value)) == len(value) <= _LARGEST_INTEGER
    ):
        raise ValueError(
            "must be a list of at least two different strings, numbers or booleans, not "
            f"{format_value(value)}"
        )
    if _are_all(value, int, float):
        whole = _are_all(value, int)
        for choice in value:
            _check_number(choice, whole=whole)
    return list(value)


def _are_all(values: Sequence[Any], *kinds: type) -> bool:
    """Whether all values have one of the types; booleans are not integers."""
    return all(type(value) in kinds for value in values)


def _check_number(choice: float, *, whole: bool) -> None:
    """Raise ValueError for a number that is not exact as a 32-bit float."""
    largest = _LARGEST_INTEGER if whole else _LARGEST_REAL
    if not abs(choice) <= largest:  # NaN is not
        raise ValueError(f"{format_value(choice)} is outside -{largest:g} to {largest:g}")
    (single,) = shortest(np.array([choice], dtype=np.float32))
    if single != choice:
        raise ValueError(f"{format_value(choice)} is sent as the 32-bit float {single!r}; write that number")


class ChoiceParameter(_Parameter):
    """One of several values."""

    choices: Annotated[
        Any,
        BeforeValidator(_choices),
        WithJsonSchema({"type": "array", "items": {"type": ["string", "number", "boolean"]}, "minItems": 2}),
    ]
    """The values: all strings, all numbers, or all booleans."""

    inactive: str | float | bool | None = None
    """Value that is sent while `when` is not true. Default: the first choice."""

    @property
    def fallback(self) -> float:
        """The value while it is inactive; for strings the index of the choice."""
        choice = self.choices[0] if self.inactive is None else self.inactive
        return float(self.choices.index(choice) if self.are_strings else choice)

    @model_validator(mode="after")
    def _check_inactive(self) -> "ChoiceParameter":
        if self.inactive is not None and self.inactive not in self.choices:
            raise FieldError("inactive", f"must be one of the choices, not {format_value(self.inactive)}")
        return self

    @property
    def are_strings(self) -> bool:
        """Whether the choices are strings, which are sent as their index."""
        return isinstance(self.choices[0], str)

    @property
    def are_booleans(self) -> bool:
        """Whether the choices are True and False, which are sent as 1 and 0."""
        return isinstance(self.choices[0], bool)


class CategoricalParameter(ChoiceParameter):
    """One of several values without an order."""

    type: Literal["categorical"]
    """One of several values, without an order."""


class OrdinalParameter(ChoiceParameter):
    """One of several values in an order."""

    type: Literal["ordinal"]
    """One of several values, in order."""


Parameter = Annotated[
    RealParameter | IntegerParameter | CategoricalParameter | OrdinalParameter, Field(discriminator="type")
]


class ParameterSetOptions(RepresentationOptions):
    """Values of parameters, for simulations that control their agents themselves."""

    kind: Literal["parameter_set"] = "parameter_set"
    file: str | None = Field(default=None, min_length=1)
    """A parameter file of irace, relative to the experiment, instead of `parameters` and `forbidden`."""
    parameters: dict[str, Parameter] = Field(default={}, max_length=10_000)
    """The evolved parameters by name: {type: real, range: [0, 5]}, {type: integer, range: [1, 10]} or {type:
    categorical, choices: [a, b]}, also of numbers or booleans; ordinal if they have an order. A real or
    integer has a scale: linear (default), or log for positive ranges over orders of magnitude. With `when`, a
    condition over other parameters, it is active only where that is true. The simulation's fixed parameters
    are under the experiment's key parameters.
    """
    forbidden: list[str] = Field(default=[], max_length=1000)
    """Conditions that no candidate may meet: ["alpha == 0 and beta == 0"]. Forbidden values are replaced by
    others of the parameters in the condition."""

    @model_validator(mode="after")
    def _check_names(self) -> "ParameterSetOptions":
        if not self.parameters:
            raise FieldError("parameters", "is missing; name at least one parameter, or a file of irace")
        for name in self.parameters:
            if name in _RESERVED:
                raise FieldError(
                    "parameters",
                    f"{name!r} cannot be evolved: it is set for each episode",
                )
        self.combinations()  # raises a FieldError
        return self

    def combinations(self) -> Combinations:
        """Return the conditions, checked. Raises FieldError if they are not valid."""
        variables = {name: _describe(parameter) for name, parameter in self.parameters.items()}
        when = {name: parameter.when for name, parameter in self.parameters.items() if parameter.when}
        return Combinations(variables, when, self.forbidden)


def _describe(parameter: Parameter) -> Variable:
    """Return what conditions can do with a parameter."""
    if not isinstance(parameter, ChoiceParameter):
        return Variable()
    return Variable(
        choices=parameter.choices if parameter.are_strings else None,
        is_boolean=parameter.are_booleans,
        is_ordered=isinstance(parameter, OrdinalParameter),
    )


class ParameterSet(Representation):
    """Parameters of a simulation that controls its agents itself.

    A candidate's values are sent with the experiment's parameters, in the parameters message of each of its
    episodes. No agent is controlled from outside.

    Genes are in 0..1, one for each parameter in the order of the file; values beyond are clipped. A real is
    low + g * (high - low), or low * (high / low) ** g on the log scale. For an integer, 0..1 is divided
    into a part for each value, equally wide, or on the log scale as wide as log(n + 1) - log(n). For a
    categorical it is divided equally among the choices. All values are computed in binary64, in operations
    that give the same bits on every machine, and rounded to float32, which is sent as its shortest decimal.
    Inactive parameters have a constant value, whatever their gene.

    If the combination of values is forbidden, the genes of the parameters in the condition are drawn again,
    from random numbers addressed by the genome, until it is allowed. So a genome always has the same values,
    for every method and on every server.

    A mutation moves a number's gene uniformly within +-severity, with `probability`, and reflects it at 0 and
    1; a categorical changes with `probability` times `severity` to another choice, all equally likely. A
    crossover takes each gene from either parent, at least one from each; with a single numeric
    parameter, it takes a value between them. The distance is the sum of the differences of genes; two
    categories differ by 1.
    """

    kind: ClassVar[str] = "parameter_set"
    options_model = ParameterSetOptions
    options: ParameterSetOptions
    steers: ClassVar[bool] = False

    def __init__(self, options: ParameterSetOptions, *, sensors: int, actuators: int) -> None:
        super().__init__(options, sensors=sensors, actuators=actuators)
        if options.forbidden:
            _ = self._allowed  # raises a FieldError

    @property
    def genome_size(self) -> int:
        """Number of parameters."""
        return len(self.options.parameters)

    @property
    def gene_names(self) -> tuple[str, ...]:
        """The names of the parameters."""
        return tuple(self.options.parameters)

    @property
    def bounds(self) -> Limits:
        """0 to 1."""
        return np.zeros(self.genome_size), np.ones(self.genome_size)

    @property
    def choices(self) -> tuple[int, ...]:
        """Number of choices of each parameter, among which 0..1 is divided equally; 0 for numbers."""
        return tuple(self._categories.astype(int).tolist())

    @cached_property
    def _categories(self) -> NDArray[np.float64]:
        """Number of choices of each parameter; 0 for numbers."""
        return np.array(
            [
                len(parameter.choices) if isinstance(parameter, CategoricalParameter) else 0
                for parameter in self.options.parameters.values()
            ],
            dtype=np.float64,
        )

    def architecture(self) -> dict[str, Any]:
        """Return names and types of the parameters, and the strings that indices select.

        Choices that are numbers or booleans become a real or an integer: the weight is the value.
        """
        parameters: list[dict[str, Any]] = []
        for name, parameter in self.options.parameters.items():
            described: dict[str, Any] = {"name": name, "type": parameter.type}
            if isinstance(parameter, ChoiceParameter):
                if parameter.are_strings:
                    described |= {"type": "categorical", "choices": parameter.choices}
                else:
                    described["type"] = (
                        "real" if any(type(c) is float for c in parameter.choices) else "integer"
                    )
            parameters.append(described)
        return {"version": 1, "kind": self.kind, "parameters": parameters}

    def weights(self, genomes: Genomes) -> NDArray[np.float32]:
        """Return the values, (candidates, parameters); for strings, the index of the choice."""
        rows = genomes.reshape(-1, self.genome_size)
        genes = np.clip(rows.astype(np.float64), 0.0, 1.0)
        values, columns = self._decode(genes)
        if self.options.forbidden:
            self._replace_forbidden(rows, genes, values, columns)
        return values.astype(np.float32).reshape(genomes.shape)

    def _decode(self, genes: Numbers) -> tuple[Numbers, dict[str, Numbers]]:
        """Return the values, (n, parameters), and the values of each parameter, NaN where it is inactive.

        genes: (n, genome_size), 0 to 1.
        """
        parameters = self.options.parameters
        columns = {
            name: _value(parameter, genes[:, index])
            for index, (name, parameter) in enumerate(parameters.items())
        }
        self._combinations.deactivate(columns)
        values = [
            np.where(np.isnan(column), parameter.fallback, column)
            for column, parameter in zip(columns.values(), parameters.values(), strict=True)
        ]
        return np.stack(values, axis=-1), columns

    @cached_property
    def _combinations(self) -> Combinations:
        return self.options.combinations()

    def _replace_forbidden(
        self, genomes: Genomes, genes: Numbers, values: Numbers, columns: Mapping[str, Numbers]
    ) -> None:
        """Replace forbidden combinations in `values`, see the class.

        Args:
            genomes: (n, genome_size).
            genes: the same, within 0 to 1.
            values: those of the genes, (n, parameters).
            columns: those of each parameter, NaN where it is inactive.
        """
        forbidden = self._combinations.find_forbidden(columns, len(genes))
        rows = np.flatnonzero(forbidden.any(axis=1))
        # The numbers of a genome depend on nothing else.
        addresses = np.array([_address(genomes[row]) for row in rows], dtype=np.int64)
        attempt = 0
        while len(rows):
            redrawn = forbidden[forbidden.any(axis=1)] @ self._combinations.involved
            units = Streams(0, "parameter_set.allowed", attempt, addresses).units(self.genome_size)
            drawn = np.where(redrawn, units, genes[rows])
            if attempt == _ATTEMPTS:
                drawn[:] = self._allowed
            genes[rows] = drawn
            values[rows], columns = self._decode(drawn)
            forbidden = self._combinations.find_forbidden(columns, len(rows))
            remaining = forbidden.any(axis=1)
            rows, addresses = rows[remaining], addresses[remaining]
            attempt += 1

    @cached_property
    def _allowed(self) -> Numbers:
        """Genes of an allowed combination, (genome_size,). Raises FieldError if random ones are forbidden."""
        for part in range(_PARTS):
            genes = Streams(0, "parameter_set.first", part, range(_PART)).units(self.genome_size)
            forbidden = self._combinations.find_forbidden(self._decode(genes)[1], len(genes)).any(axis=1)
            if not forbidden.all():
                return np.asarray(genes[np.argmin(forbidden)])
        raise FieldError(
            ("controller", "forbidden"),
            f"all of {_PART * _PARTS:,} random combinations are forbidden; forbid fewer, or change ranges",
        )

    def initial(self, stream: Stream) -> Genome:
        """Return genes that are uniform in 0..1."""
        return stream.unit(self.genome_size).astype(np.float32)

    def initials(self, streams: Streams) -> Genomes:
        """Return genes that are uniform in 0..1 for each stream."""
        return streams.units(self.genome_size).astype(np.float32)

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which each parameter is changed with `probability`, see the class."""
        drawn = [stream.unit(self.genome_size) for _ in range(2)]
        return self._mutate_genes(genome, *drawn, severity=severity, probability=probability)

    def mutations(
        self, parents: Genomes, streams: Streams, *, severity: float, probability: float
    ) -> Genomes:
        """Return a mutated copy of each parent."""
        drawn = [streams.units(self.genome_size) for _ in range(2)]
        return self._mutate_genes(parents, *drawn, severity=severity, probability=probability)

    def _mutate_genes(
        self,
        genomes: Genomes,
        rate_units: Numbers,
        value_units: Numbers,
        *,
        severity: float,
        probability: float,
    ) -> Genomes:
        """Return mutated copies, (.., genome_size), from two numbers for each gene, uniform in [0, 1)."""
        genes = genomes.astype(np.float64)
        moved = genes + (value_units * 2 - 1) * severity
        moved = np.where(moved > 1, 2 - moved, np.where(moved < 0, -moved, moved))
        choices = self._categories
        categorical, choice_counts = choices > 0, np.maximum(choices, 2)
        another = (
            _part(genes, choice_counts) + 1 + np.floor(value_units * (choice_counts - 1))
        ) % choice_counts
        moved = np.where(categorical, (another + 0.5) / choice_counts, np.clip(moved, 0, 1))
        rate = np.where(categorical, probability * severity, probability)
        return np.where(rate_units < rate, moved, genomes).astype(np.float32)

    def perturbations(
        self, parents: Genomes, streams: Streams, *, spread: Numbers, fresh: Numbers
    ) -> Genomes:
        """Return a genome around each parent: numbers from a normal distribution, categoricals redrawn."""
        drawn = [streams.units(self.genome_size) for _ in range(2)]
        numbers = sample_around(
            parents, streams, np.repeat(spread[:, np.newaxis] / 2, self.genome_size, axis=1), self.bounds
        )
        choice_counts = np.maximum(self._categories, 1)
        another = (np.floor(drawn[1] * choice_counts) + 0.5) / choice_counts
        chosen = np.where(drawn[0] < fresh[:, np.newaxis], another, parents)
        return np.where(self._categories > 0, chosen, numbers).astype(np.float32)

    def likeness(self, genomes: Genomes) -> Numbers:
        """Return genes of numbers and indices of categoricals."""
        genes, choices = genomes.astype(np.float64), self._categories
        return np.where(choices > 0, _part(genes, np.maximum(choices, 1)), genes)

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a mixture of both, see the class."""
        if self.genome_size == 1:
            if self._categories[0]:
                return (father if stream.integer(2) else mother).copy()
            difference = father.astype(np.float64) - mother
            return (mother + difference * stream.unit(1)).astype(np.float32)
        from_father = np.array(stream.integers(2, self.genome_size)) == 1
        if from_father.all() or not from_father.any():
            from_father[stream.integer(self.genome_size)] ^= True
        return np.where(from_father, father, mother).astype(np.float32)

    def crossovers(self, mothers: Genomes, fathers: Genomes, streams: Streams) -> Genomes:
        """Return a mixture of each pair."""
        if self.genome_size == 1:
            return super().crossovers(mothers, fathers, streams)
        from_father = streams.integers(2, self.genome_size) == 1
        for row in np.flatnonzero(from_father.all(axis=1) | ~from_father.any(axis=1)).tolist():
            from_father[row, streams[row].integer(self.genome_size)] ^= True
        return np.where(from_father, fathers, mothers)

    def distance(self, genome: Genome, other: Genome) -> float:
        """Return the sum of differences of genes; two categories differ by 1."""
        return float(self._distances(genome, other))

    def distances(self, genome: Genome, others: Genomes) -> NDArray[np.float64]:
        """Return the distance of one genome to each row of others, (k, D) to (k,)."""
        return self._distances(genome, others)

    def distances_among(
        self, genomes: Genomes, indices: NDArray[np.int64], others: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the distances between genomes, given by their indices."""
        distances = np.empty(others.shape)
        for part in split_rows(len(indices), others.shape[1] * self.genome_size):
            distances[part] = self._distances(genomes[indices[part]][:, np.newaxis], genomes[others[part]])
        return distances

    def _distances(self, genomes: Genomes, other_genomes: Genomes) -> Numbers:
        choices = self._categories
        left, right = genomes.astype(np.float64), other_genomes.astype(np.float64)
        choice_counts = np.maximum(choices, 1)
        parts = np.where(
            choices > 0, _part(left, choice_counts) != _part(right, choice_counts), np.abs(left - right)
        )
        # accumulate adds strictly one after another; sum() would add in an order that NumPy chooses.
        sums: Numbers = np.add.accumulate(parts, axis=-1)[..., -1]
        return sums


def _part(genes: Numbers, parts: Numbers | float) -> Numbers:
    """Return the index of the part of 0..1, divided into equal parts, in which each gene lies."""
    inside: Numbers = np.clip(np.floor(genes * parts), 0, np.asarray(parts) - 1)
    return inside


def _address(genome: Genome) -> int:
    """Return the number that addresses a genome's random numbers."""
    digest = sha256(genome.astype("<f4").tobytes()).digest()
    return int.from_bytes(digest[:8], "little") >> 1


def _value(parameter: Parameter, genes: Numbers) -> Numbers:
    if isinstance(parameter, ChoiceParameter):
        index = _part(genes, float(len(parameter.choices)))
        if parameter.are_strings:
            return index
        chosen: Numbers = np.array(parameter.choices, dtype=np.float64)[index.astype(np.intp)]
        return chosen
    low, high = (float(bound) for bound in parameter.range)
    if isinstance(parameter, IntegerParameter):
        if parameter.scale == "linear":
            return low + _part(genes, high - low + 1)
        values = np.floor(low * _power(genes, _binary_logarithm(low, high + 1)))
    elif parameter.scale == "linear":
        values = low + genes * (high - low)
    else:
        values = low * _power(genes, _binary_logarithm(low, high))
    if isinstance(parameter, RealParameter) and parameter.digits is not None:
        factor = 10.0**parameter.digits  # exact
        values = np.rint(values * factor) / factor
    inside: Numbers = np.clip(values, low, high)
    return inside


def _binary_logarithm(low: float, high: float) -> float:
    """Return log2(high / low), the same on every machine: Decimal rounds correctly."""
    with localcontext() as context:
        context.prec = 30
        return float((Decimal(high) / Decimal(low)).ln() / Decimal(2).ln())


def _power(genes: Numbers, logarithm: float) -> Numbers:
    """Return 2 ** (genes * logarithm), the same bits on every machine.

    The functions of a C library differ between machines; this is a Taylor series for the fraction, whose last
    term is below the rounding, and an exact scaling.
    """
    exponent = genes * logarithm
    whole = np.floor(exponent + 0.5)
    fraction = (exponent - whole) * _LN_2
    total = np.ones_like(fraction)
    for k in range(16, 0, -1):
        total = total * fraction / k + 1.0
    powers: Numbers = np.ldexp(total, whole.astype(np.int64))
    return powers
