"""The vectors of the extension messages: a separate reader and the schemas say what the vectors say."""

import base64
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from jsonschema import Draft202012Validator

from tests.protocol.conftest import BLOCKS, KINDS

Validators = Callable[[str], Draft202012Validator]
Json = dict[str, Any]
PROTOCOL = Path(__file__).parents[2] / "protocol"
VECTORS: list[Json] = json.loads((PROTOCOL / "vectors" / "extension.json").read_text(encoding="utf-8"))
ARRAYS = {
    "genomes": "<f4",
    "seeds": "<u8",
    "fitness": "<f8",
    "episodes": "<u4",
    "agents": "<u4",
    "sensors": "<f4",
    "ended": "<u4",
    "actuators": "<f4",
}
SCENE_ARRAYS = {
    "look": "<u4",
    **dict.fromkeys(("x", "y", "radius", "heading", "value"), "<f4"),
    "agent": "<u4",
    "body": "<u4",
    **dict.fromkeys(("angle", "start", "length", "reading"), "<f4"),
}
"""Of bodies and rays."""
SHAPES = ("", "circle", "cross", "triangle", "star", "square", "diamond", "pentagon", "hexagon")
# What is left out means this.
DEFAULTS: dict[str, Json] = {
    "evaluate": {"metrics": [], "instance": None},
    "start": {"metrics": [], "instance": None},
    "evaluated": {"fitness": b"", "metrics": {}, "failed": [], "error": None},
    "sensors": {"metrics": {}, "failed": [], "error": None},
    "failed": {"stack": None, "invalid": False},
    "scene": {
        **dict.fromkeys(("fitness", "seconds", "rays", "links", "floor", "scale")),
        "metrics": {},
        "grid": False,
        "message": "",
        **{key: [] for key in ("patches", "walls", "lights", "styles")},
    },
}


class RefusedError(Exception):
    """The payload is not a valid message."""


def plain(value: Any) -> Any:
    """The message as the schemas see it: base64 for binary, no NaN."""
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value


def demand(condition: object, reason: str) -> None:
    if not condition:
        raise RefusedError(reason)


def number_row(key: str, value: bytes, count: int) -> "np.ndarray[Any, Any]":
    """An array of a scene with so many entries."""
    row = array(key, value)
    demand(row.size == count or (key == "radius" and row.size == 1), f"{key}: another length")
    if key in ("x", "y", "radius", "angle", "start", "length"):
        demand(np.isfinite(row).all(), f"{key}: not finite")
    if key in ("heading", "value"):
        demand(not np.isinf(row).any(), f"{key}: infinite")
    return row


def check_scene(message: Json) -> None:
    """Arrays fit each other, and indices point at something."""
    bodies, rays = message["bodies"], message.get("rays")
    count = array("x", bodies["x"]).size
    rows = {key: number_row(key, bodies[key], count) for key in SCENE_ARRAYS if key in bodies}
    demand((rows.get("radius", np.zeros(1)) >= 0).all(), "radius: below 0")
    looks = len(bodies["looks"])
    demand((rows["look"] < looks).all() if "look" in rows else looks or not count, "look: no such look")
    demand(len(bodies.get("labels") or [""] * count) == count, "labels: another length")
    if rays is not None:
        body = array("body", rays["body"])
        demand((body < count).all(), "rays: no such body")
        for key in SCENE_ARRAYS:
            if key in rays:
                number_row(key, rays[key], body.size)
    links = array("links", message.get("links") or b"")
    demand(links.size % 2 == 0 and (links < count).all(), "links: no pairs of bodies")
    for style in message.get("styles", []):
        demand(re.fullmatch("(#[0-9A-Fa-f]{6})?", style.get("color", "")), "color: none")
        demand(style.get("shape", "") in SHAPES, "shape: unknown")


def array(key: str, value: bytes) -> "np.ndarray[Any, Any]":
    kind = np.dtype((ARRAYS | SCENE_ARRAYS | {"links": "<u4"}).get(key, "<f8"))
    demand(len(value) % kind.itemsize == 0, f"{key}: not a whole number of numbers")
    return np.frombuffer(value, kind)


def check(message: Json) -> None:
    """What no schema can say: shapes and finite numbers."""
    if message["kind"] == "scene":
        check_scene(message)
        return
    arrays = {key: array(key, value) for key, value in message.items() if key in ARRAYS}
    for key in ("genomes", "actuators", "sensors"):
        demand(np.isfinite(arrays.get(key, np.empty(0))).all(), f"{key}: not finite")
    if "seeds" in arrays:
        demand(arrays["seeds"].size, "seeds: none")
    demand(math.isfinite(message.get("lease", 0)), "lease: no number")
    demand(not (message.get("sample") and message["genomes"]), "genomes and a sample")
    if message["kind"] == "evaluated":
        bad = int((~np.isfinite(arrays["fitness"])).sum())
        demand(bad == len(message["failed"]), "failed does not say what has no fitness")
        for name, values in message["metrics"].items():
            demand(array(name, values).size == arrays["fitness"].size, f"{name}: another shape")
    if message["kind"] == "sensors":
        demand(np.isfinite(arrays["fitness"]).all(), "fitness: not finite")
        demand(arrays["fitness"].size == arrays["ended"].size, "fitness: another shape than ended")
        for name, values in message["metrics"].items():
            demand(array(name, values).size == arrays["ended"].size, f"{name}: another shape")
        demand(arrays["agents"].size == arrays["episodes"].size, "agents: another shape than episodes")


