"""Saving of episodes in formats by file suffix."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.plain_figures import warn_of_missing_letters
from swarmwright.common.warn_once import warn_once
from swarmwright.display._episode import Caption, Part, Recording, Shown
from swarmwright.display._look import is_moving
from swarmwright.display._scene import Bodies, Scene

_WRITERS = {".html": "page", ".gif": "animation", ".mp4": "film", ".png": "still"}

FORMATS = tuple(_WRITERS)
"""Suffixes supported by `save`."""


def save(
    shows: Recording | Sequence[Part],
    path: Path,
    *,
    caption: Caption | None = None,
    speed: float = 1.0,
    shown: Shown | None = None,
) -> None:
    """Save an episode.

    .html is a page with playback, .gif and .mp4 are animations, .png shows all trajectories.

    Args:
        shows: the episode, or several that a page shows side by side.
        path: the file, which is overwritten.
        caption: the text on the page, and the title of a video; pictures have the simulation's message.
        speed: factor relative to the simulation's step size, for a page initially.
        shown: optional parts of the picture, on a page initially.

    Raises:
        ValueError: another suffix.
        InputError: ffmpeg is missing for a video, several episodes for a picture, or colours by controller
            state for
            controllers without states.
        OSError: the file cannot be written.
    """
    ending = path.suffix.lower()
    if ending not in _WRITERS:
        raise ValueError(f"'{path}': unknown suffix; use {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.")
    parts = [Part(shows)] if isinstance(shows, Recording) else shows
    if shown is not None and shown.colors == "controller":
        _check_states(parts)
    if ending != ".html" and len(parts) != 1:
        raise InputError(f"{path}: only a page, FILE.html, can show several episodes side by side")
    for part in parts:
        _warn_of_bodies_outside(part.recording)
        if ending == ".png":
            _warn_of_a_still_without_agents(part.recording)
    module = import_module(f"swarmwright.display.{_WRITERS[ending]}")
    with warn_of_missing_letters():
        if ending == ".html":
            text = module.format_page(parts, caption=caption or Caption(), speed=speed, shown=shown)
            path.write_text(text, encoding="utf-8")
            return
        module.write(parts[0], path, caption=caption or Caption(), speed=speed, shown=shown)


def _check_states(parts: Sequence[Part]) -> None:
    """Raise InputError unless the controller of an episode has known states."""
    traces = [part.recording.trace for part in parts]
    if any(trace is not None and trace.states is not None for trace in traces):
        return
    machines = parts[0].machines
    if not machines.kind or machines.machine or machines.groups_with_colors:
        why = "this episode does not report them"
    elif machines.groups is not None:
        why = "no controller of this team has any"
    else:
        why = f"a controller of the kind {machines.kind} has none"
    raise InputError(
        f"colors: controller needs states of a state machine (modules, mealy_fsm), but {why}; "
        "use auto, state or value"
    )


def _is_inside(scene: Scene) -> NDArray[np.bool_]:
    """Return which bodies overlap the scene, (bodies,)."""
    bodies = Bodies.from_bodies(scene.bodies)
    x, y, radius = bodies.x, bodies.y, bodies.radius
    inside: NDArray[np.bool_] = (
        (x >= -radius) & (x <= scene.width + radius) & (y >= -radius) & (y <= scene.height + radius)
    )
    return inside


def _warn_of_a_still_without_agents(recording: Recording) -> None:
    """Warn of a picture without agents, because all are outside the scene at the end."""
    last = recording.scenes[-1]
    agents = is_moving(Bodies.from_bodies(last.bodies))
    if not agents.any() or _is_inside(last)[agents].any():
        return
    if any(
        _is_inside(scene)[is_moving(Bodies.from_bodies(scene.bodies))].any() for scene in recording.scenes
    ):
        warn_once(
            f"all {agents.sum()} agents are outside the scene, {last.width:g} x {last.height:g}, in step "
            f"{last.step}, which the picture shows; use a page (.html) or an animation (.gif) to see all "
            "steps"
        )


def _warn_of_bodies_outside(recording: Recording) -> None:
    """Warn of an episode whose bodies are always outside the scene, so that the map is empty."""
    last = recording.scenes[-1]
    if not len(last.bodies) or any(_is_inside(scene).any() for scene in recording.scenes):
        return
    warn_once(
        f"all {len(last.bodies)} bodies are outside the scene, {last.width:g} x {last.height:g}, in all "
        "steps; positions are relative to its bottom left corner, (0, 0)"
    )
