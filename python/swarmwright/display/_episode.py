"""Episodes as the display sees them."""

from dataclasses import dataclass
from typing import Protocol

from swarmwright.core.engine_types import SceneFields
from swarmwright.display._scene import Scene


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
    """

    scenes: tuple[Scene, ...]
    fitness_so_far: tuple[float, ...]
    step_size: float

    @property
    def fitness(self) -> float:
        """Fitness of the episode, at its end."""
        return self.fitness_so_far[-1]


def record(episode: Playable) -> Recording:
    """Step an episode to its end and keep every scene."""
    scenes = [Scene.of(episode.scene())]
    fitness_so_far = [episode.fitness]
    while not episode.done:
        episode.step()
        scenes.append(Scene.of(episode.scene()))
        fitness_so_far.append(episode.fitness)
    return Recording(tuple(scenes), tuple(fitness_so_far), episode.step_size)
