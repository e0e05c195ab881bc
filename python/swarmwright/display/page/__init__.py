"""Episodes as a self-contained HTML page: play, step, scrub, zoom, follow an agent; works offline.

A page around it can play several in step: see `remote.js` for the messages. `format_player` has no episode;
the page around it sends one, packed by `pack_page`, which is shown faster than a page of its own.
"""

import base64
import html
import io
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.display._episode import Caption, Part, Recording, Shown, Trace
from swarmwright.display._key import find_directed, scale_of
from swarmwright.display._look import (
    CELLS,
    LED,
    MOVING,
    SHAPES,
    STATES,
    STRETCH,
    Looks,
    floor_labels,
    floor_patch,
    format_css,
    is_moving,
    label,
)
from swarmwright.display._scene import Bodies, Patch, Scene
from swarmwright.display.machines import Machine

if TYPE_CHECKING:
    from PIL.Image import Image

    from swarmwright.display.pictures import PictureRecording

EXACT = 300_000
"""Largest number of values that are stored as binary32; more are quantized to 2 bytes."""
TYPES = {"f4": "<f4", "i4": "<i4", "u2": "<u2", "u1": "u1", "q2": "<u2", "q1": "u1"}
ALIGNMENT = 4
"""Bytes: arrays begin at multiples, so that the script reads them in location."""


@dataclass(frozen=True)
class Packed:
    """Packed numbers.

    kind: f4 or i4 for binary32 and integers, u1 and u2 for integers of 1 or 2 bytes, q1 and q2 for
    quantization to 1 or 2 bytes between `low` and `high`, of which the largest value is NaN.
    """

    kind: str
    raw: bytes
    low: float | None = None
    high: float | None = None

    def to_mapping(self) -> dict[str, Any]:
        """Return the kind and the ends of quantized numbers."""
        ends = {} if self.low is None else {"low": self.low, "high": self.high}
        return {"type": self.kind, **ends}


def pack(values: NDArray[Any], kind: str) -> Packed:
    """Pack numbers as one of the kinds of `Packed`."""
    if not kind.startswith("q"):
        return Packed(kind, np.ascontiguousarray(values, dtype=TYPES[kind]).tobytes())
    is_finite = np.isfinite(values)
    finite = values[is_finite]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if high <= low:
        high = low + 1.0
    none = 65535 if kind == "q2" else 255
    parts = (values.astype(np.float64) - low) * ((none - 1) / (high - low))
    quantized = np.where(is_finite, np.rint(parts, out=parts), none).astype(TYPES[kind])
    return Packed(kind, quantized.tobytes(), low, high)


def pack_integers(values: NDArray[Any]) -> Packed:
    """Pack integers, 0 or more, in 2 bytes each if they are small, in 4 otherwise."""
    return pack(values, "u2" if int(values.max(initial=0)) < 1 << 16 else "i4")


def to_json(data: dict[str, Any]) -> str:
    """Return plain and packed values as JSON, with packed numbers in base64."""

    def encode(value: Packed) -> dict[str, Any]:
        return {**value.to_mapping(), "data": base64.b64encode(value.raw).decode()}

    return _dump(data, encode)


def to_bytes(data: dict[str, Any]) -> bytes:
    """Return plain and packed values as bytes that a script reads without copying them.

    They are the length of the JSON, 4 bytes with the lowest first; the JSON; and all packed numbers, at the
    offsets that the JSON names, from its end.
    """
    blobs: list[bytes] = []
    end = 0

    def encode(value: Packed) -> dict[str, Any]:
        nonlocal end
        location = {**value.to_mapping(), "at": end, "size": len(value.raw)}
        padding = -len(value.raw) % ALIGNMENT
        blobs.extend([value.raw, b"\0" * padding])
        end += len(value.raw) + padding
        return location

    text = _dump(data, encode).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    return b"".join([len(text).to_bytes(4, "little"), text, *blobs])


def _dump(data: dict[str, Any], encode: Any) -> str:  # noqa: ANN401 - as `json` takes it
    return json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"), default=encode)


