"""Checks of behaviours and conditions in Python."""

import copy
import pickle
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.modules import Behaviour, Condition, RandomNumbers, Senses, grammar
from swarmwright.controllers.modules.machine import call_module, random_words
from swarmwright.controllers.modules.registered import implementation, module

_ROBOTS, _STEPS = 40, 30


def check_behaviour(name: str) -> None:
    """Check a behaviour: a registered one, or `path/to/file.py:Class`.

    It acts for forty robots in thirty steps: with a new object, with the same object again, with another one,
    and for some robots alone; all must agree to the bit. It must not change its arguments or its object.

    Raises AssertionError, InputError or RunError with the problem.
    """
    _check("behaviour", name)


def check_condition(name: str) -> None:
    """Check a condition; see `check_behaviour`."""
    _check("condition", name)


def _check(sort: str, name: str) -> None:
    declared = module(sort, name)
    sensors = _sensors()
    parameters = _parameters(declared)
    instance = _create(sort, name)
    before = _contents(instance)
    together = _run(name, instance, sensors, parameters)
    for other in (instance, _create(sort, name)):
        repeated = _run(name, other, sensors, parameters)
        assert together.tobytes() == repeated.tobytes(), (
            f"{name}: the same senses, parameters and random numbers gave different results: keep what is to "
            "be remembered in `state` alone, and take random numbers from `random`"
        )
    after = _contents(instance)
    changed = sorted(key for key in before | after if before.get(key) != after.get(key))
    assert not changed, (
        f"{name}: self.{changed[0]} was set or changed: keep what is to be remembered in `state` alone, "
        "since all robots of all episodes share the object, and set constants in __init__"
    )
    for robot in range(0, _ROBOTS, 7):
        row = slice(robot, robot + 1)
        subset = {key: value[row] for key, value in parameters.items()}
        alone = _run(name, instance, sensors[:, row], subset)
        assert alone[:, 0].tobytes() == together[:, robot].tobytes(), (
            f"{name}: what a robot does depends on robots in other rows"
        )


def _create(sort: str, name: str) -> Behaviour | Condition:
    """Create an object of the module."""
    declared = module(sort, name)
    kind = (
        implementation("behaviour", declared)
        if sort == "behaviour"
        else implementation("condition", declared)
    )
    return kind()


def _contents(instance: Behaviour | Condition) -> dict[str, Any]:
    """Return the attributes of an object in a comparable form."""
    contents: dict[str, Any] = {}
    for key, value in vars(instance).items():
        try:
            contents[key] = pickle.dumps(copy.deepcopy(value))
        except Exception:  # noqa: BLE001 - any object may refuse it; that it is another one is seen then
            contents[key] = id(value)
    return contents


def _run(
    name: str,
    instance: Behaviour | Condition,
    sensors: NDArray[np.float32],
    parameters: dict[str, NDArray[np.float32]],
) -> NDArray[np.float32]:
    """Return the outputs of an object of the module, (steps, robots, ..)."""
    robots = sensors.shape[1]
    acts = isinstance(instance, Behaviour)
    method = instance.act if isinstance(instance, Behaviour) else instance.probability
    shape: tuple[int, ...] = (robots, 2) if acts else (robots,)
    state = np.zeros((robots, instance.state), dtype=np.float32)
    outputs = []
    for values in sensors:
        bits = (values[:, 8] * 16777216).astype(np.uint32)
        random = RandomNumbers(bits, 0, random_words(bits))
        before, copied = values.tobytes(), {key: value.copy() for key, value in parameters.items()}
        outputs.append(
            call_module(method, name, Senses.from_rows(values), copied, state, random, shape=shape)
        )
        assert values.tobytes() == before, f"{name}: the senses must not be changed"
        same = all(copied[key].tobytes() == parameters[key].tobytes() for key in parameters)
        assert same, f"{name}: parameters must not be changed"
        assert np.isfinite(state).all(), f"{name}: the state holds a number that is not finite"
    return np.array(outputs)


def _sensors() -> NDArray[np.float32]:
    """Return plausible sensor values, (steps, robots, 9)."""
    stream = Stream(1, "senses")
    sensors = stream.unit(_STEPS * _ROBOTS * grammar.SENSORS).reshape(_STEPS, _ROBOTS, grammar.SENSORS)
    sensors[..., [0, 1, 2, 3, 6, 7]] = 2 * sensors[..., [0, 1, 2, 3, 6, 7]] - 1
    sensors[..., 4] = np.floor(3 * sensors[..., 4]) / 2
    sensors[..., 5] = np.floor(8 * sensors[..., 5])
    return sensors.astype(np.float32)


def _parameters(declared: grammar.Module) -> dict[str, NDArray[np.float32]]:
    stream = Stream(1, "parameters")
    arrays = {}
    for name, (low, high, whole) in declared.parameters.items():
        values = low + (high - low) * stream.unit(_ROBOTS)
        arrays[name] = (np.round(values) if whole else values).astype(np.float32)
    return arrays
