"""Parameters of a simulation whose values are evolved: whether they fit the experiment."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from swarmwright.common.arrays import shortest
from swarmwright.common.suggestions import UnknownKey, suggest_or_list
from swarmwright.common.yaml import Path_
from swarmwright.controllers.kinds.parameter_set import CategoricalParameter, Parameter, RealParameter
from swarmwright.simulations import catalogue

_TRIED_SHARE = 0.4391
"""Of a range; a share with which the limits of few ranges make an integer."""
_EVOLVED: Path_ = ("controller", "parameters")


def problems(
    simulation: str, parameters: Mapping[str, Any], evolved: Mapping[str, Parameter], *, here: bool
) -> Iterator[tuple[Path_, str]]:
    """Yield where and why evolved parameters do not fit a simulation with the parameters that are fixed.

    here: whether the simulation can be asked.
    """
    for name in evolved:
        if name in parameters:
            yield (*_EVOLVED, name), "is also in the experiment's parameters; remove it there"
    if not here:
        return
    for name, message in unknown(simulation, evolved):
        yield (*_EVOLVED, name), message
    yield from _undeclared_booleans(simulation, evolved)
    everything = catalogue.takes_any(simulation)
    names = catalogue.parameter_names(simulation)
    known = {name: parameter for name, parameter in evolved.items() if everything or name in names}
    fixed = {name: value for name, value in parameters.items() if name not in evolved}
    if len(known) < len(evolved) or catalogue.parameter_mistakes(simulation, fixed):
        return
    found = list(_refusals(simulation, fixed, known))
    yield from found
    if not found and not all(
        catalogue.steers_itself(simulation, values) for _, _, values in _corners(fixed, known)
    ):
        title = catalogue.title(simulation)
        cure = "use a controller that steers agents, such as layered"
        if "steering" in names:
            cure = "set parameters.steering to rule"
        yield (
            ("controller", "kind"),
            f"parameter_set steers no agents, but agents of {title} must be steered; {cure}",
        )


def _undeclared_booleans(simulation: str, evolved: Mapping[str, Parameter]) -> Iterator[tuple[Path_, str]]:
    """Yield booleans of simulations that would get 0 and 1 instead: all but classes that declare them."""
    for name, parameter in evolved.items():
        if not (isinstance(parameter, CategoricalParameter) and parameter.are_booleans):
            continue
        if not catalogue.declares_boolean(simulation, name):
            message = (
                f"booleans need a class in Python in which the default of {name} is True or False; write "
                '[0, 1] or ["false", "true"], whichever the simulation reads'
            )
            yield (*_EVOLVED, name, "choices"), message


def unknown(simulation: str, names: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield each name that is not a parameter of a simulation, with the message about it."""
    if catalogue.takes_any(simulation):
        return
    known, title = catalogue.parameter_names(simulation), catalogue.title(simulation)
    for name in names:
        if name not in known:
            yield (
                name,
                UnknownKey(f"unknown parameter of {title}", suggest_or_list(name, known, "known parameters")),
            )


def _refusals(
    simulation: str, fixed: Mapping[str, Any], evolved: Mapping[str, Parameter]
) -> Iterator[tuple[Path_, str]]:
    found: dict[tuple[str, str], tuple[Any, str]] = {}
    for name, _, values in _corners(fixed, evolved):
        mistakes = catalogue.parameter_mistakes(simulation, values)
        if not mistakes:
            continue
        # Where another parameter is named, the value that was changed is what makes it wrong.
        wrong, reason = mistakes[0] if mistakes[0].field in evolved else (name, str(mistakes[0]))
        # One that is wrong by itself is so beside each value of the others.
        found.setdefault((wrong, repr(values[wrong])), (values[wrong], reason))
    for (wrong, _), (refused, reason) in found.items():
        hint, parameter = "", evolved[wrong]
        # Where a limit is refused as well, that the number between them has a fraction is not what is wrong.
        if isinstance(parameter, RealParameter) and all(
            (wrong, repr(end)) not in found for end in _limits(parameter)
        ):
            hint = "; for a parameter of integers write type: integer"
        if type(refused) is int and catalogue.declares_boolean(simulation, wrong):
            hint = "; for a boolean write {type: categorical, choices: [true, false]}"
        yield (*_EVOLVED, wrong), f"{catalogue.title(simulation)} refuses {refused!r}: {reason}{hint}"


def _corners(
    fixed: Mapping[str, Any], evolved: Mapping[str, Parameter]
) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Yield each parameter with each of its extreme values, and all parameters with it.

    Of a real number also with one between them, which is not an integer.
    """
    extremes = {name: _extremes(parameter) for name, parameter in evolved.items()}
    firsts = {name: values[0] for name, values in extremes.items()}
    for name, values in extremes.items():
        for value in values:
            yield name, value, {**fixed, **firsts, name: value}


def _extremes(parameter: Parameter) -> list[Any]:
    if isinstance(parameter, CategoricalParameter):
        return list(parameter.choices)
    if parameter.type == "integer":
        return list(parameter.range)
    low, high = _limits(parameter)
    return [low, high, *shortest(np.array([low + _TRIED_SHARE * (high - low)], dtype=np.float32))]


def _limits(parameter: RealParameter) -> list[float]:
    """Return the lowest and the highest value of a real number."""
    return list(shortest(np.array(parameter.range, dtype=np.float32)))
