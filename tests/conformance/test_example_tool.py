"""The example tool works with servers that know nothing of Swarmwright."""

import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.conftest import ROOT
from tests.examples import commands

EXAMPLES = ROOT / "wrappers" / "examples" / "python"


@contextmanager
def running(command: str, broker: str) -> Iterator[None]:
    """A server, until the block ends."""
    words = [word.format(broker=broker, id=2**40) for word in shlex.split(command)]
    server = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        server.terminate()
        server.wait(10)


def evolved(broker: str) -> str:
    """What the tool prints."""
    words = [sys.executable, str(EXAMPLES / "evolve.py"), broker, "line", "1", "1", "1"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.timeout(400)  # it may fetch and build them
def test_servers_from_d61_alone_give_the_same_fitness(embedded_broker: str) -> None:
    found = []
    for command in commands().values():
        with running(command, embedded_broker):
            found.append(evolved(embedded_broker))
    assert found[0] == found[1]
    assert len(found[0].splitlines()) > 1, "it finds better candidates"


def test_the_server_of_the_other_page_is_used(embedded_broker: str) -> None:
    with running(f"{sys.executable} {EXAMPLES / 'line_server.py'} {{broker}} {{id}}", embedded_broker):
        assert len(evolved(embedded_broker).splitlines()) > 1
