"""A simulation in two files of its own, and a run of it."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmwright.common import warn_once
from swarmwright.simulations.user_code import trust

GATHER = '''
import numpy as np
from helper import GAIN
from swarmwright import Simulation


class Gather(Simulation):
    """Agents gather."""

    title, sensors, actuators = "gather", 2, 2

    def reset(self, parameters, seed):
        self.position, self.left = np.random.default_rng(seed).uniform(-1, 1, (3, 2)), 4
        return self.look()

    def step(self, actions):
        self.position += GAIN * actions
        self.left -= 1
        return self.look()

    def look(self):
        return self.position.mean(axis=0) - self.position

    def done(self):
        return self.left == 0

    def fitness(self):
        return -self.position.std(axis=0).sum()
'''
EXPERIMENT = """simulation: gather.py:Gather
controller: {kind: layered, hidden: []}
method: {kind: nnga, population: 6, generations: 3}
servers: local
"""


@pytest.fixture(autouse=True)
def clean(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Forget what a test imported, trusted and said, as a new process of another user would."""
    modules, path = dict(sys.modules), list(sys.path)
    warn_once._given.clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        patch.setattr(trust, "_granted", set())
        yield
    sys.path[:] = path
    for name in [name for name in sys.modules if name not in modules]:
        if not name.startswith(("swarmwright.", "numpy.")):
            del sys.modules[name]


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the simulation and its experiment, in which the test works."""
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "gather.py").write_text(GATHER)
    (folder / "helper.py").write_text("GAIN = 0.1\n")
    (folder / "gather.yaml").write_text(EXPERIMENT)
    monkeypatch.chdir(folder)
    return folder


def edit(file: Path, old: str, new: str) -> None:
    """Change a text in a file; of another length, so that Python notices it within the second."""
    text = file.read_text()
    assert old in text
    assert len(old) != len(new)
    file.write_text(text.replace(old, new))
