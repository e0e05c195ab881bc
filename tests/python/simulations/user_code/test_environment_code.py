"""Runs in environments of the user's own modules go on with the copy of these, as those of classes do."""

import logging
import shutil
import sys
from pathlib import Path
from typing import Any

import gymnasium
import pytest

from swarmwright import Experiment, InputError, Run, optimize, repeat, resume, simulate
from swarmwright.simulations.gymnasium import Gymnasium
from swarmwright.simulations.isolation import IsolatedModules
from swarmwright.simulations.loading import load
from swarmwright.simulations.names import find_environment_copy
from swarmwright.simulations.user_code import trust
from tests.python.records import same_record
from tests.python.simulations.user_code.conftest import edit

MAZE = """
import gymnasium
import numpy as np
from gymnasium import spaces

from maze_parts.gain import GAIN


class Maze(gymnasium.Env):
    observation_space = action_space = spaces.Box(-1, 1, (2,), np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.left = 5
        return self.np_random.uniform(-1, 1, 2), {}

    def step(self, action):
        from maze_parts import ending  # within a function, when the episode runs
        self.left -= 1
        return self.np_random.uniform(-1, 1, 2), GAIN * float(action[0]), ending.is_over(self.left), False, {}


gymnasium.register("Maze-v0", entry_point="maze:Maze")
"""
ZOO = """
from gymnasium import spaces
from maze_parts.gain import GAIN
import numpy as np


class Zoo:
    possible_agents = ["a_0", "a_1"]

    def observation_space(self, agent):
        return spaces.Box(-1, 1, (2,), np.float64)

    action_space = observation_space

    def reset(self, seed=None):
        self.random, self.agents, self.left = np.random.default_rng(seed), list(self.possible_agents), 5
        return self.seen(), {}

    def seen(self):
        return {name: self.random.uniform(-1, 1, 2) for name in self.agents}

    def step(self, actions):
        self.left -= 1
        rewards = {name: GAIN * float(action[0]) for name, action in actions.items()}
        seen, ends = self.seen(), dict.fromkeys(actions, self.left == 0)
        self.agents = self.agents if self.left else []
        return seen, rewards, ends, ends, {}

    def close(self):
        pass


def parallel_env():
    return Zoo()
"""
NAMES = ["gymnasium:maze:Maze-v0", "pettingzoo:zoo"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "with space"
    (folder / "maze_parts").mkdir(parents=True)
    (folder / "maze.py").write_text(MAZE)
    (folder / "zoo.py").write_text(ZOO)
    (folder / "maze_parts" / "gain.py").write_text("GAIN = 1.0\n")
    (folder / "maze_parts" / "ending.py").write_text("def is_over(left):\n    return left == 0\n")
    monkeypatch.chdir(folder)
    # A test before it may have registered it: no other test is to depend on that.
    gymnasium.registry.pop("Maze-v0", None)
    return folder


def experiment(name: str, **changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": name,
            "controller": {"kind": "layered", "hidden": []},
            "method": {"population": 4, "generations": 2},
            **changes,
        }
    )


