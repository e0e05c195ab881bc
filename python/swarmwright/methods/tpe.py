"""TPE: the tree-structured Parzen estimator of Optuna, for few evaluations of few parameters."""

from collections import deque
from collections.abc import Iterable
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.controllers import Representation
from swarmwright.controllers.kinds.parameter_set import ParameterSet
from swarmwright.methods._base import Method, MethodOptions
from swarmwright.methods._numbers import box, explain_discrete

_MOST_GENES = 100
"""Genes for which densities can be estimated from some hundred evaluations."""


class TpeOptions(MethodOptions):
    """Tree-structured Parzen estimator, with the defaults of Optuna."""

    kind: Literal["tpe"] = "tpe"
    population: int = Field(default=10, ge=1, le=10_000)
    """Candidates in each generation; they are spread, as none knows the results of the others."""
    startup: int = Field(default=10, ge=1, le=10_000)
    """Random candidates before the first proposal."""
    samples: int = Field(default=24, ge=1, le=10_000)
    """Samples from the density of good candidates, the most promising of which is proposed."""
    reach: float = Field(default=5.0, ge=1, le=1e6)
    """Limit of genes without bounds, as a multiple of their initial range around its middle; extended for
    given controllers outside."""


class Tpe(Method):
    """The tree-structured Parzen estimator (TPE) of the library Optuna, a Bayesian optimization.

    It estimates the densities of good and of other candidates, and proposes where their ratio is largest. It
    suits up to some hundred evaluations of up to 100 genes, such as the parameters of a simulation; proposals
    take time proportional to the number of evaluations. Candidates in flight count as bad ones, so
    proposals at the same time differ ("constant liar").

    The proposals come from the library, not from the engine's random numbers: another version or processor
    may give others. A resumed run takes those in its record. Each is made by a new sampler, seeded for its
    number, so an interrupted run continues with the same candidates on the same machine.

    Source: Bergstra, Bardenet, Bengio and Kegl, "Algorithms for hyper-parameter optimization", NIPS 2011;
    Akiba, Sano, Yanase, Ohta and Koyama, "Optuna", KDD 2019 (arXiv:1907.10902); several parameters together:
    Falkner, Klein and Hutter, "BOHB", ICML 2018.
    """

    kind: ClassVar[str] = "tpe"
    options_model = TpeOptions
    options: TpeOptions
    steady_state = True
    start_as = "members"
    libraries = ("optuna",)
    proposals_are_recorded = True

    def __init__(self, options: TpeOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._fitness: deque[float] = deque(maxlen=options.population)
        self._recorded: deque[Genome] = deque()
        self._study: Any = None
        self._space: dict[str, Any] = {}
        self._trials: list[int] = []
        """Number of each candidate's trial in the study."""

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse too many genes, and choices other than those of parameters."""
        genes, discrete = representation.genome_size, explain_discrete(representation)
        if discrete is None and genes > _MOST_GENES:
            return f"{genes} genes are too many for few evaluations; above {_MOST_GENES}, use cma_es or nnga"
        return discrete

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def generation_size(self) -> int:
        """Candidates in each generation."""
        return self.options.population

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the last generation; in steady state, of the last candidates."""
        return np.array(self._fitness, dtype=np.float64)

    def take_recorded(self, genomes: Iterable[Genome]) -> None:
        """Propose these genomes, those of a record, before others."""
        self._recorded.extend(genomes)

    def _ask(self) -> Genomes:
        return np.stack([self._ask_next(self.evaluations + row) for row in range(self.options.population)])

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        for row, (genome, value) in enumerate(zip(genomes, fitness.tolist(), strict=True)):
            self._tell_next(self.evaluations + row, genome, value)

    def _ask_next(self, index: int) -> Genome:
        if self._study is None:
            self._begin()
        if self._recorded:
            genome = self._recorded.popleft()
        elif index < max(self.options.startup, len(self.start)):
            genome = self.initial_of(index)
        else:
            genome = self._propose(index)
        self._add(genome)
        return genome

    def _tell_next(self, index: int, genome: Genome, fitness: float) -> None:  # noqa: ARG002 - the study has it
        from optuna.trial import TrialState  # noqa: PLC0415 - an extra

        trial = self._trials[index]
        if np.isnan(fitness):
            self._study.tell(trial, state=TrialState.FAIL)
        else:
            self._study.tell(trial, fitness)
        self._fitness.append(fitness)

    def _begin(self) -> None:
        """Create the study."""
        import optuna  # noqa: PLC0415 - an extra

        verbosity = optuna.logging.get_verbosity()
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._study = optuna.create_study(direction="maximize")
        optuna.logging.set_verbosity(verbosity)
        low, high = (
            limit.astype(np.float32) for limit in box(self.representation, self.start, self.options.reach)
        )
        choices = self._choices
        self._space = {
            str(gene): optuna.distributions.CategoricalDistribution(range(choices[gene]))
            if choices[gene]
            else optuna.distributions.FloatDistribution(float(low[gene]), float(high[gene]))
            for gene in range(self.representation.genome_size)
        }

    @property
    def _choices(self) -> list[int]:
        """Number of choices of each gene, 0 for numbers."""
        if isinstance(self.representation, ParameterSet):
            return [int(count) for count in self.representation.choices]
        return [0] * self.representation.genome_size

    def _propose(self, index: int) -> Genome:
        """Return the library's proposal, rounded to a genome."""
        from optuna.samplers import TPESampler  # noqa: PLC0415 - an extra
        from optuna.trial import TrialState  # noqa: PLC0415

        self._study.sampler = TPESampler(
            n_startup_trials=1,
            n_ei_candidates=self.options.samples,
            multivariate=True,
            constant_liar=True,
            seed=int(self.streams_of("tpe", index)[0].integer(1 << 32)),
        )
        trial = self._study.ask(self._space)
        # The study gets the rounded genome instead, as when a run is resumed.
        self._study.tell(trial, state=TrialState.FAIL)
        genes = zip(self._space, self._choices, strict=True)
        values = [
            (trial.params[name] + 0.5) / choices if choices else trial.params[name] for name, choices in genes
        ]
        return np.array(values, dtype=np.float32)

    def _add(self, genome: Genome) -> None:
        """Add a trial that is in flight."""
        from optuna.trial import TrialState, create_trial  # noqa: PLC0415 - an extra

        # A record that was edited, or the initial genomes of a plug-in, may be outside of the space.
        params = {
            name: min(max(int(gene * choices), 0), choices - 1)
            if choices
            else min(max(gene, self._space[name].low), self._space[name].high)
            for name, choices, gene in zip(self._space, self._choices, genome.tolist(), strict=True)
        }
        self._trials.append(len(self._study.get_trials(deepcopy=False)))
        self._study.add_trial(
            create_trial(state=TrialState.RUNNING, params=params, distributions=self._space)
        )
