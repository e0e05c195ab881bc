"""Display of episodes: in the terminal, as a still, an animation, a video, or a page with playback."""

from swarmwright.display._bodies import Bodies
from swarmwright.display._episode import (
    COLORS,
    PARTS,
    Caption,
    Part,
    Playable,
    Recording,
    Shown,
    record,
    record_in_parts,
)
from swarmwright.display._scene import Body, Light, Patch, Ray, Scale, Scene, Style, Wall
from swarmwright.display._trace import Trace

__all__ = [
    "COLORS",
    "PARTS",
    "Bodies",
    "Body",
    "Caption",
    "Light",
    "Part",
    "Patch",
    "Playable",
    "Ray",
    "Recording",
    "Scale",
    "Scene",
    "Shown",
    "Style",
    "Trace",
    "Wall",
    "record",
    "record_in_parts",
]
