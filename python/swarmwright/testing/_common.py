"""Shared parts of the checks."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.options import Options, add_descriptions
from swarmwright.common.registry import Registry
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.methods import Method

SHAPES = ((1, 1), (4, 1), (10, 2), (3, 5))
"""Pairs of (sensors, actuators) for trying representations."""

EXAMPLES: dict[str, dict[str, Any]] = {
    "parameter_set": {
        "parameters": {
            "avoidance": {"type": "real", "range": [0, 5]},
            "hops": {"type": "integer", "range": [1, 100], "scale": "log"},
            "strategy": {"type": "categorical", "choices": ["a", "b", "c"]},
        }
    },
    "team": {
        "groups": {
            "leaders": {"hidden": [3], "agents": 2},
            "others": {"kind": "fully_meshed", "sensors": 1, "actuators": 1},
        }
    },
    "multi_fidelity": {"slow": "minisim"},
    "transferability": {"slow": "minisim", "threshold": 0.5},
}
"""Required options of built-in kinds."""


def check_options(registry: Registry[Any], kind: str, options: Mapping[str, Any] | None = None) -> Options:
    """Check the options of a component, and return them.

    options: required ones; default: none, except for built-in kinds that need some.
    """
    values = EXAMPLES.get(kind, {}) if options is None else options
    component = registry.get(kind)
    in_file = registry.is_in_file(kind)  # its kind in experiments, whatever the class defines
    assert in_file or component.kind == kind, (
        f"{component.__name__}.kind is {component.kind!r}, registered as {kind!r}"
    )
    model: type[Options] = component.options_model
    assert issubclass(model, Options), f"{model.__name__} must derive from swarmwright.controllers.Options"
    check_common_options(model, "kind", kind, values)
    return model.model_validate({**values})


def check_common_options(model: type[Options], key: str, name: str, values: Mapping[str, Any]) -> None:
    """Check that options name their component and have descriptions.

    key: option with the name, `kind` or `launcher`. name: required value of that option. values: required
    options.
    """
    field = model.model_fields.get(key)
    assert field is not None, f"{model.__name__} needs {key}: Literal[{name!r}] = {name!r}"
    assert field.default == name, f"{model.__name__}.{key} must default to {name!r}"
    for option, model_field in add_descriptions(model).model_fields.items():
        assert option == key or model_field.description, f"{model.__name__}.{option} has no description"
        assert not model_field.is_required() or option in values, (
            f"{model.__name__}.{option} has no default: give it one, or say here what it is"
        )


def kinds_without_options(registry: Registry[Any]) -> list[str]:
    """Return the kinds without required options, and the built-in ones."""
    names = registry.names()
    fields = {name: registry.get(name).options_model.model_fields.values() for name in names}
    return [
        name
        for name in names
        if name in EXAMPLES or not any(field_of_model.is_required() for field_of_model in fields[name])
    ]


def representation(
    kind: str = "layered",
    *,
    sensors: int = 4,
    actuators: int = 1,
    options: Mapping[str, Any] | None = None,
) -> Representation:
    """Create a representation, by default with only its required options.

    Its numbers of sensors and actuators fit, if it requires certain ones.
    """
    component = REPRESENTATIONS.get(kind)
    values = EXAMPLES.get(kind, {}) if options is None else options
    validated = component.options_model.model_validate({**values})
    sensors, actuators = component.shape or (sensors, actuators)
    return component(validated, sensors=sensors, actuators=actuators)


def synthetic_metrics(method: Method, genomes: Genomes, fitness: Fitness) -> NDArray[np.float64] | None:
    """Return artificial values of the metrics that a method needs; None if it needs none.

    They depend only on the genomes; those of failed candidates are NaN, as in runs.
    """
    count = len(method.options.needed_metrics)
    if count == 0:
        return None
    columns = np.arange(count) % genomes.shape[1]
    metrics: NDArray[np.float64] = genomes[:, columns].astype(np.float64)
    metrics[~np.isfinite(fitness)] = np.nan
    return metrics
