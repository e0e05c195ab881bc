"""Whether `reset` brings an environment back to where it was, which one object for all episodes needs.

Some environments keep contacts, lists or running means over `reset`. What happens in an episode would then
depend on the episodes before, and so on which server has evaluated which candidate.
"""

from collections.abc import Callable, Iterator
from enum import Enum, auto
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEPS = 200
"""Steps of a trial, at most. Those of BipedalWalker-v3 differ once it has fallen, those of
knights_archers_zombies once a zombie has got through, after 141."""

Actions = Callable[[int], NDArray[np.float64]]
"""Number of actuators -> what they do in a step, -1 to 1."""
Trial = Callable[[Any, int, Actions], Iterator[bytes]]
"""(environment, seed, actions) -> what an episode returns, step after step."""


class Restoring(Enum):
    """What trials have shown."""

    RESTORED = auto()
    """An episode with the same seed and actions is the same again."""
    NEW_ONLY = auto()
    """It is the same in a new object only."""
    NEVER = auto()
    """It differs even in a new object: not all randomness comes from the seed."""


def found_by_trials(make: Callable[[], Any], trial: Trial) -> Restoring:
    """Compare an episode with its repetition after another one, to the bit.

    Only new objects are used, so that the ones that evaluate are what they are without the comparison.

    Args:
        make: returns a new environment.
        trial: runs an episode.
    """
    env = make()
    try:
        first = _record(env, trial, 0)
        _record(env, trial, 1)
        if _record(env, trial, 0) == first:
            return Restoring.RESTORED
    finally:
        _close(env)
    env = make()
    try:
        return Restoring.NEW_ONLY if _record(env, trial, 0) == first else Restoring.NEVER
    finally:
        _close(env)


def _record(env: Any, trial: Trial, seed: int) -> list[bytes]:  # noqa: ANN401 - types of libraries
    """Return what an episode returns; one that fails ends with the exception, which episodes report."""
    generator = np.random.default_rng(seed)

    def actions(width: int) -> NDArray[np.float64]:
        return generator.uniform(-1, 1, width) if seed else np.zeros(width)

    returned = []
    try:
        for _, one in zip(range(STEPS + 1), trial(env, seed, actions), strict=False):
            returned.append(one)
    except Exception as error:  # noqa: BLE001 - libraries raise various exceptions
        returned.append(type(error).__name__.encode())
    return returned


def _close(env: Any) -> None:  # noqa: ANN401 - types of libraries
    if hasattr(env, "close"):
        env.close()
