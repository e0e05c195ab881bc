"""A package with two modules, as it would be installed."""

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from swarmwright.common import warn_once
from swarmwright.controllers.modules import BEHAVIOURS, CONDITIONS, registered
from swarmwright.simulations import loading, names

CODE = '''"""Two modules."""

import numpy as np
from swarmwright.controllers.modules import Behaviour, Condition, Parameter


class Wander(Behaviour):
    """Straight ahead; now and then the robot turns for some steps."""

    parameters = {"chance": Parameter(0.01, 0.5), "steps": Parameter(1, 20, integer=True)}
    state = 1

    def act(self, senses, parameters, state, random):
        turning = state[:, 0] > 0
        begins = ~turning & (random.unit() < parameters["chance"])
        state[:, 0] = np.where(begins, parameters["steps"], np.maximum(state[:, 0] - 1, 0))
        left = np.where(turning, -0.5, 1.0)
        return np.stack([left, np.ones(len(left))], axis=1)


class Timer(Condition):
    """After some steps."""

    parameters = {"after": Parameter(1, 100, integer=True)}
    state = 1

    def probability(self, senses, parameters, state, random):
        state[:, 0] += 1
        return (state[:, 0] >= parameters["after"]).astype(np.float32)
'''
POINTS = """[swarmwright.behaviours]
wander = own_modules:Wander
[swarmwright.conditions]
timer = own_modules:Timer
"""

SPEED = "SPEED = -0.5\n"


def forget() -> None:
    """Forget what was imported, as another process would."""
    for known in (names.files, loading._stamps, loading._digests, registered._in_files, warn_once._given):
        known.clear()
    sys.modules.pop("wheel_speeds", None)


def written(folder: Path, code: str = CODE, speed: str = SPEED) -> Path:
    """Write two modules, and what they import, into a folder; return it."""
    folder.mkdir(parents=True, exist_ok=True)
    code = code.replace("import numpy", "from wheel_speeds import SPEED\nimport numpy")
    (folder / "own.py").write_text(code.replace("-0.5", "SPEED"))
    (folder / "wheel_speeds.py").write_text(speed)
    return folder


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Work in an empty folder, with nothing imported from files."""
    forget()
    monkeypatch.chdir(tmp_path)
    path = list(sys.path)
    yield
    sys.path[:] = path
    forget()


def _forget() -> None:
    for registry in (BEHAVIOURS, CONDITIONS):
        registry.__dict__.pop("_entry_points", None)
        registry._loaded.clear()
    registered._find_registered.cache_clear()
    sys.modules.pop("own_modules", None)
    importlib.invalidate_caches()


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Path]]:
    """Return what installs modules: code, and entry points; and returns the file with the code."""
    site = tmp_path / "site"
    # Bytecode is taken for that of a file of the same size that was changed in the same second.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def put(code: str = CODE, points: str = POINTS) -> Path:
        information = site / "own_modules-1.0.dist-info"
        information.mkdir(parents=True, exist_ok=True)
        (information / "METADATA").write_text("Metadata-Version: 2.1\nName: own-modules\nVersion: 1.0\n")
        (information / "entry_points.txt").write_text(points)
        file = site / "own_modules.py"
        file.write_text(code)
        if str(site) not in sys.path:
            monkeypatch.syspath_prepend(str(site))
        _forget()
        return file

    yield put
    monkeypatch.undo()
    _forget()


@pytest.fixture
def own(install: Callable[..., Path]) -> Path:
    """Install `CODE`; return its file."""
    return install()
