"""Recorded episodes, and options for drawing them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.engine_types import SceneFields
from swarmwright.common.errors import InputError, RunError, engine_errors
from swarmwright.common.groups import Kind
from swarmwright.common.time_limit import check_time_limit
from swarmwright.display._scene import Bodies, Scene, scene_from_arrays
from swarmwright.display.machines import Machines

MOST_NUMBERS = 30_000_000
"""Largest number of sensor and actuator values of an episode (120 MB). With more agents, only the first are
recorded."""


MOST_STATE = 254
"""Largest recorded state number; larger states are recorded as this number."""


def fill_states(recorded: NDArray[np.signedinteger[Any]], agents: int) -> NDArray[np.int32]:
    """Return the states of all agents, including those that have not acted yet."""
    states = np.zeros(max(agents, len(recorded)), dtype=np.int32)
    states[len(recorded) :] = -1 if len(recorded) and recorded[-1] < 0 else 0
    states[: len(recorded)] = recorded
    return states


@dataclass(frozen=True)
class Trace:
    """Record of each agent at each step; S steps, A recorded agents, which are the first.

    sensors: (S, A, sensors), before each step; NaN for agents that did not act. actuators: (S, A, actuators),
    of each step. states: (S + 1, all agents), current state of each agent's state machine, at most 254; -1
    for agents whose controller has no states; None if no controller has. metrics: names -> (S + 1,), NaN if
    unknown.
    """

    sensors: NDArray[np.float32]
    actuators: NDArray[np.float32]
    states: NDArray[np.int16] | None
    metrics: dict[str, NDArray[np.float64]]


class Tracer:
    """Steps an episode and records sensors and actuators."""

    def __init__(self, episode: Any, metrics: Sequence[str]) -> None:  # noqa: ANN401 - see `from_episode`
        self._episode = episode
        self._names = list(metrics)
        self._steps: list[tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]] = []
        self._states: list[NDArray[np.int32]] = []
        self._metrics: list[list[float]] = []
        self._number_count = 0
        self._record_step()

    @classmethod
    def from_episode(cls, episode: Any) -> Self | None:  # noqa: ANN401 - anything that can be played
        """Return a tracer if the episode reports sensors and actuators; None otherwise."""
        if not all(hasattr(episode, name) for name in ("step_observed", "machine_states", "metrics")):
            return None
        return cls(episode, getattr(episode, "metric_names", ()))

    def step(self) -> None:
        """Step the episode."""
        agents, sensors, actuators = self._episode.step_observed()
        most = MOST_NUMBERS // max(1, 200 * (sensors.shape[1] + actuators.shape[1]))
        if len(agents) and int(agents.max()) >= max(most, 1):
            few = agents < max(most, 1)
            agents, sensors, actuators = agents[few], sensors[few], actuators[few]
        numbers = sensors.size + actuators.size
        if self._number_count + numbers <= MOST_NUMBERS:
            self._number_count += numbers
            self._steps.append((agents, sensors, actuators))
        self._record_step()

    def _record_step(self) -> None:
        states = self._episode.machine_states()
        if states is not None:
            self._states.append(states)
        if self._names:
            try:
                with engine_errors():
                    self._metrics.append(list(self._episode.metrics(self._names)))
            except RunError:  # metrics are available only at the end
                self._names = []
                self._metrics.clear()

    def trace(self) -> Trace:
        """Return the record."""
        steps = self._steps
        agents = max((int(step[0].max()) + 1 for step in steps if len(step[0])), default=0)
        widths = [steps[0][part].shape[1] if steps else 0 for part in (1, 2)]
        arrays = [np.full((len(steps), agents, width), np.nan, dtype=np.float32) for width in widths]
        if steps:
            rows = np.repeat(np.arange(len(steps)), [len(step[0]) for step in steps])
            columns = np.concatenate([step[0] for step in steps])
            for part, array in enumerate(arrays, start=1):
                array[rows, columns] = np.concatenate([step[part] for step in steps])
        agent_count = max((len(states) for states in self._states), default=0)
        states = np.zeros((len(self._states), agent_count), dtype=np.int16)
        for index, recorded in enumerate(self._states):
            states[index] = np.minimum(fill_states(recorded, agent_count), MOST_STATE)
        over_time = np.array(self._metrics, dtype=np.float64).reshape(len(self._metrics), len(self._names))
        metrics = {name: over_time[:, index] for index, name in enumerate(self._names)}
        return Trace(arrays[0], arrays[1], states if self._states else None, metrics)


class Playable(Protocol):
    """An episode that can be watched while it is stepped, such as `swarmwright._engine.Episode`."""

    @property
    def done(self) -> bool:
        """Whether the episode has ended."""

    @property
    def fitness(self) -> float:
        """Fitness so far; larger is better."""

    @property
    def step_size(self) -> float:
        """Seconds between two frames when shown."""

    def step(self) -> None:
        """Advance by one step."""

    def scene(self) -> SceneFields:
        """The scene, see `Scene.from_fields`."""

    def text(self, columns: int, color: bool, rows: int, unicode: bool) -> str:
        """The scene as text: at most `rows` lines of at most `columns` characters.

        unicode: box drawing and symbols; else the map is plain ASCII.
        """


@dataclass(frozen=True)
class Recording:
    """A whole episode: the scene before the first step and after each.

    fitness_so_far: fitness at each scene, larger is better. step_size: seconds between two scenes when shown.
    trace: sensors and actuators of agents, if known.
    """

    scenes: tuple[Scene, ...]
    fitness_so_far: tuple[float, ...]
    step_size: float
    trace: Trace | None = None

    def __post_init__(self) -> None:
        arrays = tuple(
            scene
            if isinstance(scene.bodies, Bodies)
            else replace(scene, bodies=Bodies.from_bodies(scene.bodies))
            for scene in self.scenes
        )
        object.__setattr__(self, "scenes", arrays)

    @property
    def fitness(self) -> float:
        """Fitness of the episode, at its end."""
        return self.fitness_so_far[-1]


_LEAST_BODIES = 50
"""Bodies that a scene counts for at least: scenes without any need memory, too."""


def record(episode: Playable, most_bodies: int | None = None) -> Recording:
    """Step an episode to its end and record every scene, and sensors and actuators if available.

    most_bodies: largest number of bodies in all scenes together; a scene counts as 50 bodies at least. Raises
    InputError for an episode that has more.
    """
    *_, (whole, _) = record_in_parts(episode, most_bodies=most_bodies)
    return whole


def record_in_parts(
    episode: Playable, beginning: int | None = None, *, most_bodies: int | None = None
) -> Iterator[tuple[Recording, bool]]:
    """Record an episode as `record` does; yield the beginning of a longer episode, then the whole.

    Yields (recording, whether it is the whole), in a single thread, as episodes require. beginning: steps, at
    least 1; None: only the whole.
    """
    tracer = Tracer.from_episode(episode)
    reader = _SceneReader(episode)
    scenes = [reader.read()]
    fitness_so_far = [episode.fitness]
    bodies = 0

    def make_recording() -> Recording:
        trace = None if tracer is None else tracer.trace()
        return Recording(tuple(scenes), tuple(fitness_so_far), episode.step_size, trace)

    while not episode.done:
        check_time_limit()
        if len(scenes) - 1 == beginning:
            yield make_recording(), False
        bodies += max(len(scenes[-1].bodies), _LEAST_BODIES)
        if most_bodies is not None and bodies > most_bodies:
            raise InputError(
                f"the episode is too long to be shown: it goes on after {len(scenes) - 1:,} steps with "
                f"{len(scenes[-1].bodies):,} bodies; choose fewer robots or a shorter episode"
            )
        if tracer is None:
            episode.step()
        else:
            tracer.step()
        scenes.append(reader.read())
        fitness_so_far.append(episode.fitness)
    yield make_recording(), True


class _SceneReader:
    """Reads the scenes of an episode. Scenes share the walls and the floor as long as these stay the same.

    Building them anew for each step would take longer than the simulation.
    """

    def __init__(self, episode: Playable) -> None:
        self._episode = episode
        self._arrays = getattr(episode, "scene_arrays", None)
        self._surroundings: dict[str, object] = {}
        self._previous: Scene | None = None

    def read(self) -> Scene:
        """Return the present scene."""
        if self._arrays is None:
            return Scene.from_fields(self._episode.scene())
        arrays = self._arrays()
        surroundings = dict(arrays["scene"])
        step = arrays["scene"]["step"]
        del surroundings["step"]
        if self._previous is None or surroundings != self._surroundings:
            self._surroundings = surroundings
            self._previous = scene_from_arrays(arrays)
        else:
            bodies = Bodies.from_arrays(arrays["bodies"], arrays["rays"])
            self._previous = self._previous.with_bodies(step, bodies, arrays["links"])
        return self._previous


@dataclass(frozen=True)
class Part:
    """One of the episodes that a page shows side by side.

    name: its name on the page. machines: state machines of the agents' controllers. sensor_names,
    actuator_names: actuator names of an agent; numbered if empty. kinds: kinds of agents, if the simulation
    has several. step_seconds: simulated seconds of a step, if known.
    """

    recording: Recording
    name: str = ""
    machines: Machines = field(default_factory=Machines)
    sensor_names: Sequence[str] = ()
    actuator_names: Sequence[str] = ()
    kinds: Sequence[Kind] = ()
    step_seconds: float | None = None

    @classmethod
    def from_recording(cls, shows: "Recording | Part") -> "Part":
        """Return a part; a recording becomes a part without further information."""
        return cls(shows) if isinstance(shows, Recording) else shows

    @property
    def kind_names(self) -> tuple[str, ...]:
        """Names of the kinds of agents, which are the states of bodies of the kind agent."""
        groups = self.machines.groups or ()
        return tuple(dict.fromkeys([*(kind.name for kind in self.kinds), *(group.name for group in groups)]))


PARTS = ("trails", "rays", "links", "labels")
"""Parts of a picture that are optional."""


COLORS = ("auto", "state", "value", "controller")
"""Sources of the bodies' colours."""


@dataclass(frozen=True)
class Shown:
    """Optional parts of a picture; on a page, those that are shown initially.

    labels: True or False, or None: True, except on a page with more than 100 labelled bodies, initially.
    colors: source of the bodies' colours: kind and state, value, or the state of the agent's controller if it
    is a state machine. auto: the value if there is one, on a page the controller.
    """

    trails: bool = True
    rays: bool = False
    links: bool = False
    labels: bool | None = None
    colors: Literal["auto", "state", "value", "controller"] = "auto"


@dataclass(frozen=True)
class Caption:
    """A title and facts below it."""

    title: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    """Pairs of name and value."""
