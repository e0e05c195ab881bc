"""Episodes as files, by the ending of the name."""

import warnings
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.core.teams import is_team
from swarmwright.display._caption import Caption
from swarmwright.display._episode import Recording
from swarmwright.display._machine import groups_of, has_states, state_names
from swarmwright.display._part import Part
from swarmwright.display._shown import Shown

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
        caption: the text on the page, and the title of a film; pictures have the simulation's message.
        speed: how many times faster than the simulation's step size it runs, for a page at first.
        shown: what is drawn beside bodies, on a page at first.

    Raises:
        ValueError: another ending.
        InputError: a film is wanted and what encodes it is not installed, a picture of several episodes, or
            colours of the states of controllers that have none.
        OSError: the file cannot be written.
    """
    ending = path.suffix.lower()
    if ending not in _WRITERS:
        raise ValueError(f"'{path}': files end with {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.")
    if shown is not None and shown.colors == "controller":
        _check_states([Part(shows)] if isinstance(shows, Recording) else shows)
    names: list[str] = []
    if ending != ".html" and not isinstance(shows, Recording):
        if len(shows) != 1:
            raise InputError(f"{path}: several episodes are shown beside each other by a page, FILE.html")
        specification, shows = shows[0].controller, shows[0].recording
        names = state_names(specification)
    module = import_module(f"swarmwright.display.{_WRITERS[ending]}")
    with warnings.catch_warnings():
        # A message in a script that the font lacks is shown as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing", category=UserWarning)
        if ending == ".html":
            text = module.page(shows, caption=caption or Caption(), speed=speed, shown=shown)
            path.write_text(text, encoding="utf-8")
            return
        module.write(shows, path, caption=caption or Caption(), speed=speed, shown=shown, state_names=names)


def _check_states(parts: Sequence[Part]) -> None:
    """Raise InputError unless the controller of an episode has states that are known."""
    traces = [part.recording.trace for part in parts]
    if any(trace is not None and trace.states is not None for trace in traces):
        return
    controller = parts[0].controller
    kind = controller.get("kind")
    if kind is None or has_states(controller) or groups_of(controller):
        why = "this episode does not say them"
    elif is_team(controller):
        why = "no controller of this team has any"
    else:
        why = f"a controller of the kind {kind} has none"
    raise InputError(
        f"colors: controller shows the states of state machines (modules, mealy_fsm), and {why}; "
        "there are auto, state and value"
    )
