"""Checks of evolved parameters of a simulation."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from swarmwright.common.arrays import shortest
from swarmwright.common.suggestions import UnknownKey, suggest_or_list
from swarmwright.common.yaml import Path_
from swarmwright.controllers.kinds.parameter_set import ChoiceParameter, Parameter, RealParameter
from swarmwright.simulations import catalogue

_TRIED_SHARE = 0.4391
"""Share of a range at which few ranges have an integer."""
_EVOLVED: Path_ = ("controller", "parameters")


def iter_problems(
    simulation: str, parameters: Mapping[str, Any], evolved: Mapping[str, Parameter], *, is_available: bool
) -> Iterator[tuple[Path_, str]]:
    """Yield position and reason of conflicts between evolved parameters, fixed ones and the simulation.

    here: whether the simulation can be asked.
    """
    for name in evolved:
        if name in parameters:
            yield (*_EVOLVED, name), "is also one of the experiment's parameters; remove it there"
    if not is_available:
        return
    for name, message in iter_unknown(simulation, evolved):
        yield (*_EVOLVED, name), message
    yield from _iter_undeclared_booleans(simulation, evolved)
    everything = catalogue.takes_any(simulation)
    names = catalogue.parameter_names(simulation)
    evaluable = {name: parameter for name, parameter in evolved.items() if everything or name in names}
    fixed = {name: value for name, value in parameters.items() if name not in evolved}
    if len(evaluable) < len(evolved) or catalogue.parameter_mistakes(simulation, fixed):
        return
    refusals = list(_iter_refusals(simulation, fixed, evaluable))
    yield from refusals
    if not refusals and not all(
        catalogue.steers_itself(simulation, values) for _, _, values in _iter_corners(fixed, evaluable)
    ):
        title = catalogue.title(simulation)
        cure = "use a controller of agents, such as layered"
        if "steering" in names:
            cure = "set parameters.steering to rule"
        yield (
            ("controller", "kind"),
            f"parameter_set controls no agents, but agents of {title} must be controlled; {cure}",
        )


def _iter_undeclared_booleans(
    simulation: str, evolved: Mapping[str, Parameter]
) -> Iterator[tuple[Path_, str]]:
    """Yield booleans that a simulation would receive as 0 and 1, as it does not declare them."""
    for name, parameter in evolved.items():
        if not (isinstance(parameter, ChoiceParameter) and parameter.are_booleans):
            continue
        if not catalogue.declares_boolean(simulation, name):
            message = (
                f"booleans need a Python class in which the default of {name} is True or False; write [0, "
                "1] or "
                '["false", "true"], as the simulation expects'
            )
            yield (*_EVOLVED, name, "choices"), message


def iter_unknown(simulation: str, names: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield each name that is not a parameter of a simulation, with a message."""
    if catalogue.takes_any(simulation):
        return
    names_known, title = catalogue.parameter_names(simulation), catalogue.title(simulation)
    for name in names:
        if name not in names_known:
            yield (
                name,
                UnknownKey(
                    f"unknown parameter of {title}", suggest_or_list(name, names_known, "known parameters")
                ),
            )


def _iter_refusals(
    simulation: str, fixed: Mapping[str, Any], evolved: Mapping[str, Parameter]
) -> Iterator[tuple[Path_, str]]:
    refusals: dict[tuple[str, str], tuple[Any, str]] = {}
    for name, _, values in _iter_corners(fixed, evolved):
        mistakes = catalogue.parameter_mistakes(simulation, values)
        if not mistakes:
            continue
        # If another parameter is reported, the changed value caused it.
        wrong, reason = mistakes[0] if mistakes[0].field in evolved else (name, str(mistakes[0]))
        # An invalid value is refused with any values of the other parameters.
        refusals.setdefault((wrong, repr(values[wrong])), (values[wrong], reason))
    for (wrong, _), (refused, reason) in refusals.items():
        hint, parameter = "", evolved[wrong]
        # If a limit is refused as well, the reason is not that the value in between is not an integer.
        if isinstance(parameter, RealParameter) and all(
            (wrong, repr(end)) not in refusals for end in _limits(parameter)
        ):
            hint = "; for an integer parameter, write type: integer"
        if type(refused) is int and catalogue.declares_boolean(simulation, wrong):
            hint = "; for a boolean, write {type: categorical, choices: [true, false]}"
        yield (*_EVOLVED, wrong), f"{catalogue.title(simulation)} refuses {refused!r}: {reason}{hint}"


def _iter_corners(
    fixed: Mapping[str, Any], evolved: Mapping[str, Parameter]
) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Yield each parameter with each of its extreme values, and all parameters with this value.

    Real numbers also have a value in between that is not an integer.
    """
    extremes = {name: _extremes(parameter) for name, parameter in evolved.items()}
    firsts = {name: values[0] for name, values in extremes.items()}
    for name, values in extremes.items():
        for value in values:
            yield name, value, {**fixed, **firsts, name: value}


def _extremes(parameter: Parameter) -> list[Any]:
    if isinstance(parameter, ChoiceParameter):
        return list(parameter.choices)
    if parameter.type == "integer":
        return list(parameter.range)
    low, high = _limits(parameter)
    return [low, high, *shortest(np.array([low + _TRIED_SHARE * (high - low)], dtype=np.float32))]


def _limits(parameter: RealParameter) -> list[float]:
    """Return the lowest and the highest value of a real number."""
    return list(shortest(np.array(parameter.range, dtype=np.float32)))
