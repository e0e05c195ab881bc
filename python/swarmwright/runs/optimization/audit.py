"""The audit at the end of a run: some of its evaluations are repeated and compared.

`faults: {audit}` says how many. What it finds is a warning and a fact of the store; the record stays as it
is.
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
from swarmwright.simulations.command.checking import definition_of_name
from swarmwright.simulations.command.ros_definition import RosOptions
from swarmwright.simulations.loading import load

LEAST = 30
"""Evaluations that are repeated at least. A fault that shows in 12 % of the evaluations is found with a
probability of 1 - 0.88^30 = 97.8 %."""
SHARE = 0.01
"""Of the evaluations of a run, with `audit: auto`."""
_TIME = 0.05
"""Of a run's time, for evaluations beyond the least number."""
_LONG_S = 5.0
"""An audit that takes longer is announced."""
_STREAM = 0x6175_6469
"""Seed of what is drawn."""
_progress = logging.getLogger("swarmwright.progress")


@dataclass
class _Found:
    """What an audit has found so far."""

    repeated: int = 0
    """Evaluations with at least one episode that was compared."""
    episodes: int = 0
    """Episodes that were compared."""
    elsewhere: int = 0
    """Of these, those that another server repeated."""
    failed: int = 0
    """Episodes that failed when they were repeated."""
    differ: set[int] = field(default_factory=set)
    """Numbers of the evaluations that came out differently."""
    first: tuple[Evaluation, int, tuple[str, float, float]] | None = None
    """The first that did: evaluation, episode, and what it is, as it was recorded and as it is now."""
    servers: list[set[int]] = field(default_factory=list)
    """The two servers of each difference; empty where no server, or one, did both."""

    def to_mapping(self) -> dict[str, int]:
        """Return what the store keeps."""
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
    """Repeat evaluations of a run that has ended, and warn where they come out differently.

    A random sample of the evaluations is repeated, in another order, on another server than before where
    there is one: `LEAST` of them or the experiment's share, whichever is more; beyond the least number as
    many as fit into 5 % of the run's time. The best evaluation is one of them. Nothing of it is recorded.

    Args:
        experiment: as it was run.
        reader: reads the run.
        backend: evaluates.
        on_progress: as in `optimize`.
        seconds: that the evaluations of this session took.
        evaluations: of this session.

    Returns how many evaluations were repeated and how many of them came out differently; None where none is
    repeated: `audit: 0`, a simulation that declares that episodes differ, or a built-in one.
    """
    share = experiment.faults.audit
    if share == 0 or not evaluations or not _is_asked(experiment, backend):
        return None
    chosen = _chosen(experiment, reader, backend, SHARE if share == AUTO else float(share))
    if not chosen:
        return None
    least = min(len(chosen), LEAST)
    expected = seconds / evaluations * least
    if expected > _LONG_S:
        _progress.info(
            "auditing: repeating %d evaluations, which takes about %s; `faults: {audit: 0}` leaves this out",
            least, format_duration(expected),
        )  # fmt: skip
    found = _Found()
    begun = time.monotonic()
    try:
        with suppress(SwarmwrightError, BudgetSpent):  # the run itself is finished
            for first in range(0, len(chosen), LEAST):
                if first and time.monotonic() - begun > _TIME * seconds:
                    break
                part = [reader.evaluation(number, None) for number in chosen[first : first + LEAST]]
                _repeat(experiment, reader, backend, part, found, on_progress)
    finally:  # what was found is told also where the audit is interrupted
        if found.first is not None:
            _warn(experiment, found)
    return found.to_mapping() if found.episodes or found.failed else None


def _is_asked(experiment: Experiment, backend: Backend) -> bool:
    """Whether episodes are expected to be the same again, unless this project's own code computes them."""
    name = experiment.simulation
    if has_python_modules(experiment):
        return True
    if not is_python(name):
        return backend.is_foreign or find_built_in(name) is None
    if SimulationName.parse(name).library == "vmas":  # sums differ with the number of episodes beside it
        return False
    if not is_command(name):
        return True
    options = definition_of_name(name)
    declared = getattr(options, "determinism", None)
    # They have no tolerance. Robots of a ROS system may run in real time.
    return declared != "statistical" and (declared is not None or not isinstance(options, RosOptions))


def _chosen(experiment: Experiment, reader: StoreReader, backend: Backend, share: float) -> list[int]:
    """Return the numbers of the evaluations to repeat, in random order after the best one."""
    last = reader.last()
    if last is None:
        return []
    first = reader.first_of_present_code()
    end = last.evaluations
    count = max(LEAST, math.ceil(share * (end - first)))
    # Those that were repeated during the run.
    count -= backend.incidents().get("audits", 0) // experiment.ranking.episodes
    if count <= 0:
        return []
    random = np.random.default_rng([_STREAM, end])
    numbers = random.choice(end - first, size=min(count, end - first), replace=False) + first
    best = reader.evaluation(None, None).number  # with noise, luck makes the best
    if best < first:
        return [int(number) for number in numbers]
    return [best, *(int(number) for number in numbers if number != best)][:count]


