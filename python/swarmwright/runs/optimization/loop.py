"""The optimization loop: ask, evaluate, rank, tell, store.

A resumed run passes through the stored generations by the same code as a new one through evaluations.
"""

import logging
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.errors import InputError, PlugInError, RunError
from swarmwright.common.plug_in_code import count, is_plug_in, numbers, place
from swarmwright.common.statistics import means
from swarmwright.common.untrusted import one_line
from swarmwright.controllers import Representation
from swarmwright.experiment.budget import Ended
from swarmwright.experiment.experiment import Experiment
from swarmwright.methods import Method
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.search import SearchMethod
from swarmwright.runs.optimization.account import Account
from swarmwright.runs.optimization.ahead import Ahead, Produced, can_be_ahead
from swarmwright.runs.optimization.evaluators import evaluator_of
from swarmwright.runs.optimization.failures import Failures
from swarmwright.runs.optimization.first_evaluations import FirstEvaluations, FirstFailedError
from swarmwright.runs.optimization.fitness_checks import FitnessChecks
from swarmwright.runs.optimization.generation import OnGeneration, Told
from swarmwright.runs.optimization.memory import LARGE_POPULATION, candidates, progress
from swarmwright.runs.optimization.recorder import Recorder
from swarmwright.runs.optimization.strayed import strayed
from swarmwright.runs.optimization.two_simulations import needed_columns
from swarmwright.runs.store import StoreReader, StoreWriter
from swarmwright.servers.evaluation.base import Backend, Controllers, Progress, Results
from swarmwright.servers.evaluation.seeds import check_seeds
from swarmwright.servers.rows import Evaluated, Journal