EXACT_RAYS = 20_000
"""The same for sensor rays, which are only drawn."""


def number_kind(count: int, coarse: str = "q2", exact: int = EXACT) -> str:
    """Return the kind in which a number of values is packed."""
    return "f4" if count <= exact else coarse


def pack_series(
    values: NDArray[Any], kind: str | None = None, coarse: str = "q2", exact: int = EXACT
) -> dict[str, Packed]:
    """Encode values over time; constant columns are stored once.

    values: (scenes, bodies). kind: as for `pack`; None: by how many there are, `coarse` above `exact`.
    """
    first = values[0]
    same = values == first
    if values.dtype.kind == "f":
        same |= np.isnan(values) & np.isnan(first)
    changing_columns = np.flatnonzero(~same.all(axis=0))
    changing_values = values[:, changing_columns]
    base_kind = kind or "f4"
    result = {"base": pack(first, base_kind), "which": pack(changing_columns, "i4")}
    if len(changing_columns):
        result["data"] = pack(
            changing_values.reshape(-1), kind or number_kind(changing_values.size, coarse, exact)
        )
    return result


_MOST_PLACES = 4_000_000
"""Largest number of positions of moving bodies on a page; of longer episodes, only every second, third, ...
scene is used."""
_MOST_TRACED = 3_000_000
"""Largest number of sensor and actuator values on a page; with more, only the first agents are included."""
_MOST_LINKS = 1_000_000
_MOST_RAYS = 2_000_000
_MOST_PICTURES = 300
"""Largest number of pictures on a page."""
_LARGEST_PICTURE = (560, 560)
"""Largest size of a picture, in pixels."""

TABLES = {
    "shapes": {name: path for name, (_, path) in SHAPES.items()},
    "cells": list(CELLS),
    "moving": list(MOVING),
    "led": LED,
    "stretch": STRETCH,
    "states": list(STATES),
}
"""Data that all pages share."""


def page_data(parts: Sequence[Part], *, speed: float, shown: Shown) -> tuple[dict[str, Any], Looks]:
    """Return episodes shown side by side as plain values, and the looks of their bodies.

    step_seconds and speed; looks: shape and colour by label; states: colours of controller states;
    known_seconds: simulated seconds of a step, null if unknown; kinds: names of kinds of agents; shapes as
    paths; cells, moving, led, stretch: the kinds that fill a cell of a grid, leave trails, are LEDs, and are
    wall sections; scale: of the bodies' values; shown; floors: labels of grey values; and episodes, see
    `_episode`.
    """
    scenes = list(chain.from_iterable(part.recording.scenes for part in parts))
    looks = Looks(scenes)
    scales = [scale for part in parts if (scale := scale_of(part.recording)) is not None]
    grounds: list[Scene] = []
    previous: list[object] = []
    for scene in scenes:
        if scene.patches not in previous or scene.floor not in previous:
            previous = [*previous[-8:], scene.patches, scene.floor]
            grounds.append(scene)
    data = {
        "step_seconds": max(parts[0].recording.step_size, 0.02),
        "known_seconds": parts[0].step_seconds,
        "speed": speed,
        "looks": _looks(parts, looks),
        "kinds": list(dict.fromkeys(name for part in parts for name in part.kind_names)),
        "scale": None
        if not scales
        else {
            "name": scales[0].name,
            "low": min(scale.low for scale in scales),
            "high": max(scale.high for scale in scales),
        },
        "shown": vars(shown),
        "floors": sorted(floor_labels(*grounds).items()),
        "episodes": [_episode(part) for part in parts],
    }
    return data, looks


def _looks(parts: Sequence[Part], looks: Looks) -> dict[str, dict[str, Any]]:
    """Return shape and colour by label; `directed` for bodies with headings."""
    headed = {label(*look) for part in parts for look in find_directed(part.recording)}
    return {
        name: {**look, "directed": True} if name in headed else {**look}
        for name, look in looks.plain().items()
    }


