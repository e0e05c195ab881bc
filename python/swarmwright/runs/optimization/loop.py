"""The optimization loop: what is done with every generation, whoever evaluates it.

Three strategies say which candidates are evaluated next and how the method is told what came out:
`Generational`, `Ahead` (the engine, which goes on by itself) and `SteadyState`. Everything else is done here,
once: budget, interruption, failures, checks, storing and reporting. A resumed run passes through the stored
generations by the same strategy as a new one through evaluations.
"""

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.errors import InputError, PlugInError, RunError
from swarmwright.common.plug_in_code import count, is_plug_in, locate_method, numbers
from swarmwright.common.statistics import Figures, figures_of, summarize
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers import Representation
from swarmwright.experiment.budget import Ended
from swarmwright.experiment.experiment import Experiment
from swarmwright.methods import Method
from swarmwright.methods.rankings import Ranking
from swarmwright.runs.optimization.account import Account
from swarmwright.runs.optimization.evaluators import evaluator_of
from swarmwright.runs.optimization.failures import Failures, FirstEvaluations, FirstFailedError
from swarmwright.runs.optimization.fitness_checks import FitnessChecks
from swarmwright.runs.optimization.generation import OnGeneration
from swarmwright.runs.optimization.memory import LARGE_POPULATION, candidates, progress
from swarmwright.runs.optimization.recorder import Recorder
from swarmwright.runs.optimization.resuming import refuse_cut_restart, strayed
from swarmwright.runs.optimization.two_simulations import needed_columns
from swarmwright.runs.store import StoreReader, StoreWriter
from swarmwright.servers.evaluation.base import Backend, OnResults, Progress, Results
from swarmwright.servers.rows import GenerationResult


class Strategy(ABC):
    """Which candidates are evaluated next, and how the method is told what came out.

    loop: whose strategy it is.
    """

    stores_later: ClassVar[bool] = False
    """Whether a generation can be stored while the next one is evaluated."""

    def __init__(self, loop: "Loop") -> None:
        self.loop = loop

    @abstractmethod
    def fits(self, most: int) -> bool:
        """Return whether the run has no more than so many evaluations with the next generation."""

    @abstractmethod
    def advance(self, backend: Backend) -> None:
        """Evaluate what comes next, and hand each generation that is complete to `Loop.complete`."""

    @abstractmethod
    def retell(self, stored: GenerationResult) -> bool:
        """Tell the method the next generation, which is stored, without evaluating it.

        Return whether it comes out as it is stored.
        """

    def successor(self, backend: Backend) -> "Strategy":  # noqa: ARG002 - for those that need it
        """Return the strategy that goes on from here."""
        return self

    def used_up(self) -> Ended:
        """Return which budget a method that is done has used."""
        method, last = self.loop.method, self.loop.budget.generations
        if method.by_instance and (last is None or method.generation + 1 < last):
            return "evaluations"
        return "generations"

    def close(self) -> None:  # noqa: B027 - for those that need it
        """End what goes on by itself."""


