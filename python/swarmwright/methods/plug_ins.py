"""The components that an experiment chooses by their `kind`, built in or from installed packages."""

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
"""Key of an experiment -> its components."""
