"""The definition of a simulation that is a command: `simulation: {command: ..}` in an experiment."""

import json
import math
import re
import shlex
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    BeforeValidator,
    Field,
    StrictBool,
    StrictFloat,
    StrictInt,
    StrictStr,
    ValidationError,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from swarmwright.common import metric_names
from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError, format_value, problems_of
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.yaml import Path_, format_path
from swarmwright.simulations.command import work_files
from swarmwright.simulations.ros.expression import FUNCTIONS

_FORM = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\(\s*(.+?)\s*\))?\s*")


@dataclass(frozen=True)
class Reduction:
    """A reduction of a log's column to a number: last, mean, .."""

    function: str
    column: str

    @classmethod
    def parse(cls, metric: str, text: str) -> Self:
        """Read `mean` or `mean(column)`. Raises ValueError."""
        match = _FORM.fullmatch(text)
        if match is None or match[1] not in FUNCTIONS:
            hint = did_you_mean(match[1], FUNCTIONS) if match else ""
            names = ", ".join(FUNCTIONS)
            raise FieldError(
                metric, f"{text!r} found, expected one of {names}, or such as mean(column){hint}"
            )
        return cls(match[1], match[2] or metric)

    def __str__(self) -> str:
        return f"{self.function}({self.column})"

    def reduce(self, column: Sequence[float]) -> float:
        """Return the value for a column that is not empty; NaN if the numbers have none."""
        if self.function not in {"first", "last", "count"} and any(map(math.isnan, column)):
            return math.nan  # the minimum of numbers and NaN depends on their order
        try:
            return float(FUNCTIONS[self.function](column))
        except (OverflowError, ValueError):  # infinite numbers, or too large a sum
            return math.nan


_SHELL = frozenset({">", ">>", "<", "|", "||", "&", "&&", ";", "2>&1", "2>"})
STANDARD_OUTPUT = "stdout"
"""The log of a command that prints its results."""


