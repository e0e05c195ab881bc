"""Programs that run in the Debian 11 with Gazebo."""

import os
from collections.abc import Callable
from pathlib import Path

from tests.conftest import ROOT
from tests.system.processes import Program

PROJECT = ROOT / "wrappers" / "gazebo"
BUILD = PROJECT / "build"
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


def command(program: str) -> list[str]:
    """How a program of the wrapper is started; it keeps the process id of what starts it."""
    return [str(PROJECT / "in-root"), os.environ["SWARMWRIGHT_GAZEBO"], str(BUILD / program)]


class GazeboServer(Program):
    """`swarmwright-gazebo`; ready once made, unless told not to wait."""

    def __init__(self, url: str, *options: str | int, cwd: Path, server: int = 1, wait: bool = True) -> None:
        arguments = ["--broker", url, "--id", server, *options]
        super().__init__(*command("swarmwright-gazebo"), *arguments, cwd=cwd, program=())
        if not wait:
            return
        try:
            self.until_error("ready", 60)
        except BaseException:
            self.stop()
            raise


Serve = Callable[..., GazeboServer]
Launch = Callable[..., Program]


def optimize(launch: Launch, url: str, folder: Path, name: str, more: str = "") -> Program:
    """Start a run whose results go to `folder / name`."""
    path = folder / f"{name}.yaml"
    path.write_text(EXPERIMENT + more)
    return launch("optimize", path, "--broker", url, "--out", name)
