"""The optimization loop: ask, evaluate, rank, tell, store.

A resumed run passes through the stored generations by the same code as a new one through evaluations.
"""

import logging
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from swarmwright import _engine
from swarmwright.core.errors import InputError, PlugInError, RunError
from swarmwright.core.plug_in_code import is_plug_in, numbers, place
from swarmwright.core.statistics import Summary, figures_of, means, summarize
from swarmwright.core.untrusted import one_line
from swarmwright.evaluation.base import Backend, Controllers, Progress, Results
from swarmwright.evaluation.seeds import check_seeds
from swarmwright.experiment.budget import Ended, Limit
from swarmwright.experiment.experiment import Experiment
from swarmwright.methods import Method
from swarmwright.methods.search import SearchMethod
from swarmwright.optimization.ahead import Ahead, Produced, can_be_ahead
from swarmwright.optimization.checks import check_plug_ins
from swarmwright.optimization.failures import Failures
from swarmwright.optimization.memory import LARGE, candidates, progress
from swarmwright.optimization.raced import race
from swarmwright.optimization.rate import Rate
from swarmwright.optimization.strayed import StrayedError, strayed
from swarmwright.optimization.two_simulations import (
    TwoSimulations,
    descriptor_columns,
    evaluate_both,
    needed_columns,
)
from swarmwright.rankings import Ranking
from swarmwright.rankings.race import Race
from swarmwright.rankings.slow_simulation import SlowRanking
from swarmwright.representations import Representation
from swarmwright.store import Evaluated, Journal, StoreReader, StoreWriter
from swarmwright.typing import Fitness, Genomes


@dataclass(frozen=True, kw_only=True)
class Generation:
    """The progress of an optimization, after a generation: what a callback of `optimize` gets.

    Fitness is in units of the simulation, more is better.
    """

    generation: int
    """Index of the generation, from 0."""
    generations: int | None
    """Generations of the whole run; None where only evaluations or seconds are limited."""
    best: float
    """Best fitness in the population; NaN where all of it failed."""
    mean: float
    """Mean fitness of the population, failed members left out; NaN where all failed."""
    best_so_far: float
    """Best fitness since the start of the run; where members are evaluated again, that of the best one
    now."""
    failed: int
    """Candidates of this generation whose evaluation failed."""
    evaluations: int
    """Candidates evaluated since the start, failed ones included."""
    seconds: float
    """Seconds since the start, or since the run was resumed."""
    evaluations_per_second: float
    """Candidates per second over about the last two seconds, or since the generation before where that is
    longer ago; at most since the start."""
    seconds_left: float
    """Seconds until the nearest limit is reached, estimated."""
    waiting_for: str
    """What the evaluation waited for last; empty when it waited for nothing."""
    budget: Limit = "generations"
    """Which limit is nearest: generations, evaluations or seconds."""
    share: float = 0.0
    """Share of that limit which is used, 0 to 1."""


class Told(NamedTuple):
    """A generation that the method has been told of, and what is known of the run then."""

    generation: int
    seeds: list[int]
    found: Produced
    evaluations: int
    """Since the start."""
    best_so_far: float
    leader: int

    def evaluated(self) -> Evaluated:
        """Return what is to be stored."""
        found = self.found
        summary = summarize(
            found.figures or figures_of(found.population),
            generation=self.generation,
            evaluations=self.evaluations,
            best_so_far=self.best_so_far,
            failed=found.failed,
        )
        return Evaluated(
            generation=self.generation,
            seeds=self.seeds,
            genomes=found.genomes,
            episodes=found.results.fitness,
            metrics=found.results.metrics,
            fitness=found.fitness,
            summary=summary,
            leader=self.leader,
            digests=found.digests,
        )


_MOST = 10**15  # evaluations, where there is no limit

OnGeneration = Callable[[Generation], bool | None]
"""Called after each generation; False ends the run."""


