"""The generational strategy: ask, evaluate, rank, tell."""

import numpy as np

from swarmwright import _engine
from swarmwright.common.arrays import Genomes
from swarmwright.common.plug_in_code import is_plug_in, numbers
from swarmwright.common.statistics import means
from swarmwright.runs.optimization.ahead import Ahead, can_run_ahead, replay_search
from swarmwright.runs.optimization.loop import Loop, Strategy
from swarmwright.servers.evaluation.base import Backend, Controllers, Results, check_seeds
from swarmwright.servers.rows import GenerationResult, Journal


class Generational(Strategy):
    """Asks the method for a generation, and tells it the fitness when all candidates are evaluated."""

    stores_later = True

    def __init__(self, loop: Loop) -> None:
        super().__init__(loop)
        self._new_candidates = 0  # number of new genomes, which precede re-evaluated members
        self._next: tuple[Genomes, list[int]] | None = None  # asked, and not evaluated yet
        self._ahead_is_tried = loop.is_large

    def fits(self, most: int) -> bool:
        """Ask for the next generation; see `Strategy.fits`."""
        if self._next is None:
            self._next = self._ask()
        return self.loop.account.evaluations + len(self._next[0]) <= most

    def successor(self, backend: Backend) -> Strategy:
        """Hand over to the engine if it can evolve by itself, once an evaluation has succeeded.

        Evaluations in the engine become visible only when a generation is complete.
        """
        if self._ahead_is_tried or self.loop.first.is_open:
            return self
        self._ahead_is_tried = True
        self.loop.recorder.store_last()
        ahead = Ahead.of(self.loop, backend)
        if ahead is None:
            return self
        self._next = None  # the engine has these candidates
        return ahead

    def advance(self, backend: Backend) -> None:
        """Evaluate the next generation."""
        loop = self.loop
        number = loop.method.generation
        loop.log_step(f"generation {number}: creating candidates")
        genomes, seeds = self._next or self._ask()
        self._next = None
        loop.check_size(len(genomes))
        loop.announce(backend, number)
        loop.log_step(f"generation {number}: evaluating {len(genomes):,} candidates")
        sample = loop.method.sample
        controllers = Controllers.from_genomes(loop.representation, genomes, sample)
        with loop.first_evaluations(number) as on_results:
            results = loop.evaluator.evaluate(
                *(backend, controllers, seeds, loop.recorder.progress, loop.recorder.store_last, on_results)
            )
        results = loop.failures.add_warnings(results, seeds, number)
        loop.log_step(f"generation {number}: ranking and storing them")
        keeps_sample = sample is not None and sample.is_shorter and len(sample) == len(genomes)
        loop.complete(results, lambda: self._tell(genomes, seeds, results, sample if keeps_sample else None))

    def replay_generation(self, stored: GenerationResult) -> bool:
        """Ask for the candidates and tell the stored results; see `Strategy.replay_generation`."""
        if can_run_ahead(self.loop):
            return replay_search(self.loop, stored)
        genomes, seeds = self._ask()
        if genomes.tobytes() != stored.expand_genomes().tobytes() or seeds != stored.seeds:
            return False
        results = Results(stored.episodes, stored.metrics, Journal())
        return self._tell(genomes, seeds, results).fitness.tobytes() == stored.fitness.tobytes()

    def _ask(self) -> tuple[Genomes, list[int]]:
        """Return the genomes and the seeds of the next generation."""
        method, ranking, representation = self.loop.method, self.loop.ranking, self.loop.representation
        number, first_seed = method.generation, self.loop.first_seed
        genomes = method.ask()
        self._new_candidates = len(genomes)
        if ranking.options.reevaluate:
            genomes = np.concatenate([genomes, method.survivors()])
        if is_plug_in(type(representation)):  # its operators may return a wrong shape
            size = None, representation.genome_size
            expected = "genomes, (candidates, genome_size), made by operators of the representation"
            genomes = numbers(representation, "genome_size", genomes, size, expected)
        seeds = (
            ranking.seeds_of(first_seed, method.instance)
            if method.by_instance
            else ranking.seeds(first_seed, number)
        )
        return genomes, check_seeds(ranking, seeds)

    def _tell(
        self, genomes: Genomes, seeds: list[int], results: Results, sample: _engine.Sample | None = None
    ) -> GenerationResult:
        """Rank the results and tell the method; sample: stored instead of the genomes."""
        loop, method = self.loop, self.loop.method
        failures = loop.find_failed_candidates(results)
        fitness = loop.evaluator.fitness(results, genomes)
        failed = None if failures is None else int(np.count_nonzero(failures | np.isnan(fitness)))
        loop.check(fitness, results)
        new = self._new_candidates
        reevaluated = fitness[new:] if loop.ranking.options.reevaluate else None
        metrics = means(results.metrics[:new, :, loop.needed]) if loop.needed else None
        violations = loop.constraints.measure(results.metrics)
        more = {} if violations is None else {"violations": violations}  # plug-ins may lack them
        method.tell(fitness[:new], reevaluated, metrics, **more)
        if method.by_instance:
            fitness = method.instance_means
        return loop.record_generation(
            genomes if sample is None else sample,
            seeds,
            results,
            fitness,
            failed=failed,
            violations=violations,
        )
