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
from swarmwright.methods.constraints import Limits
from swarmwright.methods.rankings.tournament import MOST_SIDES
from swarmwright.simulations.fitness import FitnessExpression

LARGEST_SIZE = 1_000_000
"""Largest number of sensors or actuators of an agent."""
_NAME_CHARACTERS = 1000
"""Characters of a simulation's name."""
Checked = dict[str, Any]
"""Key -> checked value; sections with a `kind` as the options of that kind."""
_SERVERS = ("auto", "local", "in-process")
AUTO = "auto"
"""Value of `validate.episodes` and `faults.audit` for an automatic choice."""
MAX_SERVERS = 1024
"""Upper limit of servers started by a number."""
_MOST_EPISODES = 100_000
"""Upper limit of episodes in a validation."""
_LARGEST_VALIDATION = 1_000_000
"""Upper limit of episodes of all candidates in a validation."""


def _parse_servers(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, int) and not isinstance(value, bool):
        if 1 <= value <= MAX_SERVERS:
            return value
        raise ValueError(f"must be at least 1 and at most {MAX_SERVERS}, not {value}")
    if isinstance(value, str) and value in _SERVERS:
        return value
    if isinstance(value, tuple) and all(isinstance(entry, LauncherOptions) for entry in value):
        return value  # checked by `launcher_entries`
    hint = did_you_mean(value, _SERVERS) if isinstance(value, str) else ""
    raise ValueError(
        "must be auto, local, in-process, a number of servers or a launcher such as slurm:4, not "
        f"{format_value(value)}{hint}"
    )


