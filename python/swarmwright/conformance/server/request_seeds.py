"""S9.20 and S10.7: seeds in messages of numbers."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swarmwright.conformance._extensions import ControllerSet, evaluation, free_again, numbers, played
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance._trajectory import Trajectory, same
from swarmwright.conformance.rules import NotTried
from swarmwright.conformance.server._evaluations import NUMBERS, SEEDS, announced_controllers, evaluated
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.batches import BATCHED, Batch, must_have_batches
from swarmwright.conformance.server.determinism import BEYOND_32_BITS, LARGEST_SEED
from swarmwright.servers.broker.client import Failure

_SEEDS = (BEYOND_32_BITS + 1, 2**53 + 1, LARGEST_SEED)
"""Seeds of evaluate and start that are others if bits are lost."""
_OTHER_SEED = 5
"""What `parameters` of evaluate and start say as seed, which the seeds of the message replace."""
_FIX = (
    "read each of seeds as an unsigned 64-bit integer, not as a double or with 32 bits, and put it into the "
    "parameters in place of a seed that is there"
)


@rule(
    "S9.20",
    "The seeds of evaluate are read exactly, and replace a seed in its parameters.",
    where=f"{NUMBERS}; protocol/schemas/evaluate.schema.json",
    fix=_FIX,
    needs=["S3.5", "S9.3", "S9.6"],
)
def seeds_of_evaluations(server: Server) -> None:
    """Seeds of more than 32 and of more than 53 bits, and another one in the parameters.

    Controllers that give another fitness with any seed are the matter of other rules.
    """
    controllers = announced_controllers(server, 1)
    server.comparable()
    parameters = {**server.settings.parameters, "seed": _OTHER_SEED}
    request = evaluation(server, controllers, _SEEDS, parameters=parameters)
    fitness = numbers(evaluated(server, request), "fitness", "<f8").tolist()
    free_again(server)
    if len(fitness) != len(_SEEDS):
        raise Failure(f"{len(fitness)} numbers", f"{len(_SEEDS)}, one for each episode")

    def stepwise(seed: int) -> Trajectory:
        trajectory: Trajectory = played(server, controllers, 0, seed)
        return trajectory

    for seed, value in zip(_SEEDS, fitness, strict=True):
        expected = stepwise(seed).fitness
        if not same(expected, value):
            _must_be_right(server, controllers)
            cause = _lost_seed(stepwise, seed, lambda other, value=value: same(other.fitness, value))  # type: ignore[misc]
            raise Failure(
                f"seed {seed}: {value!r} offloaded, {expected!r} stepwise{cause}",
                "the same bits",
                f'evaluate with the seeds {list(_SEEDS)}, and "seed": {_OTHER_SEED} in parameters',
            )


def _must_be_right(server: Server, controllers: ControllerSet) -> None:
    """NotTried unless a controller gives the stepwise fitness with a small seed, the only one."""
    parameters = {name: value for name, value in server.settings.parameters.items() if name != "seed"}
    request = evaluation(server, controllers, SEEDS[:1], parameters=parameters)
    fitness = numbers(evaluated(server, request), "fitness", "<f8").tolist()
    free_again(server)
    stepwise: Trajectory = played(server, controllers, 0, SEEDS[0])
    if len(fitness) != 1 or not same(stepwise.fitness, fitness[0]):
        kind = controllers.architecture["kind"]
        raise NotTried(
            f"controllers of the kind {kind} give another fitness offloaded than stepwise with the seed "
            f"{SEEDS[0]}, too"
        )


@rule(
    "S10.7",
    "The seeds of start are read exactly, and replace a seed in its parameters.",
    where=f"{BATCHED}; protocol/schemas/batch_start.schema.json",
    fix=_FIX,
    needs=["S3.5", "S10.1"],
)
def seeds_of_batches(server: Server) -> None:
    """Seeds of more than 32 and of more than 53 bits, one in a batch, and another one in the parameters."""
    must_have_batches(server)
    server.comparable()
    parameters = {**server.settings.parameters, "seed": _OTHER_SEED}
    for seed in _SEEDS:
        seen = Trajectory()

        def act(
            _episode: int, agent: int, sensors: NDArray[np.float32], seen: Trajectory = seen
        ) -> list[float]:
            readings = seen.readings[agent]
            readings.append(sensors)
            return list(server.policy(agent, len(readings) - 1, sensors))

        one = Batch(server, [seed], parameters=parameters)
        one.play(act)
        free_again(server)
        seen.fitness = one.fitness.get(0)
        difference = _difference(server, seed, seen)
        if difference:
            cause = _lost_seed(
                lambda other: _stepwise(server, other),
                seed,
                lambda other, seen=seen: not _differs(other, seen),  # type: ignore[misc]
            )
            raise Failure(
                f"seed {seed}, stepwise and batched: {difference}{cause}",
                "the same bits",
                f'start with the seed {seed}, and "seed": {_OTHER_SEED} in parameters',
            )


def _stepwise(server: Server, seed: int) -> Trajectory:
    return server.play(parameters={**server.settings.parameters, "seed": seed})


def _difference(server: Server, seed: int, seen: Trajectory) -> str:
    return _differs(_stepwise(server, seed), seen)


def _differs(stepwise: Trajectory, batched: Trajectory) -> str:
    """The first difference; metrics are not compared, since none were asked for."""
    return stepwise.difference(replace(batched, metrics=stepwise.metrics))


def _lost_seed(played: Callable[[int], Trajectory], seed: int, agrees: Callable[[Trajectory], bool]) -> str:
    """Which other seed an episode of `seed` was played with, in words; empty where none is found.

    played: the episode of a seed. agrees: whether what came is that episode.
    """
    causes = {
        _OTHER_SEED: "which is in parameters",
        seed & 0xFFFF_FFFF: "as if it were truncated to 32 bits",
        int(float(seed)): "as if it were read through a double, which has 53 bits",
    }
    for other, cause in causes.items():
        if other not in {seed, 2**63} and agrees(played(other)):
            return f", as with the seed {other}, {cause}"
    return ""
