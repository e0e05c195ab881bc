"""The numbers of state machines, and of machines and trees of modules, as code of any language has them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common import modules
from swarmwright.export.subject import Subject


def machine_tables(subject: Subject) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the next state of each row of a state machine, and its outputs, (rows, actuators), limited."""
    specification = subject.specification
    rows = subject.weights.reshape(-1, 1 + int(specification["actuators"]))
    states = np.clip(rows[:, 0], 0, int(specification["states"]) - 1)
    return np.trunc(states).astype(np.int64), np.clip(rows[:, 1:], np.float32(-1), np.float32(1))


def machine_weights(subject: Subject) -> NDArray[np.float32]:
    """Return the weights of a machine or tree of modules within their limits; those not used are 0."""
    specification = subject.specification
    sizes = (int(specification["states"]), int(specification["transitions"]))
    known = catalogue_of(specification)
    return np.array(modules.weights_of(modules.states_of(specification), *sizes, known), np.float32)


def catalogue_of(specification: Mapping[str, Any]) -> modules.Catalogue:
    """Return the engine's modules, by whose numbers code knows them, then those of authors in their order."""
    known = modules.Catalogue.of(specification)
    return modules.Catalogue(
        (*modules.BUILT_IN.behaviours, *own_modules(known.behaviours)),
        (*modules.BUILT_IN.conditions, *own_modules(known.conditions)),
    )


def own_modules(parts: tuple[modules.Module, ...]) -> list[modules.Module]:
    """Return those that are not the engine's."""
    return [one for one in parts if not one.built_in]
