"""Types of the plain values that `swarmwright._engine` takes and returns."""

from typing import Any, Literal, NotRequired, TypeAlias, TypedDict

import numpy as np
from numpy.typing import NDArray


class Requirements(TypedDict):
    """Requirements on a simulation server."""

    dimensions: float
    max_agents: NotRequired[float]


Outcome: TypeAlias = Literal[
    "done",
    "failed",
    "unusable",
    "server_failed",
    "lost",
    "disconnected",
    "handed_back",
    "overtaken",
    "dropped",
]
"""How an attempt ended.

done: with results.
failed: the simulation failed in the evaluation.
unusable: the request could not be sent, or its results could not be used.
server_failed: the server failed during this attempt.
lost: the server failed during another attempt.
disconnected: the connection to the broker broke.
handed_back: the server is reserved for another tool, or its turn is over.
overtaken: another server finished the same work first.
dropped: the evaluation is no longer needed.
"""


class AttemptFields(TypedDict):
    """One attempt at a block of evaluations; see `swarmwright.servers.rows.AttemptEntry`."""

    mode: str
    candidate: int
    candidates: int
    episode: int
    episodes: int
    server: int
    attempt: int
    steps: int | None
    started: float
    seconds: float
    outcome: Outcome
    error: str | None
    stack: str | None


class FailedEvaluation(TypedDict):
    """An evaluation that has finally failed."""

    candidate: int
    episode: int
    quarantined: int | None
    """Number of servers that failed with it, so that it is quarantined; None if it failed by itself."""


class WarningFields(TypedDict):
    """A warning for the user."""

    text: str
    time: float
    """Seconds since 1970."""
    failed: FailedEvaluation | None
    """The failed evaluation that it reports, if any."""
    unaudited: bool
    """Whether the warning reports results that count without audits."""


class Counts(TypedDict):
    """Incidents since the start of a pool."""

    server_failures: int
    """Times that a server was lost, was silent for too long, or sent unusable messages."""
    time_outs: int
    """Server failures in which it was silent for too long."""
    benched: int
    """Times that a server had to pause because it failed."""
    broker_losses: int
    retries: int
    failed: int
    """Failed evaluations."""
    quarantined: int
    """Failed evaluations during which too many servers were lost."""
    backups: int
    """Copies of work of a slow or silent server that were sent to another server."""
    late: int
    """Results that were refused because they were no longer expected."""
    double: int
    """Results that were refused because the evaluation already had one."""
    foreign: int
    """Messages that were refused because they named another simulation."""
    audits: int
    audits_left_out: int
    """Results that count without their planned audit, because no other server was usable."""
    disagreements: int
    recomputed: int
    """Evaluations that were repeated because their server turned out to be wrong."""


class Traffic(TypedDict):
    """Traffic of a connection since it was first opened."""

    sent_bytes: int
    received_bytes: int
    sent_messages: int
    received_messages: int


class ServerReport(TypedDict):
    """A server that offers the simulation has changed its state."""

    event: Literal["server"]
    server: int
    state: Literal["ready", "busy", "lost", "left"]


class AttemptReport(AttemptFields):
    """An attempt has ended."""

    event: Literal["attempt"]


class BenchedReport(TypedDict):
    """A server failed and gets no work for a while."""

    event: Literal["benched"]
    server: int
    failures: int
    """Consecutive failures."""
    reason: str
    seconds: float


class WarningReport(TypedDict):
    """A warning for the user."""

    event: Literal["warning"]
    message: str


class BrokerLostReport(TypedDict):
    """The connection to the broker broke."""

    event: Literal["broker_lost"]
    reason: str


class BrokerBackReport(TypedDict):
    """The broker is connected again."""

    event: Literal["broker_back"]


class StatusReport(TypedDict):
    """The state of the work, once a second and when work has ended."""

    event: Literal["status"]
    status: dict[str, Any]
    """See protocol/schemas/status.schema.json."""
    traffic: Traffic
    counts: Counts


Report: TypeAlias = (
    ServerReport
    | AttemptReport
    | BenchedReport
    | WarningReport
    | BrokerLostReport
    | BrokerBackReport
    | StatusReport
)
"""Live report of a pool."""


class Presence(TypedDict):
    """Presence message of a simulation server; see protocol/schemas/presence.schema.json."""

    server: int
    state: Literal["ready", "busy", "lost"]
    simulations: list[str]
    capabilities: dict[str, Any]
    tool: str | None
    since: str | None
    host: str | None
    pid: int | None


class PresenceNews(TypedDict):
    """A server has announced itself."""

    presence: Presence


class LeftNews(TypedDict):
    """A server has left."""

    left: int


class StatusNews(TypedDict):
    """The status of an optimization tool, identified by its token."""

    token: str
    status: dict[str, Any]
    """See protocol/schemas/status.schema.json; with `words` in each entry of `waiting_for`."""


