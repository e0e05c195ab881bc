"""Evaluation of candidates in the run's own simulation and in others."""

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis.groups import RunGroup, group
from swarmwright.analysis.transfer.ranges import E_PUCKS, Range, ranges_of, require_e_pucks
from swarmwright.analysis.transfer.result import Candidate, Transfer, Transferred
from swarmwright.analysis.transfer.targets import Target, targets_of
from swarmwright.core.errors import InputError, RunError
from swarmwright.core.random_numbers import Streams
from swarmwright.evaluation.base import Progress, Servers
from swarmwright.evaluation.opening import open_backend, require_here
from swarmwright.experiment.experiment import Experiment
from swarmwright.runs.code import used_for
from swarmwright.runs.post_evaluation import evaluated, unseen_seeds
from swarmwright.runs.run import Run
from swarmwright.runs.validation import leading
from swarmwright.simulations import catalogue
from swarmwright.typing import Genomes

CANDIDATES, SEEDS = 10, 30
"""Unless other numbers are given."""
FEW = 5
"""Runs of a design below which a test has little power."""


def transfer(
    runs: Iterable[Run | str | os.PathLike[str]],
    to: Sequence[str] = (),
    *,
    vary: Mapping[str, Sequence[float]] | Sequence[Range] = (),
    pseudo_reality: bool = False,
    candidates: int = CANDIDATES,
    random: int = 0,
    seeds: int = SEEDS,
    seed: int | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> Transfer:
    """Evaluate the best candidates of runs in other simulations, and say what they lose.

    Controllers evolved in one simulation exploit what is particular to it. What they lose in another one, or
    in models sampled around their own, is a sign of what they will lose on robots.

    Args:
        runs: run folders, or runs. Those that differ in the seed alone are one design; designs are compared.
        to: names of simulations, as in experiments, which have the same sensors and actuators; or files
            (.yaml) with the keys of the experiment that differ, such as simulation, parameters and servers.
        vary: key of a parameter -> its lowest and highest value, both included; whole numbers where both
            are: {"parameters.speedDefenders": (0.4, 0.8)}. Every episode has a model of its own.
        pseudo_reality: vary the noise of the arena's e-pucks as well, in ranges around the reference model's:
            drive 0 to 0.15, proximity and ground 0 to 0.1, light 0 to 0.9, loss of messages 0.8 to 0.95.
        candidates: how many of the best ones with different controllers, of each run.
        random: how many random controllers beside them.
        seeds: how many episodes, with held-out seeds, the same for all candidates and runs.
        seed: simulation seed of the first episode, the next ones follow; default: seeds that no run used.
        broker: of the servers that offer simulations which are not here, and of all where the run had a
            broker; not for targets whose file names servers or a broker.
        servers: as in `optimize`, likewise.
        on_progress: as in `optimize`.

    Raises:
        InputError: there is no run or target, a target does not fit the controllers, a number is out of
            range.
        RunError: no broker, no fitting server, or every episode failed.
    """
    opened = [run if isinstance(run, Run) else Run.open(Path(run)) for run in runs]
    if not opened:
        raise InputError("there are no runs to transfer; name run folders such as runs/minisim-1")
    for name, number, least in (("candidates", candidates, 1), ("random", random, 0), ("seeds", seeds, 2)):
        if number < least:
            raise InputError(f"{name}: must be at least {least}, not {number}")
    groups, notes = group(opened, besides={"parameters.seed"})
    kept = [run for one in groups for run in one.runs]
    ranges = ranges_of(vary)
    if pseudo_reality:
        for run in kept:
            require_e_pucks(run.experiment)
        ranges = [*E_PUCKS, *ranges]
    targets = targets_of(to, ranges)
    used = set[int]().union(*(run.store.used_seeds() for run in kept))
    first = min(run.experiment.first_seed for run in kept)
    episodes = unseen_seeds(first, used if seed is None else set(), seeds, seed)
    work = _Work(episodes, broker, servers, on_progress)
    plans = [_Plan.of(run, targets, candidates, random, seeds) for run in kept]
    for plan in plans:
        plan.check(broker)
    work.total = sum(plan.episodes(seeds) for plan in plans)
    found = [one for plan in plans for one in work.of(plan)]
    names = tuple(target.name for target in targets)
    return Transfer(tuple(episodes), names, tuple(found), tuple(groups), (*notes, *_cautions(groups, found)))


@dataclass(frozen=True)
class _Plan:
    """What is evaluated of one run."""

    run: Run
    experiment: Experiment
    targets: list[tuple[Target, list[Experiment]]]
    """Each with the experiment of all its episodes, or with one for each."""
    candidates: tuple[Candidate, ...]
    genomes: Genomes

    @classmethod
    def of(cls, run: Run, targets: Sequence[Target], candidates: int, random: int, seeds: int) -> "_Plan":
        """Choose candidates and change experiments, before anything is evaluated."""
        best = leading(run.experiment, run.store, candidates)
        experiment = used_for(run, best[0].generation)
        chosen = [Candidate(one.generation, one.candidate, one.fitness) for one in best]
        genomes = [np.stack([one.genome for one in best])]
        if random:
            streams = Streams(run.experiment.seed, "transfer", 0, list(range(random)))
            genomes.append(run.experiment.representation().initials(streams))
            chosen += [Candidate(None, index, None) for index in range(random)]
        changed = [(target, target.experiments(experiment, seeds)) for target in targets]
        return cls(run, experiment, changed, tuple(chosen), np.concatenate(genomes).astype(np.float32))

    def check(self, broker: str | None) -> None:
        """Raise InputError where a target has no place, or controllers do not fit it."""
        for target, experiments in self.targets:
            there = experiments[0]
            if broker is None and there.broker is None and not catalogue.is_here(there.simulation):
                try:
                    require_here(there)
                except InputError as error:
                    raise InputError(f"{target.name}: {error}") from error
            _check_sizes(target, there, self.experiment)

    def episodes(self, seeds: int) -> int:
        """How many are evaluated."""
        return (1 + len(self.targets)) * len(self.candidates) * seeds


def _check_sizes(target: Target, there: Experiment, here: Experiment) -> None:
    """Raise InputError where it is known that controllers do not fit."""
    sizes = [(one.sensors, one.actuators) for one in (here, there)]
    if here.steers and None not in (*sizes[0], *sizes[1]) and sizes[0] != sizes[1]:
        named = (f"{sensors} sensors and {actuators} actuators" for sensors, actuators in sizes)
        raise InputError(
            "{target}: the run's controllers have {}, agents of {label} have {}".format(
                *named, target=target.name, label=there.label
            )
        )


class _Work:
    """Evaluations, one after the other, with progress of all."""

    def __init__(
        self,
        seeds: Sequence[int],
        broker: str | None,
        servers: Servers | None,
        on_progress: Progress | None,
    ) -> None:
        self._seeds, self._broker, self._servers = seeds, broker, servers
        self._on_progress = on_progress
        self._done = 0
        self.total = 0

    def of(self, plan: _Plan) -> list[Transferred]:
        """Evaluate the candidates of a run in its own simulation and in all targets."""
        source = self._fitness(plan.experiment, plan.genomes, self._seeds)
        ranking = plan.experiment.new_ranking()
        found = []
        for target, experiments in plan.targets:
            try:
                there = self._there(plan, target, experiments)
            except (InputError, RunError) as error:
                raise type(error)(f"{target.name}: {error}") from error
            found.append(Transferred(plan.run, target.name, plan.candidates, source, there, ranking))
        return found

    def _there(self, plan: _Plan, target: Target, experiments: Sequence[Experiment]) -> NDArray[np.float64]:
        placed = target.places
        if len(experiments) == 1:
            return self._fitness(experiments[0], plan.genomes, self._seeds, placed=placed)
        columns = [
            self._fitness(experiment, plan.genomes, [seed], placed=placed, may_fail=True)
            for experiment, seed in zip(experiments, self._seeds, strict=True)
        ]
        found = np.concatenate(columns, axis=1)
        if not np.isfinite(found).any():
            raise RunError("every episode failed; `swarmwright evaluate RUN --episodes 1 --set ..` says why")
        return found

    def _fitness(
        self,
        experiment: Experiment,
        genomes: Genomes,
        seeds: Sequence[int],
        *,
        placed: bool = False,
        may_fail: bool = False,
    ) -> NDArray[np.float64]:
        """Return the fitness of episodes, (candidates, seeds); placed: where the experiment itself says."""
        before, count = self._done, len(genomes) * len(seeds)

        def on_progress(done: int, _: int, waiting_for: str) -> None:
            if self._on_progress is not None:
                self._on_progress(before + done, self.total, waiting_for)

        broker, servers = (None, None) if placed else (self._broker, self._servers)
        if experiment.broker is None and catalogue.is_here(experiment.simulation):
            broker = None
        with open_backend(experiment, broker=broker, servers=servers, most=count) as backend:
            results = evaluated(experiment, backend, genomes, seeds, on_progress, may_fail=may_fail)
        self._done += count
        return results.fitness + 0.0


def _cautions(groups: Sequence[RunGroup], found: Sequence[Transferred]) -> Iterable[str]:
    failed = {one.target: 0 for one in found}
    for one in found:
        failed[one.target] += one.failed
    for target, count in failed.items():
        if count:
            yield f"{count} episodes failed in {target} and are left out"
    if len(groups) > 1 and min(len(one.runs) for one in groups) < FEW:
        yield f"with fewer than {FEW} runs of a design a test has little power"
    if any(not math.isfinite(one.losses[0].mean) for one in found):
        yield "the best of a run failed in every episode"
