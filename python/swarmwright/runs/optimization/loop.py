"""The optimization loop: the steps of every generation, for all ways of evaluation.

Three strategies choose the candidates to evaluate next and pass the results to the method: `Generational`,
`Ahead` (the engine evolves by itself) and `SteadyState`. The loop does everything else: budget, interruption,
failures, checks, storing and reporting. A resumed run replays its stored generations with the strategy that
a new run evaluates with.
"""

import logging
import math
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
from swarmwright.experiment.budget import EndReason
from swarmwright.experiment.experiment import Experiment
from swarmwright.methods import Method
from swarmwright.methods.constraints import is_infeasible
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.rankings.tournament import Tournament
from swarmwright.runs.optimization.account import Account
from swarmwright.runs.optimization.constraints import MeasuredConstraints, find_leader
from swarmwright.runs.optimization.evaluators import create_evaluator
from swarmwright.runs.optimization.failures import Failures, FirstEvaluations, FirstFailedError
from swarmwright.runs.optimization.fitness_checks import FitnessChecks
from swarmwright.runs.optimization.generation import OnGeneration
from swarmwright.runs.optimization.memory import LARGE_POPULATION, count_candidates, progress
from swarmwright.runs.optimization.recorder import Recorder
from swarmwright.runs.optimization.resuming import build_divergence_error, refuse_cut_restart
from swarmwright.runs.optimization.two_simulations import find_needed_columns
from swarmwright.runs.store import StoreReader, StoreWriter
from swarmwright.servers.evaluation.base import Backend, OnResults, Progress, Results
from swarmwright.servers.rows import GenerationResult


class Strategy(ABC):
    """A way to choose the candidates to evaluate and to pass their results to the method.

    loop: the loop that uses the strategy.
    """

    stores_later: ClassVar[bool] = False
    """Whether a generation can be stored while the next one is evaluated."""

    def __init__(self, loop: "Loop") -> None:
        self.loop = loop

    @abstractmethod
    def fits(self, most: int) -> bool:
        """Return whether the run still has at most `most` evaluations after the next generation."""

    @abstractmethod
    def advance(self, backend: Backend) -> None:
        """Evaluate the next candidates; pass each complete generation to `Loop.complete`."""

    @abstractmethod
    def replay_generation(self, stored: GenerationResult) -> bool:
        """Pass the next stored generation to the method without evaluating it.

        Return whether the method reproduces it.
        """

    def successor(self, backend: Backend) -> "Strategy":  # noqa: ARG002 - for subclasses
        """Return the strategy for the next generation."""
        return self

    def find_exhausted_budget(self) -> EndReason:
        """Return which budget a finished method has used up."""
        method, last = self.loop.method, self.loop.budget.generations
        if method.by_instance and (last is None or method.generation + 1 < last):
            return "evaluations"
        return "generations"

    def close(self) -> None:  # noqa: B027 - for subclasses
        """Stop background work."""


