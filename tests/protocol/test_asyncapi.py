"""The AsyncAPI document: its files are there, both roles are whole, its examples fit.

AsyncAPI's own parser runs in `make lint`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import pytest
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

from tests.protocol.conftest import KINDS

Validators = Callable[[str], Draft202012Validator]
Value: TypeAlias = Any  # JSON of whatever shape
TOOL = {"discovery", "parameters", "control", "actuator", "status"}
SERVER = {"server", "sensor", "fitness", "presence"}
BLOCKS = set(KINDS.values())


@pytest.fixture(scope="module")
def document(protocol: Path) -> Value:
    """The document as plain data."""
    return YAML(typ="safe").load(protocol / "asyncapi.yaml")


def test_each_message_refers_to_its_schema(document: Value, protocol: Path) -> None:
    messages = document["components"]["messages"]
    assert set(messages) == TOOL | SERVER | BLOCKS | {"farewell"}
    for name in TOOL | SERVER | BLOCKS:
        assert messages[name]["contentType"] == f"application/{'msgpack' if name in BLOCKS else 'json'}"
        assert messages[name]["payload"]["$ref"] == f"./schemas/{name}.schema.json"
        assert (protocol / messages[name]["payload"]["$ref"]).is_file()


def test_examples_fit_their_schemas(document: Value, validators: Validators) -> None:
    for name in TOOL | SERVER | BLOCKS:
        examples = document["components"]["messages"][name]["examples"]
        assert examples
        for example in examples:
            validators(name).validate(example["payload"])


def test_addresses_are_the_topics(document: Value) -> None:
    addresses = {name: channel["address"] for name, channel in document["channels"].items()}
    expected = {name: f"{{prefix}}{name}" for name in (TOOL | SERVER) - {"presence", "status"}}
    assert addresses == {
        **expected,
        "presence": "{prefix}swarmwright/v1/presence/{server}",
        "to_server": "{prefix}swarmwright/v1/server/{server}",
        "to_tool": "{prefix}swarmwright/v1/tool/{token}",
        "status": "{prefix}swarmwright/v1/status/{token}",
    }
    assert document["components"]["parameters"]["prefix"]["default"] == ""


def test_each_topic_of_blocks_has_its_messages(document: Value) -> None:
    to_server, to_tool = (set(document["channels"][topic]["messages"]) for topic in ("to_server", "to_tool"))
    assert to_server | to_tool == BLOCKS | {"control"}
    assert not to_server & to_tool
    assert {"control", "evaluate"} <= to_server
    assert "evaluated" in to_tool


@pytest.mark.parametrize(
    ("role", "sends", "receives"),
    [
        ("optimization tool", TOOL | {"to_server"}, SERVER | {"to_tool"}),
        ("simulation server", SERVER | {"to_tool"}, TOOL - {"status"} | {"to_server"}),
        ("watcher", set(), {"status"}),
    ],
)
def test_what_one_role_sends_the_other_receives(
    document: Value, role: str, sends: set[str], receives: set[str]
) -> None:
    channels: dict[str, set[str]] = {"send": set(), "receive": set()}
    for operation in document["operations"].values():
        if [tag["name"] for tag in operation["tags"]] == [role]:
            channels[operation["action"]].add(operation["channel"]["$ref"].removeprefix("#/channels/"))
    assert channels == {"send": sends, "receive": receives}


def test_presence_alone_is_retained(document: Value) -> None:
    bindings = document["components"]["operationBindings"]
    assert {name: (b["mqtt"]["qos"], b["mqtt"]["retain"]) for name, b in bindings.items()} == {
        "conversation": (0, False),
        "presence": (1, True),
    }
    for operation in document["operations"].values():
        kind = "presence" if operation["channel"]["$ref"].endswith("/presence") else "conversation"
        assert operation["bindings"]["$ref"].endswith(f"/{kind}")
