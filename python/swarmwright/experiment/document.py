"""The keys of an experiment file, with types, defaults and descriptions."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator, model_validator

from swarmwright import _engine
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError, format_value
from swarmwright.common.simulation_names import is_command
from swarmwright.common.suggestions import did_you_mean
from swarmwright.experiment.broker_address import broker_problem, prefix_problem
from swarmwright.experiment.launchers import LauncherOptions
from swarmwright.simulations.fitness import FitnessExpression

_NAME_CHARACTERS = 1000
"""Characters of a simulation's name."""
Checked = dict[str, Any]
"""Key -> checked value; sections with a `kind` as the options of that kind."""
_SERVERS = ("auto", "local", "in-process")
AUTO = "auto"
"""Episodes of a validation, and audited evaluations: as many as are informative and cheap."""
MOST_SERVERS = 1024
"""Servers that a number starts, at most."""
_MOST_EPISODES = 100_000
"""Episodes of a validation."""
_LARGEST_VALIDATION = 1_000_000
"""Episodes of all candidates of a validation."""


def _servers(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, int) and not isinstance(value, bool):
        if 1 <= value <= MOST_SERVERS:
            return value
        raise ValueError(f"must be at least 1 and at most {MOST_SERVERS}, not {value}")
    if isinstance(value, str) and value in _SERVERS:
        return value
    if isinstance(value, tuple) and all(isinstance(entry, LauncherOptions) for entry in value):
        return value  # checked by `launcher_entries`
    hint = did_you_mean(value, _SERVERS) if isinstance(value, str) else ""
    raise ValueError(
        "must be auto, local, in-process, a number of servers, or what starts them, such as slurm:4, not "
        f"{format_value(value)}{hint}"
    )


Servers = Annotated[
    Any,
    BeforeValidator(_servers),
    WithJsonSchema(
        {"anyOf": [{"enum": list(_SERVERS)}, {"type": "integer", "minimum": 1, "maximum": MOST_SERVERS}]}
    ),
]


StartFrom = Annotated[
    Any,
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string"},
                {"type": "object"},
                {"type": "array", "items": {"anyOf": [{"type": "string"}, {"type": "object"}]}},
                {"type": "null"},
            ]
        }
    ),
]


class Requirements(Options):
    """What a simulation server must be able to do."""

    dimensions: int = Field(ge=0, le=1000)
    """Spatial dimensions of the simulation."""
    max_agents: int | None = Field(default=None, ge=1)
    """Agents that the server must support at least."""


_WAIT, _TREAT = _engine.TIMEOUTS, _engine.FAULTS
"""The engine's defaults, which are those of an experiment."""


class Timeouts(Options):
    """How long to wait, in seconds."""

    connect: float = Field(default=_WAIT["connect"], ge=0, le=31 * 86_400)
    """For a broker that does not answer at the start, for example because it is started at the same time.
    Refused credentials and certificates are reported at once. The option `--wait` takes precedence."""
    discovery: float = Field(default=_WAIT["discovery"], gt=0, le=86_400)
    """For a fitting simulation server at the start. When all are gone during a run, or the broker is not
    reachable, the run waits for as long, or for `step` where that is longer; then it ends, and can be
    resumed. It also ends when servers are there and none succeeds: after this time if all fail what succeeded
    before, after four times this time if they are silent or refuse the work, but not while a server may still
    answer within `step`. Servers that the run starts itself have this time, and at least 30 s, to import the
    simulation and connect."""
    step: float = Field(default=_WAIT["step"], gt=0, le=86_400)
    """For a simulation server's next message, before the episode is given to another server. In offloaded
    mode the next message is the result."""
    least: float = Field(default=_WAIT["least"], gt=0, le=86_400)
    """A server that is silent for much longer than ever before, and at least for this time, counts as slow:
    another server gets a backup of its work, and the first result counts. Bounded from above by `step`."""
    episode: float = Field(default=_WAIT["episode"], gt=0, le=31 * 86_400)
    """For a whole stepwise episode, before it is given to another server although messages still arrive."""
    keep_alive: int | None = Field(default=None, ge=1, le=3600)
    """Keep-alive interval of connections to the broker, of the run and of servers that it starts, in whole
    seconds. A connection that fails silently is noticed within it at both, and by the broker after one and a
    half intervals. Default: SWARMWRIGHT_KEEP_ALIVE in the environment, or 30."""

    def variables(self) -> dict[str, str]:
        """Return environment variables for servers that the run starts."""
        return {} if self.keep_alive is None else {"SWARMWRIGHT_KEEP_ALIVE": str(self.keep_alive)}