class Loop:
    """An optimization from its first generation to its last.

    Args:
        experiment: the experiment, with the sensors and actuators of its simulation.
        representation: for these sensors and actuators.
        store: receives every generation.
        strategy: the first strategy.
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
        self.evaluator = create_evaluator(self.ranking, experiment)
        self.needed = find_needed_columns(self.ranking, experiment)
        """Columns of the metrics that the method needs."""
        self.constraints = MeasuredConstraints(self.ranking, experiment)
        self.first_seed = experiment.first_seed
        check_plug_ins(self.method, self.ranking, representation)
        self.name = store.folder.resolve().name
        """Name of the run."""
        self.budget = experiment.budget
        # Champions have beaten the opponents of their generation only.
        reevaluates = self.ranking.options.reevaluate or isinstance(self.ranking, Tournament)
        self.account = Account(self.method, self.budget, reevaluates=reevaluates)
        self.failures = Failures(store.folder)
        self.first = FirstEvaluations(self.ranking.options.failure_fitness)
        self.recorder = Recorder(store, self.account)
        self.is_large = count_candidates(experiment) >= LARGE_POPULATION
        """Whether generations are large enough to log each step."""
        self._fitness_checks = FitnessChecks(
            from_random=not len(self.method.start),
            target_is_reached=lambda: self.account.target_is_reached,
        )
        self._stopped = False  # by a callback
        self._strategy = strategy(self)

    @property
    def done(self) -> bool:
        """Whether the budget is used up or the target is reached."""
        return self.ended is not None

    @property
    def evaluations(self) -> int:
        """Candidates evaluated so far, in all sessions."""
        return self.account.evaluations

    @property
    def ended(self) -> EndReason | None:
        """Why the run has ended, None while it can continue.

        May ask the method for a generation to see whether it fits into the budget.
        """
        if self.method.done:
            return "target" if self.account.target_is_reached else self._strategy.find_exhausted_budget()
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
        """Packages that the method uses."""
        return self.method.libraries

    def replay(self, reader: StoreReader, edited: Sequence[str] = ()) -> None:
        """Replay the stored generations without evaluating anything.

        The method is asked and told as before, which restores its state. Raises RunError when it asks for
        different genomes: a library has another version, or the method's code was edited.

        Args:
            reader: reader of the store.
            edited: descriptions of accepted edits of plug-in code since the run.
        """
        if self.method.proposals_are_recorded:
            self.method.take_recorded(
                genome for stored in reader.generations() for genome in stored.expand_genomes()
            )
        for stored in reader.generations():
            if self.method.done:
                raise InputError(
                    f"{reader.file}: the store has more generations than its experiment, so it was edited by "
                    "hand"
                )
            if not self._strategy.replay_generation(stored):
                refuse_cut_restart(reader, stored, self.method)
                components = self.method, self.representation, self.ranking
                raise build_divergence_error(reader, stored.generation, components, edited)
        self.account.continue_from(reader)

    def run(self, backend: Backend, on_generation: OnGeneration | None, on_progress: Progress | None) -> str:
        """Run until the budget is used up, the target is reached, a callback returns False, or Ctrl-C.

        Return the outcome: done, stopped or interrupted. Raises KeyboardInterrupt when there is no
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
                # Ctrl-C may have come before `_advance` could close anything.
                backend.release_background_evaluator()
                self.recorder.store_last()
        except KeyboardInterrupt:
            if not self.account.stored:
                raise
            return "interrupted"
        return "stopped" if self._stopped and not self.done else "done"

    def _advance(self, backend: Backend) -> None:
        """Evaluate generations until the run has ended or a callback stops it."""
        try:
            while not self._stopped and not (self.account.evaluations and self.done):
                self._strategy = self._strategy.successor(backend)
                self._strategy.advance(backend)
        finally:
            self._strategy.close()

    def complete(self, results: Results, tell_method: Callable[[], GenerationResult]) -> bool:
        """Store and report an evaluated generation; return whether to continue.

        Args:
            results: results of its candidates.
            tell_method: passes the results to the method and returns those of `record_generation`. When it
                raises RunError, the run ends, and only the journal of this generation is kept.
        """
        number = self.account.generations
        with self.recorder.keep_journal(number, results.journal):
            result = tell_method()
        self.failures.tell()
        self._fitness_checks.add(number, results.fitness)
        self._stopped = not self.recorder.take(result, later=self._strategy.stores_later)
        return not self._stopped

    def record_generation(
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
        violations: NDArray[np.float64] | None = None,
    ) -> GenerationResult:
        """Count a generation whose results the method has, and return it for the store.

        Args:
            genomes: genomes of the candidates, or the sample they are made from, if the store keeps the
                sample.
            seeds: seeds of the episodes.
            results: results of the episodes.
            fitness: fitness of the candidates, from the ranking.
            failed: number of failed candidates; None counts those without a fitness.
            outcome: outcome of the fitness, see `_engine.outcome`; None computes it.
            figures: figures of the method's population; None computes them.
            digests: digests of the columns in the store, if already computed.
            violations: of the experiment's constraints, (candidates,), if it has any. Infeasible candidates
                are recorded without a fitness.
        """
        leader, without = outcome or _engine.outcome(fitness)
        failed = without if failed is None else failed
        violation = 0.0
        if violations is not None:
            leader = find_leader(fitness, violations)
            violation = float(violations[leader])
            fitness = np.where(violations > 0, np.nan, fitness)
        number = self.account.generations
        if figures is None:
            figures = figures_of(self._population_fitness())
        self.account.add(fitness, leader, failed, violation)
        best_so_far = self.account.best_so_far
        if self.constraints and not math.isfinite(best_so_far):
            best_so_far = math.nan  # no candidate is feasible yet
        summary = summarize(
            figures,
            generation=number,
            evaluations=self.account.evaluations,
            best_so_far=best_so_far,
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
        """Raise RunError if too many candidates of a generation failed, before the method is told."""
        number = self.account.generations
        failed = np.flatnonzero(np.isnan(fitness))
        if len(failed) == len(fitness) >= self.method.contenders:
            reason = self.evaluator.explain_failure(results)
            raise RunError(f"every candidate of generation {number} failed{reason}")
        if len(failed) and self.ranking.options.failed == "stop":
            raise RunError(
                f"candidate {failed[0]} of generation {number} failed, and ranking.failed is 'stop'"
            )

    @contextmanager
    def first_evaluations(self, generation: int) -> Iterator[OnResults | None]:
        """Yield a callback that checks the first evaluations of the run; None if that is over.

        If they all fail, the journal is kept, and the error names the reason.
        """
        try:
            yield self.first.start_generation() if self.first.is_open else None
        except FirstFailedError as error:
            with self.recorder.keep_journal(generation, error.journal):
                raise

    def check_size(self, size: int) -> None:
        """Warn when the first generation, of this size, exceeds the budget."""
        most = self.budget.evaluations
        if most is not None and size > most and self.account.evaluations == 0:
            logging.getLogger("swarmwright").warning(
                "method.evaluations: %d is less than the first generation (%d candidates), which is always "
                "evaluated completely",
                most, size,
            )  # fmt: skip

    def announce(
        self, backend: Backend, generation: int | None, evaluations: tuple[int, int] | None = None
    ) -> None:
        """Tell the backend which generation it evaluates, for watchers."""
        backend.announce(self.name, generation, self.account.estimate_generations(), evaluations)

    def log_step(self, step: str) -> None:
        """Log the next step of a large generation."""
        if self.is_large:
            progress.info("%s", step)

    def find_failed_candidates(self, results: Results) -> NDArray[np.bool_] | None:
        """Return which candidates failed in an episode; None if these are those without a fitness."""
        if self.ranking.options.failure_fitness is None:
            return None
        return self.evaluator.find_failed_candidates(results)

    def _population_fitness(self) -> Fitness:
        """Return the fitness of the method's population. Raises PlugInError if it is invalid."""
        fitness = self.method.population_fitness
        if self.constraints and not self.method.ranks_violations:
            fitness = np.where(is_infeasible(fitness), np.nan, fitness)
        if not is_plug_in(type(self.method)):
            return fitness
        expected = "fitness, (members,), NaN for members that failed"
        name = "population_fitness"
        fitness = numbers(self.method, name, fitness, (None,), expected, finite=False, dtype=np.float64)
        if np.isinf(fitness).any():
            raise PlugInError(
                f"{locate_method(self.method, name)}: returned an infinite fitness; use NaN for a member "
                "that failed or has no fitness yet"
            )
        return fitness


def check_plug_ins(method: Method, ranking: Ranking, representation: Representation) -> None:
    """Raise PlugInError if a plug-in's constructor or one of its properties is wrong."""
    _check_constructor(
        representation, "options", "super().__init__(options, sensors=sensors, actuators=actuators)"
    )
    _check_constructor(method, "_pending", "super().__init__(options, representation, seed=seed)")
    _check_constructor(ranking, "_past", "super().__init__(options)")
    if is_plug_in(type(representation)):
        size = count(representation, "genome_size", representation.genome_size, "the number of genes")
        _check_bounds(representation, size)
    if is_plug_in(type(method)):
        count(method, "budget", method.budget, "the number of evaluations of the whole run")
        if method.options.operation == "steady_state":
            expected = "the number of evaluations of a generation"
            count(method, "generation_size", method.generation_size, expected)


def _check_constructor(plug_in: object, attribute: str, call: str) -> None:
    """Raise PlugInError if the constructor of the base class, which sets `attribute`, was not called."""
    if not hasattr(plug_in, attribute):
        raise PlugInError(f"{locate_method(plug_in, '__init__')}: does not call {call}")


def _check_bounds(representation: Representation, size: int) -> None:
    for name in ("bounds", "initial_range"):
        limits: Any = getattr(representation, name)
        expected = f"two arrays, (genome_size,) each: the lower and the upper limit of each of {size} genes"
        if not isinstance(limits, tuple | list) or len(limits) != 2:
            raise PlugInError(
                f"{locate_method(representation, name)}: is {escape_line(repr(limits)[:100])}, "
                f"expected {expected}"
            )
        low, high = (
            numbers(representation, name, limit, (size,), expected, finite=False, dtype=np.float64)
            for limit in limits
        )
        if not (low <= high).all():
            gene = int(np.flatnonzero(~(low <= high))[0])
            raise PlugInError(
                f"{locate_method(representation, name)}: the lower limit of gene {gene} ({low[gene]:g}) is "
                f"not below its upper limit ({high[gene]:g})"
            )