Servers = Annotated[
    Any,
    BeforeValidator(_parse_servers),
    WithJsonSchema(
        {"anyOf": [{"enum": list(_SERVERS)}, {"type": "integer", "minimum": 1, "maximum": MAX_SERVERS}]}
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
    """Capabilities that a simulation server must have."""

    dimensions: int = Field(ge=0, le=1000)
    """Spatial dimensions of the simulation."""
    max_agents: int | None = Field(default=None, ge=1)
    """Number of agents that the server must support."""


_TIMEOUTS, _FAULTS = _engine.TIMEOUTS, _engine.FAULTS
"""Defaults of the engine and of experiments."""


class Timeouts(Options):
    """Time limits, in seconds."""

    connect: float = Field(default=_TIMEOUTS["connect"], ge=0, le=31 * 86_400)
    """For a broker that does not answer yet at the start; the option `--wait` takes precedence."""
    discovery: float = Field(default=_TIMEOUTS["discovery"], gt=0, le=86_400)
    """For a matching server at the start. If all servers or the broker are lost, or no server succeeds, the
    run waits at least this time, then ends and can be resumed. Servers that the run starts have at least
    30 s.
    """
    step: float = Field(default=_TIMEOUTS["step"], gt=0, le=86_400)
    """For the next message of a server (in offloaded mode the result), before its work goes to another
    server."""
    least: float = Field(default=_TIMEOUTS["least"], gt=0, le=86_400)
    """Minimum silence of a server before it counts as slow and another one gets a backup of its work. At most
    `step`.
    """
    episode: float = Field(default=_TIMEOUTS["episode"], gt=0, le=31 * 86_400)
    """For a whole stepwise episode, before it goes to another server."""
    keep_alive: int | None = Field(default=None, ge=1, le=3600)
    """Keep-alive interval of connections to the broker; silent failures are noticed within it. Default:
    SWARMWRIGHT_KEEP_ALIVE in the environment, or 30.
    """

    def variables(self) -> dict[str, str]:
        """Return the environment variables for servers that the run starts."""
        return {} if self.keep_alive is None else {"SWARMWRIGHT_KEEP_ALIVE": str(self.keep_alive)}


def _parse_audit(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value == AUTO:
        return AUTO
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 1:
        return value
    hint = did_you_mean(value, [AUTO]) if isinstance(value, str) else ""
    raise ValueError(f"must be auto or a share from 0 to 1, not {format_value(value)}{hint}")


class Faults(Options):
    """Treatment of failing, slow and wrong servers and evaluations."""

    attempts: int = Field(default=_FAULTS["attempts"], ge=1, le=1000)
    """Attempts at an evaluation before it counts as failed, not counting failures that the server or
    another evaluation may have caused. For simulations with bitwise determinism, two failures suffice.
    """
    quarantine: int = Field(default=_FAULTS["quarantine"], ge=1, le=1000)
    """Servers that may crash or hang on an evaluation before it counts as failed; at least 3 for servers that
    the run did not start."""
    backup: bool = _FAULTS["backup"]
    """Whether idle servers repeat the work of slow or silent ones; the first result counts."""
    audit: Annotated[
        Any,
        BeforeValidator(_parse_audit),
        WithJsonSchema({"anyOf": [{"enum": ["auto"]}, {"type": "number", "minimum": 0, "maximum": 1}]}),
    ] = "auto"
    """Evaluations to repeat on another server and compare. auto: 30 or 1 % at the end of the run, with a
    warning if results differ. A share from 0 to 1: also during the run, on servers that declare their
    determinism; if two disagree, a third decides, and all evaluations of the outvoted server are repeated.
    0: none.
    """

    @property
    def audit_share(self) -> float:
        """Share of evaluations to audit during the run."""
        return 0.0 if self.audit == AUTO else float(self.audit)

    def to_engine_values(self) -> dict[str, Any]:
        """Convert the section for the engine."""
        return {**self.model_dump(), "audit": self.audit_share}


def _parse_episodes(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value == AUTO or (
        isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _MOST_EPISODES
    ):
        return value
    hint = did_you_mean(value, [AUTO]) if isinstance(value, str) else ""
    raise ValueError(
        f"must be auto or a number of episodes from 0 to {_MOST_EPISODES:,}, not {format_value(value)}{hint}"
    )


def _parse_validation(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value is None or value is True:
        return {}
    if value is False:
        return {"episodes": 0}
    if isinstance(value, Mapping | Validate):
        return value
    raise ValueError(f"must be a mapping such as {{episodes: 100}}, or false, not {format_value(value)}")


_TARGET = {"anyOf": [{"type": "string", "minLength": 1}, {"type": "object"}]}
_ENDS = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}


def _parse_targets(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, str | Mapping):
        value = [value]
    if isinstance(value, list | tuple) and all(isinstance(entry, str | Mapping) and entry for entry in value):
        return list(value)
    raise ValueError(
        f"must list simulations or files, such as [arena-gazebo, harder.yaml], not {format_value(value)}"
    )


def _parse_ranges(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if not isinstance(value, Mapping):
        raise ValueError(
            f"must map keys to ranges, such as {{parameters.speed: [0.4, 0.8]}}, not {format_value(value)}"
        )
    for key, ends in value.items():
        numbers = isinstance(ends, list | tuple) and len(ends) == 2
        if not numbers or any(isinstance(end, bool) or not isinstance(end, int | float) for end in ends):
            raise FieldError(
                str(key), f"must be the lowest and the highest value, [0.4, 0.8], not {format_value(ends)}"
            )
    return {str(key): list(ends) for key, ends in value.items()}


class Validate(Options):
    """Evaluation of a run's best candidates on held-out seeds at its end.

    It estimates their fitness without bias. With `to`, `vary` or `pseudo_reality`, also in other simulations,
    as by `swarmwright transfer`. `validate: false` skips it.
    """

    episodes: Annotated[
        Any,
        BeforeValidator(_parse_episodes),
        WithJsonSchema(
            {"anyOf": [{"enum": ["auto"]}, {"type": "integer", "minimum": 0, "maximum": 100_000}]}
        ),
    ] = "auto"
    """Episodes per candidate, with the same seeds; 0: none. auto: 100 or four times `ranking.episodes`,
    limited to 5 % of the run's episodes (none if fewer than 10 remain); 20 if fitness does not depend on
    the seed.
    """
    candidates: int = Field(default=5, ge=1, le=100)
    """Number of candidates, the best ones with different controllers. With `episodes: auto`, fewer if the
    limit requires it."""
    seed: int | None = Field(default=None, ge=0, le=2**62)
    """Simulation seed of the first episode, followed by the next seeds unused by the run. Default:
    parameters.seed + 1,000,000,000."""
    to: Annotated[
        list[Any],
        BeforeValidator(_parse_targets),
        WithJsonSchema({"anyOf": [*_TARGET["anyOf"], {"type": "array", "items": _TARGET}]}),
    ] = Field(default=[])
    """Other simulations for the candidates: names, keys that differ from the experiment ({name: harder,
    parameters: {numDefenders: 4}}), or .yaml files with them.
    """
    vary: Annotated[
        dict[str, Any],
        BeforeValidator(_parse_ranges),
        WithJsonSchema({"type": "object", "additionalProperties": _ENDS}),
    ] = Field(default={})
    """Ranges of parameters for randomly sampled models of the simulation, one per seed:
    {parameters.speedDefenders: [0.4, 0.8]}."""
    pseudo_reality: bool = False
    """Whether to sample the noise of the arena's e-pucks in such models."""
    random: int = Field(default=0, ge=0, le=100_000)
    """Number of random controllers to transfer in addition to the best candidates."""
    seeds: int = Field(default=30, ge=2, le=_MOST_EPISODES)
    """Episodes per candidate in each simulation, on held-out seeds from `seed` on."""

    @property
    def transfers(self) -> bool:
        """Whether to evaluate the best candidates in other simulations."""
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


class PopulationSection(Options):
    """A population of a competition, which plays one side of the matches."""

    controller: dict[str, Any] = Field(default={})
    """The representation of its controllers, as in `controller`."""
    method: dict[str, Any] = Field(default={})
    """Its optimization algorithm, as in `method`, which has the defaults and all limits."""
    fitness: str | None = Field(default=None, min_length=1)
    """Its fitness in a match, an expression as in `fitness`. Default: that of the side in `ranking.sides`, or
    the one that the simulation announces."""

    @field_validator("fitness")
    @classmethod
    def _fitness(cls, value: str | None) -> str | None:
        if value is not None:
            FitnessExpression(value)  # raises a ValueError
        return value


class Document(Options):
    """An experiment: simulation, controller, method and servers."""

    simulation: str = Field(min_length=1)
    """Name of a simulation: built-in, or offered by a server on the broker (`arena-NAME`: the arena's
    missions in the simulator NAME). Or a Python class, path/to/file.py:Class (relative to this file) or
    package.module:Class. Or an environment, gymnasium:CartPole-v1 or pettingzoo:NAME. Or a mapping:
    {command: ..}, a program for each episode; {fmu: ..}, or the path of a .fmu or .ssp file; {ros: ..},
    robots of a ROS system.
    """
    requirements: Requirements | None = None
    """Capabilities that a simulation server must have. Default: the announced dimensions of the simulation,
    otherwise 2 dimensions."""
    parameters: dict[str, Any] = Field(default={})
    """Parameters of the simulation. `seed`, from 0 to 2^62, is the seed of the first episode, from which
    those of all other episodes are counted."""
    sensors: int | None = Field(default=None, ge=1, le=LARGEST_SIZE)
    """Sensor values of an agent. Required only if the simulation does not announce them."""
    actuators: int | None = Field(default=None, ge=1, le=LARGEST_SIZE)
    """Actuator values of an agent. Required only if the simulation does not announce them."""
    fitness: str | None = Field(default=None, min_length=1)
    """Fitness of an episode, an expression over numbers, the simulation's metrics and its own `fitness`:
    "arrived - 0.01 * steps". Available are + - * / **, comparisons, and, or, not, `a if condition else b`,
    abs, clip, max, min, sqrt. Without a finite value, the episode fails. Default: the simulation's
    fitness."""
    constraints: dict[str, Limits] = Field(default={}, max_length=100)
    """Limits of metrics, as means over episodes: {collisions: {at_most: 0}, coverage: {at_least: 0.5}}.
    Candidates that violate them rank below all others, by the sum of their violations in units of the limits
    (of the metric if the limit is 0), and have no fitness in the record. Default: none.
    """
    start_from: StartFrom = None
    """Controllers to start from: a run folder (its best), a controller file (best.json), `{run: PATH,
    generation: G, candidate: N}`, or a list of these; paths are relative to this file. They are the first
    candidates, or the center of the initial distribution. Default: random controllers.
    """
    controller: dict[str, Any] = Field(default={})
    """The representation of controllers by genomes."""
    populations: dict[str, PopulationSection] = Field(default={}, max_length=MOST_SIDES)
    """Populations that evolve at the same time, each of which plays the side of its name in the matches of a
    tournament: {predators: {controller: {hidden: [8]}}, prey: {}}. They compete, or cooperate if they have
    the same fitness. Default: one population.
    """
    method: dict[str, Any] = Field(default={})
    """The optimization algorithm and its budget. The default, nnga, evolves every representation and is
    FREVO's method; for networks, snes needs fewer evaluations.
    """
    ranking: dict[str, Any] = Field(default={})
    """Aggregation of episodes to fitness."""
    validation: Annotated[
        Validate, BeforeValidator(_parse_validation, json_schema_input_type=bool | Validate)
    ] = Field(default_factory=Validate, alias="validate")
    """Evaluation of the best candidates on held-out seeds at the end of the run; false for none."""
    mode: Literal["auto", "stepwise", "batched", "offloaded"] = "auto"
    """How servers on a broker evaluate; the fitness is the same. stepwise: each step of each agent crosses
    the broker. batched: a message carries a step of many episodes. offloaded: servers receive the
    controllers. auto: the fastest mode of each server; other values exclude servers without the mode.
    """
    servers: Servers = "auto"
    """Where evaluations run. A number: servers started on the embedded broker. auto: one per processor, 2 to
    8; in notebooks local. local: built-in simulations in this process, Python simulations in worker
    processes. in-process: all in this process. Or launchers, with any broker: {launcher: slurm, count:
    200, partition: long}, short slurm:200, or a list of these.
    """
    broker: str | None = None
    """Address of an external broker: mqtt://HOST:PORT, mqtts://, ws://, wss:// or unix://PATH; those of a
    cluster's brokers separated by commas. User and password are in SWARMWRIGHT_USERNAME and
    SWARMWRIGHT_PASSWORD (or SWARMWRIGHT_PASSWORD_FILE). Default: an embedded broker.
    """
    prefix: str = ""
    """Prefix of all topics, to separate groups on a broker. Default: SWARMWRIGHT_PREFIX in the environment.
    """
    timeouts: Timeouts = Field(default_factory=Timeouts)
    """Time limits."""
    faults: Faults = Field(default_factory=Faults)
    """Treatment of failed evaluations and of lost, slow or wrong servers."""
    seed: int = Field(default=1, ge=0, lt=2**63)
    """Seed of the method's random numbers. The simulation's seed is parameters.seed."""

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
            FitnessExpression(value)  # raises a ValueError
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
"""Default kind of each section."""


STORE = "run.sqlite"
"""Name of the store in a run folder."""
