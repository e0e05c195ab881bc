"""Addresses of brokers."""

import pytest

from swarmwright.common.errors import InputError
from swarmwright.experiment.broker_address import broker_problem, environment_prefix


@pytest.mark.parametrize(
    "url",
    [
        "mqtt://host",
        "mqtts://host:8883?mqtt=3",
        "ws://host/mqtt?mqtt=5",
        "wss://host/mqtt?token=x&mqtt=3",
        "unix:///run/a broker.sock?mqtt=3,mqtt://host",
    ],
)
def test_addresses_that_can_be_used(url: str) -> None:
    assert broker_problem(url) is None


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("mqtt://host?mqtt=4", ("?mqtt=3", "?mqtt=5")),
        ("ws://host/mqtt?mqtt=", ("?mqtt=3", "?mqtt=5")),
        ("mqtt://host?clean=1", ("?mqtt=3", "?mqtt=5")),
        ("http://host", ("mqtt://",)),
        ("mqtt://host:0", ("65535",)),
        ("unix://broker.sock", ("absolute", "unix:///run/mosquitto.sock")),
        ("unix:///run/broker.sock?clean=1", ("?mqtt=3", "?mqtt=5")),
        (f"mqtt://host,unix:///{'x' * 107}", ("(address 2 of 2)", "108 bytes")),
    ],
)
def test_what_is_wrong_comes_with_what_is_right(url: str, words: tuple[str, ...]) -> None:
    problem = broker_problem(url)
    assert problem is not None
    assert all(word in problem for word in words)


def test_a_prefix_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SWARMWRIGHT_PREFIX", raising=False)
    assert environment_prefix() == ""
    monkeypatch.setenv("SWARMWRIGHT_PREFIX", "lab/1")
    assert environment_prefix() == "lab/1"
    monkeypatch.setenv("SWARMWRIGHT_PREFIX", "lab/#")
    with pytest.raises(InputError, match=r"SWARMWRIGHT_PREFIX \(environment\): 'lab/#' must not contain"):
        environment_prefix()