class BrokerNews(TypedDict):
    """The connection to the broker broke or is restored."""

    broker: Literal["back", "lost"]
    reason: NotRequired[str]


News: TypeAlias = PresenceNews | LeftNews | StatusNews | BrokerNews
"""News on a broker."""


class ServerEvent(TypedDict):
    """Report of a simulation server about itself."""

    event: Literal["ready", "busy", "warning", "lost"]
    server: int
    tool: NotRequired[str | None]
    """With "busy": the tool that has reserved it."""
    message: NotRequired[str]
    """With "warning" and "lost"."""


class ParameterDescription(TypedDict):
    """A parameter of a simulation."""

    type: str
    default: Any
    description: str


class MetricDescription(TypedDict):
    """A metric of a simulation."""

    unit: str
    description: str


class GroupDescription(TypedDict):
    """A kind of agents of a simulation."""

    name: str
    agents: int
    sensors: int
    actuators: int
    padded: bool
    sensor_names: list[str]
    actuator_names: list[str]
    own_sensor_names: list[str | None]
    own_actuator_names: list[str | None]


class SideFields(TypedDict):
    """A side of a match."""

    name: str
    groups: list[str]
    fitness: NotRequired[str | None]
    """The metric that is its fitness; missing or None if the simulation does not define one."""


class Description(TypedDict):
    """Description of a simulation."""

    title: str
    dimensions: int
    max_agents: int | None
    sensors: int
    actuators: int
    sensor_names: list[str]
    actuator_names: list[str]
    sensor_units: list[str]
    actuator_units: list[str]
    parameters: dict[str, ParameterDescription]
    metrics: dict[str, MetricDescription]
    determinism: str | None
    varies: bool
    groups: list[GroupDescription]
    sides: list[SideFields]


class Mission(TypedDict):
    """A built-in mission of the arena."""

    name: str
    also: str | None
    """Another name for it."""
    title: str
    robots: int
    """Default number of robots."""
    duration: float
    """Default duration in seconds."""
    text: str
    """The YAML file."""


class BodyFields(TypedDict):
    """A body in a scene; see `swarmwright.display.Body`."""

    kind: str
    x: float
    y: float
    state: str
    radius: float
    heading: NotRequired[float]
    value: NotRequired[float]
    label: NotRequired[str]
    agent: NotRequired[int]


class RayFields(TypedDict):
    """The line of sight of a sensor; see `swarmwright.display.Ray`."""

    body: int
    """Index of the body with the sensor."""
    angle: float
    start: float
    length: float
    reading: NotRequired[float]


class PatchFields(TypedDict):
    """A part of the floor; see `swarmwright.display.Patch`."""

    grey: float
    points: list[list[float]]
    radius: float
    name: str


class WallFields(TypedDict):
    """A wall; see `swarmwright.display.Wall`."""

    points: list[list[float]]
    solid: bool


class LightFields(TypedDict):
    """A lamp; see `swarmwright.display.Light`."""

    x: float
    y: float
    intensity: float


class StyleFields(TypedDict):
    """The look of a kind and state; see `swarmwright.display.Style`."""

    kind: str
    state: str
    color: str
    shape: str


class ScaleFields(TypedDict):
    """Name and range of the values of bodies; see `swarmwright.display.Scale`."""

    name: str
    low: float
    high: float


class SceneFields(TypedDict):
    """A world at one step; see `swarmwright.display.Scene`. Missing parts are omitted."""

    width: float
    height: float
    origin: NotRequired[list[float]]
    grid: bool
    step: int
    message: str
    bodies: list[BodyFields]
    floor: NotRequired[PatchFields]
    patches: NotRequired[list[PatchFields]]
    walls: NotRequired[list[WallFields]]
    lights: NotRequired[list[LightFields]]
    rays: NotRequired[list[RayFields]]
    links: NotRequired[list[list[int]]]
    styles: NotRequired[list[StyleFields]]
    scale: NotRequired[ScaleFields]


class BodyArrays(TypedDict):
    """The bodies of a scene as arrays; NaN stands for no heading and no value, -1 for no agent."""

    looks: list[tuple[str, str]]
    """Pairs of kind and state."""
    look: NDArray[np.uint16]
    """(bodies,), indices of `looks`."""
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    radius: NDArray[np.float32]
    heading: NDArray[np.float32]
    value: NDArray[np.float32]
    agent: NDArray[np.int64]
    labels: list[str] | None


class RayArrays(TypedDict):
    """The rays of a scene as arrays."""

    body: NDArray[np.uint32]
    """(rays,)"""
    numbers: NDArray[np.float32]
    """(rays, 4): angle, start, length, reading or NaN."""


class SceneArrays(TypedDict):
    """A scene with bodies, rays and links as arrays."""

    scene: SceneFields
    """The scene without bodies, rays and links."""
    bodies: BodyArrays
    rays: RayArrays
    links: NDArray[np.uint32]
    """(links, 2)"""
