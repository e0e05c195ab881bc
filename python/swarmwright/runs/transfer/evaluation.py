"""Evaluation of a run's candidates in its own simulation and in others."""

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
from swarmwright.experiment.targets import Target, unfit
from swarmwright.runs.post_evaluation import evaluate_genomes
from swarmwright.runs.store import Evaluation
from swarmwright.runs.transfer.transferred import Candidate
from swarmwright.servers.evaluation.base import Progress, Servers
from swarmwright.servers.evaluation.here import needs_no_servers, require_here
from swarmwright.servers.evaluation.opening import open_backend, open_once
from swarmwright.simulations import catalogue

Values = NDArray[np.float64]
Where = tuple[str | None, Servers | None]
"""Broker and servers, as `open_backend` takes them."""


@dataclass(frozen=True)
class Plan:
    """What is evaluated of one run."""

    experiment: Experiment
    targets: list[tuple[Target, list[Experiment]]]
    """Each with the experiment of all its episodes, or with one for each."""
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
        """Choose candidates and change experiments, before anything is evaluated.

        Args:
            experiment: of the run, with the source that it is evaluated with.
            best: the candidates of the run.
            targets: where they are evaluated as well.
            random: how many random controllers beside them.
            seeds: how many episodes.

        Raises InputError when an experiment cannot be changed like this.
        """
        chosen = [
            Candidate(evaluation.generation, evaluation.candidate, evaluation.fitness) for evaluation in best
        ]
        genomes = [np.stack([evaluation.genome for evaluation in best])]
        if random:
            streams = Streams(experiment.seed, "transfer", 0, list(range(random)))
            genomes.append(experiment.representation().initials(streams))
            chosen += [Candidate(None, index, None) for index in range(random)]
        changed = [(target, target.experiments(experiment, seeds)) for target in targets]
        return cls(experiment, changed, tuple(chosen), np.concatenate(genomes).astype(np.float32))

    def check(self, broker: str | None) -> None:
        """Raise InputError where a target has no place, or controllers do not fit it."""
        for target, experiments in self.targets:
            check_target(target, experiments[0], self.experiment, broker)

    def episodes(self, seeds: int) -> int:
        """How many are evaluated."""
        return (1 + len(self.targets)) * len(self.candidates) * seeds


def check_target(target: Target, there: Experiment, here: Experiment, broker: str | None) -> None:
    """Raise InputError where a target has no place, or the controllers of `here` do not fit it."""
    if broker is None and there.broker is None and not catalogue.is_local(there.simulation):
        try:
            require_here(there)
        except InputError as error:
            raise InputError(f"{target.name}: {error}") from error
    problem = unfit(target.name, there, here)
    if problem is not None:
        raise InputError(problem)


class Work:
    """Evaluations, one after the other, with progress of all.

    Args:
        seeds: simulation seed of each episode.
        broker: as in `optimize`, for targets that do not name servers or a broker themselves.
        servers: likewise.
        prefix: of topics there, instead of the experiments'.
        on_progress: called with the episodes of all that is evaluated.
        total: how many these are.
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

    def passed(self, episodes: int) -> None:
        """Count episodes that need not be evaluated."""
        self._done += episodes

    def here(self, plan: Plan) -> Values:
        """Return (candidates, seeds) fitness in the run's own simulation."""
        experiment = self._prefixed(plan.experiment)
        where = self._where(experiment)
        return self._fitness(experiment, plan.genomes, self._seeds, where)

    def there(self, plan: Plan, target: Target, experiments: Sequence[Experiment]) -> Values:
        """Return (candidates, seeds) fitness in a target, NaN where an episode failed.

        Raises InputError and RunError with the target's name.
        """
        try:
            if not target.places:
                experiments = [self._prefixed(changed) for changed in experiments]
            where = self._where(experiments[0], placed=target.places)
            if len(experiments) == 1:
                return self._fitness(experiments[0], plan.genomes, self._seeds, where)
            with open_once(experiments[0], *where, most=len(plan.genomes)) as where:
                parts = [
                    self._fitness(experiment, plan.genomes, [seed], where, may_fail=True)
                    for experiment, seed in zip(experiments, self._seeds, strict=True)
                ]
            found = np.concatenate(parts, axis=1)
            if not np.isfinite(found).any():
                raise RunError(
                    "every episode failed; `swarmwright evaluate RUN --episodes 1 --set ..` says why"
                )
            return found
        except (InputError, RunError) as error:
            raise with_message(error, f"{target.name}: {error}") from error

    def _prefixed(self, experiment: Experiment) -> Experiment:
        """Return an experiment with the prefix that was named."""
        return experiment if self._prefix is None else dataclasses.replace(experiment, prefix=self._prefix)

    def _where(self, experiment: Experiment, *, placed: bool = False) -> Where:
        """Return broker and servers for `open_backend`; placed: the experiment itself says them."""
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
        """Return the fitness of episodes, (candidates, seeds)."""
        before, count = self._done, len(genomes) * len(seeds)

        def on_progress(done: int, _: int, waiting_for: str) -> None:
            if self._on_progress is not None:
                self._on_progress(before + done, self._total, waiting_for)

        broker, servers = where
        with open_backend(experiment, broker=broker, servers=servers, most=count) as backend:
            results = evaluate_genomes(experiment, backend, genomes, seeds, on_progress, may_fail=may_fail)
        self._done += count
        return results.fitness + 0.0
