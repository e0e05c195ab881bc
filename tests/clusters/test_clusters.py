"""Servers on clusters of Ray and Dask with two nodes: the same record, nothing left behind, errors."""

import importlib.util
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, RunError, optimize
from swarmwright.servers.launchers import LAUNCHERS, Specification
from swarmwright.testing import check_launcher
from tests.conftest import ROOT, Run, Start
from tests.paced_simulation import written
from tests.python.records import same_record

pytestmark = [
    pytest.mark.skipif(
        "SWARMWRIGHT_CLUSTERS" not in os.environ,
        reason="SWARMWRIGHT_CLUSTERS is not set: run `make test-ray`",
    ),
    pytest.mark.timeout(200),
]


class Cluster:
    """A cluster in a process of its own."""

    def __init__(self, kind: str) -> None:
        self.kind, self.mark = kind, f"CLUSTER_OF_TESTS={secrets.token_hex(8)}"
        name, _, value = self.mark.partition("=")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.clusters.cluster", kind],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env={**os.environ, name: value},
        )
        self.address = self._line("address")

    def kill_node(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write("kill\n")
        self._process.stdin.flush()
        self._line("killed")

    def servers(self) -> int:
        """The number of processes of servers that this cluster's workers have started."""
        found = 0
        for entry in Path("/proc").iterdir():
            try:
                program = (entry / "cmdline").read_bytes()
                variables = (entry / "environ").read_bytes()
            except OSError:
                continue
            found += b"swarmwright.servers.launchers._tied" in program and self.mark.encode() in variables
        return found

    def close(self) -> None:
        self._process.communicate(timeout=60)

    def _line(self, word: str) -> str:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(word):
                return line.removeprefix(word).strip()
        raise AssertionError(f"the cluster of {self.kind} ended")


@pytest.fixture(scope="module", params=["ray", "dask"])
def cluster(request: pytest.FixtureRequest) -> Iterator[Cluster]:
    made = Cluster(request.param)
    try:
        yield made
    finally:
        made.close()


def until(holds: Callable[[], bool]) -> None:
    while not holds():  # the test's own time-out ends it
        time.sleep(0.1)


def experiment(cluster: Cluster, simulation: str = "minisim", **servers: Any) -> Experiment:
    entry = {
        "launcher": cluster.kind,
        "count": 2,
        "address": cluster.address,
        "broker_host": "127.0.0.1",
        **servers,
    }
    return Experiment.from_mapping(
        {
            "simulation": simulation,
            "method": {"population": 20, "generations": 8},
            "validate": False,
            "servers": entry,
        }
    )


def test_the_conformance_check(cluster: Cluster) -> None:
    check_launcher(cluster.kind, {"address": cluster.address}, alive=cluster.servers)


def test_a_killed_node_changes_nothing(cluster: Cluster, tmp_path: Path) -> None:
    from swarmwright.servers.evaluation.launched.servers import find_own_address

    # As on other machines: the code travels, the broker has TLS and accounts.
    made = experiment(cluster, written(tmp_path / "simulation"), broker_host=find_own_address())
    here = optimize(made, out=tmp_path / "here", servers="in-process", progress=False)
    done: list[int] = []

    def disturb(generation: Any) -> None:
        done.append(generation.generation)
        if len(done) == 2:
            until(lambda: cluster.servers() == 2)
            cluster.kill_node()
        if len(done) == 5:
            until(lambda: cluster.servers() == 2)

    same_record(optimize(made, disturb, out=tmp_path / "there", progress=False), here)
    assert len(done) == 8
    until(lambda: cluster.servers() == 0)


def test_a_killed_tool_leaves_nothing_behind(cluster: Cluster, tmp_path: Path, start: Start) -> None:
    made = experiment(cluster, written(tmp_path / "simulation"))
    made.save(tmp_path / "lab.yaml")
    longer = ("--set", "method.generations=100000", "--servers", f"{cluster.kind}:2")
    tool = start("optimize", "lab.yaml", *longer, "--out", "run")
    until(lambda: cluster.servers() == 2 or tool.poll() is not None)
    assert tool.poll() is None
    os.kill(tool.pid, signal.SIGKILL)
    until(lambda: cluster.servers() == 0)


def test_servers_finish_on_sigterm(cluster: Cluster) -> None:
    from swarmwright import _engine

    component = LAUNCHERS.get(cluster.kind)
    broker = _engine.Broker()
    made = component.options_model.model_validate({"launcher": cluster.kind, "address": cluster.address})
    launcher = component(made, Specification(simulation="minisim", broker=broker.url))
    try:
        launcher.open()
        launcher.start([21])
        until(lambda: bool(_engine.servers(broker.url, wait=0.2)))
        assert any("is ready" in line for line in launcher.logs(21))
        (own,) = (
            int(entry.name)
            for entry in Path("/proc").iterdir()
            if entry.name.isdecimal() and cluster.mark.encode() in _read(entry / "environ")
            if b"swarmwright.servers.launchers._tied" in _read(entry / "cmdline")
        )
        os.kill(own, signal.SIGTERM)
        until(lambda: launcher.health()[21].state == "ended")
        assert launcher.health()[21].reason.startswith("ended with status ")
    finally:
        launcher.close()
        broker.stop()


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


def test_resources_that_no_node_has_are_named(
    cluster: Cluster, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made = experiment(cluster, written(tmp_path / "simulation"))
    entry = {"launcher": cluster.kind, "address": cluster.address, "resources": {"simulator": 2}}
    both = made.replace(servers=[entry, {"launcher": "process", "count": 1}])
    optimize(both, out=tmp_path / "run", progress=False)
    what = "worker" if cluster.kind == "dask" else "node"
    assert f"{cluster.kind}: 1 of 1 servers are waiting: no {what} of the cluster has {{" in caplog.text
    assert "simulator: 2" in caplog.text


def test_servers_that_do_not_start_are_given_up(cluster: Cluster, tmp_path: Path) -> None:
    name = written(tmp_path / "simulation")
    file = tmp_path / "simulation" / "paced.py"
    file.write_text(
        file.read_text()
        + "\nfrom swarmwright.simulations import loading\n"
        + "if loading.serving: raise SystemExit('no licence for this machine')\n"
    )
    with pytest.raises(RunError, match=r"(?s)no server starts:.*no licence for this machine"):
        optimize(experiment(cluster, name), out=tmp_path / "run", progress=False)
    until(lambda: cluster.servers() == 0)


@pytest.mark.parametrize("kind", ["ray", "dask"])
@pytest.mark.parametrize(
    ("address", "status", "message"),
    [
        ("127.0.0.1:9", 1, "address: 127.0.0.1:9 cannot be reached: Connection refused"),
        ("cluster", 1, "address: cluster must have a host and a port"),
        ("", 2, "servers.address: "),
    ],
)
def test_wrong_addresses(
    tmp_path: Path, program: Run, kind: str, address: str, status: int, message: str
) -> None:
    (tmp_path / "lab.yaml").write_text(
        f"simulation: minisim\nmethod: {{generations: 1}}\n"
        f"servers: {{launcher: {kind}, address: '{address}'}}\n"
    )
    result = program("optimize", "lab.yaml", "--out", "run")
    assert (result.returncode, message in result.stderr) == (status, True), result.stderr
    assert "Traceback" not in result.stderr


def test_both_are_installed() -> None:
    assert all(importlib.util.find_spec(name) for name in ("ray", "distributed"))
