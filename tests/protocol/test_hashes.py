"""Canonical JSON and hashes, by an implementation of RFC 8785 other than the engine's."""

import hashlib
import json
from typing import Any

import rfc8785

Json = dict[str, Any]


def test_hash_is_that_of_the_canonical_json(hashed: Json) -> None:
    assert set(hashed["value"]) == {"simulation", "parameters", "instance"}
    canonical = rfc8785.dumps(hashed["value"])
    assert canonical.decode() == hashed["canonical"]
    assert hashlib.sha256(canonical).hexdigest() == hashed["sha256"]


def test_canonical_json_reads_back_the_same(hashed: Json) -> None:
    value = json.loads(json.dumps(hashed["value"]), parse_int=float)
    assert json.loads(hashed["canonical"], parse_int=float) == value
