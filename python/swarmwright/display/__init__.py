"""Pictures of episodes: in the terminal, as a still, an animation, a film, a page to play."""

from swarmwright.display._caption import Caption
from swarmwright.display._episode import Playable, Recording, record
from swarmwright.display._scene import Body, Scene

__all__ = ["Body", "Caption", "Playable", "Recording", "Scene", "record"]