def _audit(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value == AUTO:
        return AUTO
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 1:
        return value
    hint = did_you_mean(value, [AUTO]) if isinstance(value, str) else ""
    raise ValueError(f"must be auto or a share from 0 to 1, not {format_value(value)}{hint}")


class Faults(Options):
    """How failing, slow and wrong servers and evaluations are treated."""

    attempts: int = Field(default=_TREAT["attempts"], ge=1, le=1000)
    """Attempts at an evaluation before it has failed, on servers and with servers: in-process. Attempts in a
    batch whose failure cannot be attributed to one evaluation do not count, nor do attempts on servers that
    complete no other evaluation afterwards. For simulations and servers that declare themselves
    bit-identical, two reported failures are sufficient."""
    quarantine: int = Field(default=_TREAT["quarantine"], ge=1, le=1000)
    """Servers that may crash or hang while working on a single evaluation before it is quarantined as failed.
    Of servers that the run did not start, at least 3, which completed other evaluations while no other server
    was lost."""
    backup: bool = _TREAT["backup"]
    """Whether work on slow or silent servers is speculatively re-dispatched to idle ones; the first result
    counts."""
    audit: Annotated[
        Any,
        BeforeValidator(_audit),
        WithJsonSchema({"anyOf": [{"enum": ["auto"]}, {"type": "number", "minimum": 0, "maximum": 1}]}),
    ] = "auto"
    """How many evaluations are audited: repeated and compared, on another server where there is one. auto: at
    the end of the run 30, or 1 % where that is more; if results differ, the run warns of it, and its record
    stays as it is. A fault that shows in 12 % of the evaluations is found with a probability of 97 %. A share
    from 0 to 1: so many of them, also during the run, before their results count, where servers declare their
    determinism. If two servers disagree then, a third one decides: the outvoted server is no longer used, and
    its evaluations are repeated. 0: none."""

    @property
    def audit_share(self) -> float:
        """The share of evaluations that are audited during the run, before they count."""
        return 0.0 if self.audit == AUTO else float(self.audit)

    def for_engine(self) -> dict[str, Any]:
        """Return the section as the engine takes it."""
        return {**self.model_dump(), "audit": self.audit_share}


def _episodes(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value == AUTO or (
        isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _MOST_EPISODES
    ):
        return value
    hint = did_you_mean(value, [AUTO]) if isinstance(value, str) else ""
    raise ValueError(
        f"must be auto or a number of episodes from 0 to {_MOST_EPISODES:,}, not {format_value(value)}{hint}"
    )


def _switched(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value is None or value is True:
        return {}
    if value is False:
        return {"episodes": 0}
    if isinstance(value, Mapping | Validate):
        return value
    raise ValueError(f"must be a mapping such as {{episodes: 100}}, or false, not {format_value(value)}")


_TARGET = {"anyOf": [{"type": "string", "minLength": 1}, {"type": "object"}]}
_ENDS = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}


def _targets(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, str | Mapping):
        value = [value]
    if isinstance(value, list | tuple) and all(isinstance(entry, str | Mapping) and entry for entry in value):
        return list(value)
    raise ValueError(
        f"must be simulations or files, such as [arena-gazebo, harder.yaml], not {format_value(value)}"
    )


def _ranges(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if not isinstance(value, Mapping):
        raise ValueError(
            f"must be ranges, such as {{parameters.speed: [0.4, 0.8]}}, not {format_value(value)}"
        )
    for key, ends in value.items():
        numbers = isinstance(ends, list | tuple) and len(ends) == 2
        if not numbers or any(isinstance(end, bool) or not isinstance(end, int | float) for end in ends):
            raise FieldError(
                str(key), f"must be the lowest and the highest value, [0.4, 0.8], not {format_value(ends)}"
            )
    return {str(key): list(ends) for key, ends in value.items()}


class Validate(Options):
    """Evaluation of a run's best candidates on held-out seeds, when the run has ended.

    The best of many evaluations was also lucky, wherever fitness depends on the seed: its recorded fitness is
    biased upwards. Episodes with seeds that the run did not use estimate its fitness without bias. They are
    stored in the run, apart from its record, which they do not change. `validate: false` means no validation.
    With `to`, `vary` or `pseudo_reality` the candidates are transferred to other simulations after that, as
    `swarmwright transfer` does it.
    """

    episodes: Annotated[
        Any,
        BeforeValidator(_episodes),
        WithJsonSchema(
            {"anyOf": [{"enum": ["auto"]}, {"type": "integer", "minimum": 0, "maximum": 100_000}]}
        ),
    ] = "auto"
    """Episodes of each candidate, all with the same seeds; 0: no validation. auto: 100, or four times
    `ranking.episodes`, but at most a twentieth of the run's episodes for all candidates together, and none if
    these are fewer than 10; where `method.evaluations` ended the run, a twentieth of those. With auto, the
    validation ends after 20 if fitness has not depended on the seed in these, nor in the run."""
    candidates: int = Field(default=5, ge=1, le=100)
    """How many: the best candidate of the run, and the next best with other controllers. With `episodes:
    auto` as many as that twentieth suffices for, but at least the best one."""
    seed: int | None = Field(default=None, ge=0, le=2**62)
    """Simulation seed of the first episode; the others have the next ones that the run did not use. Default:
    parameters.seed + 1,000,000,000, so that runs with the same `parameters.seed` are validated on the same
    seeds."""
    to: Annotated[
        list[Any],
        BeforeValidator(_targets),
        WithJsonSchema({"anyOf": [*_TARGET["anyOf"], {"type": "array", "items": _TARGET}]}),
    ] = Field(default=[])
    """Other simulations in which the candidates are evaluated at the end of the run: names, files (.yaml,
    relative to this one) with the keys of the experiment that differ, or such keys,
    {name: harder, parameters: {numDefenders: 4}}. Files are read once and kept in the run."""
    vary: Annotated[
        dict[str, Any],
        BeforeValidator(_ranges),
        WithJsonSchema({"type": "object", "additionalProperties": _ENDS}),
    ] = Field(default={})
    """Parameters of the simulation that have random values in other models of it, another model for each
    seed, with the lowest and the highest value: {parameters.speedDefenders: [0.4, 0.8]}."""
    pseudo_reality: bool = False
    """Whether the noise of the arena's e-pucks varies in such models, around that of the reference model."""
    random: int = Field(default=0, ge=0, le=100_000)
    """How many random controllers are transferred beside the best candidates."""
    seeds: int = Field(default=30, ge=2, le=_MOST_EPISODES)
    """Episodes of each candidate in its own simulation and in each other one, with held-out seeds, from
    `seed` on as well."""

    @property
    def transfers(self) -> bool:
        """Whether the best candidates are evaluated in other simulations."""
        return bool(self.to or self.vary or self.pseudo_reality)

    @model_validator(mode="after")
    def _size(self) -> "Validate":
        episodes = (self.candidates + self.random) * self.seeds
        if self.transfers and episodes > _LARGEST_VALIDATION:
            raise ValueError(
                f"{self.seeds:,} episodes of {self.candidates + self.random:,} controllers are more than "
                f"{_LARGEST_VALIDATION:,}"
            )
        if self.episodes != AUTO and self.episodes * self.candidates > _LARGEST_VALIDATION:
            raise ValueError(
                f"{self.episodes:,} episodes of {self.candidates} candidates are more than "
                f"{_LARGEST_VALIDATION:,}"
            )
        return self


class Document(Options):
    """An experiment: what is evolved, on which simulation, how, and where."""

    simulation: str = Field(min_length=1)
    """Title of the simulation, as it is used in discovery. A title that is not built in needs a broker on
    which a server offers it; `arena-NAME` are the arena's missions in the simulator NAME, with the arena's
    parameters and sensors. Or a class in Python, path/to/file.py:Class (relative to this file) or
    package.module:Class, or an environment of Gymnasium or PettingZoo, gymnasium:CartPole-v1; servers of it
    are started here, too. Or a mapping: {command: ..}, any program that is run for each episode,
    {fmu: ..}, an FMU or SSP (the path of a .fmu or .ssp file is short for it), or {ros: ..}, robots of a
    running ROS system."""
    requirements: Requirements | None = None
    """What a simulation server must be able to do. Default: the dimensions that the built-in simulation or
    the class announces; 2 dimensions for any other."""
    parameters: dict[str, Any] = Field(default={})
    """Parameters of the simulation, sent as they are. Those of built-in simulations and of classes are
    checked before the run. `seed` is that of the first episode, an integer from 0 to 2^62; the seeds of all
    other episodes are counted from it."""
    sensors: int | None = Field(default=None, ge=1, le=1_000_000)
    """Sensor values of an agent. Needed only when a server does not announce them."""
    actuators: int | None = Field(default=None, ge=1, le=1_000_000)
    """Actuator values of an agent. Needed only when a server does not announce them."""
    fitness: str | None = Field(default=None, min_length=1)
    """Fitness of an episode, an expression over the metrics that the simulation reports, numbers, and
    `fitness`, the simulation's own: "arrived - 0.01 * steps". Available are + - * / **, comparisons, and, or,
    not, `a if condition else b`, abs, clip, max, min, sqrt. An episode for which it has no finite value has
    failed. Default: the simulation's own fitness."""
    start_from: StartFrom = None
    """Controllers that evolution starts from: the path of a run folder (its best) or of a controller's file
    (best.json), `{run: PATH, generation: G, candidate: N}`, or a list of these; paths are relative to this
    file. They take the first places of the first generation, or the first one is the center of the initial
    distribution; methods that do not support it reject it. They are read once and kept in the run, which does
    not need their files any more. Default: random ones."""
    controller: dict[str, Any] = Field(default={})
    """The representation: what the genome stands for."""
    method: dict[str, Any] = Field(default={})
    """The optimization algorithm and its budget."""
    ranking: dict[str, Any] = Field(default={})
    """How episodes become fitness."""
    validation: Annotated[Validate, BeforeValidator(_switched, json_schema_input_type=bool | Validate)] = (
        Field(default_factory=Validate, alias="validate")
    )
    """Evaluation of the best candidates on held-out seeds at the end of the run; false: none."""
    mode: Literal["auto", "stepwise", "batched", "offloaded"] = "auto"
    """How servers on a broker evaluate; the fitness does not depend on it. stepwise: controllers stay here,
    every step of every agent crosses the broker. batched: controllers stay here, one message carries a step
    of all agents of many episodes. offloaded: controllers travel to the servers, their fitness comes back.
    auto: for each server the fastest mode that it offers. Any other value excludes servers that do not offer
    the mode. An episode that is displayed is evaluated stepwise."""
    servers: Servers = "auto"
    """Where evaluations run when no broker is given: a number of servers started on the embedded broker;
    auto: as many as there are processors, 2 to 8, or in a notebook local; local: built-in simulations run in
    this process, those in Python in worker processes, one per processor, which are servers of the run's own;
    in-process: all of them run in this process, where code that crashes or hangs takes the run with it.
    Started servers that end or hang are started again. With a broker, the servers found there.
    Or what starts servers elsewhere, {launcher: slurm, count: 200, partition: long}, in short slurm:200, or a
    list of these; they are started on the broker that is given, or on the embedded one."""
    broker: str | None = None
    """Address of an external broker: mqtt://, mqtts://, ws:// or wss://, host, port, or unix:// and the path
    of a socket; several, separated by commas, are the brokers of a cluster, of which the next is used when
    one is lost. User and password are not part of it: they come from the environment, SWARMWRIGHT_USERNAME
    and SWARMWRIGHT_PASSWORD (or SWARMWRIGHT_PASSWORD_FILE). Default: an embedded broker is started."""
    prefix: str = ""
    """Put before every topic, with a slash, to keep several groups on one broker apart. Where it is empty,
    that of the environment, SWARMWRIGHT_PREFIX, is used, and not recorded."""
    timeouts: Timeouts = Field(default_factory=Timeouts)
    """How long to wait."""
    faults: Faults = Field(default_factory=Faults)
    """What happens when evaluations fail and when servers are lost, slow or wrong."""
    seed: int = Field(default=1, ge=0, lt=2**63)
    """Seed of all random numbers of the method. The simulation's own is parameters.seed."""

    @field_validator("simulation")
    @classmethod
    def _simulation(cls, value: str) -> str:
        if len(value) > _NAME_CHARACTERS and not is_command(value):
            raise ValueError(f"must have at most {_NAME_CHARACTERS} characters, not {len(value)}")
        return value

    @field_validator("fitness")
    @classmethod
    def _fitness(cls, value: str | None) -> str | None:
        if value is not None:
            FitnessExpression(value)  # its error is a ValueError
        return value

    @field_validator("broker")
    @classmethod
    def _broker(cls, value: str | None) -> str | None:
        problem = broker_problem(value) if value is not None else None
        if problem is not None:
            raise ValueError(problem)
        return value

    @field_validator("prefix")
    @classmethod
    def _prefix(cls, value: str) -> str:
        problem = prefix_problem(value)
        if problem is not None:
            raise ValueError(problem)
        return value


DEFAULT_KINDS = {"controller": "layered", "method": "nnga", "ranking": "absolute"}
"""The kind of a section that names none."""


STORE = "run.sqlite"
"""Name of the store in a run folder."""