def _episode(part: Part) -> dict[str, Any]:
    """Return an episode as plain values.

    name, width, height, origin, grid and message of the world; fitness so far at each scene, and metrics by
    name, null if not finite; keys: included scenes, `stride` apart; bodies; ground: [first scene, floor,
    patches, walls, lights]; and, if present, rays, links, trace, states of agents, the machine of all agents,
    and groups of a team that have machines.
    """
    recording = part.recording
    scenes = recording.scenes
    first = scenes[0]
    all_bodies = [Bodies.from_bodies(scene.bodies) for scene in scenes]
    count = int(np.count_nonzero(is_moving(all_bodies[0])))
    stride = max(1, -(-len(scenes) * count // _MOST_PLACES))
    keys = list(range(0, len(scenes), stride))
    if keys[-1] != len(scenes) - 1:
        keys.append(len(scenes) - 1)
    key_bodies = [all_bodies[key] for key in keys]
    trace = recording.trace
    return {
        "name": part.name,
        "message": first.message,
        "width": first.width,
        "height": first.height,
        "origin": list(first.origin),
        "grid": first.grid,
        "fitness": _numbers(recording.fitness_so_far, 9),
        "metrics": {name: _numbers(values, 6) for name, values in (trace.metrics if trace else {}).items()},
        "stride": stride,
        "keys": pack(np.array(keys), "i4"),
        "bodies": _bodies(key_bodies),
        "ground": _grounds(scenes),
        "rays": _rays(key_bodies),
        "links": _links([scenes[key] for key in keys]),
        "trace": None if trace is None else _trace(trace, keys, part),
        "states": None if trace is None else states_data(trace, keys),
        "machine": None if trace is None else machine_data(trace, part),
        "groups": part.machines.groups_with_colors,
    }


def _bodies(key_bodies: Sequence[Bodies]) -> dict[str, Any]:
    """Return bodies; `most`: largest number of each look in a scene."""
    count = max(len(bodies) for bodies in key_bodies)
    looks = list(dict.fromkeys(look for bodies in key_bodies for look in bodies.looks))
    index = {look: number for number, look in enumerate(looks)}
    most = dict.fromkeys(looks, 0)
    kind = np.uint8 if len(looks) < 256 else np.int32
    names = ("x", "y", "radius", "heading", "value")
    if len(looks) == 1 and all(len(bodies) == count for bodies in key_bodies):
        look: NDArray[Any] = np.zeros((len(key_bodies), count), dtype=kind)
        most[looks[0]] = count
        numbers = {name: np.stack([getattr(bodies, name) for bodies in key_bodies]) for name in names}
    else:
        look, numbers = _body_rows(key_bodies, index, most, kind)
    longest = max(key_bodies, key=len)
    kinds = {"heading": "q1"}
    return {
        "count": count,
        "looks": looks,
        "most": [most[name] for name in looks],
        "agents": pack(longest.agents(), "i4"),
        "labels": _labels(key_bodies),
        "series": {
            "look": pack_series(look, "u1" if len(looks) < 256 else "i4"),
            **{name: pack_series(values, coarse=kinds.get(name, "q2")) for name, values in numbers.items()},
        },
    }


def _body_rows(
    key_bodies: Sequence[Bodies],
    index: dict[tuple[str, str], int],
    most: dict[tuple[str, str], int],
    kind: type,
) -> tuple[NDArray[Any], dict[str, NDArray[np.float32]]]:
    """Return looks and numbers of bodies, (scenes, most bodies), for scenes that differ in their bodies.

    index: number of each look. most: raised to the largest number of each look in a scene. kind: of looks.
    """
    count = max(len(bodies) for bodies in key_bodies)
    looks = list(index)
    look: NDArray[Any] = np.zeros((len(key_bodies), count), dtype=kind)
    numbers = {
        name: np.full((len(key_bodies), count), np.nan, dtype=np.float32)
        for name in ("x", "y", "radius", "heading", "value")
    }
    for row, bodies in enumerate(key_bodies):
        look_numbers = np.array([index[name] for name in bodies.looks], dtype=look.dtype)
        look[row, : len(bodies)] = look_numbers[bodies.look] if len(look_numbers) else 0
        for number, amount in zip(
            look_numbers, np.bincount(bodies.look, minlength=len(look_numbers)), strict=True
        ):
            most[looks[number]] = max(most[looks[number]], int(amount))
        for name, values in numbers.items():
            values[row, : len(bodies)] = getattr(bodies, name)
    return look, numbers


def _labels(key_bodies: Sequence[Bodies]) -> list[tuple[int, list[str]]]:
    """Return labels of all bodies, with the first included scene of each set."""
    changes: list[tuple[int, list[str]]] = []
    for row, bodies in enumerate(key_bodies):
        labels = bodies.labels or []
        if labels != (changes[-1][1] if changes else []):
            changes.append((row, labels))
    return changes


def _grounds(scenes: Sequence[Scene]) -> list[tuple[int, dict[str, Any]]]:
    changes: list[tuple[int, dict[str, Any]]] = []
    previous: tuple[object, ...] | None = None
    for index, scene in enumerate(scenes):
        ground = (scene.floor, tuple(scene.patches), tuple(scene.walls), tuple(scene.lights))
        if ground == previous:
            continue
        previous = ground
        changes.append(
            (
                index,
                {
                    "floor": None if scene.floor is None else _patch(floor_patch(scene)),
                    "patches": [_patch(patch) for patch in scene.patches],
                    "walls": [{"points": _points(wall.points), "solid": wall.solid} for wall in scene.walls],
                    "lights": [
                        {"x": light.x, "y": light.y, "on": light.intensity > 0} for light in scene.lights
                    ],
                },
            )
        )
    return changes


def _patch(patch: Patch) -> dict[str, Any]:
    return {"points": _points(patch.points), "radius": float(patch.radius), "grey": float(patch.grey)}


def _points(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in points]


def _rays(key_bodies: Sequence[Bodies]) -> dict[str, Any] | None:
    count = max(len(bodies.ray_body) for bodies in key_bodies)
    if not 0 < count * len(key_bodies) <= _MOST_RAYS:
        return None
    body = np.full((len(key_bodies), count), -1, dtype=np.int32)
    numbers = np.full((4, len(key_bodies), count), np.nan, dtype=np.float32)
    for row, bodies in enumerate(key_bodies):
        body[row, : len(bodies.ray_body)] = bodies.ray_body
        numbers[:, row, : len(bodies.ray_body)] = bodies.ray_numbers.T
    names = ("angle", "start", "length", "reading")
    return {
        "body": pack_series(body, "i4"),
        **{
            name: pack_series(values, coarse="q1", exact=EXACT_RAYS)
            for name, values in zip(names, numbers, strict=True)
        },
    }


def _links(scenes: Sequence[Scene]) -> dict[str, Any] | None:
    """Return pairs of bodies, without repetition, and the first pair of each included scene."""
    ends = [np.asarray(scene.links, dtype=np.int64).reshape(-1, 2) for scene in scenes]
    counts = [len(pairs) for pairs in ends]
    if sum(counts) > 2 * _MOST_LINKS:  # each may be there twice
        return None
    pairs = np.concatenate(ends)
    if not len(pairs):
        return None
    low, high = np.minimum(*pairs.T), np.maximum(*pairs.T)
    # All scenes at once: sorting those of each one would take longer than the simulation.
    most = int(high.max()) + 1
    numbers = np.sort((np.repeat(np.arange(len(scenes)), counts) * most + low) * most + high)
    numbers = numbers[np.append(True, numbers[1:] != numbers[:-1])]
    if len(numbers) > _MOST_LINKS:
        return None
    starts = np.searchsorted(numbers // (most * most), np.arange(len(scenes) + 1))
    unique = np.stack([numbers // most % most, numbers % most], axis=1)
    return {"starts": pack(starts, "i4"), "ends": pack_integers(unique.reshape(-1))}


def _trace(trace: Trace, keys: Sequence[int], part: Part) -> dict[str, Any] | None:
    """Return sensors and actuators at the included scenes: names, and values (scenes, agents) of each.

    kinds: agents up to `end`, beginning after the previous kind, have these names, null for unused values.
    """
    steps, agents, sensors = trace.sensors.shape
    width = sensors + trace.actuators.shape[2]
    if not steps or not agents or not width:
        return None
    agents = min(agents, max(1, _MOST_TRACED // (len(keys) * width)))
    rows = [key for key in keys if key < steps]
    numbers = np.concatenate([trace.sensors[rows, :agents], trace.actuators[rows, :agents]], axis=2)
    # There is no step after the last scene.
    missing = np.full((len(keys) - len(rows), agents, width), np.nan, dtype=np.float32)
    kind = number_kind((len(rows) + len(missing)) * agents * width)
    columns = np.ascontiguousarray(np.concatenate([numbers, missing]).reshape(-1, width).T)
    known_names = {"sensor": part.sensor_names, "actuator": part.actuator_names}
    names = [
        known_names[noun][index] if index < len(known_names[noun]) else f"{noun} {index}"
        for noun, count in (("sensor", sensors), ("actuator", width - sensors))
        for index in range(count)
    ]
    return {
        "agents": agents,
        "sensors": sensors,
        "names": names,
        "kinds": _kinds(part, sensors, width - sensors),
        "values": [pack(column, kind) for column in columns],
    }


def _kinds(part: Part, sensors: int, actuators: int) -> list[dict[str, Any]]:
    kinds, end = [], 0
    for kind in part.kinds:
        if (len(kind.sensors), len(kind.actuators)) != (sensors, actuators):
            return []  # kinds of another episode
        end += kind.agents
        kinds.append({"name": kind.name, "end": end, "names": [*kind.sensors, *kind.actuators]})
    return kinds


def picture_data(recording: "PictureRecording", *, speed: float) -> dict[str, Any]:
    """Return an episode of pictures as plain values, like `page_data` without bodies.

    pictures: JPEG images as data URLs; picture_steps: the step of each.
    """
    count = min(len(recording.pictures), _MOST_PICTURES)
    last = len(recording.pictures) - 1
    chosen = sorted({round(number * last / max(count - 1, 1)) for number in range(count)})
    images = [recording.image(index) for index in chosen]
    return {
        "step_seconds": max(recording.step_size, 0.02),
        "known_seconds": None,
        "speed": speed,
        "looks": {},
        "kinds": [],
        "scale": None,
        "shown": vars(Shown()),
        "floors": [],
        "episodes": [
            {
                "name": "",
                "message": "",
                "width": images[0].width,
                "height": images[0].height,
                "origin": [0, 0],
                "grid": False,
                "fitness": _numbers(recording.fitness_so_far, 9),
                "metrics": {},
                "pictures": [_jpeg(image) for image in images],
                "picture_steps": [recording.steps[index] for index in chosen],
            }
        ],
    }


def _jpeg(image: "Image") -> str:
    buffer = io.BytesIO()
    image.thumbnail(_LARGEST_PICTURE)
    image.save(buffer, "JPEG", quality=80)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _numbers(values: ArrayLike, digits: int) -> list[float | None]:
    """Return values with this many significant digits; None for those that are not finite."""
    exact = np.asarray(values, dtype=np.float64) + 0.0
    is_finite = np.isfinite(exact) & (exact != 0)
    size = np.log10(np.abs(exact, where=is_finite, out=np.ones_like(exact)))
    # Factors of numbers near the ends of binary64 would be infinite or 0: these stay exact.
    is_rounded = is_finite & (np.abs(size) < 280)
    factor = 10.0 ** (digits - 1 - np.floor(np.where(is_rounded, size, 0.0)))
    rounded = np.where(is_rounded, np.rint(exact * factor) / factor, exact)
    return [value if math.isfinite(value) else None for value in rounded.tolist()]


NO_STATE = 255
"""State of an agent whose controller has no states."""


def states_data(trace: Trace, keys: Sequence[int]) -> dict[str, Any] | None:
    """Return the states of agents; None for controllers without states.

    agents: their number; at: (scenes, agents), NO_STATE for agents without states.
    """
    if trace.states is None:
        return None
    states = trace.states[list(keys)]
    return {
        "agents": states.shape[1],
        "at": pack(np.where(states < 0, NO_STATE, states).reshape(-1), "u1"),
    }


def machine_data(trace: Trace, part: Part) -> Machine | None:
    """Return the state machine of an episode's agents; None for a team, or a controller without states.

    states: name and words of each; transitions: [from, to, words]; form: "tree" for a behaviour tree.
    """
    if trace.states is None or part.machines.groups is not None:
        return None
    return part.machines.common_machine(int(trace.states.max(initial=0)))


SCRIPTS = (
    "shapes.js", "series.js", "camera.js", "ground.js", "signals.js", "sprites.js", "world.js", "pictures.js",
    "curve.js", "legend.js", "machine.js", "tree.js", "inspector.js", "player.js", "remote.js",
)  # fmt: skip
"""Parts of the script, in order."""


def format_page(
    shows: Recording | Sequence[Part],
    *,
    caption: Caption,
    speed: float = 1.0,
    shown: Shown | None = None,
) -> str:
    """Return the page, a self-contained HTML document.

    shows: an episode, or several side by side. speed: initial factor relative to the simulation's step size.
    shown: optional parts that are shown initially.
    """
    parts = [Part(shows)] if isinstance(shows, Recording) else shows
    data, looks = page_data(parts, speed=speed, shown=shown or Shown())
    return _fill_template(data, caption, looks)


def pack_page(shows: Recording | Sequence[Part], *, caption: Caption) -> bytes:
    """Return an episode for a page of `format_player`. Arguments as of `format_page`."""
    parts = [Part(shows)] if isinstance(shows, Recording) else shows
    data, looks = page_data(parts, speed=1.0, shown=Shown())
    style = format_css(looks.custom_colors) if looks.custom_colors else ""
    return to_bytes({**data, **_caption_data(data, caption), "style": style})


def format_player() -> str:
    """Return the page without an episode; it shows the episode that the surrounding page sends."""
    return _fill_template({}, Caption(), Looks(()))


def format_picture_page(recording: "PictureRecording", *, caption: Caption, speed: float = 1.0) -> str:
    """Return the page of an episode of pictures."""
    return _fill_template(picture_data(recording, speed=speed), caption, Looks(()))


def pack_picture_page(recording: "PictureRecording", *, caption: Caption) -> bytes:
    """Return an episode of pictures for a page of `format_player`."""
    data = picture_data(recording, speed=1.0)
    return to_bytes({**data, **_caption_data(data, caption)})


def write_pictures(
    recording: "PictureRecording", path: Path, *, caption: Caption, speed: float = 1.0
) -> None:
    """Write the page of an episode of pictures. Raises OSError."""
    path.write_text(format_picture_page(recording, caption=caption, speed=speed), encoding="utf-8")


def _caption_data(data: dict[str, Any], caption: Caption) -> dict[str, Any]:
    """Return the title and the facts of a page."""
    title = caption.title or next((str(episode["message"]) for episode in data.get("episodes", ())), "")
    return {"title": title or "Episode", "facts": caption.facts}


def _fill_template(data: dict[str, Any], caption: Caption, looks: Looks) -> str:
    """Fill the template of the page with the data for its script."""
    title = _caption_data(data, caption)["title"]
    facts = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>"
        for name, value in caption.facts
    )
    parts = {
        "title": html.escape(title),
        "facts": facts,
        "style": f"{format_css(looks.custom_colors)}\n{_read_part('page.css')}",
        "script": _read_script(),
        # Texts of the simulation must not end the script element.
        "episode": to_json({**TABLES, **data}).replace("<", "\\u003c"),
    }
    # In one pass, so that placeholders in inserted parts are not replaced.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _read_part("page.html"))


@cache
def _read_script() -> str:
    return "\n".join(_read_part(name) for name in SCRIPTS)


@cache
def _read_part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
