"""The strategy of whole generations: ask, evaluate, rank, tell."""

import numpy as np

from swarmwright import _engine
from swarmwright.common.arrays import Genomes
from swarmwright.common.plug_in_code import is_plug_in, numbers
from swarmwright.common.statistics import means
from swarmwright.runs.optimization.ahead import Ahead, can_be_ahead, retold
from swarmwright.runs.optimization.loop import Loop, Strategy
from swarmwright.servers.evaluation.base import Backend, Controllers, Results
from swarmwright.servers.evaluation.seeds import check_seeds
from swarmwright.servers.rows import GenerationResult, Journal


class Generational(Strategy):
    """The method is asked for a generation, and told its fitness when all of it is evaluated."""

    stores_later = True

    def __init__(self, loop: Loop) -> None:
        super().__init__(loop)
        self._asked = 0  # of the genomes to be evaluated; after them come members that are evaluated again
        self._next: tuple[Genomes, list[int]] | None = None  # asked for and not evaluated yet
        self._ahead_is_tried = loop.is_large

    def fits(self, most: int) -> bool:
        """Ask for the next generation; see `Strategy.fits`."""
        if self._next is None:
            self._next = self._ask()
        return self.loop.account.evaluations + len(self._next[0]) <= most

    def successor(self, backend: Backend) -> Strategy:
        """Return the engine where it can go on by itself, once an evaluation has succeeded.

        What the engine evaluates by itself is seen when a generation is complete.
        """
        if self._ahead_is_tried or self.loop.first.is_open:
            return self
        self._ahead_is_tried = True
        self.loop.recorder.store_last()
        ahead = Ahead.of(self.loop, backend)
        if ahead is None:
            return self
        self._next = None  # the engine knows what has been asked for
        return ahead

    def advance(self, backend: Backend) -> None:
        """Evaluate the next generation."""
        loop = self.loop
        number = loop.method.generation
        loop.say(f"generation {number}: making candidates")
        genomes, seeds = self._next or self._ask()
        self._next = None
        loop.check_size(len(genomes))
        loop.announce(backend, number)
        loop.say(f"generation {number}: evaluating {len(genomes):,} candidates")
        sample = loop.method.sample
        controllers = Controllers.from_genomes(loop.representation, genomes, sample)
        with loop.first_evaluations(number) as on_results:
            results = loop.evaluator.evaluate(
                *(backend, controllers, seeds, loop.recorder.progress, loop.recorder.store_last, on_results)
            )
        results = loop.failures.named(results, seeds, number)
        loop.say(f"generation {number}: ranking and storing them")
        keeps_sample = sample is not None and sample.is_shorter and len(sample) == len(genomes)
        loop.complete(results, lambda: self._tell(genomes, seeds, results, sample if keeps_sample else None))

    def retell(self, stored: GenerationResult) -> bool:
        """Ask the method, and tell it the stored results; see `Strategy.retell`."""
        if can_be_ahead(self.loop.method, self.loop.ranking):
            return retold(self.loop, stored)
        genomes, seeds = self._ask()
        if genomes.tobytes() != stored.expand_genomes().tobytes() or seeds != stored.seeds:
            return False
        results = Results(stored.episodes, stored.metrics, Journal())
        return self._tell(genomes, seeds, results).fitness.tobytes() == stored.fitness.tobytes()

    def _ask(self) -> tuple[Genomes, list[int]]:
        """Return the genomes to be evaluated in this generation, and on which seeds."""
        method, ranking, representation = self.loop.method, self.loop.ranking, self.loop.representation
        number, first_seed = method.generation, self.loop.first_seed
        genomes = method.ask()
        self._asked = len(genomes)
        if ranking.options.reevaluate:
            genomes = np.concatenate([genomes, method.kept()])
        if is_plug_in(type(representation)):  # an operator for many genomes may be wrong
            size = None, representation.genome_size
            what = "genomes, (candidates, genome_size), made by operators of the representation"
            genomes = numbers(representation, "genome_size", genomes, size, what)
        seeds = (
            ranking.seeds_of(first_seed, method.instance)
            if method.by_instance
            else ranking.seeds(first_seed, number)
        )
        return genomes, check_seeds(ranking, seeds)

    def _tell(
        self, genomes: Genomes, seeds: list[int], results: Results, sample: _engine.Sample | None = None
    ) -> GenerationResult:
        """Rank the results and tell the method; sample: what the store keeps instead of the genomes."""
        loop, method = self.loop, self.loop.method
        counted = loop.failed_candidates(results)
        fitness = loop.evaluator.fitness(results, genomes)
        failed = None if counted is None else int(np.count_nonzero(counted | np.isnan(fitness)))
        loop.check(fitness, results)
        kept = fitness[self._asked :] if loop.ranking.options.reevaluate else None
        needed = means(results.metrics[: self._asked, :, loop.needed]) if loop.needed else None
        method.tell(fitness[: self._asked], kept, needed)
        if method.by_instance:
            fitness = method.told_means
        return loop.told(genomes if sample is None else sample, seeds, results, fitness, failed=failed)
