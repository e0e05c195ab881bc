"""A run whose simulation is not a function of its seed says so at its end."""

import logging
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import BatchSimulation, Experiment, InputError, RunError, Simulation, optimize
from swarmwright.evaluation.base import BudgetSpent
from swarmwright.evaluation.in_process import PythonBackend
from swarmwright.optimization import repeatability
from swarmwright.store import StoreReader

WORDS = "an episode that was repeated with the same seed has another fitness"


class Settled(Simulation):
    """Fitness follows from actions alone."""

    title, sensors, actuators = "settled", 1, 1
    episodes = 0

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:  # noqa: ARG002 - of the base class
        self.left, self.sum, self.episodes = 3, 0.0, self.episodes + 1
        return np.ones((1, 1))

    def step(self, actions: Any) -> Any:
        self.left -= 1
        self.sum += float(actions.sum())
        return np.ones((1, 1))

    def done(self) -> bool:
        return self.left == 0

    def fitness(self) -> float:
        return self.sum


class Leaking(Settled):
    """Fitness depends on how many episodes the object has had."""

    def fitness(self) -> float:
        return self.sum + self.episodes


class Together(BatchSimulation):
    """Fitness depends on how many episodes the batch has."""

    title, sensors, actuators = "together", 1, 1

    def reset(self, parameters: dict[str, Any], seeds: Any) -> Any:  # noqa: ARG002 - of the base class
        self.sums = np.zeros(len(seeds))
        return np.ones((len(seeds), 1, 1))

    def step(self, actions: Any) -> Any:
        self.sums += actions.sum(axis=(1, 2))
        return np.ones((len(actions), 1, 1))

    def done(self) -> Any:
        return self.sums != 0

    def fitness(self) -> Any:
        return self.sums + len(self.sums)


class Declared(Leaking):
    """It says so."""

    determinism = "none"


class Tolerant(Leaking):
    """Fitness may differ by as much as it is."""

    determinism = "statistical"
    tolerance = 1.0


class Slow(Leaking):
    """An episode takes long."""

    def fitness(self) -> float:
        time.sleep(0.02)
        return super().fitness()


def run(
    simulation: type | str | dict[str, Any],
    folder: Path,
    servers: str | int = "in-process",
    **settings: Any,
) -> None:
    method = {"kind": "nnga", "population": 4, "generations": 2}
    settings = {"method": method, "controller": {"kind": "layered", "hidden": [1]}, **settings}
    experiment = Experiment.from_mapping({"simulation": simulation, **settings})
    optimize(experiment, servers=servers, out=folder / "run")


def warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [one.getMessage() for one in caplog.records if WORDS in one.getMessage()]


def test_a_leaking_simulation_is_reported_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, logger="swarmwright"):
        run(Leaking, tmp_path)
    (text,) = warnings(caplog)
    assert "(generation 1, candidate " in text
    assert "docs/how-to/own-simulation.md" in text


def test_both_checks_of_a_batch_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    run(Together, tmp_path)
    (text,) = warnings(caplog)
    assert "try swarmwright.testing.check_simulation and check_batch_simulation, see " in text
    assert "servers" not in text, "there are none"


@pytest.mark.parametrize("error", [BudgetSpent(), InputError("no"), RunError("no"), KeyboardInterrupt()])
def test_a_run_whose_episode_cannot_be_repeated_is_finished(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless it is interrupted."""
    real = repeatability._repeated
    asked = []

    def fail(*_arguments: Any) -> Any:
        asked.append(error)
        raise error

    def repeated(*arguments: Any) -> float | None:
        monkeypatch.setattr(PythonBackend, "evaluate", fail)
        return real(*arguments)

    monkeypatch.setattr(repeatability, "_repeated", repeated)
    if type(error) is KeyboardInterrupt:
        with pytest.raises(KeyboardInterrupt):
            run(Settled, tmp_path, validate=False)
    else:
        run(Settled, tmp_path, validate=False)
    assert asked == [error]
    if type(error) is not KeyboardInterrupt:
        assert [one.outcome for one in StoreReader(tmp_path / "run").sessions()] == ["done"]


@pytest.mark.parametrize("kind", [Settled, Declared, Tolerant])
def test_others_are_not(kind: type, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    run(kind, tmp_path)
    assert not warnings(caplog)


def drawing(folder: Path, seed: str, **definition: Any) -> dict[str, Any]:
    """Return a command whose fitness is a random number."""
    (folder / "draw.py").write_text(
        "import random, sys\n"
        f"random.seed({seed})\n"
        "open('log.csv', 'w').write(f'fitness\\n{random.random()}\\n')\n"
    )
    command = [sys.executable, str(folder / "draw.py"), "{seed}", "{parameters}"]
    return {"command": command, "log": "log.csv", **definition}


SPEED = {"kind": "parameter_set", "parameters": {"speed": {"type": "real", "range": [0, 1]}}}


def test_a_command_that_ignores_its_seed_is_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run(drawing(tmp_path, "None"), tmp_path, controller=SPEED)
    (text,) = warnings(caplog)
    assert "what the command computes does not follow from parameters and seed alone; have it" in text
    assert "simulation.determinism: none" in text


@pytest.mark.parametrize(
    ("seed", "definition"),
    [("sys.argv[1]", {}), ("None", {"determinism": "none"}), ("None", {"determinism": "statistical"})],
)
def test_other_commands_are_not(
    seed: str, definition: dict[str, Any], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run(drawing(tmp_path, seed, **definition), tmp_path, controller=SPEED)
    assert not warnings(caplog)


@pytest.mark.parametrize("servers", ["in-process", 1])
def test_an_environment_that_ignores_its_seed_is_reported(
    servers: str | int, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "drawn.py").write_text(
        "import gymnasium, numpy as np\n\n"
        "class Drawn(gymnasium.Env):\n"
        "    observation_space = action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)\n"
        "    def reset(self, *, seed=None, options=None):\n"
        "        return np.zeros(1, np.float32), {}\n"
        "    def step(self, action):\n"
        "        return np.zeros(1, np.float32), np.random.default_rng().normal(), True, False, {}\n\n"
        "gymnasium.register('Drawn-v0', Drawn)\n"
    )
    monkeypatch.chdir(tmp_path)
    run("gymnasium:drawn:Drawn-v0", tmp_path, servers=servers)
    (text,) = warnings(caplog)
    assert "an episode of the environment does not follow from parameters and seed alone" in text
    assert "reset(seed=..) has to seed all random numbers" in text


def test_an_episode_that_takes_long_is_not_repeated(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(repeatability, "_LONGEST_S", 0.01)
    run(Slow, tmp_path)
    assert not warnings(caplog)


def test_a_module_that_keeps_a_list_is_reported(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "tired.py").write_text(
        "import numpy as np\n"
        "from swarmwright.modules import Behaviour\n\n"
        "class Tired(Behaviour):\n"
        "    calls = []\n"
        "    def act(self, senses, parameters, state, random):\n"
        "        self.calls.append(1)\n"
        "        return np.full((len(senses.ground), 2), [1, np.sin(len(self.calls) / 50)])\n"
    )
    run(
        "arena",
        tmp_path,
        parameters={"mission": "aac", "robot": "e-puck-rm1.2", "robots": 5, "duration": 20},
        controller={
            "kind": "modules",
            "behaviours": [f"{tmp_path}/tired.py:Tired"],
            "conditions": ["black_floor"],
        },
        method={"kind": "random_search", "population": 8, "generations": 2},
    )
    (text,) = warnings(caplog)
    assert "docs/how-to/own-module.md" in text
