"""The topic vectors: names are what AsyncAPI's addresses and the rules for prefixes make of them."""

import re
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

Json = dict[str, Any]
# The rules of docs/reference/protocol.md, as one expression.
PREFIX = re.compile(r"(?![/$])[^+#\0]*")


def fits(prefix: str) -> bool:
    return PREFIX.fullmatch(prefix) is not None and len(prefix.encode()) <= 1000


def test_names_are_the_addresses(topics: Json, protocol: Path) -> None:
    channels = YAML(typ="safe").load(protocol / "asyncapi.yaml")["channels"]
    for vector in topics["names"]:
        prefix = vector["prefix"].removesuffix("/")
        assert fits(prefix)
        values = {
            "prefix": prefix and f"{prefix}/",
            "server": vector.get("server"),
            "token": vector.get("token"),
        }
        assert channels[vector["message"]]["address"].format(**values) == vector["topic"]
    assert {vector["message"] for vector in topics["names"]} == set(channels)


def test_prefixes_are_refused(topics: Json) -> None:
    assert not [vector["prefix"] for vector in topics["refused_prefixes"] if fits(vector["prefix"])]


def test_foreign_topics_match_no_address(topics: Json, protocol: Path) -> None:
    channels = YAML(typ="safe").load(protocol / "asyncapi.yaml")["channels"]
    addresses = [
        channel["address"].replace("{server}", "[0-9]+").replace("{token}", "[A-Za-z0-9_-]+")
        for channel in channels.values()
    ]
    for vector in topics["foreign"]:
        prefix = vector["prefix"] and f"{vector['prefix']}/"
        expected = [address.replace("{prefix}", re.escape(prefix)) for address in addresses]
        assert not [pattern for pattern in expected if re.fullmatch(pattern, vector["topic"])], vector["why"]
