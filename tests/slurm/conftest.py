"""A real Slurm on this machine: munged, slurmctld and slurmd, as root, without systemd."""

import getpass
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.conftest import free_port

HERE = Path(__file__).parent
WHY_NOT = "SWARMWRIGHT_SLURM is not set: run `make test-slurm` as root"
PATH = "/usr/sbin:/usr/bin:/sbin:/bin"

_CONFIGURATION = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmdPort={node}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MaxArraySize=2
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=1,sched_interval=1,sched_min_interval=0
SlurmdParameters=config_overrides
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ReturnToService=2
KillWait=5
MinJobAge=60
JobRequeue=1
EnforcePartLimits=ALL
NodeName={host} NodeAddr=127.0.0.1 CPUs=4
PartitionName=short Nodes={host} Default=YES MaxTime=60 State=UP
"""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if os.environ.get("SWARMWRIGHT_SLURM"):
        return
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.skip(reason=WHY_NOT))


@dataclass
class Cluster:
    """Slurm with one node."""

    folder: Path
    host: str
    processes: "list[subprocess.Popen[bytes]]"
    controller: "subprocess.Popen[bytes] | None" = None

    def run(self, *command: str) -> str:
        """Return what a command of Slurm prints."""
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    def queue(self) -> list[str]:
        """Jobs that wait, run, or are being ended."""
        return self.run("squeue", "--noheader", "--array", "--format=%i %T").splitlines()

    def running(self) -> list[str]:
        """Jobs that run."""
        return [line.split()[0] for line in self.queue() if line.endswith("RUNNING")]

    def repair(self) -> None:
        """Bring it into the state in which tests find it, whatever an earlier try of one has left."""
        if not _answers("scontrol", "ping"):
            self.stop_controller()
            self.start_controller()
        if "DRAIN" in self.run("scontrol", "show", "node", self.host):
            self.set_node("State=RESUME")
        self.run("scancel", "--quiet", f"--user={getpass.getuser()}")
        until(lambda: self.queue() == [])

    def start_controller(self) -> None:
        """Start slurmctld, again if it ends at once, and wait until it answers."""

        def answers() -> bool:
            if self.controller is None or self.controller.poll() is not None:
                self.controller = _start(self.folder, "slurmctld", "-D")
                self.processes.append(self.controller)
            return _answers("scontrol", "ping") and "UP" in self.run("scontrol", "ping")

        until(answers)

    def stop_controller(self) -> None:
        """End slurmctld, as when its machine fails."""
        if self.controller is not None:
            self.controller.kill()
            self.controller.wait()

    def set_node(self, *settings: str) -> None:
        """Change the node's state, as soon as slurmctld accepts it: shortly after its start it may refuse."""

        def accepted() -> bool:
            command = ("scontrol", "update", f"NodeName={self.host}", *settings)
            tried = subprocess.run(command, capture_output=True, text=True, check=False)
            if tried.returncode != 0:
                print(*command, tried.stdout, tried.stderr, self.run("scontrol", "show", "node", self.host))
            return tried.returncode == 0

        until(accepted)


def until(holds: Callable[[], object]) -> None:
    """Wait; the test's own time-out ends this."""
    while not holds():
        time.sleep(0.1)


def _start(folder: Path, *command: str) -> "subprocess.Popen[bytes]":
    with (folder / f"{command[0]}.out").open("wb") as out:
        program = shutil.which(command[0], path=PATH)
        assert program, f"{command[0]} is missing; `make test-slurm` installs it"
        return subprocess.Popen([program, *command[1:]], stdout=out, stderr=subprocess.STDOUT)


def _answers(*command: str) -> bool:
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@pytest.fixture(scope="session")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    folder = tmp_path_factory.mktemp("slurm")
    for name in ("state", "spool"):
        (folder / name).mkdir()
    host = socket.gethostname().partition(".")[0]
    configuration = _CONFIGURATION.format(host=host, controller=free_port(), node=free_port(), folder=folder)
    (folder / "slurm.conf").write_text(configuration)
    (folder / "cgroup.conf").write_text("CgroupPlugin=autodetect\n")
    key, munge = folder / "munge.key", folder / "munge.socket"
    key.write_bytes(os.urandom(128))
    key.chmod(0o600)
    os.environ["SLURM_CONF"] = str(folder / "slurm.conf")
    processes = [
        _start(
            folder,
            "munged",
            "--foreground",
            "--force",
            f"--key-file={key}",
            f"--socket={munge}",
            f"--pid-file={folder}/munged.pid",
            f"--seed-file={folder}/munge.seed",
        )
    ]
    made = Cluster(folder, host, processes)
    try:
        until(munge.exists)
        made.start_controller()
        processes.append(_start(folder, "slurmd", "-D", "-N", host))
        until(lambda: "idle" in made.run("sinfo", "--noheader", "--format=%t"))
        yield made
    finally:
        for process in reversed(processes):
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        del os.environ["SLURM_CONF"]


@pytest.fixture(autouse=True)
def empty(request: pytest.FixtureRequest) -> Iterator[None]:
    """Every test finds a cluster at work and leaves an empty queue behind."""
    if "slurm" not in request.fixturenames:
        yield
        return
    cluster: Cluster = request.getfixturevalue("slurm")
    cluster.repair()
    yield
    assert cluster.queue() == []
