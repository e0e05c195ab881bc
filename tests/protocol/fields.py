"""Makes protocol/vectors/fields.json from the schemas: messages complete, without a field, with one mistyped.

    python -m tests.protocol.fields > protocol/vectors/fields.json

Programs that read messages with code written by hand replay the file, so a field that a schema gains, loses
or changes is noticed by each of them.
"""

import base64
import copy
import json
import struct
import sys
from collections.abc import Iterator
from typing import Any, TypeAlias

import msgpack

from tests.protocol.conftest import BLOCKS, KINDS, PROTOCOL
from tests.protocol.test_extension import DEFAULTS, RefusedError, check, plain

Path: TypeAlias = tuple[str | int, ...]
Json: TypeAlias = dict[str, Any]

ANNOUNCED: Json = {
    "version": 1,
    "modes": ["stepwise", "offloaded"],
    "controllers": ["layered"],
    "modules": [{"role": "behaviour", "name": "Spiral", "file": "spiral.py", "sha256": "5f"}],
    "distributions": ["normal"],
    "sensors": 4,
    "actuators": 1,
    "metrics": ["steps"],
    "sides": [{"name": "prey", "groups": ["sheep"], "fitness": "steps"}],
    "determinism": "statistical",
    "tolerance": 0.5,
    "scenes": True,
    "control": True,
    "batch": 8,
    "lanes": 16,
    "instance": "a1",
    "host": "lab",
    "pid": 4711,
}
CAPABILITIES: Json = {"dimensions": 2, "max_agents": 10, "swarmwright": ANNOUNCED}
RUN: Json = {"simulation_hash": "h", "simulation": "minisim"}
REQUEST: Json = {
    "version": 1,
    "request": 7,
    "tool": "ada",
    "reply": "swarmwright/v1/tool/t1",
    "simulation": "minisim",
    "parameters": {"maxSteps": 5},
}
ANSWER: Json = {"version": 1, "request": 7, "server": 3}
SEEDS = struct.pack("<2Q", 1, 2)
FAILURE: Json = {"candidate": 0, "episode": 1, "reason": "the wheel came off", "stack": "wheel.py:3"}
ROW = struct.pack("<2d", 0.5, 1)
SAMPLE: Json = {
    "distribution": "normal",
    "seed": 1,
    "purpose": "openai_es.direction",
    "generation": 3,
    "first": 10,
    "count": 20,
    "mirrored": True,
    **dict.fromkeys(("center", "deviation", "middle", "reach", "lower", "upper"), ROW),
}
NUMBERS = struct.pack("<2f", 0.5, 1)
ERROR: Json = {"kind": "invalid", "reason": "no such metric"}

