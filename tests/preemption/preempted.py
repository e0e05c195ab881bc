"""A run on the servers of two launchers, one of which loses each of its servers again and again."""

import os
import random
import signal
import sqlite3
import subprocess
import threading
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from tests.conftest import PROGRAM, environment
from tests.ssh.conftest import Machine

MARK = "PREEMPTION_TEST"
"""Variable of the servers that are preempted."""
LIFE_S = 20.0
"""A server is preempted when it is this old."""
KILLED_AFTER_S = 5.0
"""From SIGTERM to SIGKILL, as schedulers do it."""
EPISODE_S = 1.0

_SIMULATION = '''\
"""An agent moves along a line; an episode takes the time that a variable of the environment says."""

import os
import time

import swarmwright

STEPS = 20
PAUSE_S = float(os.environ["EPISODE_S"]) / STEPS


class Walk(swarmwright.Simulation):
    """Come close to 2."""

    title, dimensions, sensors, actuators, parameters = "walk", 1, 1, 1, {}

    def reset(self, parameters, seed):
        """Begin at 9."""
        self.place, self.left = 9.0 + seed % 5, STEPS
        return [[self.place]]

    def step(self, actuators):
        """Move."""
        time.sleep(PAUSE_S)
        self.place += actuators[0][0]
        self.left -= 1
        return [[self.place]]

    def done(self):
        """Whether all steps were made."""
        return self.left == 0

    def fitness(self):
        """The nearer to 2 the better."""
        return -abs(self.place - 2.0)
'''


@dataclass(frozen=True)
class Size:
    """Servers of both launchers together, seconds for which the run lasts on them, about."""

    servers: int
    seconds: float

    @property
    def population(self) -> int:
        """Candidates of a generation: 16 for each server."""
        return 16 * self.servers

    @property
    def generations(self) -> int:
        """So many that all servers together need the time."""
        return max(2, round(self.seconds * self.servers / EPISODE_S / self.population))


def written(folder: Path, size: Size, machine: Machine, preempted: str) -> Path:
    """Write the simulation and the experiment; return the file of the latter.

    preempted: the launcher whose servers are, process or ssh.
    """
    (folder / "walk.py").write_text(_SIMULATION)
    half = size.servers // 2
    marks = {name: {MARK: str(folder)} if name == preempted else {} for name in ("process", "ssh")}
    pace = {"EPISODE_S": f"{EPISODE_S:g}"}
    experiment = {
        "simulation": "walk.py:Walk",
        "controller": {"kind": "layered", "hidden": [4]},
        "method": {"population": size.population, "generations": size.generations},
        "validate": False,
        "servers": [
            {"launcher": "process", "count": half, "environment": pace | marks["process"]},
            {
                "launcher": "ssh",
                "count": size.servers - half,
                **machine.options,
                "environment": pace | marks["ssh"],
            },
        ],
    }
    file = folder / "walk.yaml"
    file.write_text(yaml.safe_dump(experiment, sort_keys=False))
    return file