class Loop:
    """An optimization from its first generation to its last.

    Args:
        experiment: as it is run.
        representation: for its sensors and actuators.
        store: where every generation goes.
        strategy: with which it begins.
    """

    def __init__(
        self,
        experiment: Experiment,
        representation: Representation,
        store: StoreWriter,
        strategy: type[Strategy],
    ) -> None:
        self.method: Method = experiment.new_method(representation)
        self.ranking: Ranking = experiment.new_ranking()
        self.representation = representation
        self.evaluator = evaluator_of(self.ranking, experiment)
        self.needed = needed_columns(self.ranking, experiment)
        """Which of the metrics the method needs."""
        self.first_seed = experiment.first_seed
        check_plug_ins(self.method, self.ranking, representation)
        self.name = store.folder.resolve().name
        """Of the run."""
        self.budget = experiment.budget
        reevaluates = self.ranking.options.reevaluate
        self.account = Account(self.method, self.budget, reevaluates=reevaluates)
        self.failures = Failures(store.folder)
        self.first = FirstEvaluations(self.ranking.options.failure_fitness)
        self.recorder = Recorder(store, self.account)
        self.is_large = candidates(experiment) >= LARGE_POPULATION
        """Whether generations are so large that each step takes long."""
        self._fitness_checks = FitnessChecks(
            from_random=not len(self.method.start),
            target_is_reached=lambda: self.account.target_is_reached,
        )
        self._stopped = False  # by a callback
        self._strategy = strategy(self)

    @property
    def done(self) -> bool:
        """Whether the budget is used or the target is reached."""
        return self.ended is not None

    @property
    def evaluations(self) -> int:
        """Candidates that were evaluated so far, in all sessions."""
        return self.account.evaluations

    @property
    def ended(self) -> Ended | None:
        """What has ended the run, None as long as it may go on; asks for a generation to see if it fits."""
        if self.method.done:
            return "target" if self.account.target_is_reached else self._strategy.used_up()
        if self.account.evaluations == 0:
            return None
        if self.account.time_is_over:
            return "seconds"
        most = self.method.evaluation_limit
        if most is None or self._strategy.fits(most):
            return None
        return "evaluations" if most == self.budget.evaluations else "generations"

    @property
    def libraries(self) -> tuple[str, ...]:
        """Packages that the method computes with."""
        return self.method.libraries

    def replay(self, reader: StoreReader, edited: Sequence[str] = ()) -> None:
        """Go through the generations in a store, without evaluating anything, to where it ends.

        The method is asked and told as before, so that it continues in the same state. Raises
        RunError when it asks for other genomes: another version of a library that the method is made of, or
        its code was edited.

        Args:
            reader: of the store.
            edited: in words, what was edited in the code of plug-ins since the run, and accepted.
        """
        for stored in reader.generations():
            if self.method.done:
                raise InputError(
                    f"{reader.file}: holds more generations than its experiment has; it was changed by hand"
                )
            if not self._strategy.retell(stored):
                refuse_cut_restart(reader, stored, self.method)
                components = self.method, self.representation, self.ranking
                raise strayed(reader, stored.generation, components, edited)
        self.account.continue_from(reader)

    def run(self, backend: Backend, on_generation: OnGeneration | None, on_progress: Progress | None) -> str:
        """Run until the budget is used, the target is reached, a callback returns False, or Ctrl-C.

        Return how it ended: done, stopped or interrupted. Raises KeyboardInterrupt when there is no
        generation to keep, and RunError when evaluations are not possible.
        """
        self.account.start()
        self.recorder.begin(backend.failure_of, on_generation, on_progress)
        if self.account.evaluations or self.is_large or not backend.may_fail:
            self.first.close()
        try:
            try:
                self._advance(backend)
                self._fitness_checks.tell()
            finally:
                # Ctrl-C may have come before there was something to close.
                backend.release_background_evaluator()
                self.recorder.store_last()
        except KeyboardInterrupt:
            if not self.account.stored:
                raise
            return "interrupted"
        return "stopped" if self._stopped and not self.done else "done"

    def _advance(self, backend: Backend) -> None:
        """Evaluate generation after generation, until the run has ended or a callback ends it."""
        try:
            while not self._stopped and not (self.account.evaluations and self.done):
                self._strategy = self._strategy.successor(backend)
                self._strategy.advance(backend)
        finally:
            self._strategy.close()

    def complete(self, results: Results, tell: Callable[[], GenerationResult]) -> bool:
        """Take a generation that is evaluated: store it and report it; return whether to go on.

        Args:
            results: of its candidates.
            tell: tells the method what came out, and returns what `told` does. RunError: the run cannot go
                on; of this generation the journal alone is kept.
        """
        number = self.account.generations
        with self.recorder.journal_kept(number, results.journal):
            result = tell()
        self.failures.tell()
        self._fitness_checks.add(number, results.fitness)
        self._stopped = not self.recorder.take(result, later=self._strategy.stores_later)
        return not self._stopped

    def told(
        self,
        genomes: Genomes | _engine.Sample,
        seeds: list[int],
        results: Results,
        fitness: Fitness,
        *,
        failed: int | None = None,
        outcome: tuple[int, int] | None = None,
        figures: Figures | None = None,
        digests: _engine.Digests | None = None,
    ) -> GenerationResult:
        """Count a generation that the method has been told of, and return it.

        Args:
            genomes: of the candidates, or what they are made from, where the store keeps that.
            seeds: of the episodes.
            results: of the episodes.
            fitness: of the candidates, as the ranking made it.
            failed: candidates that failed; None: those without a fitness.
            outcome: of the fitness, see `_engine.outcome`; None: not known yet.
            figures: of the method's population; None: not known yet.
            digests: of the columns in the store, where they are computed already.
        """
        leader, without = outcome or _engine.outcome(fitness)
        failed = without if failed is None else failed
        number = self.account.generations
        if figures is None:
            figures = figures_of(self._population_fitness())
        self.account.add(fitness, leader, failed)
        summary = summarize(
            figures,
            generation=number,
            evaluations=self.account.evaluations,
            best_so_far=self.account.best_so_far,
            failed=failed,
        )
        return GenerationResult(
            generation=number,
            seeds=seeds,
            genomes=genomes,
            episodes=results.fitness,
            metrics=results.metrics,
            fitness=fitness,
            summary=summary,
            leader=self.account.leader,
            journal=results.journal,
            digests=digests,
        )

    def check(self, fitness: Fitness, results: Results) -> None:
        """Raise RunError where too many candidates of a generation failed; before the method is told."""
        number = self.account.generations
        failed = np.flatnonzero(np.isnan(fitness))
        if len(failed) == len(fitness) >= self.method.contenders:
            why = self.evaluator.why_failed(results)
            raise RunError(f"every candidate of generation {number} failed{why}")
        if len(failed) and self.ranking.options.failed == "stop":
            raise RunError(
                f"candidate {failed[0]} of generation {number} failed, and ranking.failed says stop"
            )

    @contextmanager
    def first_evaluations(self, generation: int) -> Iterator[OnResults | None]:
        """Yield what looks at the first evaluations of the run as they come; None where that is over.

        Where they all fail, the journal is kept, and the reason named.
        """
        try:
            yield self.first.of_generation() if self.first.is_open else None
        except FirstFailedError as error:
            with self.recorder.journal_kept(generation, error.journal):
                raise

    def check_size(self, size: int) -> None:
        """Warn when the first generation alone, of this size, exceeds the budget."""
        most = self.budget.evaluations
        if most is not None and size > most and self.account.evaluations == 0:
            logging.getLogger("swarmwright").warning(
                "method.evaluations: %d is less than the first generation, which is evaluated as a whole: %d "
                "candidates",
                most, size,
            )  # fmt: skip

    def announce(
        self, backend: Backend, generation: int | None, evaluations: tuple[int, int] | None = None
    ) -> None:
        """Tell the backend which generation it works for, for watchers."""
        backend.announce(self.name, generation, self.account.expected_generations(), evaluations)

    def say(self, what: str) -> None:
        """Log the next step where generations are so large that each step takes long."""
        if self.is_large:
            progress.info("%s", what)

    def failed_candidates(self, results: Results) -> NDArray[np.bool_] | None:
        """Return which candidates failed in an episode; None where those are the ones without a fitness."""
        if self.ranking.options.failure_fitness is None:
            return None
        return self.evaluator.failed_candidates(results)

    def _population_fitness(self) -> Fitness:
        """Return the fitness of the method's population. Raises PlugInError when it is something else."""
        found = self.method.population_fitness
        if not is_plug_in(type(self.method)):
            return found
        what = "fitness, (members,), NaN for members that failed"
        name = "population_fitness"
        made = numbers(self.method, name, found, (None,), what, finite=False, dtype=np.float64)
        if np.isinf(made).any():
            raise PlugInError(
                f"{locate_method(self.method, name)}: returned an infinite fitness; a member that failed, "
                "or has "
                "no fitness yet, has NaN"
            )
        return made


