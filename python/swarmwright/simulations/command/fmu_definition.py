"""The definition of a simulation that is an FMU, `simulation: {fmu: model.fmu, ..}`, and its checks."""

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
    describe_expected,
    find_layout,
    fits,
    flatten,
    get_platforms,
    get_stop_time,
    has_library,
    is_installed,
    is_unsigned,
    takes_seeds,
)
from swarmwright.simulations.fmu.ssp import ENDING, VERSION, Algorithm, describe

MOST = 1000
"""Largest number of variables of an FMU that are used without being named."""

Problem = tuple[Path_, str]


def problems(options: "FmuOptions") -> list[Problem]:
    """Return the mismatches between a definition and its FMU, each with its key."""
    try:
        description = options.description
    except InputError as error:
        return [(("fmu",), str(error))]
    return [
        *_check_model(options, description),
        *_check_channels(options, description, "sensors"),
        *_check_channels(options, description, "actuators"),
        *_check_metrics(options, description),
        *_check_starts(options, description),
    ]


def _check_model(options: "FmuOptions", description: Description) -> Iterator[Problem]:
    if not has_library(description):
        yield ("fmu",), options.no_library
    if options.algorithm is not None and description.version != VERSION:
        yield ("algorithm",), f"is for systems of FMUs ({ENDING}); {options.fmu} is a single FMU"
    if options.solver is not None and description.exchange is None:
        yield ("solver",), f"{options.fmu} supports only co-simulation, with its own solver"
    if description.only_once and options.agents > 1 and not options.is_one:
        yield ("agents",), f"{options.fmu} allows a single instance in a process, not {options.agents}"


def _check_metrics(options: "FmuOptions", description: Description) -> Iterator[Problem]:
    for name in options.metrics:
        problem = _check_readable(options, description, options.columns[name].column)
        if problem is not None:
            yield ("metrics", name), problem


def _check_starts(options: "FmuOptions", description: Description) -> Iterator[Problem]:
    names = list(description.variables)
    for name, value in options.start.items():
        variable = description.variables.get(name)
        problem = (
            _describe_unknown_variable(options.fmu, name, names)
            if variable is None
            else _check_start(variable, value, f"{name} of {options.fmu}", description)
        )
        if problem is not None:
            yield ("start", name), problem
    if options.seed is None:
        return
    variable = description.variables.get(options.seed)
    if variable is None:
        yield ("seed",), _describe_unknown_variable(options.fmu, options.seed, names)
    elif not takes_seeds(variable):
        kind = "an array" if variable.is_array else f"of the type {variable.type}"
        yield ("seed",), f"{options.seed} of {options.fmu} is {kind}; expected an integer or a number"
    elif variable.count > 1:
        yield ("seed",), f"{options.seed} of {options.fmu} is an element of an array; expected a variable"


def _check_start(
    variable: Variable,
    value: Any,  # noqa: ANN401 - whatever the file says
    about: str,
    description: Description,
) -> str | None:
    """Return the problem with a start value of a variable, if any."""
    if variable.count > 1:
        whole = variable.name.rpartition("[")[0]
        return f"{about} is an element of an array; write the start values of the array {whole} as a list"
    if variable.is_array:
        return _check_start_array(variable, value, about)
    if isinstance(value, list):
        return f"{about} is a single value, not a list"
    if variable.causality == STRUCTURAL:
        if description.version == VERSION:
            return f"{about} is a structural parameter, which can be set for a single FMU, but not in an SSP"
        if type(value) is not int or value < 1:
            return f"{about} is a structural parameter, expected an integer from 1, not {format_value(value)}"
    return None if fits(variable, value) else _describe_type_mismatch(variable, value, about)