def unpack(payload: bytes) -> Json:
    try:
        message = msgpack.unpackb(payload, raw=False, strict_map_key=True)
    except (ValueError, msgpack.exceptions.UnpackException) as error:
        raise RefusedError(str(error)) from error
    demand(isinstance(message, dict), "no map")
    return dict(message)


def read(topic: str, payload: bytes, validators: Validators) -> Json:
    """The typed message, defaults filled in."""
    message = unpack(payload)
    name = KINDS.get(message.get("kind", ""), "")
    demand(BLOCKS.get(name) == topic, "another kind")
    validator = validators(name)
    demand(validator.is_valid(plain(message)), "does not fit its schema")
    # Base64 stands for binary in the schemas; text in its place is another thing.
    parts = [message] if message["kind"] != "scene" else [message["bodies"], message.get("rays") or {}]
    names = ARRAYS if message["kind"] != "scene" else SCENE_ARRAYS
    binary = [part[key] for part in parts for key in names if key in part]
    binary += [message["links"]] if "links" in message else []
    demand(all(isinstance(value, bytes) for value in binary), "text for binary")
    known = set(validator.schema["properties"])  # type: ignore[index]
    message = {**DEFAULTS.get(message["kind"], {}), **{k: v for k, v in message.items() if k in known}}
    if message["kind"] == "scene":
        bodies = dict.fromkeys(("look", "radius", "heading", "value", "agent"))
        filled = {**bodies, "labels": [], **message["bodies"]}
        check_scene(message if message["rays"] is not None else {**message, "rays": None})
        rays = message["rays"]
        return {**message, "bodies": filled, "rays": rays and {"reading": None, **rays}}
    if isinstance(message.get("failed"), list):
        message["failed"] = [{"stack": None, **failure} for failure in message["failed"]]
    check(message)
    return message


def bits(key: str, value: bytes) -> list[str]:
    size = np.dtype((ARRAYS | SCENE_ARRAYS | {"links": "<u4"}).get(key, "<f8")).itemsize
    return [value[start : start + size][::-1].hex() for start in range(0, len(value), size)]


def reading(message: Json) -> Json:
    """As the vectors write it: numbers of arrays by their bits."""
    read: Json = {
        key: bits(key, value) if isinstance(value, bytes) else value for key, value in message.items()
    }
    for part in ("bodies", "rays"):
        if isinstance(read.get(part), dict):
            read[part] = reading(read[part])
    if isinstance(read.get("metrics"), dict) and read["kind"] != "scene":
        read["metrics"] = {name: bits(name, values) for name, values in read["metrics"].items()}
    return read


@pytest.mark.parametrize("vector", VECTORS, ids=[vector["name"] for vector in VECTORS])
def test_vector_is_accepted_or_refused_and_read_as_it_says(vector: Json, validators: Validators) -> None:
    payload = base64.b64decode(vector["bytes"], validate=True)
    try:
        message = read(vector["topic"], payload, validators)
    except RefusedError:
        assert not vector["accept"]
        return
    assert vector["accept"]
    assert reading(message) == vector["reading"]


@pytest.mark.parametrize(
    "vector", [v for v in VECTORS if v.get("canonical")], ids=lambda vector: vector["name"]
)
def test_canonical_vector_is_what_msgpack_writes(vector: Json) -> None:
    payload = base64.b64decode(vector["bytes"])
    assert msgpack.packb(msgpack.unpackb(payload)) == payload


@pytest.mark.parametrize("vector", [v for v in VECTORS if v.get("schema")], ids=lambda vector: vector["name"])
def test_what_a_schema_cannot_say_is_said_by_the_reader(vector: Json, validators: Validators) -> None:
    message = unpack(base64.b64decode(vector["bytes"]))
    validators(KINDS[message["kind"]]).validate(plain(message))
    assert not vector["accept"]


def test_vectors_have_both_outcomes_of_every_kind() -> None:
    for accept in (True, False):
        found = set()
        for vector in VECTORS:
            if vector["accept"] is accept:
                try:
                    found.add(unpack(base64.b64decode(vector["bytes"])).get("kind"))
                except RefusedError:
                    assert not accept
        assert set(KINDS) <= found
