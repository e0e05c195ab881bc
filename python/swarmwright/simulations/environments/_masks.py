"""Action masks: which choices an environment allows, as it says in its observations.

The form of PettingZoo and others: the observation is a dictionary with `action_mask`, 1 for each choice that
is allowed and 0 for others, beside what is observed.
"""

from collections.abc import Callable, Mapping
from typing import Any, NoReturn

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

MASK = "action_mask"
"""Key of the mask in an observation."""
Allowed = NDArray[np.bool_]
"""(choices,), those of one part of an action after those of the other."""


def mask_width(observations: Any, actions: Any) -> int:  # noqa: ANN401 - spaces of an environment
    """Return how many choices the mask in observations is of; 0 where none fits the actions."""
    if not isinstance(observations, spaces.Dict) or set(observations.spaces) <= {MASK}:
        return 0
    match actions:
        case spaces.Discrete():
            choices = int(actions.n)
        case spaces.MultiDiscrete():
            choices = int(actions.nvec.sum())
        case _:
            return 0
    mask = observations.spaces.get(MASK)
    parts: tuple[Any, ...] = mask.spaces if isinstance(mask, spaces.Tuple) else (mask,)
    if not all(isinstance(part, spaces.Box | spaces.MultiBinary | spaces.MultiDiscrete) for part in parts):
        return 0
    sizes = [int(np.prod(part.shape)) for part in parts]
    return choices if sum(sizes) == choices else 0


def mask_reader(
    observations: Any,  # noqa: ANN401 - as above
    actions: Any,  # noqa: ANN401
    refuse: Callable[[Any], NoReturn],
) -> Callable[[Any], Allowed | None]:
    """Return what reads the choices that an observation allows; None stands for all.

    All are allowed where the mask has none, as that of an agent whose turn it is not.

    Args:
        observations: their space.
        actions: their space.
        refuse: raises for a mask of another size, and for None where an observation has none.
    """
    width = mask_width(observations, actions)
    if not width:
        return lambda _: None

    def read(seen: Any) -> Allowed | None:  # noqa: ANN401 - an observation
        mask = seen.get(MASK) if isinstance(seen, Mapping) else None
        if mask is None:
            refuse(None)
        flat = (
            np.concatenate([np.ravel(part) for part in mask]) if isinstance(mask, tuple) else np.ravel(mask)
        )
        if flat.size != width:
            refuse(mask)
        allowed = flat > 0
        return allowed if allowed.any() else None

    return read
