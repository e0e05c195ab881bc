"""Requests that ask a server for too much: memory beyond measure, an episode without end."""

import json
import re
import time
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from swarmwright import Experiment
from swarmwright.common.random_numbers import Stream
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Serve
from tests.system.peer import PRESENCE, TOOLS, Peer

REPLY = f"{TOOLS}demanding"
MIB = 1 << 20


def request(number: int = 1, **changes: Any) -> bytes:
    representation = Experiment.from_mapping({"simulation": "minisim"}).representation()
    specification = representation.specification(representation.initial(Stream(1, "test", 0, 0)))
    weights = specification.pop("weights")
    message = {
        "kind": "evaluate",
        "version": 1,
        "request": number,
        "tool": "ada",
        "reply": REPLY,
        "simulation": "minisim",
        "parameters": {"maxSteps": 3},
        "controller": specification,
        "genomes": np.zeros((4, len(weights)), "<f4").tobytes(),
        "seeds": np.arange(2, dtype="<u8").tobytes(),
        "attempt": 1,
        "lease": 60.0,
    }
    for key, value in changes.items():
        message[key] = {**message[key], **value} if isinstance(value, dict) else value  # type: ignore[dict-item]
    packed: bytes = msgpack.packb(message)
    return packed


def ask(peer: Peer, payload: bytes) -> dict[str, Any]:
    peer.publish("swarmwright/v1/server/5", payload)
    while True:
        answer = peer.inbox.get(timeout=30)
        if answer.topic == REPLY:
            return answer.json


def peak(pid: int) -> int:
    """Most bytes of memory that a process has had."""
    found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    assert found
    return int(found[1]) << 10


@pytest.mark.parametrize("key", ["parameters", "controller"])
@pytest.mark.parametrize("item", [1, [1], {"": 1}], ids=["numbers", "lists", "maps"])
def test_values_of_a_request_take_a_limited_memory(
    key: str, item: object, embedded: BrokerProcess, serve: Serve
) -> None:
    """Of each kind there were gigabytes before: 60 bytes for each of the message, of maps 600."""
    pid = serve(embedded.url, first=5).pids[5]
    with Peer(embedded.url, REPLY) as peer:
        before = peak(pid)
        size = len(msgpack.packb(item))
        many: dict[str, Any] = {key: {"x": [item] * (12 * MIB // size)}}
        refused = ask(peer, request(**many))
        assert refused["error"]["kind"] == "invalid"
        assert "more values than a message may have" in refused["error"]["reason"]
        assert peak(pid) - before < 450 * MIB
        assert len(ask(peer, request(2))["fitness"]) == 8 * 8, "it goes on"


def test_the_number_of_steps_has_a_limit_that_the_server_states(
    embedded: BrokerProcess, serve: Serve
) -> None:
    serve(embedded.url, first=5)
    with Peer(embedded.url, REPLY) as peer:
        refused = ask(peer, request(parameters={"maxSteps": 4_000_000_000}))
        assert refused["error"]["reason"] == (
            "parameter maxSteps: 4000000000 found, expected a whole number from 1 to 10000000"
        )


def test_a_long_episode_that_nobody_waits_for_any_more_ends(embedded: BrokerProcess, serve: Serve) -> None:
    serve(embedded.url, first=5)
    endless = {"maxSteps": 10_000_000, "numAgents": 100, "numDefenders": 0, "speedAgents": 0}
    with Peer(embedded.url, REPLY, f"{PRESENCE}#") as peer:
        peer.publish("swarmwright/v1/server/5", request(parameters=endless))

        def until(state: str) -> None:
            while True:
                told = peer.inbox.get(timeout=10)
                if told.topic.startswith(PRESENCE) and told.json["state"] == state:
                    return

        until("busy")
        time.sleep(0.5)
        release = {"server": 5, "simulation_hash": "a" * 64, "run": False, "tool": "ada"}
        peer.publish("control", json.dumps(release))
        given_up = time.monotonic()
        assert len(ask(peer, request(2))["fitness"]) == 8 * 8
        assert time.monotonic() - given_up < 2.0
