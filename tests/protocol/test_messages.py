"""The message vectors: a small separate reader and the schemas must say what the vectors say."""

import base64
import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jsonschema import Draft202012Validator

Validators = Callable[[str], Draft202012Validator]
Value: TypeAlias = Any  # JSON of whatever shape
Json = dict[str, Any]

DEEPEST = 127
ANNOUNCEMENT = (
    "version",
    "modes",
    "controllers",
    "batch",
    "sensors",
    "actuators",
    "metrics",
    "sides",
    "instance",
    "host",
    "pid",
)
PRESENCE = ("server", "state", "simulations", "capabilities", "tool", "since")


class RefusedError(Exception):
    """The payload is not a valid message."""


def payload(message: Json, protocol: Path) -> bytes:
    """What goes over the wire."""
    if "file" in message:
        return (protocol / "vectors" / str(message["file"])).read_bytes()
    if "bytes" in message:
        return base64.b64decode(message["bytes"], validate=True)
    return str(message["text"]).encode()


def depth(text: str) -> int:
    """How deep lists and objects lie in one another, without recursion."""
    deepest = level = 0
    quoted = escaped = False
    for character in text:
        if quoted:
            quoted = escaped or character != '"'
            escaped = character == "\\" and not escaped
        elif character == '"':
            quoted = True
        else:
            level += (character in "[{") - (character in "]}")
            deepest = max(deepest, level)
    return deepest


def finite(text: str) -> float:
    """A number within binary64."""
    value = float(text)
    if not np.isfinite(value):
        raise RefusedError(text)
    return value


def parse(raw: bytes, real: Callable[[str], Any] = finite) -> Value:
    """Strict JSON: UTF-8, no NaN or 1e999, no lone surrogates, bounded depth; the last of repeated keys."""

    def constant(name: str) -> None:
        raise RefusedError(name)

    try:
        text = raw.decode()
        if depth(text) > DEEPEST:
            raise RefusedError("too deep")
        value = json.loads(text, parse_constant=constant, parse_float=real)
        json.dumps(value, ensure_ascii=False, default=str).encode()
    except ValueError as error:
        raise RefusedError(str(error)) from error
    return value


def lenient(value: Json) -> Json:
    """The message without another peer's own use of the extensions' keys."""
    value = dict(value)
    for key in ("tool", "reply", "instance"):
        if not isinstance(value.get(key, ""), str):
            del value[key]
    capabilities = value.get("capabilities")
    if isinstance(capabilities, dict) and not isinstance(capabilities.get("swarmwright", {}), dict):
        value["capabilities"] = {key: item for key, item in capabilities.items() if key != "swarmwright"}
    elif isinstance(capabilities, dict) and "swarmwright" in capabilities:
        announced = capabilities["swarmwright"]
        if not isinstance(announced.get("metrics", []), list):
            announced = {key: item for key, item in announced.items() if key != "metrics"}
            value["capabilities"] = {**capabilities, "swarmwright": announced}
        if "sides" in announced and not are_sides(announced["sides"]):
            announced = {key: item for key, item in announced.items() if key != "sides"}
            value["capabilities"] = {**capabilities, "swarmwright": announced}
    if "metrics" in value:
        value["metrics"] = measured(value["metrics"])
    return value


def are_sides(value: Value) -> bool:
    """Whether these are sides of a match: of other names and other groups."""

    def is_name(name: Value) -> bool:
        return isinstance(name, str) and 1 <= len(name) <= 100

    if not isinstance(value, list) or len(value) > 256:
        return False
    names: list[str] = []
    groups: list[str] = []
    for side in value:
        own = side.get("groups") if isinstance(side, dict) else None
        if not isinstance(own, list) or not 1 <= len(own) <= 256:
            return False
        if not all(is_name(name) for name in [side.get("name"), side.get("fitness", "x"), *own]):
            return False
        names.append(side["name"])
        groups += own
    return len(set(names)) == len(names) and len(set(groups)) == len(groups)


def measured(value: Value) -> Json:
    """What are metrics in the extension's key of a fitness message."""
    if not isinstance(value, dict):
        return {}
    return {
        name: number
        for name, number in value.items()
        if isinstance(number, int | float) and not isinstance(number, bool)
    }


def offer(value: Json) -> Json:
    """Requirements or capabilities."""
    return {
        "dimensions": value["dimensions"],
        "max_agents": value.get("max_agents", value.get("max agents")),
    }


