"""Checks of the parameters of an experiment, by asking its simulation."""

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from swarmwright.common.problems import Report, shown
from swarmwright.common.yaml import Path_, path_of
from swarmwright.experiment.evolved import unknown
from swarmwright.simulations import catalogue


def check_parameters(simulation: str | None, parameters: dict[str, Any], report: Report) -> None:
    """Check that parameters can be sent as JSON, and that the simulation knows and takes them.

    Args:
        simulation: that is asked; None where it is not here.
        parameters: as the experiment has them.
        report: takes each problem.
    """
    for path, problem in _unsendable(parameters, ("parameters",)):
        report(path, problem)
        return
    if simulation is None:
        return
    known = catalogue.parameter_names(simulation)
    for key, problem in unknown(simulation, parameters):
        report(("parameters", key), problem)
    everything = catalogue.takes_any(simulation)
    given = {key: value for key, value in parameters.items() if everything or key in known}
    mistakes = catalogue.parameter_mistakes(simulation, given)
    if mistakes is not None:
        for place, reason in mistakes:
            _report_parameter(place, reason, given, report)
        return
    first = True
    # The simulation names one at a time: it is removed to find the next. What only its absence makes wrong is
    # not reported.
    while (wrong := catalogue.parameters_problem(simulation, given)) is not None:
        place, _, reason = wrong.removeprefix("parameter ").partition(": ")
        name = _parameter_of(place)
        if not (reason and name in given):
            if first:
                report((("parameters", name) if reason and name in known else ("parameters",)), wrong)
            return
        if first or _is_wrong_alone(simulation, name, given[name], wrong):
            _report_parameter(place, reason, given, report)
        del given[name]
        first = False


def _parameter_of(place: str) -> str:
    """Return the name of the parameter in which a place is."""
    return re.split(r"[.[]", place, maxsplit=1)[0]


def _report_parameter(place: str, reason: str, given: Mapping[str, Any], report: Report) -> None:
    """Report why a parameter is refused, at its place in the file."""
    if place == "mission.robots" and _has_own_radius(given):
        place, reason = "robot.radius", f"{reason}, or a smaller radius"
    name = _parameter_of(place)
    if name in given:
        report(("parameters", *path_of(place)), reason)
    else:
        report(("parameters", name), f"parameter {place}: {reason}")


def _has_own_radius(parameters: Mapping[str, Any]) -> bool:
    """Whether the arena's robots have a radius that is given, in a mission that is not written out."""
    robot, mission = parameters.get("robot"), parameters.get("mission")
    return isinstance(robot, Mapping) and "radius" in robot and not isinstance(mission, Mapping)


def _is_wrong_alone(simulation: str, name: str, value: Any, wrong: str) -> bool:  # noqa: ANN401 - any value of a file
    """Whether a parameter is wrong whatever the others are."""
    return catalogue.parameters_problem(simulation, {name: value}) == wrong


def _unsendable(value: Any, path: Path_) -> Iterator[tuple[Path_, str]]:  # noqa: ANN401 - any value of a file
    """Yield what JSON cannot carry."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if isinstance(key, str):
                yield from _unsendable(inner, (*path, key))
            else:
                yield path, f"a key must be text, not {shown(key)}"
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from _unsendable(inner, (*path, index))
    elif isinstance(value, float) and not math.isfinite(value):
        yield path, f"must be a finite number, not {value}"
    elif not (value is None or isinstance(value, bool | int | float | str)):
        yield path, f"a value of the type {type(value).__name__} cannot be sent to a simulation"
