"""Whole systems: real processes, both brokers, peers of another make."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.cpp import CppServer
from tests.java import JavaServer
from tests.system.brokers import KINDS, BrokerProcess, Kind
from tests.system.peer import Peer
from tests.system.processes import Program, Servers
from tests.system.runs import record

Serve = Callable[..., Servers]
ServeJava = Callable[..., JavaServer]
ServeCpp = Callable[..., CppServer]
Launch = Callable[..., Program]
Experiment = Callable[..., Path]


@pytest.fixture
def cleanup() -> Iterator[ExitStack]:
    """What a test started, ended in reverse order."""
    with ExitStack() as stack:
        yield stack


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> Kind:
    """Each kind of broker."""
    chosen: Kind = request.param
    return chosen


@pytest.fixture
def broker(kind: Kind, tmp_path: Path, cleanup: ExitStack) -> BrokerProcess:
    """A broker of each kind, started."""
    process = BrokerProcess(kind, tmp_path / "broker")
    cleanup.callback(process.stop)
    return process.start()


@pytest.fixture
def embedded(tmp_path: Path, cleanup: ExitStack) -> BrokerProcess:
    """The embedded broker, for what does not depend on the broker."""
    process = BrokerProcess("embedded", tmp_path / "broker")
    cleanup.callback(process.stop)
    return process.start()


@pytest.fixture
def serve(tmp_path: Path, cleanup: ExitStack) -> Serve:
    """Starts `swarmwright serve minisim`."""

    def start(url: str, *options: str, first: int = 1, count: int = 1) -> Servers:
        servers = Servers(url, *options, cwd=tmp_path, first=first, count=count)
        cleanup.callback(servers.stop)
        return servers

    return start


@pytest.fixture
def serve_java(tmp_path: Path, cleanup: ExitStack) -> ServeJava:
    """Starts the example server of the Java wrapper."""

    def start(url: str | None, *options: str, **more: Any) -> JavaServer:
        server = JavaServer(url, *options, cwd=tmp_path, **more)
        cleanup.callback(server.stop)
        return server

    return start


@pytest.fixture
def serve_cpp(tmp_path: Path, cleanup: ExitStack) -> ServeCpp:
    """Starts an example server of the C++ wrapper."""

    def start(url: str | None, *options: str, **more: Any) -> CppServer:
        server = CppServer(url, *options, cwd=tmp_path, **more)
        cleanup.callback(server.stop)
        return server

    return start


@pytest.fixture
def launch(tmp_path: Path, cleanup: ExitStack) -> Launch:
    """Starts `swarmwright ARGUMENTS` in the temporary folder."""

    def start(*arguments: Any, **options: Any) -> Program:
        program = Program(*arguments, cwd=tmp_path, **options)
        cleanup.callback(program.stop)
        return program

    return start


@pytest.fixture
def connect(cleanup: ExitStack) -> Callable[..., Any]:
    """Connects a peer: `connect(Kind of peer, url, ...)`."""

    def make(peer: type[Peer], *arguments: Any, **options: Any) -> Peer:
        return cleanup.enter_context(peer(*arguments, **options))

    return make


QUICK = "simulation: minisim\nmethod: {kind: nnga, population: 12, generations: 3}\nseed: 3\n"


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    """Writes an experiment file; a small Minisim when not told otherwise."""

    def write(text: str = QUICK, name: str = "experiment.yaml") -> Path:
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


EXPERIMENT = """\
simulation: minisim
parameters: {numAgents: 3, numDefenders: 2, placement: random, speedDefenders: 0.5}
controller: {kind: fully_meshed, hidden: 2}
method: {kind: nnga, population: 12, generations: 3}
ranking: {episodes: 2}
seed: 11
"""
"""What servers in all languages are to evaluate alike."""


@pytest.fixture
def expected(launch: Launch, experiment: Experiment) -> dict[str, Any]:
    """The record of `EXPERIMENT` that the engine makes without any broker."""
    path = experiment(EXPERIMENT, "expected.yaml")
    program = launch("optimize", path, "--servers", "local", "--out", "expected")
    assert program.wait() == 0, program.stderr
    return record(path.parent / "expected")
