"""Programs of the two Gazebos, each in a system that has it."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import ROOT
from tests.system.processes import Program

PROJECT = ROOT / "wrappers" / "gazebo"
YARD = PROJECT / "tests" / "yard" / "yard.world"
"""A world of a user."""
MODELS = PROJECT / "models"
SCANNER = MODELS / "turtlebot3_like" / "model.sdf"
E_PUCK = MODELS / "e_puck_like" / "model.sdf"
XACRO = MODELS / "two_wheels.urdf.xacro"

EXPERIMENT = """simulation: arena-gazebo
parameters: {mission: aggregation, robots: 4, duration: 4}
controller: {kind: evostick}
method: {kind: evostick, population: 8, elites: 2, generations: 3}
ranking: {episodes: 2, seeds: new}
validate: false
"""


@dataclass(frozen=True)
class Gazebo:
    """A server of the wrapper, with the library that it is built for."""

    server: str
    title: str
    """Of its missions in experiments."""
    build: Path
    root: str
    """The environment variable with the folder of the system that has the library; `/` for this system."""

    def command(self, program: str) -> list[str]:
        """How a program of the wrapper is started; it keeps the process id of what starts it."""
        root = os.environ[self.root]
        within = [] if root == "/" else [str(PROJECT / "in-root"), root]
        return [*within, str(self.build / program)]

    def experiment(self) -> str:
        """An experiment in it that takes seconds."""
        return EXPERIMENT.replace("arena-gazebo", self.title)


CLASSIC = Gazebo("swarmwright-gazebo", "arena-gazebo", PROJECT / "build", "SWARMWRIGHT_GAZEBO")
FORTRESS = Gazebo("swarmwright-gz", "arena-gz", PROJECT / "build" / "gz", "SWARMWRIGHT_GZ")


def command(program: str) -> list[str]:
    """How a program with Gazebo classic is started."""
    return CLASSIC.command(program)


class GazeboServer(Program):
    """A server; ready once made, unless told not to wait."""

    def __init__(
        self,
        url: str,
        *options: str | int,
        cwd: Path,
        server: int = 1,
        wait: bool = True,
        gazebo: Gazebo = CLASSIC,
    ) -> None:
        arguments = ["--broker", url, "--id", server, *options]
        super().__init__(*gazebo.command(gazebo.server), *arguments, cwd=cwd, program=())
        if not wait:
            return
        try:
            self.until_error("ready", 60)
        except BaseException:
            self.stop()
            raise


Serve = Callable[..., GazeboServer]
Launch = Callable[..., Program]


def optimize(
    launch: Launch, url: str, folder: Path, name: str, more: str = "", gazebo: Gazebo = CLASSIC
) -> Program:
    """Start a run whose results go to `folder / name`."""
    path = folder / f"{name}.yaml"
    path.write_text(gazebo.experiment() + more)
    return launch("optimize", path, "--broker", url, "--out", name)
