"""What an experiment says of a simulation that is a command: `simulation: {command: ..}`.

What is made of a column of a log: last, mean, ..; exact sums, the same on every machine.
"""

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
from swarmwright.simulations.ros.reductions import FUNCTIONS

_FORM = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\(\s*(.+?)\s*\))?\s*")


@dataclass(frozen=True)
class Reduction:
    """A function of a column."""

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

    def of(self, column: Sequence[float]) -> float:
        """Return its value for a column, not empty; NaN where numbers in it have none."""
        if self.function not in {"first", "last", "count"} and any(map(math.isnan, column)):
            return math.nan  # the smallest of numbers and NaN would depend on their order
        try:
            return float(FUNCTIONS[self.function](column))
        except (OverflowError, ValueError):  # of numbers that are infinite, or together too large
            return math.nan


_SHELL = frozenset({">", ">>", "<", "|", "||", "&", "&&", ";", "2>&1", "2>"})
STANDARD_OUTPUT = "stdout"
"""The log of a command that prints its results."""


def _words(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    """Split a command as a shell does, which itself is not used."""
    if isinstance(value, str):
        try:
            value = shlex.split(text := value)
        except ValueError as error:
            raise ValueError(
                f"cannot be split into words: {error}; a list of words needs no quotes"
            ) from None
        strange = next((word for word in value if word in _SHELL), None)
        if strange is not None:
            raise ValueError(
                f"{strange} is for a shell, and none is used; write [sh, -c, {json.dumps(text)}]"
            )
    if not isinstance(value, list) or not all(isinstance(item, str | int | float) for item in value):
        raise ValueError(f"must be text or a list of words, not {format_value(value)}")
    words = ["" if isinstance(item, bool) else str(item) for item in value]
    if not words or not words[0]:
        raise ValueError("must not be empty")
    return words


def _texts(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    return [value] if isinstance(value, str) else value


def _reduced(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
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
Command = Annotated[Any, BeforeValidator(_words), WithJsonSchema(_COMMAND)]
Choices = dict[str, Annotated[list[StrictStr | StrictBool | StrictInt | StrictFloat], Field(min_length=1)]]
Texts = Annotated[list[str], BeforeValidator(_texts), WithJsonSchema(_COMMAND)]


class Definition(Options):
    """What an experiment says of a simulation that is run by a command."""

    prefix: ClassVar[str]
    """What names of such simulations begin with."""

    if TYPE_CHECKING:  # every definition has them, in a place of its own
        folder: str
        fitness: str | None

    @property
    def name(self) -> str:
        """The simulation's name, which holds all of this."""
        values = self.model_dump(exclude_defaults=True)
        return f"{self.prefix}{json.dumps(values, sort_keys=True, separators=(',', ':'))}"

    def below(self, base: Path) -> Self:
        """Return the same with its folder relative to another one."""
        return self.model_copy(update={"folder": str(base / self.folder)})

    @classmethod
    def of(cls, name: str) -> Self:
        """Return what a simulation's name holds. Raises InputError for what is no such definition."""
        try:
            return cls.model_validate_json(name.removeprefix(cls.prefix))
        except ValidationError as error:
            found = problems_of(error, cls, (cls.prefix.removesuffix(":"),))
            raise InputError(
                "\n".join(f"{format_path(path)}: {message}" for path, message in found)
            ) from error

    @abstractmethod
    def as_command(self) -> "CommandOptions":
        """Return the command that runs episodes."""

    @abstractmethod
    def named_files(self) -> Iterator[tuple[str, Sequence[str]]]:
        """Yield keys, and the files that they name; of `command`, words of which some may be files."""

    def problems(self) -> list[tuple[Path_, str]]:
        """Return what is wrong beyond each key's own form, with the keys."""
        return []


class CommandOptions(Definition):
    """A simulation that is a command: a process for each episode, which reads and writes files.

    Its process has a work folder of its own. The command's words, the values of `environment` and the text of
    `files` may hold placeholders: {parameters}, {controller}, {weights}, {log} (paths of these files),
    {folder} (the work folder), {build} (the folder of what was compiled), {here} (the folder of the
    experiment file), {seed}, {episode}, {instance}, {port}, and the simulation's parameters by their names.
    {{name}} in a command stands for {name}. Parameters that are numbers can stand anywhere; for text see
    `choices`.
    """

    prefix: ClassVar[str] = SimulationName.COMMAND

    command: Command
    """The program and its arguments, as text that is split as in a shell, or as a list. No shell is used. A
    word that names a file beside the experiment file stands for that file."""
    title: str | None = Field(default=None, min_length=1, max_length=1000)
    """The name in discovery. Default: the program's name and a digest of this definition and of the files
    that it names, so that servers whose scripts differ are never mixed up."""
    parameters: str | None = Field(default=None, min_length=1)
    """A YAML or JSON file with the program's own parameters and their values: names that can be set and
    evolved, with their defaults; those of nested mappings are written with points, pid.kp. Default: any name
    can be set, and there are no defaults."""
    choices: Choices = Field(default={})
    """All values that a parameter may have: mode: [fast, exact]. Text can be put into words of the command
    and into files only if its choices are declared here, so that no optimization tool decides what is run."""
    parameters_format: Literal["yaml", "json", "ros2"] = "yaml"
    """Format of the file {parameters}, which has all parameters, and the episode's seed as `seed`. ros2: YAML
    below `/**: ros__parameters:`, as nodes of ROS 2 read it."""
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
    """Files and folders that are put into the work folder: a list of paths, or name in the work folder ->
    path. Placeholders in them are filled in, except for binary files, which contain a NUL byte; braces around
    other words stay as they are. A file has at most 64 MiB, and there are at most 10,000."""
    log: Texts = Field(default=[])
    """What the program writes, relative to the work folder: a path, a pattern such as `agent_*.csv`, or a
    list; the rows of all are taken together. `stdout`: what it prints."""
    log_format: Literal["auto", "csv", "tsv", "agents", "jsonl", "json", "rosbag", "mcap"] = "auto"
    """auto: by the ending of the log's name. csv and tsv have a line with the names of the columns; lines
    that begin with # are comments, and a row of units below the names does not count; agents are files
    without names, one for each agent, lines of a step, a tab and a value, of which each is a row with the
    columns steps (how many), first and last; jsonl has an object a line; json an object, or a list of
    objects, whose nested values have names such as pose.x; rosbag, a file or folder of ROS 1 or 2, and mcap
    have messages, whose values are columns such as /robot_1/pose.position.x."""
    metrics: Annotated[dict[str, str], BeforeValidator(_reduced), WithJsonSchema(_METRICS)] = Field(
        default={}
    )
    """Metrics of an episode, name -> what is made of a column: last, first, mean, sum, min, max, std (the
    population standard deviation, divided by n) or count, or with a column of another name
    mean(column). A list of names stands for the last value of each. stepwise: names of metrics that the
    command reports. Default: those of the fitness, each the last value of the column with its name."""
    fitness: str | None = Field(default=None, min_length=1)
    """The simulation's own fitness, an expression over its metrics. Default: the experiment's, or the metric
    or column `fitness`."""
    controller: Literal["none", "json", "c", "cpp", "python", "onnx", "stepwise"] = "none"
    """How a controller that steers agents goes in. none: not at all, what is evolved are parameters
    (parameter_set). json: as a file with its specification, {controller}. c, cpp, python, onnx: as source
    code or a model, see `swarmwright export`; {controller} is controller.c, controller.hpp, controller.py or
    controller.onnx. stepwise: the command is asked for sensors and given actuators over its standard input
    and output, a JSON object a line; one process runs many episodes."""
    sensors: int | None = Field(default=None, ge=1, le=1_000_000)
    """Sensor values of an agent; needed where controllers steer agents."""
    actuators: int | None = Field(default=None, ge=1, le=1_000_000)
    """Actuator values of an agent; needed where controllers steer agents."""
    dimensions: int = Field(default=2, ge=0, le=1000)
    """Spatial dimensions, which experiments may require."""
    visual: Command | None = None
    """A command that is run in the place of `command` by `swarmwright simulate --visual`, to show an episode.
    Default: the same."""
    compile: Command | None = None
    """A command that is run once for each controller before its episodes, with {controller} and {build}, the
    folder where the controller is and where it puts what `command` then runs."""
    weights: Literal["compiled", "file"] = "compiled"
    """Where a controller in C that is compiled has its weights. compiled: in its source, which is compiled
    once for each candidate. file: in the file {weights}, which the program reads with
    `controller_load(path)`, so that one compilation serves all candidates of an experiment."""
    timeout: float = Field(default=60.0, gt=0, le=31 * 86_400)
    """Seconds that an episode may take. Then it has failed, and its processes are ended."""
    recycle: int = Field(default=0, ge=0)
    """stepwise: episodes after which the process is ended and another one started; 0 for never."""
    environment: dict[str, str] = Field(default={})
    """Environment variables of the process, in addition to the inherited ones: `ROS_MASTER_URI:
    "http://localhost:{port}"`, `DISPLAY: ":1{instance}"`."""
    output: float = Field(default=10.0, gt=0)
    """Megabytes that an episode may print. An episode that prints more fails."""
    disk: float = Field(default=1000.0, gt=0)
    """Megabytes that an episode may have in its work folder, and in any one file. With more it fails."""
    children: Literal["fail", "end"] = "fail"
    """Whether the episode fails (fail) or not (end) when one of its processes still runs 0.3 s after
    the command has ended. The process is ended in either case."""
    keep: Literal["failed", "all", "none"] = "failed"
    """Which work folders are kept: failed (of each process that runs the command, that of the first failed
    episode of each kind of failure, five kinds at most; ten folders for each {instance}), all, or none. What
    the servers print, servers.log in a run folder, names them."""
    work: str | None = Field(default=None, min_length=1)
    """The folder that work folders are made in. Default: one of the user's in the system's folder for
    temporary files."""
    sources: list[str] = Field(default=[])
    """Further files and folders that the simulation consists of: as those that the command names, and what
    Python files import, they are part of its digest, and copied into run folders."""
    determinism: Literal["bitwise", "statistical", "none"] | None = None
    """How far two evaluations of one episode agree on any server; needed for audits (`faults: {audit}`)."""
    folder: str = Field(default=".", min_length=1)
    """The folder that paths here are relative to. Default: that of the experiment file."""

    @field_validator("files")
    @classmethod
    def _files(cls, value: Any) -> dict[str, str]:  # noqa: ANN401 - whatever the file says
        if isinstance(value, str | list):
            paths = list(_texts(value))
            value = {Path(str(path)).name: path for path in paths}
            if "" in value:
                raise ValueError(f"{value['']} has no name for the work folder; write {{NAME: {value['']}}}")
            if len(value) < len(paths):
                raise ValueError(
                    "two paths end in the same name; write a mapping from different names in the work folder "
                    "to paths"
                )
        if not isinstance(value, Mapping) or not all(isinstance(item, str) for item in value.values()):
            raise ValueError("must be a list of paths, or a mapping from names in the work folder to paths")
        for name in value:
            if Path(name).is_absolute() or ".." in Path(name).parts or not Path(name).parts:
                raise ValueError(f"{name!r} lies outside of the work folder")
        return dict(value)

    @field_validator("log")
    @classmethod
    def _log(cls, value: list[str]) -> list[str]:
        for name in value:
            if ".." in Path(name).parts or Path(name).is_absolute() or not name:
                raise ValueError(
                    f"{name!r} lies outside of the work folder; have the command write it there: "
                    "{log} is its path"
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
                        f"{{{name}}} differs from episode to episode, but a stepwise command runs "
                        "many of them; it gets parameters and seed over its standard input",
                    )
            if self.log or (
                self.metrics
                and any(str(reduction) != f"last({name})" for name, reduction in self.reductions.items())
            ):
                raise FieldError(
                    "log",
                    "a stepwise command reports metrics and fitness in its last line of an episode; "
                    "leave out log, and write metrics: [NAME]",
                )
        if "{log}" in text and len(self.log) != 1:
            raise FieldError(
                "command",
                "{log} needs one log; write log: result.csv"
                if not self.log
                else "{log} needs one log, not several; write their paths as {folder}/NAME",
            )
        if "{controller}" in text and not self.takes_controller:
            raise FieldError("command", "{controller} needs a controller: json, c, cpp, python or onnx")
        if "{build}" in text and self.compile is None:
            raise FieldError("command", "{build} needs compile, a command that puts something there")
        if self.compile is not None and not self.takes_controller:
            raise FieldError("compile", "needs a controller: json, c, cpp, python or onnx")
        if not self.log and self.controller != "stepwise":
            raise FieldError("log", "is missing: the file with results that the command writes, or stdout")
        return self

    @model_validator(mode="after")
    def _weights_fit(self) -> "CommandOptions":
        if self.loads_weights and (self.controller != "c" or self.compile is None):
            raise FieldError("weights", "file needs controller: c, and compile, which is then run once")
        if self.loads_weights and "{weights}" in " ".join(self.compile or []):
            raise FieldError(
                "compile",
                "{weights} differs from candidate to candidate, but compile is run once for all; "
                "give it to the command",
            )
        if "{weights}" in " ".join([*self.command, *(self.visual or [])]) and not self.loads_weights:
            raise FieldError("command", "{weights} needs weights: file")
        return self

    @property
    def takes_controller(self) -> bool:
        """Whether the command gets controllers as files."""
        return self.controller not in {"none", "stepwise"}

    @property
    def loads_weights(self) -> bool:
        """Whether the weights of a compiled controller are in a file of their own."""
        return self.weights == "file"

    @property
    def reductions(self) -> dict[str, Reduction]:
        """What is made of columns, by the metric's name."""
        return {name: Reduction.parse(name, text) for name, text in self.metrics.items()}

    def as_command(self) -> "CommandOptions":
        """Return itself."""
        return self

    def problems(self) -> list[tuple[Path_, str]]:
        """See `Definition`."""
        problem = work_files.problem_of(self.files, Path(self.folder))
        return [] if problem is None else [(("files",), problem)]

    def named_files(self) -> Iterator[tuple[str, Sequence[str]]]:
        """See `Definition`."""
        yield "command", [*self.command, *(self.compile or ()), *(self.visual or ())]
        yield "parameters", [] if self.parameters is None else [self.parameters]
        yield "files", list(self.files.values())
        yield "sources", self.sources
