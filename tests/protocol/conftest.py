"""What the tests of the contract share: its schemas as validators, its vectors as JSON."""

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import pytest
from jsonschema import Draft202012Validator, FormatChecker
from ruamel.yaml import YAML

PROTOCOL = Path(__file__).parents[2] / "protocol"
TOPICS = ("discovery", "server", "parameters", "control", "sensor", "actuator", "fitness")

Validators = Callable[[str], Draft202012Validator]
Value: TypeAlias = Any  # JSON of whatever shape


def _kinds() -> dict[str, str]:
    schemas = {
        path.name.removesuffix(".schema.json"): json.loads(path.read_text(encoding="utf-8"))
        for path in sorted((PROTOCOL / "schemas").glob("*.schema.json"))
    }
    constants = {name: schema["properties"].get("kind", {}).get("const") for name, schema in schemas.items()}
    return {kind: name for name, kind in constants.items() if kind}


KINDS = _kinds()
"""Extension messages, which share topics: the name of the schema of each `kind`."""
_CHANNELS = YAML(typ="safe").load(PROTOCOL / "asyncapi.yaml")["channels"]
BLOCKS = {name: topic for topic in ("to_server", "to_tool") for name in _CHANNELS[topic]["messages"]}
"""The topic of each extension message, by the name of its schema, and of control messages to one server."""


@functools.cache
def _validator(name: str) -> Draft202012Validator:
    schema = json.loads((PROTOCOL / "schemas" / f"{name}.schema.json").read_text(encoding="utf-8"))
    return Draft202012Validator(schema, format_checker=FormatChecker(["date-time"]))


@pytest.fixture(scope="session")
def protocol() -> Path:
    """The folder of the contract."""
    return PROTOCOL


@pytest.fixture(scope="session")
def validators() -> Validators:
    """The validator of `discovery`, `published/discovery`, ... by name."""
    return _validator


def vectors(name: str) -> Value:
    """The JSON of a file under protocol/vectors."""
    return json.loads((PROTOCOL / "vectors" / name).read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def topics() -> Value:
    """The topic vectors."""
    return vectors("topics.json")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run once per topic, message vector, hash vector, conversation."""
    if "topic" in metafunc.fixturenames:
        metafunc.parametrize("topic", TOPICS)
    messages = vectors("messages.json")
    seed = [message for message in messages if message["accept"] and message["topic"] in TOPICS]
    for fixture, chosen in {
        "message": messages,
        "accepted": seed,
        "numbered": [message for message in messages if "binary32" in message],
        "hashed": vectors("hashes.json"),
    }.items():
        if fixture in metafunc.fixturenames:
            metafunc.parametrize(fixture, chosen, ids=[vector["name"] for vector in chosen])
    if "conversation" in metafunc.fixturenames:
        paths = sorted((PROTOCOL / "vectors" / "conversations").glob("*.json"))
        metafunc.parametrize(
            "conversation",
            [json.loads(path.read_text(encoding="utf-8")) for path in paths],
            ids=[path.stem for path in paths],
        )
