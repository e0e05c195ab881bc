"""Properties derived from an experiment."""

import dataclasses
import marshal
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import InputError
from swarmwright.common.values import plain
from swarmwright.common.yaml import Source, read
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.experiment.broker_address import environment_prefix
from swarmwright.methods.rankings.slow_simulation import SlowOptions
from swarmwright.simulations.fitness import FitnessExpression

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment

_KEY = "_evaluation_key"
"""Attribute that caches an experiment's `evaluation_key`."""


def find_source(experiment: "Experiment", key: str) -> Source | None:
    """Return the experiment's file if it exists and contains a key, else None."""
    if experiment.path is not None:
        with suppress(InputError):
            source = read(experiment.path)
            value = source.values.get(key) if isinstance(source.values, Mapping) else None
            is_overridden = isinstance(value, str) and value != getattr(
                experiment, key
            )  # another value was set
            if value is not None and not is_overridden:
                return source
    return None


def place_of(experiment: "Experiment", key: str) -> str:
    """Return the position of a key, `file.yaml:3: simulation: `, as far as known."""
    source = find_source(experiment, key)
    return f"{key}: " if source is None else source.locate((key,))


def with_environment(experiment: "Experiment") -> "Experiment":
    """Return an experiment with the environment's topic prefix if it has none; records leave it out.

    Raises InputError for an invalid prefix.
    """
    prefix = "" if experiment.prefix else environment_prefix()
    return dataclasses.replace(experiment, prefix=prefix) if prefix else experiment


def evaluation_key(experiment: "Experiment") -> bytes | None:
    """Return a key of everything that the fitness of genomes depends on; None if it cannot be compared.

    Types count: 1 differs from 1.0.
    """
    attributes: dict[str, Any] = vars(experiment)
    if _KEY not in attributes:
        attributes[_KEY] = _evaluation_key(experiment)
    key: bytes | None = attributes[_KEY]
    return key


def _evaluation_key(experiment: "Experiment") -> bytes | None:
    values = (
        experiment.simulation,
        plain(experiment.parameters),
        experiment.sensors,
        experiment.actuators,
        plain(vars(experiment.requirements)),
        plain(vars(experiment.controller)),
        plain(vars(experiment.ranking)),
    )
    try:
        return marshal.dumps(values, 2)  # version 2 writes equal values as equal bytes
    except ValueError:
        return None


def steers_agents(experiment: "Experiment") -> bool:
    """Whether controllers are evolved, so that sensors and actuators must be known."""
    return REPRESENTATIONS.get(experiment.controller.kind).steers


def has_python_modules(experiment: "Experiment") -> bool:
    """Whether controllers are machines with Python modules, which Python evaluates."""
    return bool(getattr(experiment.controller, "in_python", False))


def reports_slow(experiment: "Experiment") -> bool:
    """Whether the best of a run is validated in the ranking's slow simulation."""
    return isinstance(experiment.ranking, SlowOptions)


def fitness_expression(experiment: "Experiment") -> FitnessExpression | None:
    """Return the fitness as an expression over metrics; None for the simulation's own."""
    return None if experiment.fitness is None else FitnessExpression(experiment.fitness)
