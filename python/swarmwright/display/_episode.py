"""Recorded episodes, and options for drawing them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

from swarmwright.common.engine_types import SceneFields
from swarmwright.common.errors import InputError
from swarmwright.common.groups import Kind
from swarmwright.common.time_limit import check_time_limit
from swarmwright.display._bodies import Bodies, scene_from_arrays
from swarmwright.display._scene import Scene
from swarmwright.display._trace import Trace, Tracer
from swarmwright.display.machines import Machines


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
