"""The vectors of the status message: a separate reader and the schema say what the vectors say."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

Validators = Callable[[str], Draft202012Validator]
Json = dict[str, Any]
VECTORS: list[Json] = json.loads(
    (Path(__file__).parents[2] / "protocol" / "vectors" / "status.json").read_text(encoding="utf-8")
)
# What people are told, docs/reference/protocol.md.
WORDS = {
    ("episode", "start"): "begun its episode",
    ("episode", "sensors"): "answered the actuators of agent {agent} in step {step}",
    ("episode", "result"): "sent the fitness of its episode",
    ("batch", "start"): "begun its batch of {evaluations} episodes",
    ("batch", "sensors"): "answered the actuators of {evaluations} episodes in step {step}",
    ("batch", "result"): "sent the fitness of its batch of {evaluations} episodes",
    ("block", "result"): "answered a block of {evaluations} evaluations",
}
KEYS = ("tool", "state", "simulation", "run", "generation", "generations", "done", "total", "no_server")
WAITING = ("server", "kind", "missing", "evaluations", "agent", "step", "silent")
USED = ("server", "mode", "speed", "failures", "reason", "benched")


def waiting(entry: Json) -> Json:
    known = {key: entry.get(key) for key in WAITING}
    missing = WORDS[entry["kind"], entry["missing"]].format(**known)
    return {
        **known,
        "words": f"server {entry['server']} has not {missing} for {entry['silent']:.1f} s",
    }


def reading(value: Json) -> Json:
    return {
        **{key: value.get(key) for key in KEYS},
        "waiting_for": [waiting(entry) for entry in value["waiting_for"]],
        "servers": [{key: used.get(key) for key in USED} for used in value["servers"]],
    }


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["name"])
def test_vector_is_accepted_or_refused_and_read_as_it_says(vector: Json, validators: Validators) -> None:
    try:
        value = json.loads(vector["text"])
    except ValueError:
        assert not vector["accept"]
        return
    assert validators("status").is_valid(value) == vector["accept"]
    if vector["accept"]:
        assert reading(value) == vector["reading"]


def test_vectors_have_every_state_and_every_piece() -> None:
    read = [vector["reading"] for vector in VECTORS if vector["accept"]]
    pieces = {(entry["kind"], entry["missing"]) for one in read for entry in one["waiting_for"]}
    assert pieces == set(WORDS)
    assert {one["state"] for one in read} == {"looking", "evaluating", "left"}
