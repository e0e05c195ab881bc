"""Registries of the components that an experiment selects by `kind`."""

from collections.abc import Mapping
from typing import Any

from swarmwright.common.registry import Registry
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods import METHODS
from swarmwright.methods.rankings import RANKINGS

REGISTRIES: Mapping[str, Registry[Any]] = {
    "controller": REPRESENTATIONS,
    "method": METHODS,
    "ranking": RANKINGS,
}
"""Key of an experiment -> registry of its components."""
