"""Episodes as the display sees them: recorded, with what is known of the controller and what is drawn."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

from swarmwright.common.engine_types import SceneFields
from swarmwright.common.groups import Kind
from swarmwright.display._bodies import Bodies, scene_of
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
        """Move on by one step."""

    def scene(self) -> SceneFields:
        """The scene, see `Scene.of`."""

    def text(self, columns: int, color: bool, rows: int, unicode: bool) -> str:
        """The scene as text: at most `rows` lines of at most `columns` characters.

        unicode: box drawing and symbols; else the map is plain ASCII.
        """


@dataclass(frozen=True)
class Recording:
    """A whole episode: the scene before the first step and after each.

    fitness_so_far: at each scene, more is better. step_size: seconds between two scenes when shown.
    trace: what agents sensed and did, where that is known.
    """

    scenes: tuple[Scene, ...]
    fitness_so_far: tuple[float, ...]
    step_size: float
    trace: Trace | None = None

    def __post_init__(self) -> None:
        arrays = tuple(
            scene if isinstance(scene.bodies, Bodies) else replace(scene, bodies=Bodies.of(scene.bodies))
            for scene in self.scenes
        )
        object.__setattr__(self, "scenes", arrays)

    @property
    def fitness(self) -> float:
        """Fitness of the episode, at its end."""
        return self.fitness_so_far[-1]


def record(episode: Playable) -> Recording:
    """Step an episode to its end and keep every scene, and what agents sensed and did where it says so."""
    tracer = Tracer.of(episode)
    scenes = [_scene(episode)]
    fitness_so_far = [episode.fitness]
    while not episode.done:
        if tracer is None:
            episode.step()
        else:
            tracer.step()
        scenes.append(_scene(episode))
        fitness_so_far.append(episode.fitness)
    trace = None if tracer is None else tracer.trace()
    return Recording(tuple(scenes), tuple(fitness_so_far), episode.step_size, trace)


def _scene(episode: Playable) -> Scene:
    arrays = getattr(episode, "scene_arrays", None)
    return Scene.of(episode.scene()) if arrays is None else scene_of(arrays())


@dataclass(frozen=True)
class Part:
    """One of the episodes that a page shows beside each other.

    name: what it is called there. machines: of the controllers of its agents. sensor_names, actuator_names:
    of an agent; those without a name are numbered. kinds: of agents, where the simulation has several.
    step_seconds: of a step in the simulated world, where known.
    """

    recording: Recording
    name: str = ""
    machines: Machines = field(default_factory=Machines)
    sensor_names: Sequence[str] = ()
    actuator_names: Sequence[str] = ()
    kinds: Sequence[Kind] = ()
    step_seconds: float | None = None

    @classmethod
    def of(cls, shows: "Recording | Part") -> "Part":
        """Return an episode, with no more known of it where it is a recording."""
        return cls(shows) if isinstance(shows, Recording) else shows

    @property
    def kind_names(self) -> tuple[str, ...]:
        """The names of the kinds of agents, which bodies of the kind agent have as their state."""
        groups = self.machines.groups or ()
        return tuple(dict.fromkeys([*(kind.name for kind in self.kinds), *(group.name for group in groups)]))


PARTS = ("trails", "rays", "links", "labels")
"""What can be drawn or left out."""


COLORS = ("auto", "state", "value", "controller")
"""What can give bodies their colours."""


@dataclass(frozen=True)
class Shown:
    """What is drawn beside bodies: a page shows it at first, and can show all.

    labels: True or False, or None: True, but on a page with more than 100 labelled bodies False at first.
    colors: what gives bodies their colours: their kind and state, their value, or the state of the agent's
    controller where that is a state machine. auto: the value where there is one, on a page the controller.
    """

    trails: bool = True
    rays: bool = False
    links: bool = False
    labels: bool | None = None
    colors: Literal["auto", "state", "value", "controller"] = "auto"


@dataclass(frozen=True)
class Caption:
    """A title, and facts below it."""

    title: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    """Name and value of each."""
