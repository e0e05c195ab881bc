"""`servers --simulation`: servers without presence are found by a discovery."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.conftest import ROOT
from tests.python.cli.test_services import events

pytestmark = pytest.mark.slow

LEAST = ROOT / "tests" / "conformance" / "least.py"


@pytest.fixture
def silent(embedded_broker: str) -> Iterator[str]:
    """A broker with a server that implements D6.1 alone: id 7, title `least`."""
    server = subprocess.Popen([sys.executable, str(LEAST), embedded_broker, "7"])
    yield embedded_broker
    server.terminate()
    server.wait(10)


def listed(program: Any, broker: str, *options: str) -> list[dict[str, Any]]:
    done = program("servers", "--broker", broker, "--wait", "0.3", "--json", *options)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.journey
def test_a_server_without_presence_is_listed_when_it_answers(program: Any, start: Any, silent: str) -> None:
    serving = start("serve", "minisim", "--broker", silent, "--id", "40", "--json")
    events(serving, "ready")
    deadline = time.monotonic() + 15
    while len(found := listed(program, silent, "--simulation", "least")) < 2:
        assert time.monotonic() < deadline, "it never answered"
    assert [(one["server"], one["presence"], one["answers"]) for one in found] == [
        (7, False, True),
        (40, True, False),
    ]
    assert found[0]["simulations"] == ["least"]
    assert [one["server"] for one in listed(program, silent)] == [40]
    assert "answers" not in listed(program, silent)[0]
    text = program("servers", "--broker", silent, "--wait", "0.3", "--simulation", "minisim").stdout
    assert "ready, answers" in text
    assert "least" not in text
    text = program("servers", "--broker", silent, "--wait", "0.3", "--simulation", "least").stdout
    assert "answers, without presence" in text


def test_silence_is_explained(program: Any, start: Any, embedded_broker: str) -> None:
    where = ("servers", "--broker", embedded_broker, "--wait", "0.1")
    done = program(*where, "--simulation", "plane", "--dimensions", "3")
    assert done.returncode == 0
    assert "No server answered a discovery of 'plane' (dimensions: 3)." in done.stdout
    assert "another title or other dimensions" in done.stdout
    events(start("serve", "minisim", "--broker", embedded_broker, "--json"), "ready")
    done = program(*where, "--simulation", "minisim", "--dimensions", "3")
    assert "No server answered" in done.stdout, "minisim has two dimensions"
    assert "ready" in done.stdout
    assert "No server answered" not in program(*where, "--simulation", "minisim").stdout


def test_without_a_server_the_option_is_named(program: Any, embedded_broker: str) -> None:
    done = program("servers", "--broker", embedded_broker, "--wait", "0")
    assert f"swarmwright servers --broker {embedded_broker} --simulation TITLE" in done.stdout


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--dimensions", "2"), "--dimensions needs --simulation"),
        (("--simulation", "x", "--watch"), "and --simulation exclude each other"),
        (("--simulation", "x", "--forget-lost"), "and --simulation exclude each other"),
        (("--simulation", "x", "--broker", "mqtt://a:1,mqtt://b:1"), "names several brokers"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    program: Any, options: tuple[str, ...], words: str
) -> None:
    done = program("servers", *options)
    assert done.returncode == 2
    assert words in done.stderr
