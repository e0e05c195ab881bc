"""What is wrong with a definition of an FMU as a simulation, beyond the form of each key."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

from swarmwright.common.errors import InputError
from swarmwright.common.problems import shown
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.yaml import Path_
from swarmwright.simulations.fmu.description import STRUCTURAL, Description, Variable, flat, runs_here
from swarmwright.simulations.fmu.layout import AGENT
from swarmwright.simulations.fmu.ssp import ENDING, VERSION
from swarmwright.simulations.fmu.values import expected, fits, is_unsigned, takes_seeds

if TYPE_CHECKING:  # which calls what is here
    from swarmwright.simulations.command.fmu_channels import Channel
    from swarmwright.simulations.command.fmu_definition import FmuOptions

MOST = 1000
"""Variables of an FMU that are taken without being named."""

Problem = tuple[Path_, str]


def problems(options: "FmuOptions") -> list[Problem]:
    """Return where and why a definition does not fit its FMU."""
    try:
        known = options.description
    except InputError as error:
        return [(("fmu",), str(error))]
    return [
        *_of_the_whole(options, known),
        *_of_channels(options, known, "sensors"),
        *_of_channels(options, known, "actuators"),
        *_of_metrics(options, known),
        *_of_starts(options, known),
    ]


def _of_the_whole(options: "FmuOptions", known: Description) -> Iterator[Problem]:
    if not runs_here(known):
        yield ("fmu",), options.no_library
    if options.algorithm is not None and known.version != VERSION:
        yield ("algorithm",), f"is for systems of FMUs ({ENDING}); {options.fmu} is one FMU"
    if options.solver is not None and known.exchange is None:
        yield ("solver",), f"{options.fmu} is for co-simulation only, and has its own solver"
    if known.only_once and options.agents > 1 and not options.is_one:
        yield ("agents",), f"{options.fmu} allows one instance in a process only, not {options.agents}"


def _of_metrics(options: "FmuOptions", known: Description) -> Iterator[Problem]:
    for name in options.metrics:
        problem = _unreadable(options, known, options.columns[name].column)
        if problem is not None:
            yield ("metrics", name), problem


def _of_starts(options: "FmuOptions", known: Description) -> Iterator[Problem]:
    names = list(known.variables)
    for name, value in options.start.items():
        variable = known.variables.get(name)
        problem = (
            _unknown(options.fmu, name, names)
            if variable is None
            else _unstartable(variable, value, f"{name} of {options.fmu}", known)
        )
        if problem is not None:
            yield ("start", name), problem
    if options.seed is None:
        return
    variable = known.variables.get(options.seed)
    if variable is None:
        yield ("seed",), _unknown(options.fmu, options.seed, names)
    elif not takes_seeds(variable):
        kind = "an array" if variable.is_array else f"of the type {variable.type}"
        yield ("seed",), f"{options.seed} of {options.fmu} is {kind}; expected an integer or a number"
    elif variable.count > 1:
        yield ("seed",), f"{options.seed} of {options.fmu} is one element of an array; expected a variable"


def _unstartable(
    variable: Variable,
    value: Any,  # noqa: ANN401 - whatever the file says
    about: str,
    known: Description,
) -> str | None:
    """Return what is wrong with a start value of a variable."""
    if variable.count > 1:
        whole = variable.name.rpartition("[")[0]
        return f"{about} is one element of an array; write the start of the whole array {whole} as a list"
    if variable.is_array:
        return _unstartable_array(variable, value, about)
    if isinstance(value, list):
        return f"{about} is one value, not a list"
    if variable.causality == STRUCTURAL:
        if known.version == VERSION:
            return f"{about} is a structural parameter, which is settable for one FMU alone, not in an SSP"
        if type(value) is not int or value < 1:
            return f"{about} is a structural parameter, expected a whole number from 1, not {shown(value)}"
    return None if fits(variable, value) else _misfit(variable, value, about)


def _unstartable_array(variable: Variable, value: Any, about: str) -> str | None:  # noqa: ANN401 - as above
    count = math.prod(variable.shape)
    wanted = f"{about} has the shape {' x '.join(map(str, variable.shape))}"
    if not isinstance(value, list):
        return f"{wanted}; expected a list of {count} values, not {shown(value)}"
    values = flat(value)
    if len(values) != count:
        return f"{wanted}, {count} values row by row, but {len(values)} are given"
    if (
        value
        and isinstance(value[0], list)
        and any(not isinstance(row, list) or len(row) * variable.shape[0] != count for row in value)
    ):
        return f"{wanted}; expected {variable.shape[0]} rows of {count // variable.shape[0]} values each"
    wrong = next((one for one in values if not fits(variable, one)), None)
    return None if wrong is None else _misfit(variable, wrong, about)


def _misfit(variable: Variable, value: Any, about: str) -> str:  # noqa: ANN401 - as above
    wanted = expected(variable)
    if wanted is None:
        return f"{about} is of the type {variable.type}, which cannot be set"
    return f"{about} is of the type {variable.type}, expected {wanted}, not {shown(value)}"


def _of_channels(
    options: "FmuOptions", known: Description, which: Literal["sensors", "actuators"]
) -> Iterator[Problem]:
    given = options.sensors if which == "sensors" else options.actuators
    causality = "output" if which == "sensors" else "input"
    for index, channel in enumerate(given or ()):
        parts = options.expanded(channel, causality)
        if not parts:
            yield (which, index), _empty(options.fmu, known, channel.terminal, causality)
        found = (_of_channel(options, known, part, which) for part in parts)
        problem = next((one for one in found if one is not None), None)
        if problem is not None:
            yield (which, index), problem
    channels = options.channels(which)
    if given is None and len(channels) > MOST:
        what = "outputs" if which == "sensors" else "inputs"
        yield (which,), f"is missing: {options.fmu} has {len(channels):,} {what}; name those that are {which}"
    elif given is None and which == "actuators":
        without = (_without_range(options, known, one) for one in channels)
        yield from (((which,), f"is missing: {one}") for one in without if one is not None)
    if not channels and (which == "sensors" or given is None):
        what = "an output" if which == "sensors" else "an input"
        yield (which,), f"is missing: {options.fmu} has no variable that is {what} and a number"


def _of_channel(
    options: "FmuOptions", known: Description, channel: "Channel", which: Literal["sensors", "actuators"]
) -> str | None:
    """Return what is wrong with a sensor or an actuator."""
    problem = _unreadable(options, known, channel.variable)
    if problem is None and which == "actuators":
        problem = _unsettable(options.fmu, known, channel.variable)
    problem = problem or _unconvertible(options, known, channel)
    if problem is None and which == "actuators":
        problem = _without_range(options, known, options.ranged(channel))
    return problem


def _without_range(options: "FmuOptions", known: Description, channel: "Channel") -> str | None:
    """Return what is wrong with an actuator that is never negative, but has no range that -1 to 1 becomes."""
    variable = known.variables[channel.variable.replace(AGENT, "1")]
    if channel.range is not None or not is_unsigned(variable):
        return None
    return (
        f"{variable.name} of {options.fmu} is of the type {variable.type}, without min and max; write what "
        f"-1 to 1 of the actuator becomes, such as {{variable: {channel.variable}, range: [0, 10]}}"
    )


def _unreadable(options: "FmuOptions", known: Description, name: str) -> str | None:
    """Return what is wrong with a variable whose values are read."""
    for one in {name.replace(AGENT, str(agent)) for agent in (1, options.agents)}:
        variable = known.variables.get(one)
        if variable is None:
            numbers = [other.name for other in known.variables.values() if other.is_number]
            return _unknown(options.fmu, one, numbers)
        if not variable.is_number:
            kind = "an array" if variable.is_array else f"of the type {variable.type}"
            return f"{one} of {options.fmu} is {kind}, not one number"
    return None


def _unsettable(file: str, known: Description, name: str) -> str | None:
    causality = known.variables[name.replace(AGENT, "1")].causality
    if causality == "input":
        return None
    inputs = ", ".join(one.name for one in known.of_causality("input")) or "none"
    return f"{name} of {file} is not an input, but has the causality {causality}; inputs: {inputs}"


def _unconvertible(options: "FmuOptions", known: Description, channel: "Channel") -> str | None:
    variable = known.variables[channel.variable.replace(AGENT, "1")]
    if not channel.unit or channel.unit == variable.unit or options.conversion(channel) is not None:
        return None
    about = f"{variable.name} of {options.fmu}"
    if not variable.unit:
        return f"unit: {about} has no unit, so {channel.unit} cannot be converted"
    others = list(known.conversions.get(variable.unit, {}))
    hint = did_you_mean(channel.unit, others) or f"; available: {', '.join(others) or 'none'}"
    return (
        f"unit: {options.fmu} does not define how {variable.unit}, the unit of {variable.name}, is "
        f"converted to {channel.unit!r}{hint}"
    )


def _empty(file: str, known: Description, terminal: str, causality: str) -> str:
    """Return what is wrong with a terminal that has no variables."""
    if terminal in known.terminals:
        return f"the terminal {terminal} of {file} has no {causality}"
    names = list(known.terminals)
    hint = did_you_mean(terminal, names) or f"; available: {', '.join(names) or 'none'}"
    return f"{file} has no terminal {terminal!r}{hint}"


def _unknown(file: str, name: str, names: Sequence[str]) -> str:
    few = ", ".join(names[:20]) + (", .." if len(names) > 20 else "")
    hint = did_you_mean(name, list(names)) or f"; available: {few or 'none'}"
    return f"{file} has no variable {name!r}{hint}"
