"""The audit at the end of a run: repeat some of its evaluations and compare them.

`faults: {audit}` sets how many. Differences are logged as a warning and noted in the store; the record stays
unchanged.
"""

import logging
import math
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from swarmwright.common.errors import SwarmwrightError
from swarmwright.common.formatting import format_duration
from swarmwright.common.simulation_names import SimulationName, is_command, is_environment, is_python
from swarmwright.experiment.derived import has_python_modules
from swarmwright.experiment.document import AUTO
from swarmwright.experiment.experiment import Experiment
from swarmwright.runs.store import Evaluation, StoreReader
from swarmwright.servers.evaluation.base import AuditedEpisode, Backend, BudgetSpent, Controllers, Progress
from swarmwright.simulations.base import BatchSimulation
from swarmwright.simulations.catalogue import find_built_in
from swarmwright.simulations.command.checking import parse_name
from swarmwright.simulations.command.ros_definition import RosOptions
from swarmwright.simulations.loading import load

MIN_EVALUATIONS = 30
"""Least number of evaluations to repeat. A fault that affects 12 % of the evaluations is detected with a
probability of 1 - 0.88^30 = 97.8 %."""
AUTO_SHARE = 0.01
"""Share of a run's evaluations to repeat with `audit: auto`."""
_MAX_TIME_SHARE = 0.05
"""Share of a run's time that evaluations beyond the least number may take."""
_ANNOUNCED_S = 5.0
"""Expected seconds from which an audit is announced."""
_SEED = 0x6175_6469
"""Seed of the sample and of its order."""
_progress = logging.getLogger("swarmwright.progress")


@dataclass
class _AuditResult:
    """The result of an audit so far."""

    repeated: int = 0
    """Evaluations with at least one compared episode."""
    episodes: int = 0
    """Compared episodes."""
    elsewhere: int = 0
    """Compared episodes that another server repeated."""
    failed: int = 0
    """Episodes that failed in the repetition."""
    differ: set[int] = field(default_factory=set)
    """Numbers of the evaluations with a different result."""
    first: tuple[Evaluation, int, tuple[str, float, float]] | None = None
    """The first difference: evaluation, episode, and (quantity, recorded value, repeated value)."""
    servers: list[set[int]] = field(default_factory=list)
    """The two servers of each difference; empty if fewer than two known servers were involved."""

    def to_mapping(self) -> dict[str, int]:
        """Return the counts for the store."""
        return {
            "evaluations": self.repeated,
            "episodes": self.episodes,
            "elsewhere": self.elsewhere,
            "failed": self.failed,
            "differ": len(self.differ),
        }


def audit(
    experiment: Experiment,
    reader: StoreReader,
    backend: Backend,
    on_progress: Progress | None,
    seconds: float,
    evaluations: int,
) -> dict[str, int] | None:
    """Repeat evaluations of a finished run, and warn if their results differ.

    A random sample of the evaluations, including the best, is repeated in another order, on another server
    than before if there is one: `MIN_EVALUATIONS` or the experiment's share, whichever is more; beyond that
    minimum as many as fit into 5 % of the run's time. The repetitions are not recorded.

    Args:
        experiment: the run's experiment.
        reader: reads the run's store.
        backend: evaluates the repetitions.
        on_progress: as in `optimize`.
        seconds: duration of the evaluations of this session.
        evaluations: number of evaluations of this session.

    Returns the number of repeated and of different evaluations, and the other counts that the store keeps;
    None if nothing is repeated: `audit: 0`, a built-in simulation, or one that declares itself not
    deterministic.
    """
    share = experiment.faults.audit
    if share == 0 or not evaluations or not _is_auditable(experiment, backend):
        return None
    numbers = _choose_evaluations(experiment, reader, backend, AUTO_SHARE if share == AUTO else float(share))
    if not numbers:
        return None
    least = min(len(numbers), MIN_EVALUATIONS)
    expected = seconds / evaluations * least
    if expected > _ANNOUNCED_S:
        _progress.info(
            "audit: repeating %d evaluations takes about %s; skip it with `faults: {audit: 0}`",
            least, format_duration(expected),
        )  # fmt: skip
    result = _AuditResult()
    start = time.monotonic()
    try:
        with suppress(SwarmwrightError, BudgetSpent):  # the run itself is finished
            for first in range(0, len(numbers), MIN_EVALUATIONS):
                if first and time.monotonic() - start > _MAX_TIME_SHARE * seconds:
                    break
                evaluations_part = [
                    reader.evaluation(number, None) for number in numbers[first : first + MIN_EVALUATIONS]
                ]
                _repeat(experiment, reader, backend, evaluations_part, result, on_progress)
    finally:  # report differences even if the audit is interrupted
        if result.first is not None:
            _warn(experiment, result)
    return result.to_mapping() if result.episodes or result.failed else None


