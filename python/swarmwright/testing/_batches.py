"""Checks that a BatchSimulation's results do not depend on the number of episodes."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmwright.simulations.batches import BatchSimulation
from swarmwright.simulations.host import Host
from swarmwright.testing._simulations import MOST_STEPS, class_of

EPISODES = 7
"""Enough for full and partial SIMD vectors in numpy's loops."""


def check_batch_simulation(
    simulation: type[BatchSimulation] | str, parameters: Mapping[str, Any] | None = None, *, seed: int = 1
) -> None:
    """Check that episodes do not depend on the others in the batch.

    Seven episodes are run at once, with random actions, and each alone: observations, who acts, when it ends,
    fitness and metrics must be the same, to the bit.

    Args:
        simulation: the class, or its name: `path/to/file.py:Class` or `package.module:Class`.
        parameters: with which it is reset; default: its defaults.
        seed: of the actions.

    AssertionError says what is wrong, InputError and RunError too.
    """
    kind = class_of(simulation, (BatchSimulation,), "a BatchSimulation; check_simulation checks others")
    given = dict(parameters or {})
    seeds = np.arange(EPISODES, dtype=np.uint64)
    together, alone = Host(kind), [Host(kind) for _ in seeds]
    seen = together.start(given, seeds)
    single = [one.start(given, seeds[i : i + 1]) for i, one in enumerate(alone)]
    random = np.random.default_rng(seed)
    ended = np.zeros(EPISODES, bool)
    for step in range(MOST_STEPS):
        for i, (acts, rows, over) in enumerate(single):
            if ended[i]:
                continue
            where = f"{kind.__name__}: after {step} steps, an episode alone has other"
            assert over[0] == seen[2][i], f"{where} end"
            if not over[0]:
                assert (acts[0] == seen[0][i]).all(), f"{where} agents that act"
                same = (rows[0] == seen[1][i])[acts[0]]
                assert same.all(), f"{where} observations"
        fresh = seen[2] & ~ended
        if fresh.any():
            found = together.results(bool(together.metrics))
            for i in np.flatnonzero(fresh).tolist():
                results = alone[i].results(bool(together.metrics))[:, 0]
                assert (results == found[:, i]).all(), (
                    f"{kind.__name__}: an episode alone has other results: {results}, not {found[:, i]}"
                )
            ended |= fresh
        if ended.all():
            return
        actions = random.uniform(-1, 1, (*seen[0].shape, together.actuators)).astype(np.float32)
        actions[~seen[0]] = 0
        seen = together.go(actions)
        single = [now if ended[i] else alone[i].go(actions[i : i + 1]) for i, now in enumerate(single)]
