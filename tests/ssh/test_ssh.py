"""Servers through SSH: the same record, nothing left behind, errors with their words."""

import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, RunError, optimize
from swarmwright.servers.launchers import Code
from swarmwright.testing import check_launcher
from tests.conftest import PROGRAM, environment
from tests.paced_simulation import written
from tests.python.records import same_record
from tests.ssh.conftest import Machine, running

SIMULATION = """\
import json, pathlib
import swarmwright
from walls import NEAR

class Gather(swarmwright.Simulation):
    title, dimensions, sensors, actuators, parameters = "gather", 2, 1, 1, {}

    def reset(self, parameters, seed):
        far = json.loads((pathlib.Path(__file__).parent / "maps" / "hall.json").read_text())["far"]
        self.place, self.left = float(far), 20
        print("far is", far, flush=True)
        return [[self.place]]

    def step(self, actuators):
        self.place += actuators[0][0]
        self.left -= 1
        return [[self.place]]

    def done(self):
        return self.left == 0

    def fitness(self):
        return -abs(self.place - NEAR)
"""


def experiment(machine: Machine, simulation: str = "minisim", **servers: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": simulation,
            "method": {"population": 20, "generations": 10},
            "validate": False,
            "servers": {"launcher": "ssh", "count": 2, **machine.options, **servers},
        }
    )


def until(holds: Callable[[], bool]) -> None:
    while not holds():  # the test's own time-out ends this
        time.sleep(0.1)


def test_the_conformance_check(machine: Machine) -> None:
    check_launcher("ssh", machine.options, alive=lambda: len(machine.servers()))


@pytest.mark.timeout(120)
def test_code_travels_once_and_the_record_is_the_same(machine: Machine, tmp_path: Path) -> None:
    home = tmp_path / "simulation"
    (home / "maps").mkdir(parents=True)
    (home / "gather.py").write_text(SIMULATION)
    (home / "walls.py").write_text("NEAR = 2.0\n")
    (home / "maps" / "hall.json").write_text('{"far": 9}')
    name = f"{home}/gather.py:Gather"
    made = experiment(machine, name, files=["maps/*.json"])
    here = optimize(made, out=tmp_path / "here", servers="in-process", progress=False)
    copies = machine.folder / "cache" / "code"
    times = []
    for folder in ("first", "second", "third"):
        same_record(optimize(made, out=tmp_path / folder, progress=False), here)
        assert ": far is 9\n" in (tmp_path / folder / "servers.log").read_text()
        (copied,) = copies.iterdir()
        times.append(copied.stat().st_mtime_ns)  # it travels once
        if folder == "second":
            assert times[0] == times[1]
            other = Code.from_files({"gather.py": SIMULATION.replace("-abs", "abs").encode()})
            copied.write_bytes(other.archive)  # what was altered is not used
    assert copied.name == f"{hashlib.sha256(copied.read_bytes()).hexdigest()}.tar.gz"
    assert not list((machine.folder / "cache" / "run").iterdir())
    until(lambda: machine.servers() == [])


@pytest.mark.timeout(120)
def test_values_of_the_environment_are_in_no_arguments(machine: Machine, tmp_path: Path) -> None:
    found: set[str] = set()

    def look(_generation: object) -> None:
        for process in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                arguments = (process / "cmdline").read_bytes()
                if b"serve" in arguments:
                    found.add("server")
                if b"a-licence-key" in arguments:
                    found.add(arguments.decode())

    made = experiment(machine, written(tmp_path / "simulation"), environment={"LICENCE": "a-licence-key"})
    optimize(made, look, out=tmp_path / "run", progress=False)
    assert found == {"server"}


@pytest.mark.timeout(120)
def test_tls_with_an_account_and_a_connection_that_breaks(machine: Machine, tmp_path: Path) -> None:
    from swarmwright.servers.evaluation.launched.servers import find_own_address

    broken: list[int] = []

    def breaks(_generation: object) -> None:
        if not broken:
            broken.extend(machine.sessions())
            for session in broken:
                os.kill(session, signal.SIGKILL)
            until(lambda: len(machine.sessions()) > 0)

    made = experiment(machine, written(tmp_path / "simulation"), broker_host=find_own_address())
    here = optimize(made, out=tmp_path / "here", servers="in-process", progress=False)
    same_record(optimize(made, breaks, out=tmp_path / "there", progress=False), here)
    assert broken
    until(lambda: machine.servers() == [])


@pytest.mark.timeout(120)
def test_nothing_is_left_behind_when_the_tool_is_killed(machine: Machine, tmp_path: Path) -> None:
    made = experiment(machine).replace(method={"generations": 1_000_000})
    made.save(tmp_path / "long.yaml")
    tool = subprocess.Popen(
        [*PROGRAM, "optimize", str(tmp_path / "long.yaml"), "--out", str(tmp_path / "long")],
        env=environment(),
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert tool.stdout is not None
        assert tool.stdout.readline()
        assert machine.servers()
    finally:
        tool.kill()
        tool.wait()
        tool.stdout.close()  # type: ignore[union-attr] # a pipe
    until(lambda: machine.servers() == [])
    until(lambda: not list((machine.folder / "cache" / "run").iterdir()))


@pytest.mark.parametrize(
    ("servers", "message"),
    [
        (
            {"key": "{folder}/other_key"},
            r"127\.0\.0\.1: login refused \(.*\); check the options user and key",
        ),
        ({"known_hosts": "{folder}/config"}, r"127\.0\.0\.1: its host key is not trusted"),
        ({"hosts": ["127.0.0.1:1"]}, r"127\.0\.0\.1: .*(refused|Connect call failed)"),
        ({"hosts": ["no-such-machine.invalid"]}, r"no-such-machine\.invalid: "),
        ({"command": "/opt/no/swarmwright"}, "the program /opt/no/swarmwright was not found"),
        ({"setup": "echo no module >&2; exit 3"}, "ended with status 3: no module"),
        ({"command": f"{sys.executable} -c 'exit(\"no licence\")'"}, "no server starts:(.|\n)*no licence"),
        ({"broker_host": "127.0.0.2", "start_timeout": 8.0}, "no server starts"),
    ],
)
def test_what_is_wrong_is_said_with_the_machines_words(
    machine: Machine, tmp_path: Path, servers: dict[str, Any], message: str
) -> None:
    given = {
        key: value.format(folder=machine.folder) if isinstance(value, str) else value
        for key, value in servers.items()
    }
    with pytest.raises(RunError, match=message):
        optimize(experiment(machine, **given), out=tmp_path / "run", progress=False)
    until(lambda: machine.servers() == [])


def test_a_machine_without_sftp(tmp_path: Path) -> None:
    words = r"refuses SFTP, which is needed to copy files .* sshd_config"
    with (
        running(tmp_path / "machine", subsystem="other internal-sftp") as machine,
        pytest.raises(RunError, match=words),
    ):
        optimize(experiment(machine), out=tmp_path / "run", progress=False)


def test_without_machines(machine: Machine, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"servers\.hosts: is missing; ssh needs machines"):
        optimize(experiment(machine, hosts=[]), out=tmp_path / "run", progress=False)