def _check_start_array(variable: Variable, value: Any, about: str) -> str | None:  # noqa: ANN401 - as above
    count = math.prod(variable.shape)
    shape = f"{about} has the shape {' x '.join(map(str, variable.shape))}"
    if not isinstance(value, list):
        return f"{shape}; expected a list of {count} values, not {format_value(value)}"
    values = flatten(value)
    if len(values) != count:
        return f"{shape}; expected {count} values, row by row, not {len(values)}"
    if (
        value
        and isinstance(value[0], list)
        and any(not isinstance(row, list) or len(row) * variable.shape[0] != count for row in value)
    ):
        return f"{shape}; expected {variable.shape[0]} rows of {count // variable.shape[0]} values each"
    wrong = next((item for item in values if not fits(variable, item)), None)
    return None if wrong is None else _describe_type_mismatch(variable, wrong, about)


def _describe_type_mismatch(variable: Variable, value: Any, about: str) -> str:  # noqa: ANN401 - as above
    expected_value = describe_expected(variable)
    if expected_value is None:
        return f"{about} is of the type {variable.type}, which cannot be set"
    return f"{about} is of the type {variable.type}, expected {expected_value}, not {format_value(value)}"


def _check_channels(
    options: "FmuOptions", description: Description, kind: Literal["sensors", "actuators"]
) -> Iterator[Problem]:
    declared = options.sensors if kind == "sensors" else options.actuators
    causality = "output" if kind == "sensors" else "input"
    for index, channel in enumerate(declared or ()):
        parts = options.expand_channel(channel, causality)
        if not parts:
            yield (
                (kind, index),
                _describe_empty_terminal(options.fmu, description, channel.terminal, causality),
            )
        messages = (_check_channel(options, description, part, kind) for part in parts)
        problem = next((item for item in messages if item is not None), None)
        if problem is not None:
            yield (kind, index), problem
    channels = options.channels(kind)
    if declared is None and len(channels) > MOST:
        noun = "outputs" if kind == "sensors" else "inputs"
        yield (kind,), f"is missing: {options.fmu} has {len(channels):,} {noun}; name the {kind} among them"
    elif declared is None and kind == "actuators":
        without = (_check_range(options, description, port) for port in channels)
        yield from (((kind,), f"is missing: {item}") for item in without if item is not None)
    if not channels and (kind == "sensors" or declared is None):
        noun = "an output" if kind == "sensors" else "an input"
        yield (kind,), f"is missing: {options.fmu} has no numeric variable that is {noun}"


def _check_channel(
    options: "FmuOptions", description: Description, channel: "Channel", kind: Literal["sensors", "actuators"]
) -> str | None:
    """Return the problem with a sensor or an actuator, if any."""
    problem = _check_readable(options, description, channel.variable)
    if problem is None and kind == "actuators":
        problem = _check_settable(options.fmu, description, channel.variable)
    problem = problem or _check_convertible(options, description, channel)
    if problem is None and kind == "actuators":
        problem = _check_range(options, description, options.add_range(channel))
    return problem


def _check_range(options: "FmuOptions", description: Description, channel: "Channel") -> str | None:
    """Return the problem with an unsigned actuator that has no range, if any."""
    variable = description.variables[channel.variable.replace(AGENT, "1")]
    if channel.range is not None or not is_unsigned(variable):
        return None
    return (
        f"{variable.name} of {options.fmu} is of the type {variable.type}, without min and max; write the "
        f"range for -1 to 1 of the actuator, such as {{variable: {channel.variable}, range: [0, 10]}}"
    )


def _check_readable(options: "FmuOptions", description: Description, name: str) -> str | None:
    """Return the problem with reading the values of a variable, if any."""
    for full_name in {name.replace(AGENT, str(agent)) for agent in (1, options.agents)}:
        variable = description.variables.get(full_name)
        if variable is None:
            numbers = [candidate.name for candidate in description.variables.values() if candidate.is_number]
            return _describe_unknown_variable(options.fmu, full_name, numbers)
        if not variable.is_number:
            kind = "an array" if variable.is_array else f"of the type {variable.type}"
            return f"{full_name} of {options.fmu} is {kind}, not a number"
    return None