MESSAGES: dict[str, Json] = {
    "discovery": {**RUN, "requirements": {"dimensions": 2, "max_agents": 10}, "tool": "ada"},
    "server": {"server": 3, "simulation_hash": "h", "simulations": ["minisim"], "capabilities": CAPABILITIES},
    "parameters": {"server": 3, "simulation_hash": "h", "maxSteps": 5},
    "control": {
        "server": 3,
        **RUN,
        "run": False,
        "visual": True,
        "tool": "ada",
        "reply": "swarmwright/v1/tool/t1",
        "instance": "a1",
        "scenes": ["rays", "links"],
    },
    "sensor": {**RUN, "agent": 0, "sensor": [0.5, -0.25]},
    "actuator": {**RUN, "agent": 0, "actuator": [0.5]},
    "fitness": {**RUN, "fitness": -1.5, "metrics": {"steps": 5}},
    "presence": {
        "version": 1,
        "server": 3,
        "state": "busy",
        "simulations": ["minisim"],
        "capabilities": CAPABILITIES,
        "tool": "ada",
        "since": "2026-01-31T12:00:00Z",
        "host": "lab",
        "pid": 4711,
        "instance": "a1",
    },
    "status": {
        "version": 1,
        "tool": "ada",
        "state": "evaluating",
        "simulation": "minisim",
        "run": "2026-01-31",
        "generation": 3,
        "generations": 10,
        "done": 5,
        "total": 100,
        "waiting_for": [
            {
                "server": 3,
                "kind": "episode",
                "missing": "sensors",
                "evaluations": 1,
                "agent": 0,
                "step": 4,
                "silent": 2.5,
            }
        ],
        "servers": [
            {"server": 3, "mode": "stepwise", "speed": 8.5, "failures": 2, "reason": "slow", "benched": 1.5}
        ],
        "no_server": {"seconds": 2.5, "found": "no server"},
    },
    "evaluate": {
        "kind": "evaluate",
        **REQUEST,
        "controller": {"kind": "layered", "version": 1},
        "genomes": b"",
        "seeds": SEEDS,
        "metrics": ["steps"],
        "attempt": 1,
        "lease": 60.5,
        "instance": "a1",
        "sample": SAMPLE,
    },
    "batch_start": {"kind": "start", **REQUEST, "seeds": SEEDS, "metrics": ["steps"], "instance": "a1"},
    "batch_actuators": {
        "kind": "actuators",
        "version": 1,
        "request": 7,
        "step": 4,
        "actuators": struct.pack("<2f", 0.5, -1),
    },
    "evaluated": {
        "kind": "evaluated",
        **ANSWER,
        "fitness": struct.pack("<2d", 1.5, float("nan")),
        "metrics": {"steps": struct.pack("<2d", 5, float("nan"))},
        "failed": [FAILURE],
        "error": ERROR,
        "seconds": 0.25,
    },
    "batch_sensors": {
        "kind": "sensors",
        **ANSWER,
        "step": 4,
        "episodes": struct.pack("<I", 0),
        "agents": struct.pack("<I", 0),
        "sensors": struct.pack("<2f", 0.5, -1),
        "ended": struct.pack("<I", 1),
        "fitness": struct.pack("<d", 1.5),
        "metrics": {"steps": struct.pack("<d", 5)},
        "failed": [FAILURE],
        "error": ERROR,
    },
    "failed": {
        "kind": "failed",
        "version": 1,
        "server": 3,
        "simulation_hash": "h",
        "reason": "the wheel came off",
        "stack": "wheel.py:3",
        "invalid": True,
    },
    "scene": {
        "kind": "scene",
        "version": 1,
        "server": 3,
        "simulation_hash": "h",
        "step": 4,
        "fitness": -1.5,
        "metrics": {"steps": 4.0},
        "seconds": 0.25,
        "width": 4.5,
        "height": 3.0,
        "origin": [-1.5, 0.5],
        "grid": True,
        "message": "Hello there",
        "bodies": {
            "looks": [["agent", "free"], ["goal", ""]],
            "look": struct.pack("<2I", 0, 1),
            "x": NUMBERS,
            "y": NUMBERS,
            "radius": NUMBERS,
            "heading": struct.pack("<2f", 1.5, float("nan")),
            "value": struct.pack("<2f", float("nan"), -2),
            "agent": struct.pack("<2I", 0, 2**32 - 1),
            "labels": ["leader", ""],
        },
        "rays": {
            "body": struct.pack("<2I", 0, 0),
            **dict.fromkeys(("angle", "start", "length"), NUMBERS),
            "reading": struct.pack("<2f", 0.5, float("nan")),
        },
        "links": struct.pack("<2I", 0, 1),
        "floor": {"grey": 0.5, "points": [[0.5, 0.0]], "radius": 2.0, "name": "floor"},
        "patches": [{"grey": 1.0, "points": [[0.5, 0.0], [1.0, 0.0]], "radius": 0.0, "name": "nest"}],
        "walls": [{"points": [[0.5, 0.0], [1.0, 0.0]], "solid": True}],
        "lights": [{"x": 0.5, "y": 1.0, "intensity": 0.5}],
        "styles": [{"kind": "agent", "state": "free", "color": "#0072b2", "shape": "star"}],
        "scale": {"name": "charge", "low": 0.0, "high": 1.5},
    },
}
"""Each message with every field of its schema."""

