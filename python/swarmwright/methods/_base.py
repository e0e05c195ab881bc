"""What every method does."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
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


class SteadyState(ABC):
    """The half of a method that works in steady state: `ask_next` and `tell_next`.

    Candidate n is made when the results of candidates 0 to n - in_flight have been told, in order of their
    index, and of no later one. So it depends on `in_flight`, and not on how many servers there are, how fast
    they answer or when candidates are asked for. The caller keeps results that arrive earlier.
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
        self._made = 0
        """Candidates made so far, of which `_handed_out` have been asked for."""
        self._handed_out = 0
        self._untold: deque[Genome] = deque()

    @property
    def generation_size(self) -> int:
        """So many evaluations in a row make a generation of the record."""
        raise NotImplementedError

    @property
    def can_ask(self) -> bool:
        """Whether `ask_next` has a candidate now; if not, `tell_next` or `done` comes first."""
        last = min(self.evaluations + self.options.in_flight, self._last)
        return not self.done and self._handed_out < last

    def ask_next(self) -> tuple[int, Genome]:
        """Return the next candidate that needs evaluation: its index, from 0, and its genome (genome_size,).

        Raises InputError when as many as `in_flight` are without fitness, when there are no more candidates,
        or when the method works in generations.
        """
        self._check_operation("steady_state", "ask and tell")
        self._check_not_done()
        if self._handed_out == self._last:
            raise InputError("all candidates have been asked for: tell the fitness of the last ones")
        if not self.can_ask:
            raise InputError(
                f"{self.options.in_flight} candidate(s) are in flight: "
                f"tell the fitness of candidate {self.evaluations} before asking again"
            )
        self._make(self._handed_out + 1)
        self._handed_out += 1
        return self._handed_out - 1, self._untold[self._handed_out - 1 - self.evaluations].copy()

    def tell_next(self, fitness: float) -> None:
        """Take the fitness of candidate `evaluations`, the lowest one not told yet; NaN = failed.

        Raises InputError when that candidate has not been asked for.
        """
        self._check_operation("steady_state", "ask and tell")
        self._check_not_done()
        if self.evaluations == self._handed_out:
            raise InputError("there is nothing to tell: ask for a candidate first")
        # Make all candidates that must not depend on this result before it is told.
        self._make(min(self.evaluations + self.options.in_flight, self._last))
        value = float(fitness) if isfinite(fitness) else nan
        self._told(self.evaluations, self._untold.popleft(), value)
        self.evaluations += 1
        target = self.options.target
        reached = target is not None and value >= target
        self.done = reached or self.evaluations >= self._last
        if not self.done:
            self.generation = self.evaluations // self.generation_size

    def streams_of(self, purpose: str, index: int) -> Streams:
        """Return the random numbers for a purpose and one candidate.

        They are those of candidate index % generation_size of generation index // generation_size.
        """
        generation, candidate = divmod(index, self.generation_size)
        return Streams(self.seed, purpose, generation, [candidate])

    def initial_of(self, index: int) -> Genome:
        """Return a random genome for a candidate; see `streams_of`. The first are those to start from."""
        if index < len(self.start):
            return np.array(self.start[index])
        genomes = self.representation.initials(self.streams_of("initial", index))
        return np.asarray(genomes[0])

    def _next(self, index: int) -> Genome:
        """Return the genome of candidate `index`."""
        raise NotImplementedError

    def _told(self, index: int, genome: Genome, fitness: float) -> None:
        """Take the fitness of candidate `index`; finite or NaN. Called in order of index."""
        raise NotImplementedError

    def _check_operation(self, needed: str, instead: str) -> None:
        if self.options.operation != needed:
            raise InputError(f"the method's operation is {self.options.operation}: use {instead}")

    def _check_not_done(self) -> None:
        if self.done:
            raise InputError(f"the method is done after {self.generation + 1} generation(s); start a new one")

    @cached_property
    def _last(self) -> int:
        """How many candidates there are in all: whole generations, at least one."""
        size, most = self.generation_size, self.options.evaluations
        last = self.options.generations * size
        return last if most is None else min(last, max(most // size, 1) * size)

    def _make(self, count: int) -> None:
        """Make candidates until there are `count`."""
        while self._made < count:
            genome = self._next(self._made)
            if is_plug_in(type(self)):
                size = (self.representation.genome_size,)
                genome = numbers(self, "_next", genome, size, "a genome, (genome_size,)")
            self._untold.append(genome)
            self._made += 1


NO_LIMIT = 1_000_000_000
"""As many generations as there can be."""


def by_metric(given: object, what: str, example: str, form: str) -> object:
    """Return what was given for an option that is a mapping by the names of metrics, see `metrics_option`.

    Raises ValueError with the right form where it is a name, or a list of names.

    Args:
        given: whatever the file says.
        what: of each metric, in words: "a range".
        example: a metric's name, where none was given.
        form: how what is to be said of a metric is written.
    """
    if isinstance(given, list | str):
        names = [given] if isinstance(given, str) else given
        name = next((one for one in names if isinstance(one, str) and one), example)
        raise ValueError(f"must name {what} for each metric, such as {{{name}: {form}}}")
    return given


class MethodOptions(Options):
    """Options of every method."""

    kind: str = ""
    """The name of the method; each has its own."""
    metrics_option: ClassVar[str | None] = None
    """The option, a mapping by their names, that says which metrics the method needs; experiments must have
    it."""

    generations: int = Field(default=200, ge=1, le=NO_LIMIT)
    """Number of generations; in steady state, and with restarts that enlarge the population, at most that
    many times `population` evaluations. The first of the limits generations, evaluations and seconds ends the
    run. Default: 200, or no limit where evaluations or seconds are given."""
    evaluations: int | None = Field(default=None, ge=1, le=10**15)
    """Candidates that are evaluated at most: the run ends before the first generation with which there would
    be more. The first generation is evaluated in any case, as a whole. Default: no limit."""
    seconds: float | None = Field(default=None, gt=0, le=3_200_000_000)
    """How long the run takes at most, all its sessions together: it ends with the generation in which this
    time is over. How many generations that are depends on the machine; they are the first ones of the run
    without this limit. Default: no limit."""
    target: float | None = None
    """Stop as soon as a candidate's fitness is at least this; without it the whole budget is used."""
    operation: Literal["generational", "steady_state"] = "generational"
    """generational: candidates are asked for and told in whole generations. steady_state: one by one, so that
    servers do not wait for the slowest candidate of a generation; methods that do not support it reject
    it."""
    in_flight: int = Field(default=16, ge=1, le=1_000_000)
    """Steady state only: candidates that may be evaluated at the same time. The results of a run depend on
    it, and not on the number or speed of servers: candidate n is created from the results of candidates 0
    to n - in_flight alone."""

    @model_validator(mode="before")
    @classmethod
    def _other_budget(cls, values: Any) -> Any:  # noqa: ANN401 - whatever the file says
        if isinstance(values, Mapping) and "generations" not in values:
            others = (values.get("evaluations"), values.get("seconds"))
            if any(option is not None for option in others):
                return {**values, "generations": NO_LIMIT}
        return values

    @property
    def needed_metrics(self) -> tuple[str, ...]:
        """Names of the metrics that the method needs beside fitness, see `Method.metrics`. Default: none."""
        return ()

    @property
    def generation_limit(self) -> int | None:
        """How many generations there may be, None for any number."""
        return (
            None if self.generations == NO_LIMIT and (self.evaluations or self.seconds) else self.generations
        )


class Incumbent(NamedTuple):
    """The candidate that a method takes for the best."""

    evaluation: int
    """Number of its last evaluation in the whole run, from 0."""
    fitness: float


class Method(SteadyState):
    """Optimization is a conversation: `ask` for genomes, evaluate them in any way, `tell` their fitness.

    `ask` and `tell` are templates around `_ask` and `_tell`, which a method implements; they keep count,
    check shapes and see to it that a method meets each generation once. Fitness may have any sign; more is
    better; NaN means that the evaluation failed: such a candidate ranks below all others and its number is
    never computed with. A method draws its random numbers from `stream`, by generation and candidate, never
    from a shared source, so the same seed gives the same genomes whatever happens in between. Telling a new
    method what another one with the same options, representation and seed was told brings it to the same
    state: that is how an interrupted run goes on.

    A method that can work candidate by candidate sets `steady_state` and implements `_next`, `_told` and
    `generation_size` as well. With the option `operation: steady_state` the conversation is `ask_next` and
    `tell_next` instead.

    Args:
        options: this method's section of the experiment.
        representation: gives genomes their operators.
        seed: of the experiment.

    Raises:
        InputError: the method cannot evolve this representation, or not in steady state.
    """

    kind: ClassVar[str]
    """Name in experiment files."""
    options_model: ClassVar[type[MethodOptions]]
    """Typed options, with `kind` among them."""
    default_options: ClassVar[type[MethodOptions]] = MethodOptions
    """Those of a class in a file (`my_method.py:Class`) that has no `options_model`."""
    keeps_members: ClassVar[bool] = False
    """Whether members stay from one generation to the next with the fitness that they have: see `kept`."""
    start_as: ClassVar[Literal["members", "center"] | None] = None
    """How it starts from given controllers, see `start_from`. members: they are among its first candidates,
    which come from `initials` or `initial_of`. center: its distribution begins at the first one, `start[0]`.
    None: it cannot."""
    by_instance: ClassVar[bool] = False
    """Whether it asks for the same candidates again on one instance after the other, see `instance`. Its
    record has their mean so far as fitness, and its best candidate is `incumbent`."""
    spreads_evaluations: ClassVar[bool] = False
    """Whether what it asks for depends on `evaluations` of the options from the start, so that a run with
    more of them would be another one."""
    libraries: ClassVar[tuple[str, ...]] = ()
    """Packages that the method computes with, besides NumPy; the record of a run names their versions."""
    generational_because: ClassVar[str] = "it learns from whole generations"
    """Why the method cannot work in steady state, when it cannot; the end of a sentence."""

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
        """The generation that `ask` asks for, or has asked for last."""
        self.evaluations = 0
        """Candidates told so far."""
        self.done = False
        """Whether the budget is used up or the target is reached."""
        self.reached = False
        """Whether the target is reached; not in steady state."""
        self.start: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        """Genomes to start from, (k, genome_size); none unless `start_from` was called."""
        self.metrics: NDArray[np.float64] = np.empty((0, len(options.needed_metrics)))
        """Metrics of those told last, `needed_metrics` of the options in their order, (n, metrics): means
        over the episodes of each; NaN where no episode had one."""
        self._asked: Genomes | None = None
        self._begin_steady_state()

    def __repr__(self) -> str:
        """Name the class and how far it got."""
        return f"<{type(self).__name__}: generation {self.generation}, {self.evaluations} evaluations>"

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:  # noqa: ARG003 - for those that refuse
        """Return why this method cannot evolve a representation, as the end of a sentence; None if it can."""
        return None

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Return which options are invalid for this representation: option -> reason.

        Args:
            options: the method's section of the experiment.
            representation: None when it is not known yet.
        """
        found = {}
        if options.operation == "steady_state" and not cls.steady_state:
            found["operation"] = (
                f"{cls.kind} cannot work in steady state: {cls.generational_because}; leave the key out"
            )
        elif options.operation == "steady_state" and options.needed_metrics:
            names = ", ".join(options.needed_metrics)
            found["operation"] = (
                f"{cls.kind} cannot work in steady state with metrics ({names}), which are told for whole "
                "generations only; leave the key out"
            )
        reason = None if representation is None else cls.unsuitable(representation)
        if representation is not None and reason is not None:
            found["kind"] = f"{cls.kind} cannot evolve {representation.kind}: {reason}"
        return found

    @classmethod
    def missing(cls) -> str | None:
        """Return what to install before the method can be used; None if nothing is missing."""
        missing = [library for library in cls.libraries if find_spec(library) is None]
        if not missing:
            return None
        return (
            f"{cls.kind} needs {' and '.join(missing)}, not installed here: pip install {' '.join(missing)}"
        )

    @classmethod
    def first_generation(
        cls,
        options: MethodOptions,
        representation: Representation | None,  # noqa: ARG003 - for those whose default depends on it
    ) -> int | None:
        """Return how many candidates the first generation has; None when that is not known.

        Args:
            options: the method's section of the experiment.
            representation: None when it is not known yet.
        """
        population = getattr(options, "population", None)
        if not isinstance(population, int):
            return None
        return population * int(getattr(options, "populations", 1))

    @classmethod
    def no_start(cls, options: MethodOptions, count: int) -> str | None:
        """Return why this method cannot start from so many given controllers; None if it can.

        Args:
            options: of the method.
            count: given controllers, at least 1.
        """
        if cls.start_as is None:
            return (
                f"{cls.kind} cannot start from given controllers; leave the key out, or take another method"
            )
        if cls.start_as == "center" and count > 1:
            return f"{cls.kind} starts from one controller, the center of its first sample, not from {count}"
        return cls.surplus(options, count)

    @classmethod
    def surplus(cls, options: MethodOptions, count: int) -> str | None:
        """Return why the first generation has no place for so many given controllers; None if it has.

        Args:
            options: of the method.
            count: given controllers, at least 1.
        """
        places = cls.first_generation(options, None)
        if places is not None and count > places:
            return f"{count} controllers are more than the {places} of the first generation"
        return None

    def start_from(self, genomes: Genomes) -> None:
        """Start from these genomes, (k, genome_size), k >= 1; called before anything is asked for.

        Raises InputError when the method cannot.
        """
        problem = self.no_start(self.options, len(genomes))
        if problem is not None:
            raise InputError(problem)
        self.start = np.array(genomes, dtype=np.float32)

    def ask(self) -> Genomes:
        """Return the genomes of this generation that need evaluation: float32, (n, genome_size), n >= 1.

        Raises InputError when the fitness of the last ones has not been told, when the method is done, or
        when it works in steady state.
        """
        self._check_operation("generational", "ask_next and tell_next")
        if self._asked is not None:
            raise InputError(
                "the fitness of the genomes asked for last is missing: tell it before asking again"
            )
        self._check_not_done()
        self._asked = self._ask()
        if is_plug_in(type(self)):
            shape = None, self.representation.genome_size
            self._asked = numbers(self, "_ask", self._asked, shape, "genomes, (candidates, genome_size)")
        return self._asked if self._forgets_asked else self._asked.copy()

    @property
    def _forgets_asked(self) -> bool:
        """Whether `_tell` does not use the genomes, so that the caller may have them."""
        return False

    @property
    def sample(self) -> _engine.Sample | None:
        """What all genomes asked for last were made from, where servers can make them from it, too."""
        return None

    @property
    def instance(self) -> int:
        """Number, from 0, of the seeds for those asked for, where generations have new ones.

        Default: the generation. With `by_instance` the seeds are new in any case.
        """
        return self.generation

    @property
    def contenders(self) -> int:
        """With `by_instance`: candidates that may be the best one, among them those asked for."""
        return 0

    @property
    def told_means(self) -> Fitness:
        """With `by_instance`: mean fitness on all instances so far of those told last, in their order."""
        raise NotImplementedError

    @property
    def incumbent(self) -> Incumbent | None:
        """With `by_instance`: the best candidate after the last `tell`; None when all have failed."""
        raise NotImplementedError

    def kept(self) -> Genomes:
        """Return the members that stay, (k, genome_size), after `ask`; none with most methods.

        Where evaluations are noisy, a member with a lucky evaluation would stay permanently: these can be
        evaluated again along with those asked for, and `tell` takes what came out.
        """
        return np.empty((0, self.representation.genome_size), dtype=np.float32)

    def tell(
        self,
        fitness: ArrayLike,
        kept: ArrayLike | None = None,
        metrics: ArrayLike | None = None,
    ) -> None:
        """Take the fitness of the genomes asked for last: numbers, (n,), in their order; NaN = failed.

        Args:
            fitness: of each.
            kept: new fitness of the members that `kept` returned, (k,), if they were evaluated again.
            metrics: (n, metrics), where `needed_metrics` of the options names any.

        Raises InputError when nothing was asked for, or the number of values is another.
        """
        self._check_operation("generational", "ask_next and tell_next")
        if self._asked is None:
            raise InputError("there is nothing to tell: ask for genomes first")
        values = _checked(fitness, len(self._asked), "asked were")
        self._take(metrics, len(values))
        if kept is not None:
            self._rescore(_checked(kept, len(self.kept()), "kept are"))
        self._tell(self._asked, values)
        self.passed(values)

    def _take(self, metrics: ArrayLike | None, count: int) -> None:
        """Keep the metrics of what is told. Raises InputError when they are missing."""
        needed = self.options.needed_metrics
        if not needed:
            return
        if metrics is None:
            names = ", ".join(needed)
            raise InputError(f"{self.kind} needs metrics: tell(fitness, metrics=...), with columns {names}")
        values = _numbers("metrics", metrics)
        if values.shape != (count, len(needed)):
            raise InputError(f"metrics has the shape {values.shape}; expected {(count, len(needed))}")
        self.metrics = values

    def passed(self, values: Fitness) -> None:
        """Count a generation whose fitness, (n,), it has been told, be it by `tell` or within the engine."""
        self._asked = None
        self.evaluations += len(values)
        target = self.options.target
        self.reached = target is not None and self._reaches(values, target)
        self.done = self.reached or self._exhausted()
        if not self.done:
            self.generation += 1

    def _reaches(self, values: Fitness, target: float) -> bool:
        """Return whether the target is reached with the fitness told last."""
        return bool((values >= target).any())

    def _rescore(self, fitness: Fitness) -> None:
        """Take new fitness of the members that stay; finite or NaN. Methods that keep members have it."""
        raise NotImplementedError(f"{self.kind} keeps no members")

    def stream(self, purpose: str, candidate: int = 0) -> Stream:
        """Return the random numbers for a purpose and candidate of this generation."""
        return Stream(self.seed, purpose, self.generation, candidate)

    def streams(self, purpose: str, candidates: Sequence[int] | NDArray[np.int64]) -> Streams:
        """Return the random numbers for a purpose and several candidates of this generation."""
        return Streams(self.seed, purpose, self.generation, candidates)

    def initials(self, candidates: Sequence[int]) -> Genomes:
        """Return random genomes to start from; the same for every method, by generation and candidate.

        In the first generation those of `start` have the first places.
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
        """Number of evaluations of the whole run, when nothing fails and no target stops it.

        Where it depends on the fitness, the most that can be expected.
        """

    @property
    def evaluation_limit(self) -> int | None:
        """How many candidates a run evaluates at most; it ends before a generation that does not fit.

        None where only generations, all of one size, are counted, or time.
        """
        return self.options.evaluations

    @property
    @abstractmethod
    def population_fitness(self) -> Fitness:
        """Fitness of the population after the last `tell`: what the figures of a generation describe."""

    @abstractmethod
    def _ask(self) -> Genomes:
        """Return the genomes of generation `self.generation`."""

    @abstractmethod
    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        """Take their fitness; finite or NaN."""

    def _exhausted(self) -> bool:
        """Return whether the generation told last was the last one."""
        return self.generation + 1 >= self.options.generations


def _numbers(name: str, given: ArrayLike) -> NDArray[np.float64]:
    """Return what was told as binary64. Raises InputError for what holds no numbers."""
    try:
        values = np.asarray(given)
        if values.dtype.kind in "biufO":  # None is NaN, as in tables
            return values.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: must be an array of numbers: {error}") from error
    raise InputError(f"{name}: must be an array of numbers, not of the type {values.dtype}")


def _checked(fitness: ArrayLike, count: int, which: str) -> Fitness:
    values = _numbers("fitness", fitness)
    if values.shape != (count,):
        raise InputError(f"fitness has the shape {values.shape}; {which} {count} genomes")
    return np.where(np.isfinite(values), values, np.nan)