def capabilities(value: Json) -> Json:
    """Capabilities with the extension."""
    extension = value.get("swarmwright")
    known = None if extension is None else {key: extension.get(key) for key in ANNOUNCEMENT}
    if known and known["sides"]:
        known["sides"] = [
            {key: side.get(key) for key in ("name", "groups", "fitness")} for side in known["sides"]
        ]
    return {**offer(value), "swarmwright": known}


def reading(kind: str, value: Json) -> Json:
    """The typed reading of a message that fits its schema."""
    if kind == "parameters":
        address = {key: value[key] for key in ("server", "simulation_hash")}
        return {**address, "parameters": {key: item for key, item in value.items() if key not in address}}
    if kind == "presence":
        return {key: value.get(key) for key in PRESENCE} | {
            "capabilities": capabilities(value["capabilities"])
        }
    read = {"simulation": value.get("simulation"), "simulation_hash": value["simulation_hash"]}
    match kind:
        case "discovery":
            return {**read, "requirements": offer(value["requirements"]), "tool": value.get("tool")}
        case "server":
            del read["simulation"]
            offered = {"capabilities": capabilities(value["capabilities"])}
            return {**read, "server": value["server"], "simulations": value["simulations"], **offered}
        case "control":
            flags = {"run": value.get("run", True), "visual": value.get("visual", False)}
            extensions = {key: value.get(key) for key in ("tool", "reply", "instance")}
            return {**read, "server": value["server"], **flags, **extensions}
        case "fitness":
            return {**read, "fitness": value["fitness"], "metrics": value.get("metrics") or None}
    return {**read, "agent": value["agent"], kind: value[kind]}


def exact(value: Value) -> Value:
    """Booleans kept apart from numbers, which Python takes for equal."""
    if isinstance(value, dict):
        return {key: exact(item) for key, item in value.items()}
    if isinstance(value, list):
        return [exact(item) for item in value]
    return ("boolean", value) if isinstance(value, bool) else value


def binary32(decimal: Fraction) -> np.float32:
    """The nearest binary32, ties to even."""
    guess = np.float32(float(decimal))
    with np.errstate(over="ignore", under="ignore"):
        near = [guess, *(np.nextafter(guess, np.float32(end)) for end in (-np.inf, np.inf))]
    finite = [value for value in near if np.isfinite(value)]
    return min(finite, key=lambda x: (abs(Fraction(float(x)) - decimal), int(x.view(np.uint32)) & 1))


def test_vector_is_accepted_or_refused_and_read_as_it_says(
    message: Json, protocol: Path, validators: Validators
) -> None:
    kind = message["topic"]
    raw = payload(message, protocol)
    try:
        value = parse(raw)
        if isinstance(value, dict):
            if message.get("schema") is False:
                assert not validators(kind).is_valid(value)
            value = lenient(value)
        if not validators(kind).is_valid(value):
            raise RefusedError("does not fit the schema")
    except RefusedError:
        assert not message["accept"]
        return
    assert message["accept"]
    assert exact(reading(kind, value)) == exact(message["reading"])


def test_numbers_become_the_nearest_binary32(numbered: Json, protocol: Path) -> None:
    values = parse(payload(numbered, protocol), real=lambda text: (Fraction(text), text))["sensor"]
    numbers = [value if isinstance(value, tuple) else (Fraction(value), str(value)) for value in values]
    bits = [int(binary32(exact_value).view(np.uint32)) for exact_value, _ in numbers]
    signs = [0x8000_0000 if text.startswith("-") else 0 for _, text in numbers]
    assert [f"{bit | sign:08x}" for bit, sign in zip(bits, signs, strict=True)] == numbered["binary32"]


def test_with_its_title_an_accepted_message_fits_the_printed_schema(
    accepted: Json, protocol: Path, validators: Validators
) -> None:
    value = parse(payload(accepted, protocol))
    value.setdefault("simulation", "minisim")
    validators(f"published/{accepted['topic']}").validate(value)


def test_examples_are_the_printed_bytes(protocol: Path) -> None:
    parameters = (protocol / "vectors" / "messages" / "parameters.d61.json").read_text(encoding="utf-8")
    assert parameters.count('"speedAgents": 1,') == 2
    assert parameters.count('"defenders": [[8, 3.5]],') == 2
