"""How candidates come about: one file and one line below for each method."""

from swarmwright._registry import Registry
from swarmwright.methods._base import Method, MethodOptions

__all__ = ["METHODS", "Method", "MethodOptions"]

METHODS: Registry[Method] = Registry(
    "method",
    "swarmwright.methods",
    {
        "nnga": "swarmwright.methods.nnga:Nnga",
        "random_search": "swarmwright.methods.random_search:RandomSearch",
    },
    "swarmwright.methods:Method",
)
"""All methods, by the `kind` of an experiment's `method`."""