def _repeat(
    experiment: Experiment,
    reader: StoreReader,
    backend: Backend,
    chosen: Sequence[Evaluation],
    found: _Found,
    on_progress: Progress | None,
) -> None:
    """Repeat all episodes of some evaluations that did not fail, and compare them."""
    before = reader.evaluators({evaluation.generation for evaluation in chosen})
    representation = experiment.representation(backend.sensors, backend.actuators)
    controllers = Controllers.from_genomes(
        representation, np.stack([evaluation.genome for evaluation in chosen])
    )
    places = [
        (index, episode)
        for index, evaluation in enumerate(chosen)
        for episode in np.flatnonzero(np.isfinite(evaluation.episodes)).tolist()
    ]
    # In another order than in the run: what an episode leaves behind is to meet another one.
    places = [places[index] for index in np.random.default_rng(_STREAM).permutation(len(places))]
    wanted = [
        AuditedEpisode(
            index, evaluation.seeds[episode], before.of(evaluation.generation, evaluation.candidate, episode)
        )
        for index, episode in places
        for evaluation in (chosen[index],)
    ]
    if not wanted:
        return
    backend.announce_post_evaluation()
    results, servers = backend.repeat(controllers, wanted, on_progress or (lambda *_: None))
    compared = set()
    for row, ((index, episode), asked, server) in enumerate(zip(places, wanted, servers, strict=True)):
        candidate, fitness = chosen[index], float(results.fitness[row, 0])
        tolerance = backend.tolerance({asked.before, server})
        if tolerance is None:
            continue
        if not np.isfinite(fitness):
            found.failed += 1
            continue
        compared.add(candidate.number)
        found.episodes += 1
        between = {each for each in (asked.before, server) if each is not None}
        found.elsewhere += len(between) > 1
        measured = results.metrics[row, 0]
        pairs = [("fitness", float(candidate.episodes[episode]), fitness)]
        pairs += zip(backend.metrics, candidate.metrics[episode].tolist(), measured.tolist(), strict=False)
        different = [pair for pair in pairs if not _are_alike(pair[1], pair[2], tolerance)]
        if different:
            found.differ.add(candidate.number)
            found.servers.append(between if len(between) > 1 else set())
            if found.first is None:
                found.first = (candidate, episode, different[0])
    found.repeated += len(compared)


def _are_alike(recorded: float, repeated: float, tolerance: float) -> bool:
    if not (math.isfinite(recorded) and math.isfinite(repeated)):
        return math.isfinite(recorded) == math.isfinite(repeated)
    return abs(repeated - recorded) <= tolerance * max(1.0, abs(repeated), abs(recorded))


def _warn(experiment: Experiment, found: _Found) -> None:
    """Say what came out differently, and what to do."""
    assert found.first is not None
    audited, episode, (what, recorded, repeated) = found.first
    logging.getLogger("swarmwright").warning(
        "%d of %d evaluations that were repeated came out differently, such as generation %d, candidate %d, "
        "seed %d: the %s was %r and is %r; the run cannot be repeated: %s does not follow from parameters "
        "and seed alone%s; %s",
        len(found.differ), found.repeated, audited.generation, audited.candidate, audited.seeds[episode],
        what, recorded, repeated, _suspect(experiment), _of_servers(found.servers), _advice(experiment),
    )  # fmt: skip


def _of_servers(servers: Sequence[set[int]]) -> str:
    """Return what else may be the cause where all differences are between two servers.

    servers: the two of each difference; empty where one server, or none, evaluated both times.
    """
    if not all(servers):
        return ""
    shared = set.intersection(*servers)
    if len(shared) == 1 and len(set.union(*servers)) > 2:
        (server,) = shared
        return f", or server {server}, which was one of the two each time, computes differently"
    return ", or the servers compute differently"


def _suspect(experiment: Experiment) -> str:
    """Return what has come out differently."""
    name = experiment.simulation
    if is_command(name):
        return "what the command computes"
    if is_environment(name):
        return "an episode of the environment"
    return "some of the code in Python" if _is_in_python(experiment) else "an episode of the simulation"


def _is_in_python(experiment: Experiment) -> bool:
    return is_python(experiment.simulation) or has_python_modules(experiment)


def _advice(experiment: Experiment) -> str:
    """Return which checks find the cause, or what it may be, and the page that has them."""
    if is_command(experiment.simulation):
        return (
            "have it take all random numbers from the episode's seed, or declare simulation.determinism: "
            "none, see docs/how-to/attach-command.md"
        )
    if is_environment(experiment.simulation):
        return "reset(seed=..) has to seed all random numbers, see docs/how-to/use-environments.md"
    if not _is_in_python(experiment):
        return (
            "have the simulation take all random numbers from the episode's seed and set everything anew at "
            "the start of an episode, or have its server declare its determinism as none"
        )
    if not is_python(experiment.simulation):
        return "try swarmwright.testing.check_behaviour and check_condition, see docs/how-to/plug-ins.md"
    check = "swarmwright.testing.check_simulation"
    if issubclass(load(experiment.simulation), BatchSimulation):  # they may depend on others of their batch
        check += " and check_batch_simulation"
    return f"try {check}, see `Test it` in docs/how-to/own-simulation.md"
