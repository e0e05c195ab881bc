"""Episodes as the display sees them."""

from dataclasses import dataclass, replace
from typing import Protocol

from swarmwright.common.engine_types import SceneFields
from swarmwright.display._bodies import Bodies, scene_of
from swarmwright.display._scene import Scene
from swarmwright.display._trace import Trace, Tracer


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