def run(file: Path, out: Path, *arguments: str, episode_s: float) -> int:
    """Run `swarmwright optimize` to its end; return its exit status. What it prints is in OUT.log."""
    with out.with_suffix(".log").open("w") as printed:
        return subprocess.run(
            [*PROGRAM, "optimize", str(file), "--out", str(out), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=subprocess.STDOUT,
            env=environment({"EPISODE_S": f"{episode_s:g}"}),
            check=False,
        ).returncode


@dataclass
class Preemption(threading.Thread):
    """Sends SIGTERM to each server of a launcher that is old enough, and SIGKILL to one that stays."""

    folder: Path
    count: int = 0
    killed: int = 0
    """Of these, those that had not ended in time."""
    _seen: dict[int, float] = field(default_factory=dict)
    _asked: dict[int, float] = field(default_factory=dict)
    _stopping: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        super().__init__(daemon=True)

    def __hash__(self) -> int:
        return id(self)

    def run(self) -> None:
        """Look twice a second."""
        while not self._stopping.wait(0.5):
            self._look(time.monotonic(), self.found())

    def stop(self) -> None:
        """End the thread."""
        self._stopping.set()
        self.join()

    def _look(self, now: float, found: set[int]) -> None:
        servers = {process for process in found if self._is_server(process)}
        for server in sorted(servers - self._seen.keys()):
            # Those that start together do not end together.
            self._seen[server] = now - LIFE_S / 2 * random.random()
        for server in servers:
            if server in self._asked:
                if now - self._asked[server] > KILLED_AFTER_S:
                    self._signal(server, signal.SIGKILL)
                    self.killed += 1
                    self._asked[server] = now
            elif now - self._seen[server] >= LIFE_S:
                # As when a node is taken away: those that started it get the signal, too, after it.
                for process in (server, *self._starters(server, found)):
                    self._signal(process, signal.SIGTERM)
                self._asked[server] = now
                self.count += 1

    @staticmethod
    def _is_server(process: int) -> bool:
        """Whether it is not one of those that started a server."""
        try:
            return b"server_process" in Path(f"/proc/{process}/cmdline").read_bytes()
        except OSError:
            return False

    @staticmethod
    def _starters(process: int, found: set[int]) -> list[int]:
        """Return those found that started a process, the nearest first."""
        starters: list[int] = []
        while True:
            try:
                # The name, in parentheses, may have spaces.
                process = int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                return starters
            if process not in found:
                return starters
            starters.append(process)

    @staticmethod
    def _signal(server: int, number: signal.Signals) -> None:
        try:
            os.kill(server, number)
        except ProcessLookupError:
            return

    def found(self) -> set[int]:
        """Return the ids of the processes that are asked to end."""
        mark = f"{MARK}={self.folder}".encode()
        found = set()
        for place in Path("/proc").glob("[0-9]*/environ"):
            try:
                if mark in place.read_bytes().split(b"\0"):
                    found.add(int(place.parent.name))
            except OSError:
                continue
        return found


@dataclass(frozen=True)
class Figures:
    """What the journal of a run says.

    evaluations: that were computed and counted. handed_back: that had been sent to a server ahead or were cut
    off, and were given to another one. repeated: that were computed more than once. lost: the share of the
    servers' computing time that went into evaluations that were cut off or computed again. utilisation: the
    share of the servers' time that went into evaluations which counted, from the first one to the end of the
    last one, starts of servers included. seconds: between these two.
    """

    evaluations: int
    handed_back: int
    repeated: int
    lost: float
    utilisation: float
    seconds: float

    @classmethod
    def of(cls, folder: Path, servers: int) -> "Figures":
        """Read the journal of a run on so many servers."""
        with closing(sqlite3.connect(folder / "run.sqlite")) as store:
            rows = store.execute(
                "SELECT generation, candidate, candidates, server, started, started + seconds, error "
                "FROM attempt ORDER BY started + seconds"
            ).fetchall()
        counted: set[tuple[int, int]] = set()
        free: dict[int, float] = {}
        """Until when each server has computed what is known."""
        handed_back, repeated, lost = 0, 0, 0.0
        for generation, candidate, candidates, server, started, ended, error in rows:
            # What is sent ahead waits for what was sent before.
            began = max(started, free.get(server, 0.0))
            free[server] = ended
            if error is not None:
                handed_back += candidates
                lost += max(0.0, ended - began)
                continue
            ours = {(generation, candidate + index) for index in range(candidates)}
            repeated += len(ours & counted)
            lost += len(ours & counted) * EPISODE_S
            counted |= ours
        useful = len(counted) * EPISODE_S
        first, last = min(row[4] for row in rows), max(row[5] for row in rows)
        return cls(
            evaluations=len(counted),
            handed_back=handed_back,
            repeated=repeated,
            lost=lost / (lost + useful),
            utilisation=useful / (servers * (last - first)),
            seconds=last - first,
        )