def _check_settable(file: str, description: Description, name: str) -> str | None:
    causality = description.variables[name.replace(AGENT, "1")].causality
    if causality == "input":
        return None
    inputs = ", ".join(variable.name for variable in description.get_variables("input")) or "none"
    return f"{name} of {file} is not an input, but has the causality {causality}; inputs: {inputs}"


def _check_convertible(options: "FmuOptions", description: Description, channel: "Channel") -> str | None:
    variable = description.variables[channel.variable.replace(AGENT, "1")]
    if not channel.unit or channel.unit == variable.unit or options.conversion(channel) is not None:
        return None
    about = f"{variable.name} of {options.fmu}"
    if not variable.unit:
        return f"unit: {about} has no unit, so {channel.unit} cannot be converted"
    units = list(description.conversions.get(variable.unit, {}))
    hint = suggest_or_list(channel.unit, units)
    return (
        f"unit: {options.fmu} does not define a conversion from {variable.unit}, the unit of "
        f"{variable.name}, to {channel.unit!r}{hint}"
    )


def _describe_empty_terminal(file: str, description: Description, terminal: str, causality: str) -> str:
    """Return a message about a terminal without variables."""
    if terminal in description.terminals:
        return f"the terminal {terminal} of {file} has no {causality}"
    names = list(description.terminals)
    hint = suggest_or_list(terminal, names)
    return f"{file} has no terminal {terminal!r}{hint}"


def _describe_unknown_variable(file: str, name: str, names: Sequence[str]) -> str:
    few = ", ".join(names[:20]) + (", .." if len(names) > 20 else "")
    hint = did_you_mean(name, list(names)) or f"; available: {few or 'none'}"
    return f"{file} has no variable {name!r}{hint}"