def _is_auditable(experiment: Experiment, backend: Backend) -> bool:
    """Return whether episodes should be reproducible and are not computed by built-in code alone."""
    name = experiment.simulation
    if has_python_modules(experiment):
        return True
    if not is_python(name):
        return backend.is_foreign or find_built_in(name) is None
    if SimulationName.parse(name).library == "vmas":  # sums depend on the number of parallel episodes
        return False
    if not is_command(name):
        return True
    options = parse_name(name)
    declared = getattr(options, "determinism", None)
    # Commands declare no tolerance. Robots of a ROS system may run in real time.
    return declared != "statistical" and (declared is not None or not isinstance(options, RosOptions))


def _choose_evaluations(
    experiment: Experiment, reader: StoreReader, backend: Backend, share: float
) -> list[int]:
    """Return the numbers of the evaluations to repeat, in random order after the best one."""
    last = reader.last()
    if last is None:
        return []
    first = reader.find_first_of_present_code()
    end = last.evaluations
    number_wanted = max(MIN_EVALUATIONS, math.ceil(share * (end - first)))
    # Some were repeated during the run.
    number_wanted -= backend.incidents().get("audits", 0) // experiment.ranking.episodes
    if number_wanted <= 0:
        return []
    random = np.random.default_rng([_SEED, end])
    numbers = random.choice(end - first, size=min(number_wanted, end - first), replace=False) + first
    best = reader.evaluation(None, None).number  # with noise, the best was partly lucky
    if best < first:
        return [int(number) for number in numbers]
    return [best, *(int(number) for number in numbers if number != best)][:number_wanted]


def _repeat(
    experiment: Experiment,
    reader: StoreReader,
    backend: Backend,
    evaluations: Sequence[Evaluation],
    result: _AuditResult,
    on_progress: Progress | None,
) -> None:
    """Repeat all successful episodes of some evaluations, and compare them."""
    before = reader.evaluators({evaluation.generation for evaluation in evaluations})
    representation = experiment.representation(backend.sensors, backend.actuators)
    controllers = Controllers.from_genomes(
        representation, np.stack([evaluation.genome for evaluation in evaluations])
    )
    positions = [
        (index, episode)
        for index, evaluation in enumerate(evaluations)
        for episode in np.flatnonzero(np.isfinite(evaluation.episodes)).tolist()
    ]
    # In another order than in the run, to detect state that carries over from one episode to the next.
    positions = [positions[index] for index in np.random.default_rng(_SEED).permutation(len(positions))]
    episodes = [
        AuditedEpisode(
            index,
            evaluation.seeds[episode],
            before.find_server(evaluation.generation, evaluation.candidate, episode),
        )
        for index, episode in positions
        for evaluation in (evaluations[index],)
    ]
    if not episodes:
        return
    backend.announce_post_evaluation()
    results, servers = backend.repeat(controllers, episodes, on_progress or (lambda *_: None))
    compared = set()
    for row, ((index, episode), requested, server) in enumerate(
        zip(positions, episodes, servers, strict=True)
    ):
        candidate, fitness = evaluations[index], float(results.fitness[row, 0])
        tolerance = backend.tolerance({requested.before, server})
        if tolerance is None:
            continue
        if not np.isfinite(fitness):
            result.failed += 1
            continue
        compared.add(candidate.number)
        result.episodes += 1
        between = {each for each in (requested.before, server) if each is not None}
        result.elsewhere += len(between) > 1
        measured = results.metrics[row, 0]
        pairs = [("fitness", float(candidate.episodes[episode]), fitness)]
        pairs += zip(backend.metrics, candidate.metrics[episode].tolist(), measured.tolist(), strict=False)
        different = [pair for pair in pairs if not _are_equal(pair[1], pair[2], tolerance)]
        if different:
            result.differ.add(candidate.number)
            result.servers.append(between if len(between) > 1 else set())
            if result.first is None:
                result.first = (candidate, episode, different[0])
    result.repeated += len(compared)


