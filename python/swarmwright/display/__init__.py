"""Pictures of episodes: in the terminal, as an animation, as a still."""

from swarmwright.display._episode import Playable, record
from swarmwright.display._scene import Body, Scene

__all__ = ["Body", "Playable", "Scene", "record"]