class Channel(Options):
    """A variable of an FMU, or all variables of a terminal, as sensors or actuators.

    With a range, its lowest and highest values are -1 and 1 for the controller.
    """

    variable: str = ""
    """The name of the variable; {agent} stands for the number of the agent, from 1. Each element of an array
    (FMI 3.0) is a sensor or an actuator; `x[{agent}]` is a row of elements for each agent."""
    terminal: str = ""
    """Instead of a variable: a terminal (FMI 3.0), all outputs of which are sensors, or all inputs
    actuators."""
    unit: str = ""
    """The unit of the values and of the range, converted by the FMU's unit definitions. Default: the
    variable's unit."""
    range: tuple[float, float] | None = None
    """Lowest and highest value. Default for actuators: the variable's min and max if it has both; otherwise
    values are not scaled."""

    @model_validator(mode="after")
    def _is_one(self) -> "Channel":
        if bool(self.variable) == bool(self.terminal):
            raise ValueError("write either a variable or a terminal")
        if AGENT in self.terminal:
            raise FieldError("terminal", f"cannot contain {AGENT}; name its variables")
        return self

    @field_validator("range")
    @classmethod
    def _check_order(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
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
    """Convert lists of two numbers, as in YAML, to tuples."""
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
"""Name of the program's input file in the folder of an instance."""
_STEPS = 100
_MOST_STEPS = 2**31


class FmuOptions(Definition):
    """A simulation that is a Functional Mock-up Unit (FMU) of FMI 2.0 or 3.0.

    FMPy steps it: `pip install 'swarmwright[fmi]'`. The FMU's parameters are the simulation's, set and
    evolved by name.
    """

    prefix: ClassVar[str] = SimulationName.FMU

    fmu: str = Field(min_length=1)
    """The file, relative to the experiment file: an FMU, or an SSP with several FMUs, stepped together."""
    algorithm: Algorithm | None = None
    """Stepping of the FMUs of an SSP. jacobi: inputs are outputs at the beginning of the step. gauss_seidel:
    in the order of the file, with the new outputs of previous FMUs. Default: gauss_seidel."""
    title: str | None = Field(default=None, min_length=1, max_length=1000)
    """The name in discovery. Default: the file's name and a digest of this definition and of the file."""
    agents: int = Field(default=1, ge=1, le=10_000)
    """Number of agents, each an instance of the FMU, or all in one if names contain {agent}. Default with
    variables agent[1].NAME, agent[2].NAME, ..: all of these in one instance.
    """
    sensors: Channels = None
    """Sensors of an agent: names of variables, {terminal: NAME}, or {variable: NAME, range: [low, high]} to
    map a range to -1 to 1, optionally with `unit: km/h`. An array stands for all its elements. Default: all
    numeric and boolean outputs of the agent, not scaled."""
    actuators: Channels = None
    """Actuators of an agent, in the same form; -1 to 1 is mapped to the range. Default: all numeric and
    boolean inputs; none if a parameter set is evolved."""
    step: float | None = Field(default=None, gt=0)
    """Seconds of a step. Default: the FMU's own step size, else a hundredth of its stop time, else 0.1."""
    solver: Literal["cvode", "euler"] | None = None
    """Solver for model exchange: CVode of SUNDIALS, or Euler's method. Default: co-simulation, or CVode if
    the FMU supports only model exchange."""
    steps: int | None = Field(default=None, ge=1, le=2**31)
    """Steps of an episode. Default: up to the FMU's stop time, else 100."""
    start: dict[str, float | int | bool | str | list[Any]] = Field(default={})
    """Start values of variables, by name; for arrays (FMI 3.0), a list of values or of rows. Structural
    parameters set the sizes of arrays."""
    seed: str | None = Field(default=None, min_length=1)
    """Parameter or input for the episode's seed, modulo 2^31 or the size of its type. Default: the numeric
    parameter `seed`; without it, all episodes are the same."""
    metrics: dict[str, str] = Field(default={})
    """Metrics of an episode, name -> reduction of its variable over the steps: last, first, mean, sum, min,
    max, std or count; of another variable: mean(variable). Several agents are averaged. Default: last of
    each output with a valid name (world_x for world.x of an SSP), up to 1,000.
    """
    done: str | None = Field(default=None, min_length=1)
    """Condition that ends an episode early, over the metrics: "distance < 0.1"."""
    fitness: str | None = Field(default=None, min_length=1)
    """The simulation's own fitness, an expression over its metrics. Default: the experiment's fitness."""
    recycle: int = Field(default=1000, ge=0)
    """Episodes after which the process is replaced, for FMUs that leak memory; 0 for never."""
    timeout: float = Field(default=60.0, gt=0, le=31 * 86_400)
    """Seconds that an episode may take."""
    environment: dict[str, str] = Field(default={})
    """Environment variables of the process, in addition to the inherited ones."""
    output: float = Field(default=10.0, gt=0)
    """Megabytes that may be printed between two starts of the process."""
    disk: float = Field(default=1000.0, gt=0)
    """Megabytes that may be written into the work folder, where the FMU is unpacked."""
    work: str | None = Field(default=None, min_length=1)
    """Parent folder of work folders. Default: the system's folder for temporary files."""
    sources: list[str] = Field(default=[])
    """Further files and folders of the simulation, for its digest and for run folders."""
    dimensions: int = Field(default=2, ge=0, le=1000)
    """Spatial dimensions, which experiments may require."""
    determinism: Literal["bitwise", "statistical", "none"] | None = None
    """Agreement of repeated evaluations of an episode; required for audits (`faults: {audit}`)."""
    folder: str = Field(default=".", min_length=1)
    """Base folder of relative paths in this section. Default: that of the experiment file."""

    @field_validator("metrics")
    @classmethod
    def _names(cls, value: dict[str, str]) -> dict[str, str]:
        for name, text in value.items():
            metric_names.check([name])
            Reduction.parse(name, text)
        return value

    @model_validator(mode="after")
    def _agents_fit(self) -> "FmuOptions":
        channels = [*(self.sensors or ()), *(self.actuators or ())]
        numbered = [AGENT in channel.variable for channel in channels]
        if any(numbered) and not all(numbered):
            without = next(channel.variable for channel in channels if AGENT not in channel.variable)
            raise FieldError(
                "sensors", f"{without} lacks {AGENT}, which other names have; add it to all names"
            )
        if any(numbered) and (self.sensors is None or self.actuators is None):
            raise FieldError("sensors", f"write both sensors and actuators if names contain {AGENT}")
        return self

    @property
    def file(self) -> Path:
        """Path of the FMU."""
        return Path(self.folder) / self.fmu

    @property
    def description(self) -> Description:
        """The FMU's description. Raises InputError."""
        return describe(self.file, self.start)

    @property
    def layout(self) -> Layout | None:
        """The layout of an FMU of a whole swarm, unless variables are named. Raises InputError."""
        if self.sensors is not None or self.actuators is not None or "agents" in self.model_fields_set:
            return None
        return find_layout(self.description)

    @property
    def reports_fitness(self) -> bool:
        """Whether an output is the fitness."""
        swarm_layout = self.layout
        return swarm_layout is not None and swarm_layout.fitness is not None

    @property
    def count(self) -> int:
        """Number of agents."""
        swarm_layout = self.layout
        return self.agents if swarm_layout is None else swarm_layout.agents

    @property
    def is_one(self) -> bool:
        """Whether all agents are in the same instance."""
        return self.layout is not None or any(AGENT in sensor.variable for sensor in self.sensors or ())

    def channels(self, kind: Literal["sensors", "actuators"]) -> list[Channel]:
        """Return sensors or actuators, with default ranges added."""
        causality = "output" if kind == "sensors" else "input"
        declared = self.sensors if kind == "sensors" else self.actuators
        swarm_layout = self.layout
        if swarm_layout is not None:
            names = swarm_layout.sensors if kind == "sensors" else swarm_layout.actuators
            declared = [Channel(variable=name) for name in names]
        elif declared is None:
            declared = [
                Channel(variable=variable.name)
                for variable in self.description.get_variables(causality)
                if variable.name != self.seed_variable
            ]
        parts = [part for member in declared for part in self.expand_channel(member, causality)]
        return parts if kind == "sensors" else [self.add_range(channel) for channel in parts]

    def expand_channel(self, channel: Channel, causality: str) -> list[Channel]:
        """Return the channels of the variables of a terminal, and of the elements of an array."""
        description = self.description
        names = [channel.variable]
        if channel.terminal:
            members = description.terminals.get(channel.terminal, ())
            names = [
                name
                for name in members
                if name in description.variables and description.variables[name].causality == causality
            ]
        elements = [element for name in names for element in self._elements(description, name)]
        return [Channel(variable=name, unit=channel.unit, range=channel.range) for name in elements]

    def _elements(self, description: Description, name: str) -> Sequence[str]:
        variable = description.variables.get(name)
        if variable is not None:
            return variable.elements or [name]
        first = name.replace(AGENT, "1")
        if name.endswith("]") and first not in description.variables:  # a row of a two-dimensional array
            row = [
                full_name[len(first) - 1 :]
                for full_name in description.variables
                if full_name.startswith(f"{first[:-1]},")
            ]
            return [f"{name[:-1]}{indices}" for indices in row] or [name]
        return [name]

    def add_range(self, channel: Channel) -> Channel:
        """Return an actuator with the range of its variable, unless it has its own."""
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
        """Return factor and offset from a variable's unit to a channel's; None if they are the same."""
        variable = self.description.variables.get(channel.variable.replace(AGENT, "1"))
        if not channel.unit or variable is None or channel.unit == variable.unit:
            return None
        return self.description.conversions.get(variable.unit, {}).get(channel.unit)

    @property
    def solver_name(self) -> str | None:
        """FMPy's name of the solver; None for co-simulation."""
        description = self.description
        if description.exchange is None or (self.solver is None and description.identifier):
            return None
        return "Euler" if self.solver == "euler" else "CVode"

    @property
    def seed_variable(self) -> str | None:
        """Name of the variable that receives the episode's seed."""
        variable = self.description.variables.get("seed")
        is_default = variable is not None and variable.causality == "parameter" and takes_seeds(variable)
        return self.seed or ("seed" if is_default else None)

    @property
    def columns(self) -> dict[str, Reduction]:
        """Reductions of variables, by the metric's name."""
        if self.metrics:
            return {name: Reduction.parse(name, text) for name, text in self.metrics.items()}
        swarm_layout = self.layout
        if swarm_layout is not None and swarm_layout.metrics:
            return {name: Reduction("last", variable) for name, variable in swarm_layout.metrics.items()}
        outputs = [output.name for output in self.description.get_variables("output")]
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
        description = self.description
        duration = None if description.stop_time is None else description.stop_time - description.start_time
        return description.step_size or (duration / _STEPS if duration and duration > 0 else 0.1)

    @property
    def _duration(self) -> float | None:
        """Seconds from the start to the stop time; None if the FMU does not define them."""
        start, stop = self.description.start_time, get_stop_time(self.description)
        return None if stop is None or stop <= start else stop - start

    @property
    def length(self) -> int:
        """Steps of an episode."""
        duration = self._duration
        if self.steps is not None or duration is None:
            swarm_layout = self.layout
            until_done = swarm_layout is not None and swarm_layout.done is not None
            return self.steps or (_MOST_STEPS if until_done else _STEPS)
        return max(1, round(duration / self.size))

    @property
    def uneven_steps(self) -> str | None:
        """Notice that steps do not end at the stop time; None if they do."""
        duration = self._duration
        if self.steps is not None or duration is None:
            return None
        whole = self.length * self.size
        if math.isclose(whole, duration, rel_tol=1e-6):
            return None
        return (
            f"step: {self.size:g} s does not divide the {duration:g} s from start to stop of {self.fmu}, so "
            f"an episode has {self.length} steps, {whole:g} s; set simulation.steps for another length"
        )

    @property
    def parameters(self) -> dict[str, Variable]:
        """Parameters that experiments can set, without `seed`, the name of the episode's seed."""
        return {
            variable.name: variable
            for variable in self.description.variables.values()
            if variable.causality == "parameter"
            and not variable.is_array
            and variable.count == 1
            and variable.name not in {*self.start, self.seed_variable, "seed"}
        }

    def list_named_files(self) -> Iterator[tuple[str, Sequence[str]]]:
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
        """Return the program's input."""
        swarm_layout = self.layout
        return {
            "fmu": str(self.file.resolve()),
            "agents": self.count,
            "one": self.is_one,
            "algorithm": self.algorithm or "gauss_seidel",
            "solver": self.solver_name,
            "sensors": [self._describe_channel(channel) for channel in self.channels("sensors")],
            "actuators": [self._describe_channel(channel) for channel in self.channels("actuators")],
            "step": self.size,
            "steps": self.length,
            "start": self.start,
            "seed": self.seed_variable,
            "metrics": {name: [column.function, column.column] for name, column in self.columns.items()},
            "done": self.done,
            "fitness": None if swarm_layout is None else swarm_layout.fitness,
            "acts": None if swarm_layout is None else swarm_layout.acts,
            "ended": None if swarm_layout is None else swarm_layout.done,
        }

    def _describe_channel(self, channel: Channel) -> dict[str, Any]:
        """Return the program's input for a channel."""
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
        """Message that the FMU has no library for this machine."""
        platforms = ", ".join(self.description.platforms) or "none"
        return (
            f"{self.file}: has no library for this machine, {' or '.join(get_platforms())}; available: "
            f"{platforms}. If the FMU contains its C source, `fmpy compile FILE` builds a library"
        )


def explain_missing(options: FmuOptions) -> str | None:
    """Return what this machine lacks to run an FMU, "key: reason"; None for nothing."""
    if not is_installed():
        return f"fmu: {NEEDS}"
    return None if has_library(options.description) else f"fmu: {options.no_library}"