def _split_words(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    """Split a command into words like a shell, without running a shell."""
    if isinstance(value, str):
        try:
            value = shlex.split(text := value)
        except ValueError as error:
            raise ValueError(
                f"cannot be split into words: {error}; write a list of words, which needs no quotes"
            ) from None
        strange = next((word for word in value if word in _SHELL), None)
        if strange is not None:
            raise ValueError(
                f"{strange} needs a shell, but commands run without one; write [sh, -c, {json.dumps(text)}]"
            )
    if not isinstance(value, list) or not all(isinstance(item, str | int | float) for item in value):
        raise ValueError(f"must be text or a list of words, not {format_value(value)}")
    words = ["" if isinstance(item, bool) else str(item) for item in value]
    if not words or not words[0]:
        raise ValueError("must not be empty")
    return words


def _to_list(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    return [value] if isinstance(value, str) else value


def _expand_names(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    """Return the last value of each column for a list of names."""
    if isinstance(value, list) and all(isinstance(item, str) for item in value):
        return dict.fromkeys(value, "last")
    return value


_METRICS = {
    "anyOf": [
        {"type": "object", "additionalProperties": {"type": "string"}},
        {"type": "array", "items": {"type": "string"}},
    ]
}
_COMMAND = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}
Command = Annotated[Any, BeforeValidator(_split_words), WithJsonSchema(_COMMAND)]
Choices = dict[str, Annotated[list[StrictStr | StrictBool | StrictInt | StrictFloat], Field(min_length=1)]]
Texts = Annotated[list[str], BeforeValidator(_to_list), WithJsonSchema(_COMMAND)]


class Definition(Options):
    """The definition of a simulation that runs as a process."""

    prefix: ClassVar[str]
    """Prefix of the names of these simulations."""

    if TYPE_CHECKING:  # fields of every definition, which declare them themselves
        folder: str
        fitness: str | None

    @property
    def name(self) -> str:
        """The simulation's name, which contains the whole definition."""
        values = self.model_dump(exclude_defaults=True)
        return f"{self.prefix}{json.dumps(values, sort_keys=True, separators=(',', ':'))}"

    def rebase(self, base: Path) -> Self:
        """Return a copy whose folder is relative to `base`."""
        return self.model_copy(update={"folder": str(base / self.folder)})

    @classmethod
    def parse(cls, name: str) -> Self:
        """Parse a simulation's name. Raises InputError if it does not contain a definition."""
        try:
            return cls.model_validate_json(name.removeprefix(cls.prefix))
        except ValidationError as error:
            problems = problems_of(error, cls, (cls.prefix.removesuffix(":"),))
            raise InputError(
                "\n".join(f"{format_path(path)}: {message}" for path, message in problems)
            ) from error

    @abstractmethod
    def as_command(self) -> "CommandOptions":
        """Return the command that runs episodes."""

    @abstractmethod
    def list_named_files(self) -> Iterator[tuple[str, Sequence[str]]]:
        """Yield keys, and the files that they name; for `command`, words that may be files."""

    def problems(self) -> list[tuple[Path_, str]]:
        """Return problems that involve more than the form of a key, with the keys."""
        return []


class CommandOptions(Definition):
    """A simulation that is a command: each episode is a process with its own work folder.

    The command, the values of `environment` and the text of `files` may contain placeholders: {parameters},
    {controller}, {weights}, {log} (paths of these files), {folder} (the work folder), {build} (the folder of
    compiled files), {here} (the folder of the experiment file), {seed}, {episode}, {instance}, {port}, and
    the simulation's parameters by name (text only with `choices`). {{name}} in a command stands for {name}.
    """

    prefix: ClassVar[str] = SimulationName.COMMAND

    command: Command
    """The program and its arguments, as a list or as text that is split as in a shell, but run without one.
    Names of files beside the experiment file become their paths.
    """
    title: str | None = Field(default=None, min_length=1, max_length=1000)
    """The name in discovery. Default: the program's name and a digest of this definition and its files."""
    parameters: str | None = Field(default=None, min_length=1)
    """A YAML or JSON file with the program's parameters and their defaults; nested ones have dots, pid.kp.
    Default: any name can be set.
    """
    choices: Choices = Field(default={})
    """All values of a parameter: mode: [fast, exact]. Required for text in commands and files, so that an
    optimization tool cannot choose what is run.
    """
    parameters_format: Literal["yaml", "json", "ros2"] = "yaml"
    """Format of the file {parameters}, with all parameters and the episode's `seed`. ros2: YAML below `/**:
    ros__parameters:`."""
    files: Annotated[
        Any,
        WithJsonSchema(
            {
                "anyOf": [
                    {"type": "array", "items": {"type": "string"}},
                    {"type": "object", "additionalProperties": {"type": "string"}},
                ]
            }
        ),
    ] = Field(default={})
    """Files and folders to copy into the work folder, at most 10,000 of 64 MiB: a list of paths, or a mapping
    from names in the work folder to paths. Placeholders in text files are filled in.
    """
    log: Texts = Field(default=[])
    """Result files in the work folder: a path, a pattern such as `agent_*.csv`, or a list, whose rows are
    concatenated. `stdout`: the program's output."""
    log_format: Literal["auto", "csv", "tsv", "agents", "jsonl", "json", "rosbag", "mcap"] = "auto"
    """auto: by the suffix. csv, tsv: with column names; comments (#) and a row of units are ignored. agents:
    a file per agent, with lines of step, tab and value; its columns are steps, first and last. jsonl: an
    object per line. json: an object or a list of objects; nested values have names such as pose.x. rosbag
    (ROS 1 or 2), mcap: messages, with columns such as /robot_1/pose.position.x.
    """
    metrics: Annotated[dict[str, str], BeforeValidator(_expand_names), WithJsonSchema(_METRICS)] = Field(
        default={}
    )
    """Metrics of an episode, name -> reduction of its column: last, first, mean, sum, min, max, std
    (population) or count; of another column: mean(column). A list of names means last. stepwise: names of
    reported metrics. Default: last of the metrics in the fitness.
    """
    fitness: str | None = Field(default=None, min_length=1)
    """The simulation's own fitness, an expression over its metrics. Default: the experiment's fitness, or the
    metric or column `fitness`."""
    controller: Literal["none", "json", "c", "cpp", "python", "onnx", "stepwise"] = "none"
    """How the command receives a controller. none: only parameters are evolved (parameter_set). json: its
    specification as the file {controller}. c, cpp, python, onnx: exported code or model as {controller},
    see `swarmwright export`. stepwise: the process exchanges sensors and actuators as JSON lines over
    standard input and output, for many episodes.
    """
    sensors: int | None = Field(default=None, ge=1, le=1_000_000)
    """Sensor values of an agent; required if controllers control agents."""
    actuators: int | None = Field(default=None, ge=1, le=1_000_000)
    """Actuator values of an agent; required if controllers control agents."""
    dimensions: int = Field(default=2, ge=0, le=1000)
    """Spatial dimensions, which experiments may require."""
    visual: Command | None = None
    """Command for `swarmwright simulate --visual`. Default: `command`."""
    compile: Command | None = None
    """Command to run once per controller, with {controller} and {build}, the folder for the compiled
    program."""
    weights: Literal["compiled", "file"] = "compiled"
    """Weights of a controller in C. compiled: in its source, compiled for each candidate. file: in the file
    {weights}, read with `controller_load(path)`: one compilation for all candidates.
    """
    timeout: float = Field(default=60.0, gt=0, le=31 * 86_400)
    """Time limit of an episode, seconds; then it fails and its processes are ended."""
    recycle: int = Field(default=0, ge=0)
    """stepwise: episodes after which the process is replaced; 0 for never."""
    environment: dict[str, str] = Field(default={})
    """Further environment variables, such as `DISPLAY: ":1{instance}"`."""
    output: float = Field(default=10.0, gt=0)
    """Megabytes that an episode may print before it fails."""
    disk: float = Field(default=1000.0, gt=0)
    """Megabytes that an episode may write into its work folder before it fails."""
    children: Literal["fail", "end"] = "fail"
    """Whether the episode fails if another of its processes still runs 0.3 s after the command; it is ended
    in either case."""
    keep: Literal["failed", "all", "none"] = "failed"
    """Work folders to keep: of the first failures of each kind, all, or none; servers.log in the run folder
    lists them.
    """
    work: str | None = Field(default=None, min_length=1)
    """Parent folder of work folders. Default: the system's folder for temporary files."""
    sources: list[str] = Field(default=[])
    """Further files and folders of the simulation, for its digest and for run folders; those in the command
    and Python imports are included.
    """
    determinism: Literal["bitwise", "statistical", "none"] | None = None
    """Agreement of repeated evaluations of an episode; required for audits (`faults: {audit}`)."""
    folder: str = Field(default=".", min_length=1)
    """Base folder of relative paths in this section. Default: that of the experiment file."""

    @field_validator("files")
    @classmethod
    def _files(cls, value: Any) -> dict[str, str]:  # noqa: ANN401 - whatever the file says
        if isinstance(value, str | list):
            paths = list(_to_list(value))
            value = {Path(str(path)).name: path for path in paths}
            if "" in value:
                raise ValueError(f"{value['']} needs a name in the work folder; write {{NAME: {value['']}}}")
            if len(value) < len(paths):
                raise ValueError(
                    "two paths end in the same name; write a mapping from different names in the work folder "
                    "to paths"
                )
        if not isinstance(value, Mapping) or not all(isinstance(item, str) for item in value.values()):
            raise ValueError("must be a list of paths, or a mapping from names in the work folder to paths")
        for name in value:
            if Path(name).is_absolute() or ".." in Path(name).parts or not Path(name).parts:
                raise ValueError(f"{name!r} is outside the work folder")
        return dict(value)

    @field_validator("log")
    @classmethod
    def _log(cls, value: list[str]) -> list[str]:
        for name in value:
            if ".." in Path(name).parts or Path(name).is_absolute() or not name:
                raise ValueError(
                    f"{name!r} is outside the work folder; have the command write it to the path {{log}}"
                )
        return value

    @field_validator("metrics")
    @classmethod
    def _metrics(cls, value: dict[str, str]) -> dict[str, str]:
        for name, text in value.items():
            problem = metric_names.problem_of(name)
            if problem:
                raise ValueError(f"{problem}; write {metric_names.suggest_name(name)}: last({name})")
            Reduction.parse(name, text)
        return value

    @model_validator(mode="after")
    def _fits(self) -> "CommandOptions":
        text = " ".join([*self.command, *(self.visual or [])])
        if self.controller == "stepwise":
            for name in ("parameters", "seed", "episode", "log"):
                if f"{{{name}}}" in text:
                    raise FieldError(
                        "command",
                        f"{{{name}}} differs between episodes, but a stepwise command runs many of them; "
                        "read parameters and seed from the standard input",
                    )
            if self.log or (
                self.metrics
                and any(str(reduction) != f"last({name})" for name, reduction in self.reductions.items())
            ):
                raise FieldError(
                    "log",
                    "not possible with a stepwise command, which reports metrics and fitness in its last "
                    "line of an episode; remove log, and write metrics: [NAME]",
                )
        if "{log}" in text and len(self.log) != 1:
            raise FieldError(
                "command",
                "{log} needs a log; write log: result.csv"
                if not self.log
                else "{log} needs a single log; write the paths of several as {folder}/NAME",
            )
        if "{controller}" in text and not self.takes_controller:
            raise FieldError("command", "{controller} needs a controller: json, c, cpp, python or onnx")
        if "{build}" in text and self.compile is None:
            raise FieldError("command", "{build} needs compile, the command that fills that folder")
        if self.compile is not None and not self.takes_controller:
            raise FieldError("compile", "needs a controller: json, c, cpp, python or onnx")
        if not self.log and self.controller != "stepwise":
            raise FieldError("log", "is missing; name the result file that the command writes, or stdout")
        return self

    @model_validator(mode="after")
    def _weights_fit(self) -> "CommandOptions":
        if self.loads_weights and (self.controller != "c" or self.compile is None):
            raise FieldError("weights", "file needs controller: c and compile")
        if self.loads_weights and "{weights}" in " ".join(self.compile or []):
            raise FieldError(
                "compile",
                "{weights} differs between candidates, but compile is run once for all; pass it to the "
                "command",
            )
        if "{weights}" in " ".join([*self.command, *(self.visual or [])]) and not self.loads_weights:
            raise FieldError("command", "{weights} needs weights: file")
        return self

    @property
    def takes_controller(self) -> bool:
        """Whether the command receives controllers as files."""
        return self.controller not in {"none", "stepwise"}

    @property
    def loads_weights(self) -> bool:
        """Whether the weights of a compiled controller are in a separate file."""
        return self.weights == "file"

    @property
    def reductions(self) -> dict[str, Reduction]:
        """Reductions of columns, by the metric's name."""
        return {name: Reduction.parse(name, text) for name, text in self.metrics.items()}

    def as_command(self) -> "CommandOptions":
        """Return this definition."""
        return self

    def problems(self) -> list[tuple[Path_, str]]:
        """See `Definition`."""
        problem = work_files.find_problem(self.files, Path(self.folder))
        return [] if problem is None else [(("files",), problem)]

    def list_named_files(self) -> Iterator[tuple[str, Sequence[str]]]:
        """See `Definition`."""
        yield "command", [*self.command, *(self.compile or ()), *(self.visual or ())]
        yield "parameters", [] if self.parameters is None else [self.parameters]
        yield "files", list(self.files.values())
        yield "sources", self.sources
