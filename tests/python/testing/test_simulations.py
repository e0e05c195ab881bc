"""The checks of simulations in Python find what makes episodes depend on more than seed and actions."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import InputError, RunError, Simulation
from swarmwright.display import Body, Scene
from swarmwright.simulations.physics import Physics
from swarmwright.testing import check_batch_simulation, check_simulation
from tests.python.simulations import minisim, minisim_batch

PARAMETERS = {"numAgents": 3, "numDefenders": 2}


class Steps(Simulation):
    """An episode of five steps."""

    title, sensors, actuators = "steps", 2, 1
    parameters = {"agents": 3}  # noqa: RUF012 - as in the base class
    episodes = 0

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.left, self.sum = 5, 0.0
        self.random = np.random.default_rng(seed)
        return self.random.random((parameters["agents"], 2))

    def step(self, actions: Any) -> Any:
        self.left -= 1
        self.sum += float(actions.sum())
        return self.random.random((len(actions), 2))

    def done(self) -> bool:
        return self.left == 0

    def fitness(self) -> float:
        return self.sum


class Unseeded(Steps):
    """Its fitness has noise that does not come from the seed."""

    def fitness(self) -> float:
        return float(np.random.default_rng().random())


class Noisy(Unseeded):
    """It says so."""

    determinism = "none"


class Tolerant(Unseeded):
    """It says that fitness differs by less than 1."""

    determinism = "statistical"
    tolerance = 1.0


class Misdrawn(Noisy):
    """What it shows is not a scene."""

    def scene(self) -> Any:
        return 5


class Counting(Steps):
    """Its observations depend on the episodes before."""

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.episodes += 1
        return super().reset(parameters, seed) + self.episodes


class LastSeed(Steps):
    """It ends earlier where the episode before had another seed."""

    last: int | None = None

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        before, self.last = self.last, seed
        seen = super().reset(parameters, seed)
        if before not in {None, seed}:
            self.left = 4
        return seen


class Hashed(Steps):
    """It sums in the order of a set of texts."""

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.names = {f"robot {number}" for number in range(20)}
        return super().reset(parameters, seed)

    def step(self, actions: Any) -> Any:
        self.sum += sum(number * int(name.split()[1]) for number, name in enumerate(self.names))
        return super().step(actions)


class Numbered(Steps):
    """It has the number of its process."""

    def fitness(self) -> float:
        return float(os.getpid())


class Drawn(Steps):
    """Drawing it takes random numbers."""

    def scene(self) -> Scene:
        return Scene(1, 1, 5 - self.left, "", [Body("agent", self.random.random(), 0.5)])


class WithoutMetric(Steps):
    """A metric is not measured."""

    metrics = ("collisions",)

    def measure(self) -> dict[str, float]:
        return {"collision": 1.0}


@pytest.mark.slow
def test_what_follows_from_the_seed_passes() -> None:
    check_simulation(Steps)
    check_simulation(Steps, {"agents": 1}, seed=7, steps=3)
    check_simulation(minisim.Minisim, PARAMETERS)
    check_simulation(minisim_batch.Minisim, PARAMETERS)
    check_simulation(Noisy)
    check_simulation(Tolerant)


@pytest.mark.journey
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Unseeded, r"Unseeded: an episode of another object, .* differs in its fitness, .* not from `seed`"),
        (
            Counting,
            r"Counting: an episode that is repeated, .* differs in its observations at its start; .*reset",
        ),
        (
            LastSeed,
            r"LastSeed: an episode after one with another seed, .* differs in its end after 4 steps; .*reset",
        ),
        (
            Hashed,
            r"Hashed: an episode with another hash seed \(PYTHONHASHSEED\), .* in its fitness, .* sort them",
        ),
        (Numbered, r"Numbered: an episode in another process, .* differs in its fitness, .* kept in classes"),
        (Drawn, r"Drawn: an episode in which `scene` is called, .* its observations after 1 step; .*scene"),
    ],
)
def test_what_does_not_is_found(kind: type[Simulation], message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_simulation(kind)


@pytest.mark.slow
def test_what_other_processes_do_not_find_is_not_checked_there(caplog: pytest.LogCaptureFixture) -> None:
    class Local(Steps):
        pass

    check_simulation(Steps)
    assert not caplog.messages
    check_simulation(Local)
    (text,) = caplog.messages
    assert text.startswith("Local was not checked in other processes: ")
    assert "not defined at the top level of a module" in text


@pytest.mark.slow
def test_other_processes_import_nothing_from_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "json.py").write_text("open('imported', 'w').close()")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    check_simulation(Steps)
    assert not (tmp_path / "imported").exists()


@pytest.mark.slow
def test_a_script_that_checks_its_own_class_is_run_once_more_in_each_process(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from swarmwright import Simulation\nfrom swarmwright.testing import check_simulation\n\n"
        "class One(Simulation):\n"
        "    sensors = actuators = 1\n"
        "    def reset(self, parameters, seed): return [[0.0]]\n"
        "    def step(self, actions): return [[0.0]]\n"
        "    def done(self): return True\n"
        "    def fitness(self): return 1\n\n"
        "check_simulation(One)\nprint('checked')\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout == "checked\n"
    assert done.stderr == ""


def test_what_runs_refuse_is_refused() -> None:
    with pytest.raises(RunError, match=r"WithoutMetric\.measure: .* lacks 'collisions'"):
        check_simulation(WithoutMetric)
    with pytest.raises(InputError, match="Steps: unknown parameter 'agent'; did you mean 'agents'"):
        check_simulation(Steps, {"agent": 2})
    with pytest.raises(RunError, match=r"Misdrawn\.scene: "):
        check_simulation(Misdrawn)
    with pytest.raises(InputError, match="steps: 0 found, expected at least 1"):
        check_simulation(Steps, steps=0)


@pytest.mark.slow
def test_classes_are_named_or_given(tmp_path: Path) -> None:
    (tmp_path / "twos.py").write_text(
        "from swarmwright import BatchSimulation, Simulation\nimport numpy as np\n\n"
        "class One(Simulation):\n"
        "    sensors = actuators = 1\n"
        "    def reset(self, parameters, seed): return np.zeros((1, 1))\n"
        "    def step(self, actions): return np.zeros((1, 1))\n"
        "    def done(self): return True\n"
        "    def fitness(self): return 1\n\n"
        "class Many(BatchSimulation):\n"
        "    sensors = actuators = 1\n"
        "    def reset(self, parameters, seeds):\n"
        "        self.count = len(seeds)\n"
        "        return np.zeros((len(seeds), 1, 1))\n"
        "    def step(self, actions): return np.zeros((len(actions), 1, 1))\n"
        "    def done(self): return np.ones(self.count, bool)\n"
        "    def fitness(self): return np.ones(self.count)\n"
    )
    check_simulation(f"{tmp_path}/twos.py:One")
    check_simulation(f"{tmp_path}/twos.py:Many")
    check_batch_simulation(f"{tmp_path}/twos.py:Many")
    with pytest.raises(InputError, match="One: is not a BatchSimulation; check_simulation checks others"):
        check_batch_simulation(f"{tmp_path}/twos.py:One")
    for other in (Physics, Path, 3):
        with pytest.raises(InputError, match="is not a Simulation"):
            check_simulation(other)  # type: ignore[arg-type] # wrong on purpose


@pytest.mark.parametrize("name", ["minisim", "there.py", "there.py:", ":Class"])
def test_what_names_no_class_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"^'{name}' does not name a class; expected path/to/file"):
        check_simulation(name)