def _are_equal(recorded: float, repeated: float, tolerance: float) -> bool:
    if not (math.isfinite(recorded) and math.isfinite(repeated)):
        return math.isfinite(recorded) == math.isfinite(repeated)
    return abs(repeated - recorded) <= tolerance * max(1.0, abs(repeated), abs(recorded))


def _warn(experiment: Experiment, result: _AuditResult) -> None:
    """Log the first difference, its likely cause and the remedy."""
    assert result.first is not None
    audited, episode, (quantity, recorded, repeated) = result.first
    logging.getLogger("swarmwright").warning(
        "%d of %d repeated evaluations gave different results, the first in generation %d, candidate %d, "
        "seed %d: the %s was %r and is now %r. The run is not reproducible: %s does not depend on parameters "
        "and seed alone%s; %s",
        len(result.differ), result.repeated, audited.generation, audited.candidate, audited.seeds[episode],
        quantity, recorded, repeated, _suspect(experiment), _suspect_servers(result.servers),
        _advice(experiment),
    )  # fmt: skip


def _suspect_servers(servers: Sequence[set[int]]) -> str:
    """Return the servers as a further possible cause if all differences are between two servers.

    servers: the two of each difference; empty if fewer than two known servers were involved.
    """
    if not all(servers):
        return ""
    shared = set.intersection(*servers)
    if len(shared) == 1 and len(set.union(*servers)) > 2:
        (server,) = shared
        return f", or server {server}, involved in every difference, computes differently"
    return ", or the servers compute differently"


def _suspect(experiment: Experiment) -> str:
    """Return what probably causes the differences."""
    name = experiment.simulation
    if is_command(name):
        return "the output of the command"
    if is_environment(name):
        return "an episode of the environment"
    return "some Python code" if _is_in_python(experiment) else "an episode of the simulation"


def _is_in_python(experiment: Experiment) -> bool:
    return is_python(experiment.simulation) or has_python_modules(experiment)


def _advice(experiment: Experiment) -> str:
    """Return the remedy, with the page that explains it."""
    if is_command(experiment.simulation):
        return (
            "derive all random numbers from the episode's seed, or set simulation.determinism to none, see "
            "docs/how-to/attach-command.md"
        )
    if is_environment(experiment.simulation):
        return "reset(seed=..) must seed all random numbers, see docs/how-to/use-environments.md"
    if not _is_in_python(experiment):
        return (
            "derive all random numbers in the simulation from the episode's seed and reset all state at the "
            "start of an episode, or let its server declare its determinism as none"
        )
    if not is_python(experiment.simulation):
        return "try swarmwright.testing.check_behaviour and check_condition, see docs/how-to/plug-ins.md"
    check = "swarmwright.testing.check_simulation"
    if issubclass(load(experiment.simulation), BatchSimulation):  # episodes may depend on their batch
        check += " and check_batch_simulation"
    return f"try {check}, see `Test it` in docs/how-to/own-simulation.md"
