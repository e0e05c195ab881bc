"""Checks of behaviours and conditions in Python."""

import numpy as np
from numpy.typing import NDArray

from swarmwright.core import modules
from swarmwright.core.random_numbers import Stream
from swarmwright.modules import RandomNumbers, Senses
from swarmwright.modules.machine import called, random_words
from swarmwright.modules.registered import implementation, module

_ROBOTS, _STEPS = 40, 30


def check_behaviour(name: str) -> None:
    """Check a behaviour: a registered one, or `path/to/file.py:Class`.

    AssertionError says what is wrong, InputError and RunError too.
    """
    _check("behaviour", name)


def check_condition(name: str) -> None:
    """Check a condition; see `check_behaviour`."""
    _check("condition", name)


def _check(what: str, name: str) -> None:
    known = module(what, name)
    sensors = _sensors()
    parameters = _parameters(known)
    together = _run(what, name, sensors, parameters)
    again = _run(what, name, sensors, parameters)
    assert together.tobytes() == again.tobytes(), (
        f"{name}: the same senses, parameters and random numbers gave different results: keep what is to be "
        "remembered in `state` alone, and take random numbers from `random`"
    )
    for robot in range(0, _ROBOTS, 7):
        row = slice(robot, robot + 1)
        alone = _run(what, name, sensors[:, row], {key: value[row] for key, value in parameters.items()})
        assert alone[:, 0].tobytes() == together[:, robot].tobytes(), (
            f"{name}: what a robot does depends on robots in other rows"
        )
    if what == "condition":
        assert ((together >= 0) & (together <= 1)).all(), f"{name}: probabilities must be 0 to 1"


def _run(
    what: str, name: str, sensors: NDArray[np.float32], parameters: dict[str, NDArray[np.float32]]
) -> NDArray[np.float32]:
    """Return what comes out in each step, (steps, robots, ..), with a new object."""
    robots = sensors.shape[1]
    shape: tuple[int, ...]
    if what == "behaviour":
        behaviour = implementation("behaviour", module(what, name))()
        method, shape, kept = behaviour.act, (robots, 2), behaviour.state
    else:
        condition = implementation("condition", module(what, name))()
        method, shape, kept = condition.probability, (robots,), condition.state
    state = np.zeros((robots, kept), dtype=np.float32)
    found = []
    for seen in sensors:
        bits = (seen[:, 8] * 16777216).astype(np.uint32)
        random = RandomNumbers(bits, 0, random_words(bits))
        before, given = seen.tobytes(), {key: value.copy() for key, value in parameters.items()}
        found.append(called(method, name, Senses.of(seen), given, state, random, shape=shape))
        assert seen.tobytes() == before, f"{name}: the senses must not be changed"
        same = all(given[key].tobytes() == parameters[key].tobytes() for key in parameters)
        assert same, f"{name}: parameters must not be changed"
        assert np.isfinite(state).all(), f"{name}: the state holds a number that is not finite"
    return np.array(found)


def _sensors() -> NDArray[np.float32]:
    """Return what robots might sense, (steps, robots, 9)."""
    stream = Stream(1, "senses")
    found = stream.unit(_STEPS * _ROBOTS * modules.SENSORS).reshape(_STEPS, _ROBOTS, modules.SENSORS)
    found[..., [0, 1, 2, 3, 6, 7]] = 2 * found[..., [0, 1, 2, 3, 6, 7]] - 1
    found[..., 4] = np.floor(3 * found[..., 4]) / 2
    found[..., 5] = np.floor(8 * found[..., 5])
    return found.astype(np.float32)


def _parameters(known: modules.Module) -> dict[str, NDArray[np.float32]]:
    stream = Stream(1, "parameters")
    made = {}
    for name, (low, high, whole) in known.parameters.items():
        values = low + (high - low) * stream.unit(_ROBOTS)
        made[name] = (np.round(values) if whole else values).astype(np.float32)
    return made
