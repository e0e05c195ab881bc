"""What an experiment says of an FMU as its simulation: `simulation: {fmu: model.fmu, ..}`.

Sensors and actuators of an FMU, as an experiment names them.

What is wrong with a definition of an FMU as a simulation, beyond the form of each key.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator, model_validator

from swarmwright.common import metric_names
from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError, format_value
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.suggestions import did_you_mean, suggest_or_list
from swarmwright.common.yaml import Path_
from swarmwright.simulations.command.definition import CommandOptions, Definition, Reduction
from swarmwright.simulations.fmu.description import (
    AGENT,
    NEEDS,
    STRUCTURAL,
    Description,
    Layout,
    Variable,
    expected,
    fits,
    flat,
    is_installed,
    is_unsigned,
    layout,
    place,
    runs_here,
    stop_time,
    takes_seeds,
)
from swarmwright.simulations.fmu.ssp import ENDING, VERSION, Algorithm, described

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
            return (
                f"{about} is a structural parameter, expected a whole number from 1, not "
                f"{format_value(value)}"
            )
    return None if fits(variable, value) else _misfit(variable, value, about)


def _unstartable_array(variable: Variable, value: Any, about: str) -> str | None:  # noqa: ANN401 - as above
    count = math.prod(variable.shape)
    wanted = f"{about} has the shape {' x '.join(map(str, variable.shape))}"
    if not isinstance(value, list):
        return f"{wanted}; expected a list of {count} values, not {format_value(value)}"
    values = flat(value)
    if len(values) != count:
        return f"{wanted}, {count} values row by row, but {len(values)} are given"
    if (
        value
        and isinstance(value[0], list)
        and any(not isinstance(row, list) or len(row) * variable.shape[0] != count for row in value)
    ):
        return f"{wanted}; expected {variable.shape[0]} rows of {count // variable.shape[0]} values each"
    wrong = next((item for item in values if not fits(variable, item)), None)
    return None if wrong is None else _misfit(variable, wrong, about)


def _misfit(variable: Variable, value: Any, about: str) -> str:  # noqa: ANN401 - as above
    wanted = expected(variable)
    if wanted is None:
        return f"{about} is of the type {variable.type}, which cannot be set"
    return f"{about} is of the type {variable.type}, expected {wanted}, not {format_value(value)}"


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
        problem = next((item for item in found if item is not None), None)
        if problem is not None:
            yield (which, index), problem
    channels = options.channels(which)
    if given is None and len(channels) > MOST:
        what = "outputs" if which == "sensors" else "inputs"
        yield (which,), f"is missing: {options.fmu} has {len(channels):,} {what}; name those that are {which}"
    elif given is None and which == "actuators":
        without = (_without_range(options, known, port) for port in channels)
        yield from (((which,), f"is missing: {item}") for item in without if item is not None)
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
    for full_name in {name.replace(AGENT, str(agent)) for agent in (1, options.agents)}:
        variable = known.variables.get(full_name)
        if variable is None:
            numbers = [other.name for other in known.variables.values() if other.is_number]
            return _unknown(options.fmu, full_name, numbers)
        if not variable.is_number:
            kind = "an array" if variable.is_array else f"of the type {variable.type}"
            return f"{full_name} of {options.fmu} is {kind}, not one number"
    return None


def _unsettable(file: str, known: Description, name: str) -> str | None:
    causality = known.variables[name.replace(AGENT, "1")].causality
    if causality == "input":
        return None
    inputs = ", ".join(variable.name for variable in known.of_causality("input")) or "none"
    return f"{name} of {file} is not an input, but has the causality {causality}; inputs: {inputs}"


def _unconvertible(options: "FmuOptions", known: Description, channel: "Channel") -> str | None:
    variable = known.variables[channel.variable.replace(AGENT, "1")]
    if not channel.unit or channel.unit == variable.unit or options.conversion(channel) is not None:
        return None
    about = f"{variable.name} of {options.fmu}"
    if not variable.unit:
        return f"unit: {about} has no unit, so {channel.unit} cannot be converted"
    others = list(known.conversions.get(variable.unit, {}))
    hint = suggest_or_list(channel.unit, others)
    return (
        f"unit: {options.fmu} does not define how {variable.unit}, the unit of {variable.name}, is "
        f"converted to {channel.unit!r}{hint}"
    )


def _empty(file: str, known: Description, terminal: str, causality: str) -> str:
    """Return what is wrong with a terminal that has no variables."""
    if terminal in known.terminals:
        return f"the terminal {terminal} of {file} has no {causality}"
    names = list(known.terminals)
    hint = suggest_or_list(terminal, names)
    return f"{file} has no terminal {terminal!r}{hint}"


def _unknown(file: str, name: str, names: Sequence[str]) -> str:
    few = ", ".join(names[:20]) + (", .." if len(names) > 20 else "")
    hint = did_you_mean(name, list(names)) or f"; available: {few or 'none'}"
    return f"{file} has no variable {name!r}{hint}"


class Channel(Options):
    """A variable of an FMU, or all those of a terminal, as sensors or actuators.

    With a range, their lowest and highest values are -1 and 1 for the controller.
    """

    variable: str = ""
    """The name of the variable; {agent} stands for the number of the agent, from 1. An array of FMI 3.0 gives
    as many sensors or actuators as it has elements, `x[{agent}]` the elements of a row for each agent."""
    terminal: str = ""
    """In the place of a variable: a terminal of FMI 3.0, all outputs of which are sensors, or all inputs
    actuators."""
    unit: str = ""
    """The unit of the values and of the range, which the FMU's unit definitions convert. Default: the
    variable's."""
    range: tuple[float, float] | None = None
    """Lowest and highest value. Default for actuators: the variable's own min and max where it has both;
    otherwise values are what they are."""

    @model_validator(mode="after")
    def _is_one(self) -> "Channel":
        if bool(self.variable) == bool(self.terminal):
            raise ValueError("write a variable or a terminal, one of them")
        if AGENT in self.terminal:
            raise FieldError("terminal", f"cannot hold {AGENT}; name its variables")
        return self

    @field_validator("range")
    @classmethod
    def _ordered(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not value[0] < value[1]:
            raise ValueError(f"the lowest value must be below the highest, not {value[0]:g} and {value[1]:g}")
        return value


def _channels(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value is None:
        return value
    if not isinstance(value, list):
        raise ValueError(f"must be a list of variables, not {format_value(value)}")
    return [{"variable": item} if isinstance(item, str) else item for item in value]


def _pairs(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    """Take lists of two numbers, as YAML has them, for tuples."""
    for item in value if isinstance(value, list) else []:
        if isinstance(item, dict) and isinstance(item.get("range"), list) and len(item["range"]) == 2:
            item["range"] = tuple(float(part) if isinstance(part, int) else part for part in item["range"])
    return value


Channels = Annotated[
    list[Channel] | None,
    BeforeValidator(lambda value: _pairs(_channels(value))),
    WithJsonSchema(
        {
            "type": "array",
            "items": {
                "anyOf": [
                    {"type": "string"},
                    {
                        "type": "object",
                        "properties": {
                            "variable": {"type": "string"},
                            "terminal": {"type": "string"},
                            "unit": {"type": "string"},
                            "range": {"type": "array", "items": {"type": "number"}},
                        },
                        "oneOf": [{"required": ["variable"]}, {"required": ["terminal"]}],
                        "additionalProperties": False,
                    },
                ]
            },
        }
    ),
]


ATTACHMENT = "fmu.json"
"""What the program reads, in the folder of an instance."""
_STEPS = 100
_MOST_STEPS = 2**31


class FmuOptions(Definition):
    """A simulation that is a Functional Mock-up Unit (FMU) of FMI 2.0 or 3.0.

    Its parameters are the simulation's: they can be set and evolved by their names. A process with the
    instances runs many episodes; FMPy steps them (`pip install 'swarmwright[fmi]'`).
    """

    prefix: ClassVar[str] = SimulationName.FMU

    fmu: str = Field(min_length=1)
    """The file, relative to that of the experiment: an FMU, or an SSP with several, stepped together."""
    algorithm: Algorithm | None = None
    """How the FMUs of an SSP are stepped. jacobi: each gets the outputs that the others had at the beginning
    of the step. gauss_seidel: in the order of the file, each gets the outputs that those before it have at
    the end of the step. Default: gauss_seidel."""
    title: str | None = Field(default=None, min_length=1, max_length=1000)
    """The name in discovery. Default: the file's name and a digest of this definition and of the file."""
    agents: int = Field(default=1, ge=1, le=10_000)
    """Agents: each is an instance of the FMU, or where names hold {agent}, all are in one instance. Default
    for FMUs with variables agent[1].NAME, agent[2].NAME, ..: as many as there are, in one instance."""
    sensors: Channels = None
    """What an agent's controller senses: names of variables, or {variable: NAME, range: [low, high]}, where
    the range becomes -1 to 1, with `unit: km/h` in another unit that the FMU defines; or {terminal: NAME}.
    An array is all its elements. Default: all outputs that are numbers or booleans, as they are; where there
    are variables agent[1].NAME, those of the agent."""
    actuators: Channels = None
    """What it sets, likewise. -1 to 1 becomes the range. Default: all inputs that are numbers or booleans;
    none where a parameter set is evolved: inputs then keep their start values."""
    step: float | None = Field(default=None, gt=0)
    """Seconds of a step. Default: the FMU's own step size, else a hundredth of its stop time, else 0.1."""
    solver: Literal["cvode", "euler"] | None = None
    """What integrates an FMU for model exchange: CVode of SUNDIALS, or one step of Euler's method in each
    step. Default: co-simulation, or CVode if the FMU is for model exchange only."""
    steps: int | None = Field(default=None, ge=1, le=2**31)
    """Steps of an episode. Default: to the FMU's stop time, else 100."""
    start: dict[str, float | int | bool | str | list[Any]] = Field(default={})
    """Start values of variables that no parameter sets, by name. Of an array of FMI 3.0: a list of all its
    values, row by row, or a list of rows. Structural parameters set the sizes of arrays."""
    seed: str | None = Field(default=None, min_length=1)
    """The parameter or input that gets the episode's seed, modulo 2^31, or modulo 2^7 to 2^16 where it is an
    integer of FMI 3.0 of 8 or 16 bits. Default: the parameter `seed`, if it is a number; else all episodes
    are the same."""
    metrics: dict[str, str] = Field(default={})
    """Metrics of an episode, name -> what is made of a variable's values after the steps: last, first, mean,
    sum, min, max, std or count, or with a variable of another name mean(variable). Those of several agents
    are averaged. Default: the last value of each output with a name that an expression can have (world_x for
    world.x of an SSP), where there are at most 1,000."""
    done: str | None = Field(default=None, min_length=1)
    """Condition that ends an episode early: an expression over the metrics as they are after a step, such as
    "distance < 0.1"."""
    fitness: str | None = Field(default=None, min_length=1)
    """The simulation's own fitness, an expression over its metrics. Default: the experiment's."""
    recycle: int = Field(default=1000, ge=0)
    """Episodes after which the process is ended and another one started, for FMUs that leak memory; 0 for
    never."""
    timeout: float = Field(default=60.0, gt=0, le=31 * 86_400)
    """Seconds that an episode may take."""
    environment: dict[str, str] = Field(default={})
    """Environment variables of the process, in addition to the inherited ones."""
    output: float = Field(default=10.0, gt=0)
    """Megabytes that may be printed between two starts of the process."""
    disk: float = Field(default=1000.0, gt=0)
    """Megabytes that may be written into the work folder, where the FMU is unpacked."""
    work: str | None = Field(default=None, min_length=1)
    """The folder that work folders are made in. Default: one of the user's in the system's folder for
    temporary files."""
    sources: list[str] = Field(default=[])
    """Files and folders that the simulation consists of beside the FMU: part of its digest, and copied into
    run folders."""
    dimensions: int = Field(default=2, ge=0, le=1000)
    """Spatial dimensions, which experiments may require."""
    determinism: Literal["bitwise", "statistical", "none"] | None = None
    """How far two evaluations of one episode agree on any server; needed for audits (`faults: {audit}`)."""
    folder: str = Field(default=".", min_length=1)
    """The folder that paths here are relative to. Default: that of the experiment file."""

    @field_validator("metrics")
    @classmethod
    def _names(cls, value: dict[str, str]) -> dict[str, str]:
        for name, text in value.items():
            metric_names.check([name])
            Reduction.parse(name, text)
        return value

    @model_validator(mode="after")
    def _agents_fit(self) -> "FmuOptions":
        named = [*(self.sensors or ()), *(self.actuators or ())]
        numbered = [AGENT in channel.variable for channel in named]
        if any(numbered) and not all(numbered):
            without = next(channel.variable for channel in named if AGENT not in channel.variable)
            raise FieldError("sensors", f"{without} has no {AGENT}, but others do: it would be of all agents")
        if any(numbered) and (self.sensors is None or self.actuators is None):
            raise FieldError("sensors", f"where names hold {AGENT}, write both sensors and actuators")
        return self

    @property
    def file(self) -> Path:
        """The FMU."""
        return Path(self.folder) / self.fmu

    @property
    def description(self) -> Description:
        """What the FMU announces. Raises InputError."""
        return described(self.file, self.start)

    @property
    def layout(self) -> Layout | None:
        """What the variables of an FMU of a whole swarm are, unless they are named. Raises InputError."""
        if self.sensors is not None or self.actuators is not None or "agents" in self.model_fields_set:
            return None
        return layout(self.description)

    @property
    def reports_fitness(self) -> bool:
        """Whether an output is the fitness."""
        found = self.layout
        return found is not None and found.fitness is not None

    @property
    def count(self) -> int:
        """How many agents there are."""
        found = self.layout
        return self.agents if found is None else found.agents

    @property
    def is_one(self) -> bool:
        """Whether all agents are in one instance."""
        return self.layout is not None or any(AGENT in sensor.variable for sensor in self.sensors or ())

    def channels(self, which: Literal["sensors", "actuators"]) -> list[Channel]:
        """Return sensors or actuators, with their ranges written out."""
        causality = "output" if which == "sensors" else "input"
        given = self.sensors if which == "sensors" else self.actuators
        found = self.layout
        if found is not None:
            names = found.sensors if which == "sensors" else found.actuators
            given = [Channel(variable=name) for name in names]
        elif given is None:
            given = [
                Channel(variable=variable.name)
                for variable in self.description.of_causality(causality)
                if variable.name != self.seeded
            ]
        parts = [part for member in given for part in self.expanded(member, causality)]
        return parts if which == "sensors" else [self.ranged(channel) for channel in parts]

    def expanded(self, channel: Channel, causality: str) -> list[Channel]:
        """Return the channels of the variables of a terminal, and of the elements of an array."""
        known = self.description
        names = [channel.variable]
        if channel.terminal:
            members = known.terminals.get(channel.terminal, ())
            names = [
                name
                for name in members
                if name in known.variables and known.variables[name].causality == causality
            ]
        elements = [element for name in names for element in self._elements(known, name)]
        return [Channel(variable=name, unit=channel.unit, range=channel.range) for name in elements]

    def _elements(self, known: Description, name: str) -> Sequence[str]:
        variable = known.variables.get(name)
        if variable is not None:
            return variable.elements or [name]
        first = name.replace(AGENT, "1")
        if name.endswith("]") and first not in known.variables:  # a row of an array of two dimensions
            row = [
                full_name[len(first) - 1 :]
                for full_name in known.variables
                if full_name.startswith(f"{first[:-1]},")
            ]
            return [f"{name[:-1]}{rest}" for rest in row] or [name]
        return [name]

    def ranged(self, channel: Channel) -> Channel:
        """Return an actuator with the range of its variable, unless it has one."""
        variable = self.description.variables.get(channel.variable.replace(AGENT, "1"))
        if channel.range is not None or variable is None:
            return channel
        low, high = variable.minimum, variable.maximum
        factor, offset = self.conversion(channel) or (1.0, 0.0)
        if low is None or high is None or not low < high:
            return channel
        limits = sorted(factor * end + offset for end in (low, high))
        if limits == [-1.0, 1.0]:
            return channel
        return Channel(variable=channel.variable, unit=channel.unit, range=(limits[0], limits[1]))

    def conversion(self, channel: Channel) -> tuple[float, float] | None:
        """Return factor and offset from the FMU's unit of a variable to that of a channel; None for none."""
        variable = self.description.variables.get(channel.variable.replace(AGENT, "1"))
        if not channel.unit or variable is None or channel.unit == variable.unit:
            return None
        return self.description.conversions.get(variable.unit, {}).get(channel.unit)

    @property
    def solved_by(self) -> str | None:
        """FMPy's name of the solver; None for co-simulation."""
        known = self.description
        if known.exchange is None or (self.solver is None and known.identifier):
            return None
        return "Euler" if self.solver == "euler" else "CVode"

    @property
    def seeded(self) -> str | None:
        """The variable that gets the episode's seed."""
        known = self.description.variables.get("seed")
        by_name = known is not None and known.causality == "parameter" and takes_seeds(known)
        return self.seed or ("seed" if by_name else None)

    @property
    def columns(self) -> dict[str, Reduction]:
        """What is made of variables, by the metric's name."""
        if self.metrics:
            return {name: Reduction.parse(name, text) for name, text in self.metrics.items()}
        found = self.layout
        if found is not None and found.metrics:
            return {name: Reduction("last", variable) for name, variable in found.metrics.items()}
        outputs = [output.name for output in self.description.of_causality("output")]
        if len(outputs) > MOST:
            return {}
        is_system = self.description.version == VERSION
        named = {name.replace(".", "_") if is_system else name: name for name in outputs}
        return {
            metric: Reduction("last", name)
            for metric, name in named.items()
            if metric_names.problem_of(metric) is None
        }

    @property
    def size(self) -> float:
        """Seconds of a step."""
        if self.step is not None:
            return self.step
        known = self.description
        duration = None if known.stop_time is None else known.stop_time - known.start_time
        return known.step_size or (duration / _STEPS if duration and duration > 0 else 0.1)

    @property
    def _duration(self) -> float | None:
        """Seconds from the start to the stop time; None where these say nothing about episodes."""
        start, stop = self.description.start_time, stop_time(self.description)
        return None if stop is None or stop <= start else stop - start

    @property
    def length(self) -> int:
        """Steps of an episode."""
        duration = self._duration
        if self.steps is not None or duration is None:
            found = self.layout
            until_done = found is not None and found.done is not None
            return self.steps or (_MOST_STEPS if until_done else _STEPS)
        return max(1, round(duration / self.size))

    @property
    def uneven_steps(self) -> str | None:
        """What is to be said where steps do not end at the stop time; None where they do."""
        duration = self._duration
        if self.steps is not None or duration is None:
            return None
        whole = self.length * self.size
        if math.isclose(whole, duration, rel_tol=1e-6):
            return None
        return (
            f"step: {self.size:g} s does not divide the {duration:g} s from start to stop of {self.fmu}; an "
            f"episode has {self.length} steps, {whole:g} s; write simulation.steps for another length"
        )

    @property
    def parameters(self) -> dict[str, Variable]:
        """What experiments can set; not `seed`, which is the name of the episode's."""
        return {
            variable.name: variable
            for variable in self.description.variables.values()
            if variable.causality == "parameter"
            and not variable.is_array
            and variable.count == 1
            and variable.name not in {*self.start, self.seeded, "seed"}
        }

    def named_files(self) -> Iterator[tuple[str, Sequence[str]]]:
        """See `Definition`."""
        yield "fmu", [self.fmu]
        yield "sources", self.sources

    def as_command(self) -> CommandOptions:
        """See `Definition`."""
        return CommandOptions(
            command=[sys.executable, "-m", "swarmwright.simulations.fmu", f"{{folder}}/{ATTACHMENT}"],
            title=self.title,
            controller="stepwise",
            sensors=len(self.channels("sensors")) or None,
            actuators=len(self.channels("actuators")) or None,
            metrics=dict.fromkeys(self.columns, "last"),
            fitness=self.fitness,
            dimensions=self.dimensions,
            timeout=self.timeout,
            recycle=self.recycle,
            environment=self.environment,
            output=self.output,
            disk=self.disk,
            children="end",
            work=self.work,
            determinism=self.determinism,
            folder=self.folder,
        )

    def attachment(self) -> dict[str, Any]:
        """Return what the program reads."""
        found = self.layout
        return {
            "fmu": str(self.file.resolve()),
            "agents": self.count,
            "one": self.is_one,
            "algorithm": self.algorithm or "gauss_seidel",
            "solver": self.solved_by,
            "sensors": [self._written(channel) for channel in self.channels("sensors")],
            "actuators": [self._written(channel) for channel in self.channels("actuators")],
            "step": self.size,
            "steps": self.length,
            "start": self.start,
            "seed": self.seeded,
            "metrics": {name: [column.function, column.column] for name, column in self.columns.items()},
            "done": self.done,
            "fitness": None if found is None else found.fitness,
            "acts": None if found is None else found.acts,
            "ended": None if found is None else found.done,
        }

    def _written(self, channel: Channel) -> dict[str, Any]:
        """Return what the program reads of a channel."""
        return {
            "variable": channel.variable,
            "range": channel.range,
            "convert": self.conversion(channel),
        }

    def problems(self) -> list[tuple[Path_, str]]:
        """See `Definition`."""
        return problems(self)

    @property
    def no_library(self) -> str:
        """What is said where the FMU has no library for this machine."""
        there = ", ".join(self.description.platforms) or "none"
        return (
            f"{self.file}: has no library for this machine, {' or '.join(place())}; available: {there}. "
            "`fmpy compile FILE` makes one where the FMU holds its source in C"
        )


def missing(options: FmuOptions) -> str | None:
    """Return what this machine lacks to run an FMU, "key: why"; None for nothing."""
    if not is_installed():
        return f"fmu: {NEEDS}"
    return None if runs_here(options.description) else f"fmu: {options.no_library}"
