"""Servers in two network namespaces: a jump host, and a network that fails in the middle of a run."""

import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, Generation, RunError, optimize
from tests.conftest import PROGRAM
from tests.paced_simulation import written
from tests.python.records import same_record
from tests.ssh.conftest import Machine
from tests.ssh.namespaces import Networks, joined
from tests.ssh.test_ssh import until

pytestmark = pytest.mark.timeout(240)


@pytest.fixture
def networks(tmp_path: Path) -> Iterator[Networks]:
    with joined(tmp_path) as made:
        yield made


def experiment(networks: Networks, folder: Path, generations: int = 12, **servers: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": written(folder / "simulation"),
            "method": {"population": 20, "generations": generations},
            "validate": False,
            "servers": {
                "launcher": "ssh",
                "count": 4,
                "hosts": ["near slots=2", "far slots=2"],
                "config": str(networks.config(folder)),
                "command": " ".join(PROGRAM),
                "folder": str(folder / "cache"),
                "broker_host": networks.broker_host,
                **servers,
            },
        }
    )


def reachable(machine: Machine) -> bool:
    """Whether an sshd answers this machine: gateways may take connections to addresses that nobody has."""
    try:
        with socket.create_connection((machine.address, machine.port), 1) as connection:
            return connection.recv(4) == b"SSH-"
    except OSError:
        return False


def serving(machine: Machine) -> int:
    """How many servers were started through an sshd."""
    return sum(line.startswith(sys.executable) and " serve " in line for line in machine.servers())


def test_a_network_that_fails_and_comes_back(networks: Networks, tmp_path: Path) -> None:
    assert reachable(networks.near)
    assert not reachable(networks.far)
    seen: list[Any] = []

    def disturb(generation: Generation) -> None:
        if generation.generation == 2:
            seen.append((serving(networks.near), serving(networks.far)))
            networks.cable("down")
            seen.append(reachable(networks.near))
        elif generation.generation == 4:  # the servers of `far` evaluated the one before
            networks.cable("up")
            until(lambda: reachable(networks.near))

    made = experiment(networks, tmp_path)
    here = optimize(made, out=tmp_path / "here", servers="in-process", progress=False)
    there = optimize(made, disturb, out=tmp_path / "there", progress=False)
    same_record(there, here)
    assert seen == [(2, 2), False]
    until(lambda: networks.near.servers() == networks.far.servers() == [])


def test_a_jump_host_that_refuses(networks: Networks, tmp_path: Path) -> None:
    (networks.near.folder / "authorized_keys").write_text("")
    with pytest.raises(RunError, match=r"far: .*near|far: .*login refused"):
        optimize(experiment(networks, tmp_path, hosts=["far"]), out=tmp_path / "run", progress=False)
