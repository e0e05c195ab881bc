"""Display of episodes: in the terminal, as a still, an animation, a video, or a page with playback."""

from swarmwright.display._episode import (
    COLORS,
    PARTS,
    Caption,
    Part,
    Playable,
    Recording,
    Shown,
    Trace,
    record,
    record_in_parts,
)
from swarmwright.display._scene import Bodies, Body, Light, Patch, Ray, Scale, Scene, Style, Wall

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
