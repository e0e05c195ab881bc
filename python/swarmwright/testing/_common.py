"""What the checks share."""

from typing import Any

from swarmwright._descriptions import described
from swarmwright._options import Options
from swarmwright._registry import Registry
from swarmwright.representations import REPRESENTATIONS, Representation

SHAPES = ((1, 1), (4, 1), (10, 2), (3, 5))
"""(sensors, actuators) that representations are tried with."""


def check_options(registry: Registry[Any], kind: str) -> Options:
    """Check the options of a component; return its defaults."""
    component = registry.get(kind)
    assert component.kind == kind, f"{component.__name__}.kind is {component.kind!r}, registered as {kind!r}"
    model: type[Options] = component.options_model
    assert issubclass(model, Options), (
        f"{model.__name__} must derive from swarmwright.representations.Options"
    )
    field = model.model_fields.get("kind")
    assert field is not None, f"{model.__name__} needs kind: Literal[{kind!r}] = {kind!r}"
    assert field.default == kind, f"{model.__name__}.kind must default to {kind!r}"
    for name, one in described(model).model_fields.items():
        assert name == "kind" or one.description, f"{model.__name__}.{name} has no description"
        assert not one.is_required(), f"{model.__name__}.{name} has no default: {kind} alone must be enough"
    return model()


def representation(kind: str = "layered", *, sensors: int = 4, actuators: int = 1) -> Representation:
    """Return a representation with its default options."""
    component = REPRESENTATIONS.get(kind)
    return component(component.options_model(), sensors=sensors, actuators=actuators)
