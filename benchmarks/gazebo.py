"""Missions of the arena in Gazebo: ticks a second through a server, against Gazebo's library alone.

Both compute the same world, which the server saves, with the same steps, ray sensors and number of robots.
"""

import contextlib
import json
import os
import socket
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.measurement import Samples
from benchmarks.processes import ROOT, embedded
from benchmarks.suite import NotBuiltError
from benchmarks.wrappers import Server, Subject, evaluate, pool_for

PROJECT = ROOT / "wrappers" / "gazebo"
GAZEBO_ROOT = Path(os.environ.get("SWARMWRIGHT_GAZEBO", "~/.cache/swarmwright/gazebo/root")).expanduser()
SENSORS, ACTUATORS = 24, 2
"""Of the e-puck of the reference model RM1.1."""
SECONDS = 20
"""Of an episode."""
TICKS = SECONDS * 10
STEPS = 20
"""Of Gazebo in a tick."""
ROBOTS = (2, 10, 20)
COUNTED = 10
"""Robots for which an aim is set."""


def command(program: str) -> list[str]:
    """How a program in the Debian with Gazebo is started."""
    built = PROJECT / "build" / program
    if not built.exists() or not (GAZEBO_ROOT / ".complete").exists():
        raise NotBuiltError(f"{program} is missing; `make gazebo` builds it")
    return [str(PROJECT / "in-root"), str(GAZEBO_ROOT), str(built)]


def _free_port() -> int:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as probe:
        return int(probe.getsockname()[1])


class GazeboSuite:
    """Offloaded and stepwise ticks a second with some robots, against the bare loop."""

    def __init__(self, scale: int = 1) -> None:
        self._stack = contextlib.ExitStack()
        self._folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
        self._broker = self._stack.enter_context(embedded())
        self._episodes = max(1, 6 // scale)
        self._samples: dict[tuple[int, str], Samples] = {}
        for robots in ROBOTS:
            bare = Samples(f"Gazebo's library alone, {robots} robots", "ticks/s")
            self._samples[robots, "bare"] = bare
            for mode in ("offloaded", "stepwise", "batched"):
                aim = ">= 0.8" if robots == COUNTED else ""
                one = Samples(f"missions in Gazebo, {mode}, {robots} robots", "ticks/s", bare, aim)
                self._samples[robots, mode] = one

    def repeat(self) -> None:
        """Take one sample of everything, with a new server for each number of robots."""
        for robots in ROBOTS:
            world = self._folder / "world.sdf"
            parameters = {"mission": "aggregation", "robots": robots, "duration": SECONDS}
            start = [*command("swarmwright-gazebo"), "--save-world", str(world)]
            subject = Subject(start, "arena-gazebo", parameters, SENSORS, ACTUATORS)
            prefix = f"bench/gazebo/{robots}"
            with contextlib.closing(Server(subject.command, self._broker, prefix)):
                for mode in ("offloaded", "stepwise", "batched"):
                    with pool_for(self._broker, prefix, subject, mode) as servers:
                        evaluate(servers, subject.block(1))  # makes the world
                        _, seconds = evaluate(servers, subject.block(self._episodes))
                    self._samples[robots, mode].add(self._episodes * TICKS / seconds)
            self._samples[robots, "bare"].add(self._bare(world))

    def _bare(self, world: Path) -> float:
        local = {"GAZEBO_IP": "127.0.0.1", "GAZEBO_MODEL_DATABASE_URI": "", "ALSOFT_DRIVERS": "null"}
        arguments = [str(world), str(STEPS), str(self._episodes * TICKS), str(TICKS)]
        done = subprocess.run(
            [*command("gazebo-loop"), *arguments],
            env={**os.environ, **local, "GAZEBO_MASTER_URI": f"http://127.0.0.1:{_free_port()}"},
            capture_output=True,
            text=True,
            check=True,
        )
        found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        return float(found["ticks_per_second"])

    def samples(self) -> list[Samples]:
        """Everything measured."""
        return list(self._samples.values())

    def close(self) -> None:
        """End everything that was started."""
        self._stack.close()
