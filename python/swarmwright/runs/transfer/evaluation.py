"""Evaluate a run's candidates in its own simulation and in others."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Genomes
from swarmwright.common.errors import InputError, RunError, with_message
from swarmwright.common.random_numbers import Streams
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.targets import Target, explain_mismatch
from swarmwright.runs.post_evaluation import evaluate_genomes
from swarmwright.runs.store import Evaluation
from swarmwright.runs.transfer.transferred import Candidate
from swarmwright.servers.evaluation.base import Progress, Servers
from swarmwright.servers.evaluation.opening import needs_no_servers, open_backend, open_once, require_here
from swarmwright.simulations import catalogue

Values = NDArray[np.float64]
Where = tuple[str | None, Servers | None]
"""Broker and servers for `open_backend`."""


@dataclass(frozen=True)
class Plan:
    """The candidates and targets of a run to evaluate."""

    experiment: Experiment
    targets: list[tuple[Target, list[Experiment]]]
    """Each target with the experiment of all its episodes, or with an experiment for each episode."""
    candidates: tuple[Candidate, ...]
    genomes: Genomes

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        best: Sequence[Evaluation],
        targets: Sequence[Target],
        *,
        random: int,
        seeds: int,
    ) -> Self:
        """Choose candidates and derive the targets' experiments.

        Args:
            experiment: experiment of the run, with the code to use.
            best: the candidates of the run.
            targets: other simulations.
            random: number of additional random controllers.
            seeds: number of episodes.

        Raises InputError when an experiment cannot be derived.
        """
        chosen = [
            Candidate(evaluation.generation, evaluation.candidate, evaluation.fitness) for evaluation in best
        ]
        genomes = [np.stack([evaluation.genome for evaluation in best])]
        if random:
            streams = Streams(experiment.seed, "transfer", 0, list(range(random)))
            genomes.append(experiment.representation().initials(streams))
            chosen += [Candidate(None, index, None) for index in range(random)]
        changed = [(target, target.make_experiments(experiment, seeds)) for target in targets]
        return cls(experiment, changed, tuple(chosen), np.concatenate(genomes).astype(np.float32))

    def check(self, broker: str | None) -> None:
        """Raise InputError if a target is not available, or controllers do not fit it."""
        for target, experiments in self.targets:
            check_target(target, experiments[0], self.experiment, broker)

    def episodes(self, seeds: int) -> int:
        """Return the number of episodes to evaluate."""
        return (1 + len(self.targets)) * len(self.candidates) * seeds


def check_target(
    target: Target, target_experiment: Experiment, source: Experiment, broker: str | None
) -> None:
    """Raise InputError if a target is not available, or the controllers of the source do not fit it."""
    if (
        broker is None
        and target_experiment.broker is None
        and not catalogue.is_local(target_experiment.simulation)
    ):
        try:
            require_here(target_experiment)
        except InputError as error:
            raise InputError(f"{target.name}: {error}") from error
    problem = explain_mismatch(target.name, target_experiment, source)
    if problem is not None:
        raise InputError(problem)


class Work:
    """Sequential evaluations with a common progress.

    Args:
        seeds: simulation seed of each episode.
        broker: as in `optimize`, for targets that do not name servers or a broker themselves.
        servers: likewise.
        prefix: of topics, in place of the experiments'.
        on_progress: called with the number of finished episodes in total.
        total: number of episodes of all evaluations.
    """

    def __init__(
        self,
        seeds: Sequence[int],
        broker: str | None,
        servers: Servers | None,
        on_progress: Progress | None,
        total: int,
        *,
        prefix: str | None = None,
    ) -> None:
        self._prefix = prefix
        self._seeds, self._broker, self._servers = seeds, broker, servers
        self._on_progress, self._total = on_progress, total
        self._done = 0

    def skip(self, episodes: int) -> None:
        """Count episodes that need not be evaluated."""
        self._done += episodes

    def evaluate_source(self, plan: Plan) -> Values:
        """Return the fitness in the run's own simulation, (candidates, seeds)."""
        experiment = self._add_prefix(plan.experiment)
        where = self._choose_servers(experiment)
        return self._fitness(experiment, plan.genomes, self._seeds, where)

    def evaluate_target(self, plan: Plan, target: Target, experiments: Sequence[Experiment]) -> Values:
        """Return the fitness in a target, (candidates, seeds), NaN for failed episodes.

        Raises InputError and RunError with the target's name.
        """
        try:
            if not target.sets_servers:
                experiments = [self._add_prefix(changed) for changed in experiments]
            where = self._choose_servers(experiments[0], placed=target.sets_servers)
            if len(experiments) == 1:
                return self._fitness(experiments[0], plan.genomes, self._seeds, where)
            with open_once(experiments[0], *where, most=len(plan.genomes)) as where:
                parts = [
                    self._fitness(experiment, plan.genomes, [seed], where, may_fail=True)
                    for experiment, seed in zip(experiments, self._seeds, strict=True)
                ]
            fitness = np.concatenate(parts, axis=1)
            if not np.isfinite(fitness).any():
                raise RunError(
                    "every episode failed; find the reason with `swarmwright evaluate RUN --episodes 1 "
                    "--set ..`"
                )
            return fitness
        except (InputError, RunError) as error:
            raise with_message(error, f"{target.name}: {error}") from error

    def _add_prefix(self, experiment: Experiment) -> Experiment:
        """Return an experiment with the prefix, if there is one."""
        return experiment if self._prefix is None else dataclasses.replace(experiment, prefix=self._prefix)

    def _choose_servers(self, experiment: Experiment, *, placed: bool = False) -> Where:
        """Return broker and servers for `open_backend`; placed: the experiment itself names them."""
        broker, servers = (None, None) if placed else (self._broker, self._servers)
        if experiment.broker is None and catalogue.is_local(experiment.simulation):
            broker = None
        if servers is None and broker is None and needs_no_servers(experiment):
            servers = "in-process"
        return broker, servers

    def _fitness(
        self,
        experiment: Experiment,
        genomes: Genomes,
        seeds: Sequence[int],
        where: Where,
        *,
        may_fail: bool = False,
    ) -> Values:
        """Evaluate genomes; return the fitness of their episodes, (candidates, seeds)."""
        before, count = self._done, len(genomes) * len(seeds)

        def on_progress(done: int, _: int, waiting_for: str) -> None:
            if self._on_progress is not None:
                self._on_progress(before + done, self._total, waiting_for)

        broker, servers = where
        with open_backend(experiment, broker=broker, servers=servers, most=count) as backend:
            results = evaluate_genomes(experiment, backend, genomes, seeds, on_progress, may_fail=may_fail)
        self._done += count
        return results.fitness + 0.0