def goes_on(returned: bool | np.bool_ | None) -> bool:
    """Return whether a run goes on after a callback: unless that returned False, NumPy's included."""
    return not (isinstance(returned, bool | np.bool_) and not returned)


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
        self._descriptor = descriptor_columns(self._ranking, experiment)
        self._needed = needed_columns(self._ranking, experiment)
        self._first_seed = experiment.first_seed
        self._representation = representation
        check_plug_ins(self._method, self._ranking, representation)
        self._store = store
        self._name = store.folder.resolve().name
        self._failures = Failures(store.folder)
        self._asked = 0
        self._evaluations = 0
        self._leader = -1
        self._best_so_far = -np.inf
        self._best_seen = -np.inf
        self._waiting_for = ""
        self._started: float | None = None  # the clock of this session, from `run` on
        self._rate = Rate(0.0, 0)
        self._resumed_at = 0  # told to the method before this session
        self._stored = 0  # generations
        self._budget = experiment.budget
        self._before = 0.0  # seconds of earlier sessions
        self._next: tuple[Genomes, list[int]] | None = None  # asked for and not evaluated yet
        self._large = candidates(experiment) >= LARGE
        self._unstored: Told | None = None  # the last generation, until it is handed to the store
        self._ahead: Ahead | None = None  # where the engine evolves by itself

    @property
    def done(self) -> bool:
        """Whether the budget is used or the target is reached."""
        return self.ended is not None

    @property
    def ended(self) -> Ended | None:
        """What has ended the run, None as long as it may go on."""
        target, most = self._method.options.target, self._budget.evaluations
        if self._method.done:
            reached = target is not None and self._best_seen >= target
            if self._method.by_instance:
                reached = self._method.reached
            return "target" if reached else self._used_up()
        if self._evaluations == 0:
            return None
        if self._time_is_over():
            return "seconds"
        return "evaluations" if most is not None and not self._fits(most) else None

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
        return self._evaluations + len(self._next[0]) <= most

    def _time_is_over(self) -> bool:
        limit = self._budget.seconds
        return limit is not None and self._before + self._elapsed() >= limit

    def _elapsed(self) -> float:
        """Return the seconds of this session; 0 before `run`: starting servers is not what is limited."""
        return 0.0 if self._started is None else time.monotonic() - self._started

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
            self._check_not_done(reader)
            if not self._again(evaluated):
                raise self._strayed(reader, evaluated.generation, edited)
        self._continue_from(reader)

    def _check_not_done(self, reader: StoreReader) -> None:
        """Raise InputError when a store has another generation although the method is done."""
        if self._method.done:
            raise InputError(
                f"{reader.file}: holds more generations than its experiment has; it was changed by hand"
            )

    def _strayed(self, reader: StoreReader, generation: int, edited: Sequence[str]) -> StrayedError:
        """Return the error for a generation that comes out differently."""
        return strayed(reader, generation, (self._method, self._representation, self._ranking), edited)

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

    def _continue_from(self, reader: StoreReader) -> None:
        """Note what earlier sessions have used."""
        self._resumed_at, self._stored = self._method.evaluations, len(reader.history())
        self._before = math.fsum(session.seconds or 0.0 for session in reader.sessions())

    def run(self, backend: Backend, on_generation: OnGeneration | None, on_progress: Progress | None) -> str:
        """Run until the budget is used, the target is reached, a callback returns False, or Ctrl-C.

        Return how it ended: done, stopped or interrupted. Raises KeyboardInterrupt when there is no
        generation to keep, and RunError when evaluations are not possible.
        """
        self._started = time.monotonic()
        self._rate = Rate(self._started, self._evaluations)
        try:
            try:
                stopped = self._continue(backend, on_generation, on_progress)
            finally:
                self._store_last()
        except KeyboardInterrupt:
            if not self._stored:
                raise
            return "interrupted"
        return "stopped" if stopped and not self._is_complete() else "done"

    def _is_complete(self) -> bool:
        """Return whether nothing of the budget is left when a callback ends the run."""
        if self._ahead is None:
            return self.done
        most = self._budget.evaluations  # the engine's thread, which knows the next generation, has ended
        return self._method.done or (most is not None and self._evaluations >= most)

    def _continue(
        self, backend: Backend, on_generation: OnGeneration | None, on_progress: Progress | None
    ) -> bool:
        """Work to the end; return whether a callback ended it before."""
        watched = self._watched(on_progress)
        if not self._large:
            self._ahead = Ahead.of(
                *(self._method, self._ranking, self._representation, backend, watched),
                first_seed=self._first_seed,
                run=self._name,
                samples=self._store.samples,
            )
        if self._ahead is not None:
            with closing(self._ahead):
                return self._continue_ahead(self._ahead, backend, on_generation, on_progress)
        while self.ended is None:
            number = self._method.generation
            self._say(f"generation {number}: making candidates")
            genomes, seeds = self._next or self._ask()
            self._next = None
            self._check_first(len(genomes))
            self._announce(backend, number)
            self._say(f"generation {number}: evaluating {len(genomes):,} candidates")
            sample = self._method.sample
            controllers = Controllers.of(self._representation, genomes, sample)
            if isinstance(self._ranking, SlowRanking):
                assert isinstance(backend, TwoSimulations)
                both = self._ranking, self._descriptor, backend
                results = evaluate_both(*both, controllers, seeds, watched, self._store_last)
            elif isinstance(self._ranking, Race):
                results = race(self._ranking, backend, controllers, seeds, watched, self._store_last)
            else:
                results = backend.evaluate(controllers, seeds, watched, self._store_last)
            results = self._failures.named(results, seeds, number)
            self._say(f"generation {number}: ranking and storing them")
            with self._kept(number, results.journal):
                told = self._tell(genomes, seeds, results)
            self._failures.tell()
            if sample is not None and self._keeps(sample, genomes):
                told = told._replace(found=told.found._replace(genomes=sample))
            self._unstored = told._replace(found=told.found.digested())
            if on_generation is not None and not self._report_last(on_generation):
                return True
        return False

    def _keeps(self, sample: _engine.Sample, genomes: Genomes) -> bool:
        """Return whether the store keeps a sample instead of the genomes that are made from it."""
        return self._store.samples and sample.is_shorter and len(sample) == len(genomes)

    def _continue_ahead(
        self,
        ahead: Ahead,
        backend: Backend,
        on_generation: OnGeneration | None,
        on_progress: Progress | None,
    ) -> bool:
        """Store and report what the engine evolves meanwhile; return whether a callback ended it."""
        self._next = None  # the engine knows what has been asked for
        ahead.expect(self._budget.expected_generations(self._stored, self._evaluations))
        while self.ended is None:
            number = self._method.generation
            if not ahead.is_ready:
                self._store.has_time()
            found = ahead.take()
            self._check_first(len(found.genomes))
            self._waiting_for = ""
            if on_progress is not None:
                episodes = found.results.fitness.size
                on_progress(episodes, episodes, "")
            seeds = self._ranking.seeds(self._first_seed, number)
            if found.failed:
                backend.count_failed(found.results)
                found = found._replace(results=self._failures.named(found.results, seeds, number))
                with self._kept(number, found.results.journal):
                    self._check(found.fitness, number, found.results)
                self._failures.tell()
            self._method.passed(found.fitness)
            self._unstored = self._told(number, seeds, found)
            ahead.expect(self._budget.expected_generations(number + 1, self._evaluations))
            if on_generation is None:
                self._store_last()
            elif not self._report_last(on_generation):
                return True
        return False

    def _check_first(self, size: int) -> None:
        """Warn when the first generation alone exceeds the budget."""
        most = self._budget.evaluations
        if most is not None and size > most and self._evaluations == 0:
            logging.getLogger("swarmwright").warning(
                "method.evaluations: %d is less than the first generation, which is evaluated as a whole: %d "
                "candidates",
                most, size,
            )  # fmt: skip

    def _say(self, what: str) -> None:
        """Log the next step where generations are so large that each step takes long."""
        if self._large:
            progress.info("%s", what)

    def _store_last(self) -> None:
        """Hand the last generation to the store; where nobody waits for it, while the next is evaluated."""
        told, self._unstored = self._unstored, None
        if told is not None:
            self._commit(told.evaluated(), told.found.results.journal)

    def _report_last(self, on_generation: OnGeneration) -> bool:
        """Store the last generation and report it; return whether to go on."""
        told, self._unstored = self._unstored, None
        assert told is not None
        return self._finish(told.evaluated(), told.found.results.journal, on_generation)

    def _commit(self, evaluated: Evaluated, journal: Journal) -> None:
        self._store.commit(evaluated, journal)
        self._stored = evaluated.generation + 1

    def _finish(self, evaluated: Evaluated, journal: Journal, on_generation: OnGeneration | None) -> bool:
        """Store a generation and report it; return whether to go on."""
        self._commit(evaluated, journal)
        if on_generation is None:
            return True
        self._store.keep()  # what is reported is kept, even when the process is killed
        return goes_on(on_generation(self._report(evaluated.summary)))

    @contextmanager
    def _kept(self, generation: int, journal: Journal) -> Iterator[None]:
        """Keep the journal also when the generation fails; name the reason."""
        try:
            yield
        except RunError as error:
            self._store.note(generation, journal)
            reasons = journal.errors
            if not reasons or isinstance(error, PlugInError):  # not for what failed episodes raised
                raise
            raise error.reworded(f"{error}; the last reason: {one_line(reasons[-1])}") from error

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
        generations = self._budget.expected_generations(self._stored, self._evaluations)
        backend.about(self._name, generation, generations, evaluations)

    def _watched(self, on_progress: Progress | None) -> Progress:
        """Return the callback that also notes what is waited for."""

        def progress(done: int, total: int, waiting_for: str) -> None:
            self._waiting_for = waiting_for if done < total else ""
            self._store.keep_soon()  # also while the first generation takes long
            if on_progress is not None:
                on_progress(done, total, waiting_for)

        return progress

    def _tell(self, genomes: Genomes, seeds: list[int], results: Results) -> Told:
        """Rank the results and tell the method."""
        number = self._method.generation
        if isinstance(self._ranking, SlowRanking):
            metrics = results.metrics[:, :, self._descriptor]
            fitness = self._ranking.ranked(results.fitness, results.metrics[:, :, -1], metrics)
        else:
            fitness = self._ranking.score(results.fitness, genomes)
        self._check(fitness, number, results)
        kept = fitness[self._asked :] if self._ranking.options.reevaluate else None
        needed = means(results.metrics[: self._asked, :, self._needed]) if self._needed else None
        self._method.tell(fitness[: self._asked], kept, needed)
        if self._method.by_instance:
            fitness = self._method.told_means
        return self._told(number, seeds, Produced.of(genomes, results, fitness, self._population_fitness()))

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
        self._lead(found)
        self._evaluations += len(found.fitness)
        return Told(
            generation=number,
            seeds=seeds,
            found=found,
            evaluations=self._evaluations,
            best_so_far=self._best_so_far,
            leader=self._leader,
        )

    def _check(self, fitness: Fitness, generation: int, results: Results) -> None:
        failed = np.flatnonzero(np.isnan(fitness))
        if len(failed) == len(fitness) >= self._method.contenders:
            raise RunError(f"every candidate of generation {generation} failed{_why(results, self._ranking)}")
        if len(failed) and self._ranking.options.failed == "stop":
            raise RunError(
                f"candidate {failed[0]} of generation {generation} failed, and ranking.failed says stop"
            )

    def _lead(self, found: Produced) -> None:
        """Note the best evaluation so far; with re-evaluation, of this generation."""
        if self._method.by_instance:
            incumbent = self._method.incumbent
            if incumbent is not None:
                self._best_so_far, self._leader = incumbent.fitness, incumbent.evaluation
            return
        value = float(found.fitness[found.leader])
        self._best_seen = max(self._best_seen, value)
        if value > self._best_so_far or self._ranking.options.reevaluate:
            self._best_so_far = value
            self._leader = self._evaluations + found.leader

    def _report(self, summary: Summary) -> Generation:
        elapsed = self._elapsed()
        budget, share = self._budget.nearest(
            summary.generation + 1, summary.evaluations, self._before + elapsed
        )
        left = 0 if self._method.done else max(self._whole() - self._method.evaluations, 0)
        seconds_left = left * elapsed / max(self._method.evaluations - self._resumed_at, 1)
        if self._budget.seconds is not None:
            seconds_left = min(seconds_left, max(self._budget.seconds - self._before - elapsed, 0.0))
        return Generation(
            generation=summary.generation,
            generations=self._budget.generations,
            best=summary.best,
            mean=summary.mean,
            best_so_far=summary.best_so_far,
            failed=summary.failed,
            evaluations=summary.evaluations,
            seconds=elapsed,
            evaluations_per_second=self._rate.after(time.monotonic(), summary.evaluations),
            seconds_left=seconds_left,
            waiting_for=self._waiting_for,
            budget=budget,
            share=share,
        )

    def _whole(self) -> int:
        """Return how many candidates are evaluated in the whole run, at most."""
        return min(self._method.budget, self._budget.evaluations or _MOST, _MOST)


def _why(results: Results, ranking: Ranking) -> str:
    """Return why candidates failed none of whose episodes did; empty where another reason is known."""
    failed = ~np.isfinite(results.fitness)
    if isinstance(ranking, Race):  # those that were dropped went through some of their episodes only
        failed &= np.arange(failed.shape[1]) < ranking.ran(results.fitness)[:, np.newaxis]
    if results.journal.errors or failed.any():
        return ""
    return (
        ": all of their episodes worked, but what the ranking makes of them is no finite number, such as a "
        "sum beyond binary64, or what a plug-in returned"
    )