def check_plug_ins(method: Method, ranking: Ranking, representation: Representation) -> None:
    """Raise PlugInError when a plug-in's constructor or one of its properties is wrong."""
    _check_begun(representation, "options", "super().__init__(options, sensors=sensors, actuators=actuators)")
    _check_begun(method, "_untold", "super().__init__(options, representation, seed=seed)")
    _check_begun(ranking, "_past", "super().__init__(options)")
    if is_plug_in(type(representation)):
        size = count(representation, "genome_size", representation.genome_size, "the number of genes")
        _check_bounds(representation, size)
    if is_plug_in(type(method)):
        count(method, "budget", method.budget, "the number of evaluations of the whole run")
        if method.options.operation == "steady_state":
            what = "the number of evaluations of a generation"
            count(method, "generation_size", method.generation_size, what)


def _check_begun(made: object, attribute: str, call: str) -> None:
    """Check that the constructor of the base class was called, which sets an attribute."""
    if not hasattr(made, attribute):
        raise PlugInError(f"{locate_method(made, '__init__')}: does not call {call}")


def _check_bounds(representation: Representation, size: int) -> None:
    for name in ("bounds", "initial_range"):
        limits: Any = getattr(representation, name)
        what = f"two arrays, (genome_size,) each: the lower and the upper limit of each of {size} genes"
        if not isinstance(limits, tuple | list) or len(limits) != 2:
            raise PlugInError(
                f"{locate_method(representation, name)}: is {escape_line(repr(limits)[:100])}, expected "
                f"{what}"
            )
        low, high = (
            numbers(representation, name, limit, (size,), what, finite=False, dtype=np.float64)
            for limit in limits
        )
        if not (low <= high).all():
            gene = int(np.flatnonzero(~(low <= high))[0])
            raise PlugInError(
                f"{locate_method(representation, name)}: of gene {gene} the lower limit, {low[gene]:g}, is "
                "not "
                f"below the upper one, {high[gene]:g}"
            )
