"""Episodes as files, by the ending of the name."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.plain_figures import warn_of_missing_letters
from swarmwright.common.warn_once import warn_once
from swarmwright.display._bodies import Bodies
from swarmwright.display._episode import Caption, Part, Recording, Shown
from swarmwright.display._look import moving
from swarmwright.display._scene import Scene

_WRITERS = {".html": "page", ".gif": "animation", ".mp4": "film", ".png": "still"}

FORMATS = tuple(_WRITERS)
"""Endings that `save` knows."""


def save(
    shows: Recording | Sequence[Part],
    path: Path,
    *,
    caption: Caption | None = None,
    speed: float = 1.0,
    shown: Shown | None = None,
) -> None:
    """Write an episode.

    .html is a page to play and step through, .gif and .mp4 move, .png shows all trajectories.

    Args:
        shows: the episode, or several that a page shows beside each other.
        path: is written over.
        caption: the text on the page, and the title of a video; pictures have the simulation's message.
        speed: how many times faster than the simulation's step size it runs, for a page at first.
        shown: what is drawn beside bodies, on a page at first.

    Raises:
        ValueError: another ending.
        InputError: a video is wanted and what encodes it is not installed, a picture of several episodes, or
            colours of the states of controllers that have none.
        OSError: the file cannot be written.
    """
    ending = path.suffix.lower()
    if ending not in _WRITERS:
        raise ValueError(f"'{path}': files end with {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.")
    parts = [Part(shows)] if isinstance(shows, Recording) else shows
    if shown is not None and shown.colors == "controller":
        _check_states(parts)
    if ending != ".html" and len(parts) != 1:
        raise InputError(f"{path}: several episodes are shown beside each other by a page, FILE.html")
    for part in parts:
        _warn_of_bodies_outside(part.recording)
        if ending == ".png":
            _warn_of_a_still_without_agents(part.recording)
    module = import_module(f"swarmwright.display.{_WRITERS[ending]}")
    with warn_of_missing_letters():
        if ending == ".html":
            text = module.page(parts, caption=caption or Caption(), speed=speed, shown=shown)
            path.write_text(text, encoding="utf-8")
            return
        module.write(parts[0], path, caption=caption or Caption(), speed=speed, shown=shown)


def _check_states(parts: Sequence[Part]) -> None:
    """Raise InputError unless the controller of an episode has states that are known."""
    traces = [part.recording.trace for part in parts]
    if any(trace is not None and trace.states is not None for trace in traces):
        return
    machines = parts[0].machines
    if not machines.kind or machines.machine or machines.colored_groups:
        why = "this episode does not say them"
    elif machines.groups is not None:
        why = "no controller of this team has any"
    else:
        why = f"a controller of the kind {machines.kind} has none"
    raise InputError(
        f"colors: controller shows the states of state machines (modules, mealy_fsm), and {why}; "
        "there are auto, state and value"
    )


def _within(scene: Scene) -> NDArray[np.bool_]:
    """Return which bodies lie within a scene, or reach into it, (bodies,)."""
    bodies = Bodies.of(scene.bodies)
    x, y, radius = bodies.x, bodies.y, bodies.radius
    within: NDArray[np.bool_] = (
        (x >= -radius) & (x <= scene.width + radius) & (y >= -radius) & (y <= scene.height + radius)
    )
    return within


def _warn_of_a_still_without_agents(recording: Recording) -> None:
    """Warn of a picture on which nothing that moves is seen, because the episode ends with all outside."""
    last = recording.scenes[-1]
    agents = moving(Bodies.of(last.bodies))
    if not agents.any() or _within(last)[agents].any():
        return
    if any(_within(scene)[moving(Bodies.of(scene.bodies))].any() for scene in recording.scenes):
        warn_once(
            f"the picture shows step {last.step}, when all agents ({agents.sum()}) are outside the scene, "
            f"{last.width:g} x {last.height:g}; a page (.html) or an animation (.gif) shows the steps before"
        )


def _warn_of_bodies_outside(recording: Recording) -> None:
    """Warn of an episode in which no body ever lies within the scene, so that the map is empty."""
    last = recording.scenes[-1]
    if not len(last.bodies) or any(_within(scene).any() for scene in recording.scenes):
        return
    warn_once(
        f"{len(last.bodies)} of {len(last.bodies)} bodies are outside of the scene, {last.width:g} x "
        f"{last.height:g}, in all steps; positions of bodies are from its bottom left corner, (0, 0)"
    )
