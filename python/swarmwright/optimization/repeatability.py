"""Repeating an episode of a run's best, to find code of users that is not a function of its seed."""

import logging
from contextlib import suppress
from typing import Any

import numpy as np

from swarmwright.commands.checking import definition_of_name
from swarmwright.commands.definition import CommandOptions
from swarmwright.core.errors import SwarmwrightError
from swarmwright.core.simulation_names import SimulationName, is_command, is_environment, is_python
from swarmwright.evaluation.base import Backend, BudgetSpent, Controllers
from swarmwright.experiment.derived import has_python_modules
from swarmwright.experiment.experiment import Experiment
from swarmwright.simulations.batches import BatchSimulation
from swarmwright.simulations.loading import load
from swarmwright.store import Evaluation, StoreReader

_LONGEST_S = 5.0
"""Seconds that an episode may take to be repeated."""


def warn_of_difference(
    experiment: Experiment, reader: StoreReader, backend: Backend, mean_s: float | None
) -> None:
    """Warn where the first episode of a run's best has another fitness when it is repeated.

    Only code of users is asked: simulations and modules in Python, environments of Gymnasium and PettingZoo,
    and commands, unless they declare that episodes differ or take too long. Nothing of it is recorded.

    Args:
        experiment: as it was run.
        reader: reads the run.
        backend: evaluates.
        mean_s: seconds of an episode, where it is known better than from the journal.
    """
    tolerance = _tolerance(experiment)
    if tolerance is None or reader.last() is None:
        return
    best = reader.evaluation(None, None)
    if not _of_present_code(reader, best.generation):
        return
    shares = [one.seconds / one.evaluations for one in reader.servers() if one.evaluations]
    seconds = max(shares, default=mean_s)
    if seconds is None or seconds > _LONGEST_S or not np.isfinite(best.episodes[0]):
        return
    repeated = _repeated(experiment, backend, best)
    recorded = float(best.episodes[0])
    if repeated is None or abs(repeated - recorded) <= tolerance * max(1.0, abs(repeated), abs(recorded)):
        return
    logging.getLogger("swarmwright").warning(
        "an episode that was repeated with the same seed has another fitness, %r instead of %r (generation "
        "%d, candidate %d, seed %d), so that the run cannot be repeated: %s does not follow from parameters "
        "and seed alone%s; %s",
        repeated, recorded, best.generation, best.candidate, best.seeds[0], _suspect(experiment.simulation),
        ", or servers on different machines compute differently" if shares else "", _advice(experiment),
    )  # fmt: skip


def _suspect(name: str) -> str:
    """Return what has given another fitness."""
    if is_command(name):
        return "what the command computes"
    return "an episode of the environment" if is_environment(name) else "some of the code in Python"


def _advice(experiment: Experiment) -> str:
    """Return which checks find the cause, or what it may be, and the page that has them."""
    if is_command(experiment.simulation):
        return (
            "have it take all random numbers from the episode's seed, or declare simulation.determinism: "
            "none, see docs/how-to/attach-command.md"
        )
    if is_environment(experiment.simulation):
        return "reset(seed=..) has to seed all random numbers, see docs/how-to/use-environments.md"
    if not is_python(experiment.simulation):
        return "see `Test it` in docs/how-to/own-module.md"
    check = "swarmwright.testing.check_simulation"
    if issubclass(load(experiment.simulation), BatchSimulation):  # they may depend on others of their batch
        check += " and check_batch_simulation"
    return f"try {check}, see `Test it` in docs/how-to/own-simulation.md"


def _of_present_code(reader: StoreReader, generation: int) -> bool:
    """Whether a generation was evaluated by the code of the last session; others may differ on purpose."""
    sessions = {one.session: one.code for one in reader.sessions()}
    return sessions[reader.session_of(generation)] == sessions[max(sessions)]


def _tolerance(experiment: Experiment) -> float | None:
    """Return how far fitness may differ, as a part of the larger one; None where nothing is repeated."""
    name = experiment.simulation
    if not is_python(name):
        return 0.0 if has_python_modules(experiment) else None
    if is_command(name):
        # Robots of a ROS system may run in real time.
        options = definition_of_name(name)
        is_asked = isinstance(options, CommandOptions) and options.determinism in {None, "bitwise"}
        return 0.0 if is_asked else None
    if SimulationName.parse(name).library == "vmas":  # sums differ with the number of episodes beside it
        return None
    kind: Any = load(name)
    declared, tolerance = kind.determinism, kind.tolerance
    if declared == "statistical" and isinstance(tolerance, int | float):
        return float(tolerance)
    # What a property says would need an object.
    return 0.0 if declared in {None, "bitwise"} else None


def _repeated(experiment: Experiment, backend: Backend, best: Evaluation) -> float | None:
    """Return the fitness of the first episode now; None where it fails, or no server may compute it."""
    with suppress(SwarmwrightError, BudgetSpent):  # the run itself is finished
        representation = experiment.representation(backend.sensors, backend.actuators)
        controllers = Controllers.of(representation, best.genome[np.newaxis])
        backend.post_evaluates()
        fitness = float(backend.evaluate(controllers, best.seeds[:1], lambda *_: None).fitness[0, 0])
        return fitness if np.isfinite(fitness) else None
    return None