LENIENT: set[tuple[str, Path]] = {
    ("discovery", ("tool",)),
    ("control", ("tool",)),
    ("control", ("reply",)),
    ("control", ("instance",)),
    ("control", ("scenes",)),
    ("control", ("scenes", 0)),
    ("fitness", ("metrics",)),
}
"""Fields of extensions in messages of D6.1: another peer may use the names for something else, so readers
ignore other types, as they do in `capabilities.swarmwright`."""


def schema(message: str) -> Json:
    """The schema of a message."""
    path = PROTOCOL / "schemas" / f"{message}.schema.json"
    return dict(json.loads(path.read_text(encoding="utf-8")))


def fields(part: Json, path: Path = ()) -> Iterator[tuple[Path, bool]]:
    """Every field that a schema defines, and the first item of lists, and whether it is required."""
    for name, inner in part.get("properties", {}).items():
        yield (*path, name), name in part.get("required", [])
        yield from fields(inner, (*path, name))
    if "items" in part:
        yield (*path, 0), False
        yield from fields(part["items"], (*path, 0))


def at(value: Any, path: Path) -> Any:
    """The value at a path. Raises LookupError if there is none."""
    for key in path:
        value = value[key]
    return value


def mistyped(value: Any) -> Any:
    """A value of another type than JSON and MessagePack give this one."""
    return 7 if isinstance(value, str | bytes | list | dict) else "seven"


def is_lenient(message: str, path: Path) -> bool:
    """Whether readers ignore the field if its type is wrong, or, of an announcement, if it is missing."""
    return (message, path) in LENIENT or (
        path[:2] == ("capabilities", "swarmwright") and message in ("server", "presence")
    )


def packed(message: str, value: Json) -> bytes:
    """MessagePack; the numbers of a scene's world are binary32, as in its arrays."""
    if message != "scene":
        return bytes(msgpack.packb(value))
    double, single = msgpack.Packer(), msgpack.Packer(use_single_float=True)
    parts = [double.pack_map_header(len(value))]
    for key, item in value.items():
        packer = double if key in ("fitness", "metrics", "seconds") else single
        parts += [double.pack(key), packer.pack(item)]
    return b"".join(parts)


def encoded(message: str, value: Json) -> Json:
    """The payload as the vectors have it."""
    if message in KINDS.values():
        return {"bytes": base64.b64encode(packed(message, value)).decode()}
    return {"text": json.dumps(value)}


def is_consistent(message: str, value: Json) -> bool:
    """Whether arrays have the shapes and numbers that the others demand, which a schema cannot express."""
    if message not in KINDS.values():
        return True
    try:
        check({**DEFAULTS.get(value["kind"], {}), **value})
    except RefusedError:
        return False
    return True


def variants(message: str) -> Iterator[Json]:
    """The vectors of a message."""

    def vector(name: str, accept: bool, value: Json) -> Json:
        topic = BLOCKS[message] if message in KINDS.values() else message
        return {"name": f"{message}: {name}", "topic": topic, "accept": accept, **encoded(message, value)}

    complete = MESSAGES[message]
    yield {**vector("all fields", True, complete), "written": True}
    for path, required in fields(schema(message)):
        name = ".".join(map(str, path))
        without = copy.deepcopy(complete)
        del at(without, path[:-1])[path[-1]]
        is_item = isinstance(path[-1], int)
        if not is_item and (required or is_consistent(message, without)):
            yield vector(f"{name} is missing", not required or is_lenient(message, path), without)
        other = copy.deepcopy(complete)
        at(other, path[:-1])[path[-1]] = mistyped(at(complete, path))
        yield vector(f"{name} has another type", is_lenient(message, path), other)


def vectors() -> list[Json]:
    """The content of the file."""
    return [vector for message in MESSAGES for vector in variants(message)]


def decoded(message: str) -> Json:
    """A complete message in the form that its schema describes."""
    return dict(plain(MESSAGES[message]))


def text() -> str:
    """The file."""
    lines = ",\n".join("  " + json.dumps(vector) for vector in vectors())
    return f"[\n{lines}\n]\n"


if __name__ == "__main__":
    sys.stdout.write(text())
