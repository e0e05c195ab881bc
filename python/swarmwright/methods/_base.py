"""The base class of methods."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from importlib.util import find_spec
from math import isfinite, nan
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.plug_in_code import is_plug_in, numbers
from swarmwright.common.problems import FieldError
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers import Representation
from swarmwright.controllers._base import LARGEST_GENOME
from swarmwright.methods.constraints import rank_feasible_first

DrawStreams = Callable[[str, Sequence[int] | NDArray[np.int64]], Streams]
"""Returns the streams of random numbers for a purpose and several candidates."""


class SteadyState(ABC):
    """The steady-state interface of a method: `ask_next` and `tell_next`.

    Candidate n is created after the results of candidates 0 to n - in_flight, told in order of index, and
    before any later result. It therefore depends on `in_flight`, but not on the number or speed of servers.
    The caller holds back results that arrive early.
    """

    options: "MethodOptions"
    representation: Representation
    seed: int
    generation: int
    evaluations: int
    done: bool
    start: Genomes

    steady_state: ClassVar[bool] = False
    """Whether the method can work candidate by candidate."""

    def _begin_steady_state(self) -> None:
        self._created = 0
        """Candidates created so far, of which `_handed_out` were returned by `ask_next`."""
        self._handed_out = 0
        self._pending: deque[Genome] = deque()

    @property
    def generation_size(self) -> int:
        """Number of consecutive evaluations that form a generation of the record."""
        raise NotImplementedError

    @property
    def can_ask(self) -> bool:
        """Whether `ask_next` can return a candidate now; otherwise call `tell_next`, or stop if `done`."""
        last = min(self.evaluations + self.options.in_flight, self._last)
        return not self.done and self._handed_out < last

    def ask_next(self) -> tuple[int, Genome]:
        """Return the index, from 0, and the genome, (genome_size,), of the next candidate to evaluate.

        Raises InputError if `in_flight` candidates lack fitness, no candidates remain, or the method works in
        generations.
        """
        self._check_operation("steady_state", "ask and tell")
        self._check_not_done()
        if self._handed_out == self._last:
            raise InputError("no candidates remain; tell the fitness of the last ones")
        if not self.can_ask:
            raise InputError(
                f"{self.options.in_flight} candidate(s) are in flight; "
                f"tell the fitness of candidate {self.evaluations} before asking again"
            )
        self._make(self._handed_out + 1)
        self._handed_out += 1
        return self._handed_out - 1, self._pending[self._handed_out - 1 - self.evaluations].copy()

    def tell_next(
        self, fitness: float, metrics: ArrayLike | None = None, violation: float | None = None
    ) -> None:
        """Accept the fitness of candidate number `evaluations`, the first without fitness; NaN means failed.

        Args:
            fitness: of the candidate.
            metrics: (metrics,), if the options have `needed_metrics`.
            violation: sum of its violations of constraints, see `Method.tell`; None without constraints.

        Raises InputError if no candidate is waiting for its fitness.
        """
        self._check_operation("steady_state", "ask and tell")
        self._check_not_done()
        if self.evaluations == self._handed_out:
            raise InputError("no candidate is waiting for its fitness; ask for one first")
        self._store_metrics(None if metrics is None else _parse_numbers("metrics", metrics)[np.newaxis], 1)
        # Create all candidates that must not depend on this result.
        self._make(min(self.evaluations + self.options.in_flight, self._last))
        value = float(fitness) if isfinite(fitness) else nan
        scores = self._apply_violations(np.array([value]), None if violation is None else [violation])
        self._tell_next(self.evaluations, self._pending.popleft(), float(scores[0]))
        self.evaluations += 1
        target = self.options.target
        reached = target is not None and value >= target and not violation
        self.done = reached or self.evaluations >= self._last
        if not self.done:
            self.generation = self.evaluations // self.generation_size

    def streams_of(self, purpose: str, index: int) -> Streams:
        """Return the random streams for a purpose and a candidate.

        Candidate `index` has number index % generation_size in generation index // generation_size.
        """
        generation, candidate = divmod(index, self.generation_size)
        return Streams(self.seed, purpose, generation, [candidate])

    def initial_of(self, index: int) -> Genome:
        """Return a random genome for a candidate, see `streams_of`; the first ones come from `start`."""
        if index < len(self.start):
            return np.array(self.start[index])
        genomes = self.representation.initials(self.streams_of("initial", index))
        return np.asarray(genomes[0])

    def streams_next(self, index: int) -> DrawStreams:
        """Return the source of streams with which candidate `index` is created as a generation of its own."""
        return lambda purpose, rows: Streams(self.seed, f"{purpose}.next", index, rows)

    @abstractmethod
    def _store_metrics(self, metrics: ArrayLike | None, count: int) -> None:
        """Store the metrics of `count` candidates. Raises InputError if they are missing."""

    @abstractmethod
    def _apply_violations(self, values: Fitness, violations: ArrayLike | None) -> Fitness:
        """Store violations, and return the scores for `_tell` or `_tell_next`, (n,)."""

    def _ask_next(self, index: int) -> Genome:
        """Return the genome of candidate `index`."""
        raise NotImplementedError

    def _tell_next(self, index: int, genome: Genome, fitness: float) -> None:
        """Accept the fitness of candidate `index`, finite or NaN; called in order of index."""
        raise NotImplementedError

    def _check_operation(self, needed: str, instead: str) -> None:
        if self.options.operation != needed:
            raise InputError(f"the method's operation is {self.options.operation}; use {instead}")

    def _check_not_done(self) -> None:
        if self.done:
            raise InputError(f"the method is done after {self.generation + 1} generation(s); start a new one")

    @cached_property
    def _last(self) -> int:
        """Total number of candidates, in whole generations, at least one."""
        size, most = self.generation_size, self.options.evaluations
        last = self.options.generations * size
        return last if most is None else min(last, max(most // size, 1) * size)

    def _make(self, count: int) -> None:
        """Create candidates up to `count`."""
        while self._created < count:
            genome = self._ask_next(self._created)
            if is_plug_in(type(self)):
                size = (self.representation.genome_size,)
                genome = numbers(self, "_ask_next", genome, size, "a genome, (genome_size,)")
            self._pending.append(genome)
            self._created += 1


NO_LIMIT = 1_000_000_000
"""Number of generations that stands for no limit."""


_MOST_GENES = 4_000_000_000
"""Upper limit of genes of a generation, which take 16 GB."""


def check_metric_mapping(value: object, label: str, example: str, form: str) -> object:
    """Check an option that maps names of metrics to values, see `metrics_option`; return it unchanged.

    Raises ValueError with the right form for a name or a list of names.

    Args:
        value: from the file.
        label: kind of value, such as "a range".
        example: name of a metric for the message, unless the value has one.
        form: example of a value.
    """
    if isinstance(value, list | str):
        names = [value] if isinstance(value, str) else value
        name = next((entry for entry in names if isinstance(entry, str) and entry), example)
        raise ValueError(f"must map each metric to {label}, such as {{{name}: {form}}}")
    return value


class MethodOptions(Options):
    """Options of every method."""

    kind: str = ""
    """Name of the method."""
    metrics_option: ClassVar[str | None] = None
    """The option that maps names of metrics to values, if the method needs metrics; required in
    experiments."""

    generations: int = Field(default=200, ge=1, le=NO_LIMIT)
    """Number of generations; in steady state and with growing populations, the equivalent number of
    evaluations. The first limit reached of generations, evaluations and seconds ends the run. Default:
    200, or none if evaluations or seconds are set.
    """
    evaluations: int | None = Field(default=None, ge=1, le=10**15)
    """Maximum number of evaluated candidates: the run ends before a generation would exceed it, but evaluates
    at least one generation. Default: no limit."""
    seconds: float | None = Field(default=None, gt=0, le=3_200_000_000)
    """Maximum duration of all sessions together; the run ends with the generation in which it is exceeded.
    Default: no limit."""
    target: float | None = None
    """Fitness at which the run stops. Default: none."""
    operation: Literal["generational", "steady_state"] = "generational"
    """generational: whole generations are evaluated. steady_state: candidates one by one, so that servers do
    not wait for the slowest of a generation.
    """
    in_flight: int = Field(default=16, ge=1, le=1_000_000)
    """Steady state only: candidates evaluated at the same time. Candidate n is created from the results of
    candidates 0 to n - in_flight, whatever the number and speed of servers.
    """

    @model_validator(mode="before")
    @classmethod
    def _drop_default_limit(cls, values: Any) -> Any:  # noqa: ANN401 - whatever the file says
        if isinstance(values, Mapping) and "generations" not in values:
            limits = (values.get("evaluations"), values.get("seconds"))
            if any(option is not None for option in limits):
                return {**values, "generations": NO_LIMIT}
        return values

    @property
    def needed_metrics(self) -> tuple[str, ...]:
        """Names of the metrics that the method needs besides fitness, see `Method.metrics`."""
        return ()

    def option_of(self, metric: str) -> str | None:  # noqa: ARG002 - for those with several
        """Return the option that names one of the `needed_metrics`."""
        return self.metrics_option

    @property
    def generation_limit(self) -> int | None:
        """Maximum number of generations; None for no limit."""
        return (
            None if self.generations == NO_LIMIT and (self.evaluations or self.seconds) else self.generations
        )


class Incumbent(NamedTuple):
    """The best candidate in the view of a method."""

    evaluation: int
    """Number of its last evaluation in the run, from 0."""
    fitness: float


class Method(SteadyState):
    """Base class of methods: `ask` for genomes, evaluate them, `tell` their fitness.

    `ask` and `tell` are templates around `_ask` and `_tell`, which a method implements; they count
    evaluations and check shapes. Fitness may have any sign, and higher is better; NaN marks a failed
    evaluation, which ranks below all others and must not enter computations. A method draws random numbers
    from `stream`, by generation and candidate, so that the same seed always gives the same genomes. Telling a
    new method with the same options, representation and seed the same results restores its state, which is
    how interrupted runs resume.

    A method that supports steady state sets `steady_state` and implements `_ask_next`, `_tell_next` and
    `generation_size`. With `operation: steady_state`, call `ask_next` and `tell_next`.

    Args:
        options: this method's section of the experiment.
        representation: provides the operators on genomes.
        seed: seed of the experiment.

    Raises:
        InputError: the method does not support this representation or steady state.
    """

    kind: ClassVar[str]
    """Name in experiment files."""
    options_model: ClassVar[type[MethodOptions]]
    """Model of the options, including `kind`."""
    default_options: ClassVar[type[MethodOptions]] = MethodOptions
    """Options model of classes in files (`my_method.py:Class`) without an `options_model`."""
    keeps_members: ClassVar[bool] = False
    """Whether members survive generations with their fitness, see `survivors`."""
    start_as: ClassVar[Literal["members", "center"] | None] = None
    """How the method starts from given controllers, see `start_from`. members: as first candidates, through
    `initials` or `initial_of`. center: its distribution is centered at `start[0]`. None: not supported."""
    by_instance: ClassVar[bool] = False
    """Whether candidates are evaluated repeatedly, on one instance after the other, see `instance`. The
    record then has their mean so far as fitness, and the best candidate is `incumbent`."""
    spreads_evaluations: ClassVar[bool] = False
    """Whether all candidates depend on the option `evaluations`, so that a run cannot be prolonged."""
    proposals_are_recorded: ClassVar[bool] = False
    """Whether a resumed run takes the genomes of its record instead of repeating them, since a library, whose
    numbers differ between versions and processors, proposes them; see `take_recorded`."""
    ranks_violations: ClassVar[bool] = False
    """Whether the method orders infeasible candidates itself, by `violations`. Otherwise `_tell` receives
    scores in which they are below all feasible ones: `rank_feasible_first`."""
    libraries: ClassVar[tuple[str, ...]] = ()
    """Packages used besides NumPy; a run's record includes their versions."""
    generational_because: ClassVar[str] = "it learns from whole generations"
    """Why the method does not support steady state; the end of a sentence."""

    def __init__(self, options: MethodOptions, representation: Representation, *, seed: int) -> None:
        for name, reason in self.problems(options, representation).items():
            raise FieldError(("method", name), reason)
        missing = self.missing()
        if missing is not None:
            raise FieldError(("method", "kind"), missing)
        self.options = options
        self.representation = representation
        self.seed = seed
        self.generation = 0
        """The current generation."""
        self.evaluations = 0
        """Number of evaluated candidates."""
        self.done = False
        """Whether the budget is used or the target is reached."""
        self.reached = False
        """Whether the target is reached; not in steady state."""
        self.start: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        """Genomes to start from, (k, genome_size), set by `start_from`."""
        self.metrics: NDArray[np.float64] = np.empty((0, len(options.needed_metrics)))
        """Metrics of the last `tell`, (n, metrics), in the order of the options' `needed_metrics`: means over
        episodes, NaN without any value."""
        self.violations: NDArray[np.float64] = np.empty(0)
        """Violations of the last `tell`, (n,); 0 for feasible candidates."""
        self.has_constraints = False
        """Whether the last `tell` had violations."""
        self._current: Genomes | None = None
        self._begin_steady_state()

    def __repr__(self) -> str:
        """Return the class and the progress."""
        return f"<{type(self).__name__}: generation {self.generation}, {self.evaluations} evaluations>"

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:  # noqa: ARG003 - for those that refuse
        """Return why this method cannot evolve a representation, as the end of a sentence, or None."""
        return None

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Return the options that are invalid for this representation: option -> reason.

        Args:
            options: the method's section of the experiment.
            representation: None if not yet known.
        """
        invalid = {}
        if options.operation == "steady_state" and not cls.steady_state:
            invalid["operation"] = (
                f"{cls.kind} cannot work in steady state: {cls.generational_because}; leave the key out"
            )
        reason = None if representation is None else cls.unsuitable(representation)
        if representation is not None and reason is not None:
            invalid["kind"] = f"{cls.kind} cannot evolve {representation.kind}: {reason}"
        genes = 0 if representation is None else representation.genome_size
        count = _members(options) or 0
        if genes <= LARGEST_GENOME and count * genes > _MOST_GENES:  # larger genomes are refused in any case
            invalid["population"] = (
                f"{count:,} genomes of {genes:,} genes need too much memory; use at most "
                f"{_MOST_GENES // genes:,}"
            )
        return invalid

    @classmethod
    def missing(cls) -> str | None:
        """Return a message about missing packages, or None."""
        missing = [library for library in cls.libraries if find_spec(library) is None]
        if not missing:
            return None
        return f"{cls.kind} needs {' and '.join(missing)}; run pip install {' '.join(missing)}"

    @classmethod
    def first_generation(
        cls,
        options: MethodOptions,
        representation: Representation | None,  # noqa: ARG003 - for those whose default depends on it
    ) -> int | None:
        """Return the number of candidates in the first generation; None if unknown.

        Args:
            options: the method's section of the experiment.
            representation: None if not yet known.
        """
        return _members(options)

    @classmethod
    def no_start(cls, options: MethodOptions, count: int) -> str | None:
        """Return why this method cannot start from `count` given controllers, or None.

        Args:
            options: options of the method.
            count: given controllers, at least 1.
        """
        if cls.start_as is None:
            return (
                f"{cls.kind} cannot start from given controllers; leave the key out or choose another method"
            )
        if cls.start_as == "center" and count > 1:
            return f"{cls.kind} starts from one controller, the center of its first sample, not from {count}"
        return cls.surplus(options, count)

    @classmethod
    def surplus(cls, options: MethodOptions, count: int) -> str | None:
        """Return why the first generation is too small for `count` given controllers, or None.

        Args:
            options: options of the method.
            count: given controllers, at least 1.
        """
        size = cls.first_generation(options, None)
        if size is not None and count > size:
            return f"{count} controllers exceed the {size} candidates of the first generation"
        return None

    def start_from(self, genomes: Genomes) -> None:
        """Start from these genomes, (k, genome_size), k >= 1; call it before the first `ask`.

        Raises InputError if the method does not support it.
        """
        problem = self.no_start(self.options, len(genomes))
        if problem is not None:
            raise InputError(problem)
        self.start = np.array(genomes, dtype=np.float32)

    def take_recorded(self, genomes: Iterable[Genome]) -> None:
        """Propose these genomes of a record first; for methods with `proposals_are_recorded`."""
        raise NotImplementedError(f"{self.kind} repeats its proposals")

    def ask(self) -> Genomes:
        """Return the genomes of this generation that need evaluation: float32, (n, genome_size), n >= 1.

        Raises InputError if the last fitness was not told, the method is done, or it works in steady state.
        """
        self._check_operation("generational", "ask_next and tell_next")
        if self._current is not None:
            raise InputError("the fitness of the last genomes is missing; tell it before asking again")
        self._check_not_done()
        self._current = self._ask()
        if is_plug_in(type(self)):
            shape = None, self.representation.genome_size
            self._current = numbers(self, "_ask", self._current, shape, "genomes, (candidates, genome_size)")
        return self._current if self._ignores_genomes else self._current.copy()

    @property
    def _ignores_genomes(self) -> bool:
        """Whether `_tell` ignores the genomes, so that the caller may own them."""
        return False

    @property
    def sample(self) -> _engine.Sample | None:
        """Source of the last genomes, if servers can expand it; otherwise None."""
        return None

    @property
    def instance(self) -> int:
        """Number, from 0, that selects the seeds of the current candidates when generations have new seeds.

        Default: the generation. With `by_instance` the seeds are always new.
        """
        return self.generation

    @property
    def contenders(self) -> int:
        """With `by_instance`: number of candidates that may still be the best."""
        return 0

    @property
    def instance_means(self) -> Fitness:
        """With `by_instance`: mean fitness over all instances so far of the candidates of the last `tell`."""
        raise NotImplementedError

    @property
    def incumbent(self) -> Incumbent | None:
        """With `by_instance`: the best candidate after the last `tell`; None if all failed."""
        raise NotImplementedError

    def survivors(self) -> Genomes:
        """Return the surviving members, (k, genome_size), after `ask`; most methods have none.

        With noisy evaluations, survivors can be evaluated again with the new candidates, so that a lucky
        evaluation does not keep a member forever; pass their new fitness to `tell`.
        """
        return np.empty((0, self.representation.genome_size), dtype=np.float32)

    def tell(
        self,
        fitness: ArrayLike,
        survivors: ArrayLike | None = None,
        metrics: ArrayLike | None = None,
        violations: ArrayLike | None = None,
    ) -> None:
        """Accept the fitness of the last genomes, (n,), in their order; NaN means failed.

        Args:
            fitness: fitness of each genome.
            survivors: new fitness of the survivors, (k,), if they were evaluated again.
            metrics: (n, metrics), if the options have `needed_metrics`.
            violations: sums of violations of constraints, (n,), 0 for feasible candidates. Infeasible ones
                rank below all feasible ones, those with a larger violation lower. None without constraints.

        Raises InputError without a preceding `ask`, or for a wrong number of values.
        """
        self._check_operation("generational", "ask_next and tell_next")
        if self._current is None:
            raise InputError("no genomes are waiting for their fitness; ask for them first")
        values = _check_fitness(fitness, len(self._current), "last")
        self._store_metrics(metrics, len(values))
        if survivors is not None:
            self._rescore(_check_fitness(survivors, len(self.survivors()), "surviving"))
        self._tell(self._current, self._apply_violations(values, violations))
        self.count_generation(np.where(self.violations > 0, nan, values))

    def _apply_violations(self, values: Fitness, violations: ArrayLike | None) -> Fitness:
        self.has_constraints = violations is not None
        if violations is None:
            self.violations = np.zeros(len(values))
            return values
        self.violations = _check_violations(violations, len(values))
        return values if self.ranks_violations else rank_feasible_first(values, self.violations)

    def _store_metrics(self, metrics: ArrayLike | None, count: int) -> None:
        needed = self.options.needed_metrics
        if not needed:
            return
        if metrics is None:
            names = ", ".join(needed)
            raise InputError(f"{self.kind} needs metrics: tell(fitness, metrics=...), with columns {names}")
        values = _parse_numbers("metrics", metrics)
        if values.shape != (count, len(needed)):
            raise InputError(f"metrics: shape is {values.shape}; expected {(count, len(needed))}")
        self.metrics = values

    def count_generation(self, values: Fitness) -> None:
        """Count a generation with the fitness `values`, (n,), told by `tell` or within the engine."""
        self._current = None
        self.evaluations += len(values)
        target = self.options.target
        self.reached = target is not None and self._reaches(values, target)
        self.done = self.reached or self._is_exhausted()
        if not self.done:
            self.generation += 1

    def _reaches(self, values: Fitness, target: float) -> bool:
        """Return whether this fitness reaches the target."""
        return bool((values >= target).any())

    def _rescore(self, fitness: Fitness) -> None:
        """Accept new fitness of the survivors, finite or NaN; for methods with `keeps_members`."""
        raise NotImplementedError(f"{self.kind} keeps no members")

    def stream(self, purpose: str, candidate: int = 0) -> Stream:
        """Return the random stream for a purpose and a candidate of this generation."""
        return Stream(self.seed, purpose, self.generation, candidate)

    def streams(self, purpose: str, candidates: Sequence[int] | NDArray[np.int64]) -> Streams:
        """Return the random streams for a purpose and several candidates of this generation."""
        return Streams(self.seed, purpose, self.generation, candidates)

    def initials(self, candidates: Sequence[int]) -> Genomes:
        """Return random initial genomes, the same for every method, by generation and candidate.

        In the first generation, genomes of `start` come first.
        """
        genomes = self.representation.initials(self.streams("initial", candidates))
        if self.generation == 0 and len(self.start):
            for row, candidate in enumerate(candidates):
                if candidate < len(self.start):
                    genomes[row] = self.start[candidate]
        return genomes

    @property
    @abstractmethod
    def budget(self) -> int:
        """Number of evaluations of a run without failures and target, or an upper bound."""

    @property
    def evaluation_limit(self) -> int | None:
        """Maximum number of evaluated candidates; the run ends before a generation that would exceed it.

        None if only generations of a fixed size, or time, are limited.
        """
        return self.options.evaluations

    @property
    @abstractmethod
    def population_fitness(self) -> Fitness:
        """Fitness of the population after the last `tell`, for the statistics of a generation."""

    @abstractmethod
    def _ask(self) -> Genomes:
        """Return the genomes of generation `self.generation`."""

    @abstractmethod
    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        """Accept the fitness of `genomes`, finite or NaN."""

    def _is_exhausted(self) -> bool:
        """Return whether the current generation is the last one."""
        return self.generation + 1 >= self.options.generations


def _members(options: MethodOptions) -> int | None:
    """Return the members of all populations; None if the options have no population."""
    population = getattr(options, "population", None)
    return population * int(getattr(options, "islands", 1)) if isinstance(population, int) else None


def _parse_numbers(name: str, data: ArrayLike) -> NDArray[np.float64]:
    """Convert values to binary64. Raises InputError if they are not numbers."""
    try:
        values = np.asarray(data)
        if values.dtype.kind in "biufO":  # None is NaN, as in tables
            return values.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: must be an array of numbers: {error}") from error
    raise InputError(f"{name}: must be an array of numbers, not of the type {values.dtype}")


def _check_violations(violations: ArrayLike, count: int) -> NDArray[np.float64]:
    values = _parse_numbers("violations", violations)
    if values.shape != (count,):
        raise InputError(f"violations: shape is {values.shape}; expected ({count},), for the last genomes")
    if not (values >= 0).all():
        raise InputError("violations: must not be negative or NaN; 0 stands for a feasible candidate")
    return values


def _check_fitness(fitness: ArrayLike, count: int, label: str) -> Fitness:
    values = _parse_numbers("fitness", fitness)
    if values.shape != (count,):
        raise InputError(f"fitness: shape is {values.shape}; expected ({count},), for the {label} genomes")
    return np.where(np.isfinite(values), values, np.nan)