def forget() -> None:
    """Be as another process, which has imported nothing of it."""
    for name in [name for name in sys.modules if name.partition(".")[0] in {"maze", "zoo", "maze_parts"}]:
        del sys.modules[name]
    gymnasium.registry.pop("Maze-v0", None)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_an_edited_environment_is_not_used(name: str, folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    run = optimize(experiment(name), servers="in-process", out=folder / "run")
    assert (run.path / "code/1/simulation/maze_parts/gain.py").is_file()
    edit(folder / "maze_parts" / "gain.py", "1.0", "100.0")
    forget()
    with caplog.at_level(logging.WARNING):
        assert repeat(Run.open(run.path)).same
    assert (
        "gain.py was edited since the run; its copy in the run folder is used; use --simulation"
        in caplog.text
    )
    with pytest.raises(InputError, match=r"gain.py was edited"):
        resume(run.path, generations=3)
    # The name means the current version as ever, before and after.
    now = simulate(experiment(name, parameters={"seed": 3}), servers="in-process")
    assert repeat(Run.open(run.path)).same
    assert simulate(experiment(name, parameters={"seed": 3}), servers="in-process") == now


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["in-process", 1])
@pytest.mark.parametrize("name", NAMES)
def test_a_moved_run_goes_on_with_its_copy(
    name: str, servers: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = optimize(experiment(name, method={"population": 4, "generations": 4}), out=folder / "whole")
    run = optimize(experiment(name), servers="in-process", out=folder / "run")
    shutil.copytree(run.path, tmp_path / "moved" / "run")
    shutil.rmtree(folder / "maze_parts")
    for file in ("maze.py", "zoo.py"):
        (folder / file).unlink()
    forget()
    monkeypatch.chdir(tmp_path)
    moved = Run.open("moved/run")
    assert repeat(moved).same
    resumed = resume("moved/run", generations=4, servers=servers)
    same_record(resumed, whole)
    assert Run.open("moved/run").experiment.simulation == name
    assert f'simulation: "{name}"' in (tmp_path / "moved/run/experiment.yaml").read_text()


@pytest.mark.slow
def test_the_copy_of_another_user_is_not_executed_unasked(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = optimize(experiment(NAMES[0]), servers="in-process", out=folder / "run")
    shutil.copytree(run.path, tmp_path / "received")
    (folder / "maze.py").unlink()
    forget()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(trust, "_granted", set())
    for action in (repeat, lambda run: resume(run, generations=3)):
        with pytest.raises(InputError, match=r"code/1/simulation/maze.py"):
            action(Run.open("received"))
    assert "maze" not in sys.modules
    assert repeat(Run.open("received", trust=True)).same


THIRD = """
import gymnasium
from gymnasium.envs.classic_control import CartPoleEnv


class Third(CartPoleEnv):
    pass


gymnasium.register("Third-v0", entry_point=Third)
gymnasium.register("Late-v0", entry_point="third_party:Third")
"""
WRAPPED = """
import gymnasium
import third_party

gymnasium.register("Variant-v0", entry_point="gymnasium.envs.classic_control:CartPoleEnv")
gymnasium.register("Maze-v0", entry_point=lambda: gymnasium.make("Third-v0"))
"""


def test_what_a_copy_imports_stays_registered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package is imported once in a process, and registers its environments once."""
    (tmp_path / "third_party.py").write_text(THIRD)
    monkeypatch.syspath_prepend(tmp_path)
    made = []
    try:
        for number in "12":
            (tmp_path / number).mkdir()
            (tmp_path / number / "maze.py").write_text(WRAPPED)
            modules = IsolatedModules(tmp_path / number, {"maze"})
            made.append(
                type("Copy", (Gymnasium,), {"environment": "maze:Maze-v0", "isolated_modules": modules})
            )
            assert made[-1]().sensors == 4
        for name in ("Third-v0", "Late-v0"):
            gymnasium.make(name).close()
        assert made[0]().sensors == 4
        assert {"Maze-v0", "Variant-v0"}.isdisjoint(gymnasium.registry)
    finally:
        sys.modules.pop("third_party", None)
        for name in ("Third-v0", "Late-v0"):
            gymnasium.registry.pop(name, None)


@pytest.mark.parametrize(
    "name", ["gymnasium:CartPole-v1", "gymnasium:ale_py:ALE/Pong-v5", "pettingzoo:a.b", "/a/code/1/s/x.py:C"]
)
def test_other_names_are_of_no_copy(name: str) -> None:
    assert find_environment_copy(name) is None


OPTIONAL = """
import gymnasium
from gymnasium.envs.classic_control import CartPoleEnv
from swarmwright import Simulation

try:
    import optional_library
except ImportError:
    optional_library = None


class Installed(Simulation):
    sensors = actuators = 1


gymnasium.register("Optional-v0", entry_point=CartPoleEnv)
"""


@pytest.mark.parametrize("name", ["gymnasium:installed_one:Optional-v0", "installed_one:Installed"])
def test_packages_import_nothing_from_the_working_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a run folder of another user, say, which has a module for a package that is not installed."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "installed_one.py").write_text(OPTIONAL)
    received = tmp_path / "received"
    received.mkdir()
    (received / "optional_library.py").write_text("")
    (received / "installed_one.py").write_text("raise SystemExit")
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.chdir(received)
    try:
        kind = load(name)
        if issubclass(kind, Gymnasium):
            kind()  # which imports the module
        assert sys.modules["installed_one"].optional_library is None
        assert "optional_library" not in sys.modules
    finally:
        gymnasium.registry.pop("Optional-v0", None)
        for module in ("installed_one", "optional_library"):
            sys.modules.pop(module, None)
