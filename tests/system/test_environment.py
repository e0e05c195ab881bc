"""Servers in C++ and Java take broker and topic prefix from the environment where no argument names them."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import environment
from tests.cpp import build
from tests.java import jar
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Launch, ServeCpp, ServeJava

pytestmark = pytest.mark.timeout(600)  # the first of them builds the wrappers

Start = Callable[..., Any]
WRONG = {"SWARMWRIGHT_PREFIX": "a/#"}


@pytest.fixture(params=["minisim", "minisim_plugin", "java", "java --plain"])
def start(request: pytest.FixtureRequest, serve_cpp: ServeCpp, serve_java: ServeJava) -> Start:
    """Starts a server of each kind: `start(*arguments, server=N, env=VARIABLES)`."""
    kind = request.param
    if not kind.startswith("java"):
        return lambda *options, **more: serve_cpp(None, *options, main=kind, **more)
    plain = kind.split()[1:]
    return lambda *options, **more: serve_java(None, *plain, *options, **more)


def test_broker_and_prefix_of_the_environment_are_used_where_no_argument_names_them(
    embedded: BrokerProcess, start: Start, launch: Launch
) -> None:
    lab = {"SWARMWRIGHT_BROKER": embedded.url, "SWARMWRIGHT_PREFIX": "lab1"}
    start(server=5, env=lab)
    start("--prefix", "lab2", server=6, env=lab)
    start("--prefix", "", server=7, env=lab)
    for prefix, server in (("lab1", 5), ("lab2", 6), ("", 7)):
        where = ("--broker", embedded.url, "--prefix", prefix)
        # Servers of D6.1 alone answer to a discovery, and announce nothing.
        listing = launch("servers", *where, "--simulation", "minisim", "--json")
        assert listing.wait() == 0, listing.stderr
        assert [json.loads(line)["server"] for line in listing.lines] == [server], prefix


def test_a_prefix_of_the_environment_that_cannot_be_is_refused(tmp_path: Path) -> None:
    for command in ([str(build() / "minisim")], ["java", "-jar", str(jar())]):
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=30,
            cwd=tmp_path,
            env=environment(WRONG),
            check=False,
        )
        assert done.returncode == 2, done.stderr
        assert 'topic prefix "a/#"' in done.stderr
