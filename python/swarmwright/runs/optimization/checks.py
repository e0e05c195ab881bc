"""Whether plug-ins are as an optimization needs them, before anything is evaluated."""

from typing import Any

import numpy as np

from swarmwright.common.errors import PlugInError
from swarmwright.common.plug_in_code import count, is_plug_in, numbers, place
from swarmwright.common.untrusted import one_line
from swarmwright.controllers import Representation
from swarmwright.methods import Method
from swarmwright.methods.rankings import Ranking


def check_plug_ins(method: Method, ranking: Ranking, representation: Representation) -> None:
    """Raise PlugInError when a plug-in's constructor or one of its properties is wrong."""
    _check_begun(representation, "options", "super().__init__(options, sensors=sensors, actuators=actuators)")
    _check_begun(method, "_untold", "super().__init__(options, representation, seed=seed)")
    _check_begun(ranking, "_past", "super().__init__(options)")
    if is_plug_in(type(representation)):
        size = count(representation, "genome_size", representation.genome_size, "the number of genes")
        _check_bounds(representation, size)
    if is_plug_in(type(method)):
        count(method, "budget", method.budget, "the number of evaluations of the whole run")
        if method.options.operation == "steady_state":
            what = "the number of evaluations of a generation"
            count(method, "generation_size", method.generation_size, what)


def _check_begun(made: object, attribute: str, call: str) -> None:
    """Check that the constructor of the base class was called, which sets an attribute."""
    if not hasattr(made, attribute):
        raise PlugInError(f"{place(made, '__init__')}: does not call {call}")


def _check_bounds(representation: Representation, size: int) -> None:
    for name in ("bounds", "initial_range"):
        limits: Any = getattr(representation, name)
        what = f"two arrays, (genome_size,) each: the lower and the upper limit of each of {size} genes"
        if not isinstance(limits, tuple | list) or len(limits) != 2:
            raise PlugInError(
                f"{place(representation, name)}: is {one_line(repr(limits)[:100])}, expected {what}"
            )
        low, high = (
            numbers(representation, name, one, (size,), what, finite=False, dtype=np.float64)
            for one in limits
        )
        if not (low <= high).all():
            gene = int(np.flatnonzero(~(low <= high))[0])
            raise PlugInError(
                f"{place(representation, name)}: of gene {gene} the lower limit, {low[gene]:g}, is not "
                f"below the upper one, {high[gene]:g}"
            )