class Loop:
    """An optimization from its first generation to its last.

    Args:
        experiment: as it is run.
        representation: for its sensors and actuators.
        store: where every generation goes.
    """

    def __init__(self, experiment: Experiment, representation: Representation, store: StoreWriter) -> None:
        self._method: Method = experiment.new_method(representation)
        self._ranking: Ranking = experiment.new_ranking()
        self._evaluator = evaluator_of(self._ranking, experiment)
        self._needed = needed_columns(self._ranking, experiment)
        self._first_seed = experiment.first_seed
        self._representation = representation
        check_plug_ins(self._method, self._ranking, representation)
        self._name = store.folder.resolve().name
        self._failures = Failures(store.folder)
        self._budget = experiment.budget
        reevaluates = self._ranking.options.reevaluate
        self._account = Account(self._method, self._budget, reevaluates=reevaluates)
        self._fitness_checks = FitnessChecks(
            from_random=not len(self._method.start),
            target_is_reached=lambda: self._account.target_is_reached,
        )
        self._recorder = Recorder(store, self._account)
        self._asked = 0
        self._next: tuple[Genomes, list[int]] | None = None  # asked for and not evaluated yet
        self._large = candidates(experiment) >= LARGE_POPULATION
        self._first = FirstEvaluations(self._ranking.options.failure_fitness)
        self._ahead: Ahead | None = None  # where the engine evolves by itself

    @property
    def done(self) -> bool:
        """Whether the budget is used or the target is reached."""
        return self.ended is not None

    @property
    def evaluations(self) -> int:
        """Candidates that were evaluated so far, in all sessions."""
        return self._account.evaluations

    @property
    def ended(self) -> Ended | None:
        """What has ended the run, None as long as it may go on; asks for a generation to see if it fits."""
        if self._method.done:
            return "target" if self._account.target_is_reached else self._used_up()
        if self._account.evaluations == 0:
            return None
        if self._account.time_is_over:
            return "seconds"
        most = self._method.evaluation_limit
        if most is None or self._fits(most):
            return None
        return "evaluations" if most == self._budget.evaluations else "generations"

    def _used_up(self) -> Ended:
        """Return which budget a method that is done has used."""
        last = self._budget.generations
        if self._method.by_instance and (last is None or self._method.generation + 1 < last):
            return "evaluations"
        return "generations"

    def _fits(self, most: int) -> bool:
        """Return whether no more than so many candidates are evaluated with the next generation."""
        if self._ahead is not None:
            return self._ahead.fits()
        if self._next is None:
            self._next = self._ask()
        return self._account.evaluations + len(self._next[0]) <= most

    @property
    def libraries(self) -> tuple[str, ...]:
        """Packages that the method computes with."""
        return self._method.libraries

    def replay(self, reader: StoreReader, edited: Sequence[str] = ()) -> None:
        """Go through the generations in a store, without evaluating anything, to where it ends.

        The method is asked and told as before, so that it continues in the same state. Raises
        RunError when it asks for other genomes: another version of a library that the method is made of, or
        its code was edited.

        Args:
            reader: of the store.
            edited: in words, what was edited in the code of plug-ins since the run, and accepted.
        """
        for evaluated in reader.generations():
            if self._method.done:
                raise InputError(
                    f"{reader.file}: holds more generations than its experiment has; it was changed by hand"
                )
            if not self._again(evaluated):
                self._refuse_cut_restart(reader, evaluated)
                components = self._method, self._representation, self._ranking
                raise strayed(reader, evaluated.generation, components, edited)
        self._account.continue_from(reader)

    def _refuse_cut_restart(self, reader: StoreReader, evaluated: Evaluated) -> None:
        """Raise InputError where a larger budget makes the last generation larger than it is in the store."""
        method, size = self._method, len(evaluated.fitness)
        by_generation = isinstance(method, SearchMethod) and method.options.operation == "generational"
        was_asked = by_generation and method.generation == evaluated.generation
        if was_asked and size < len(method.ask()) and evaluated.generation == len(reader.history()) - 1:
            folder = reader.file.parent
            raise InputError(
                f"method: {folder} cannot be prolonged, because its last restart had {size} candidates, the "
                "rest of its budget, and would have had more with a larger one; begin a new run with more, "
                f"from the best of this one: --set start_from={folder}"
            )

    def _again(self, evaluated: Evaluated) -> bool:
        """Tell the method a generation that is stored; return whether it is what the method asks for."""
        results = Results(evaluated.episodes, evaluated.metrics, Journal())
        if can_be_ahead(self._method, self._ranking):
            return self._again_in_engine(evaluated, results)
        genomes, seeds = self._ask()
        if genomes.tobytes() != evaluated.made().tobytes() or seeds != evaluated.seeds:
            return False
        again = self._tell(genomes, seeds, results)
        return again.found.fitness.tobytes() == evaluated.fitness.tobytes()

    def _again_in_engine(self, evaluated: Evaluated, results: Results) -> bool:
        """As `_again`, where the engine compares the genomes: with those of long runs, each copy counts."""
        assert isinstance(self._method, SearchMethod)
        number, genomes = self._method.generation, evaluated.genomes
        seeds = self._ranking.seeds(self._first_seed, number)
        fitness = self._ranking.score(results.fitness)
        same = fitness.tobytes() == evaluated.fitness.tobytes() and seeds == evaluated.seeds
        if not same or not self._method.search.retell(genomes, fitness):
            return False
        self._check(fitness, number, results)
        self._method.passed(fitness)
        self._told(number, seeds, Produced.of(genomes, results, fitness, fitness))
        return True

    def run(self, backend: Backend, on_generation: OnGeneration | None, on_progress: Progress | None) -> str:
        """Run until the budget is used, the target is reached, a callback returns False, or Ctrl-C.

        Return how it ended: done, stopped or interrupted. Raises KeyboardInterrupt when there is no
        generation to keep, and RunError when evaluations are not possible.
        """
        self._account.start()
        self._recorder.begin(backend.failure_of)
        try:
            try:
                stopped = self._continue(backend, on_generation, on_progress)
                self._fitness_checks.tell()
            finally:
                # Ctrl-C may have come before there was something to close.
                backend.end_ahead()
                self._recorder.store_last()
        except KeyboardInterrupt:
            if not self._account.stored:
                raise
            return "interrupted"
        return "stopped" if stopped and not self._is_complete() else "done"

    def _is_complete(self) -> bool:
        """Return whether nothing of the budget is left when a callback ends the run."""
        if self._ahead is None:
            return self.done
        most = self._method.evaluation_limit  # the engine's thread, which knows the next one, has ended
        return self._method.done or (most is not None and self._account.evaluations >= most)

    def _continue(
        self, backend: Backend, on_generation: OnGeneration | None, on_progress: Progress | None
    ) -> bool:
        """Work to the end; return whether a callback ended it before."""
        watched = self._recorder.watched(on_progress)
        if self._account.evaluations or self._large or not backend.may_fail:
            self._first.close()
        ahead_is_tried = self._large
        while True:
            if self._account.evaluations and self.ended is not None:
                return False
            # What the engine evaluates by itself is seen when a generation is complete.
            if not ahead_is_tried and not self._first.is_open:
                ahead_is_tried = True
                self._recorder.store_last()
                self._ahead = Ahead.of(
                    *(self._method, self._ranking, self._representation, backend, watched),
                    first_seed=self._first_seed,
                    run=self._name,
                )
                if self._ahead is not None:
                    with closing(self._ahead):
                        return self._continue_ahead(self._ahead, backend, on_generation, on_progress)
            if not self._next_generation(backend, on_generation, watched):
                return True

    def _next_generation(
        self, backend: Backend, on_generation: OnGeneration | None, watched: Progress
    ) -> bool:
        """Make, evaluate and rank a generation; return whether to go on."""
        number = self._method.generation
        self._say(f"generation {number}: making candidates")
        genomes, seeds = self._next or self._ask()
        self._next = None
        self._check_first(len(genomes))
        self._announce(backend, number)
        self._say(f"generation {number}: evaluating {len(genomes):,} candidates")
        sample = self._method.sample
        controllers = Controllers.of(self._representation, genomes, sample)
        results = self._evaluated(backend, controllers, seeds, watched)
        results = self._failures.named(results, seeds, number)
        self._say(f"generation {number}: ranking and storing them")
        with self._recorder.journal_kept(number, results.journal):
            told = self._tell(genomes, seeds, results)
        self._failures.tell()
        self._fitness_checks.add(number, results.fitness)
        if sample is not None and self._recorder.keeps(sample, genomes):
            told = told._replace(found=told.found._replace(genomes=sample))
        self._recorder.hold(told._replace(found=told.found.digested()))
        return on_generation is None or self._recorder.report_last(on_generation)

    def _evaluated(
        self, backend: Backend, controllers: Controllers, seeds: Sequence[int], watched: Progress
    ) -> Results:
        """Evaluate a generation. Raises RunError early where the first evaluations of the run all fail."""
        on_results = self._first.of_generation() if self._first.is_open else None
        with self._first_kept(self._method.generation):
            return self._evaluator.evaluate(
                backend, controllers, seeds, watched, self._recorder.store_last, on_results
            )

    @contextmanager
    def _first_kept(self, generation: int) -> Iterator[None]:
        """Keep the journal where the first evaluations of the run all fail, and name the reason."""
        try:
            yield
        except FirstFailedError as error:
            with self._recorder.journal_kept(generation, error.journal):
                raise

    def _continue_ahead(
        self,
        ahead: Ahead,
        backend: Backend,
        on_generation: OnGeneration | None,
        on_progress: Progress | None,
    ) -> bool:
        """Store and report what the engine evolves meanwhile; return whether a callback ended it."""
        self._next = None  # the engine knows what has been asked for
        ahead.expect(self._account.expected_generations())
        while True:
            # Before `ended`, which waits for a generation where it has to see whether that fits.
            if not ahead.is_ready and not self._method.done:
                self._recorder.has_time()
            if self.ended is not None:
                return False
            number = self._method.generation
            found = ahead.take()
            self._check_first(len(found.genomes))
            self._recorder.waiting_for = ""
            if on_progress is not None:
                episodes = found.results.fitness.size
                on_progress(episodes, episodes, "")
            seeds = self._ranking.seeds(self._first_seed, number)
            if found.failed:
                backend.count_failed(found.results)
                found = found._replace(results=self._failures.named(found.results, seeds, number))
                with self._recorder.journal_kept(number, found.results.journal):
                    self._check(found.fitness, number, found.results)
                self._failures.tell()
            self._method.passed(found.fitness)
            self._recorder.hold(self._told(number, seeds, found))
            self._fitness_checks.add(number, found.results.fitness)
            ahead.expect(self._account.expected_generations(number + 1))
            if on_generation is None:
                self._recorder.store_last()
            elif not self._recorder.report_last(on_generation):
                return True

    def _check_first(self, size: int) -> None:
        """Warn when the first generation alone exceeds the budget."""
        most = self._budget.evaluations
        if most is not None and size > most and self._account.evaluations == 0:
            logging.getLogger("swarmwright").warning(
                "method.evaluations: %d is less than the first generation, which is evaluated as a whole: %d "
                "candidates",
                most, size,
            )  # fmt: skip

    def _say(self, what: str) -> None:
        """Log the next step where generations are so large that each step takes long."""
        if self._large:
            progress.info("%s", what)

    def _ask(self) -> tuple[Genomes, list[int]]:
        """Return the genomes to be evaluated in this generation, and on which seeds."""
        number = self._method.generation
        genomes = self._method.ask()
        self._asked = len(genomes)
        if self._ranking.options.reevaluate:
            genomes = np.concatenate([genomes, self._method.kept()])
        if is_plug_in(type(self._representation)):  # an operator for many genomes may be wrong
            size = None, self._representation.genome_size
            what = "genomes, (candidates, genome_size), made by operators of the representation"
            genomes = numbers(self._representation, "genome_size", genomes, size, what)
        if self._method.by_instance:
            return genomes, self._seeds_of(self._method.instance)
        return genomes, check_seeds(self._ranking, self._ranking.seeds(self._first_seed, number))

    def _seeds_of(self, instance: int) -> list[int]:
        return check_seeds(self._ranking, self._ranking.seeds_of(self._first_seed, instance))

    def _announce(
        self, backend: Backend, generation: int | None, evaluations: tuple[int, int] | None = None
    ) -> None:
        """Tell the backend which generation it works for, for watchers."""
        backend.about(self._name, generation, self._account.expected_generations(), evaluations)

    def _tell(self, genomes: Genomes, seeds: list[int], results: Results) -> Told:
        """Rank the results and tell the method."""
        number = self._method.generation
        counted = self._failed_candidates(results)
        fitness = self._evaluator.fitness(results, genomes)
        failed = None if counted is None else int(np.count_nonzero(counted | np.isnan(fitness)))
        self._check(fitness, number, results)
        kept = fitness[self._asked :] if self._ranking.options.reevaluate else None
        needed = means(results.metrics[: self._asked, :, self._needed]) if self._needed else None
        self._method.tell(fitness[: self._asked], kept, needed)
        if self._method.by_instance:
            fitness = self._method.told_means
        population = self._population_fitness()
        return self._told(number, seeds, Produced.of(genomes, results, fitness, population, failed))

    def _failed_candidates(self, results: Results) -> NDArray[np.bool_] | None:
        """Return which candidates failed in an episode; None where those are the ones without a fitness."""
        if self._ranking.options.failure_fitness is None:
            return None
        return self._evaluator.failed_candidates(results)

    def _population_fitness(self) -> Fitness:
        """Return the fitness of the method's population. Raises PlugInError when it is something else."""
        found = self._method.population_fitness
        if not is_plug_in(type(self._method)):
            return found
        what = "fitness, (members,), NaN for members that failed"
        name = "population_fitness"
        made = numbers(self._method, name, found, (None,), what, finite=False, dtype=np.float64)
        if np.isinf(made).any():
            raise PlugInError(
                f"{place(self._method, name)}: returned an infinite fitness; a member that failed, or has "
                "no fitness yet, has NaN"
            )
        return made

    def _told(self, number: int, seeds: list[int], found: Produced) -> Told:
        """Return a generation that the method has been told of."""
        self._account.add(found)
        return Told(
            generation=number,
            seeds=seeds,
            found=found,
            evaluations=self._account.evaluations,
            best_so_far=self._account.best_so_far,
            leader=self._account.leader,
        )

    def _check(self, fitness: Fitness, generation: int, results: Results) -> None:
        failed = np.flatnonzero(np.isnan(fitness))
        if len(failed) == len(fitness) >= self._method.contenders:
            why = self._evaluator.why_failed(results)
            raise RunError(f"every candidate of generation {generation} failed{why}")
        if len(failed) and self._ranking.options.failed == "stop":
            raise RunError(
                f"candidate {failed[0]} of generation {generation} failed, and ranking.failed says stop"
            )


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
        raise PlugInError(f"{place(made, '__init__')}: does not call {call}")


def _check_bounds(representation: Representation, size: int) -> None:
    for name in ("bounds", "initial_range"):
        limits: Any = getattr(representation, name)
        what = f"two arrays, (genome_size,) each: the lower and the upper limit of each of {size} genes"
        if not isinstance(limits, tuple | list) or len(limits) != 2:
            raise PlugInError(
                f"{place(representation, name)}: is {one_line(repr(limits)[:100])}, expected {what}"
            )
        low, high = (
            numbers(representation, name, one, (size,), what, finite=False, dtype=np.float64)
            for one in limits
        )
        if not (low <= high).all():
            gene = int(np.flatnonzero(~(low <= high))[0])
            raise PlugInError(
                f"{place(representation, name)}: of gene {gene} the lower limit, {low[gene]:g}, is not "
                f"below the upper one, {high[gene]:g}"
            )
