"""Evaluations that are repeated at the end of a run, to find those that come out differently."""

import logging
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import BatchSimulation, Experiment, InputError, Run, RunError, Simulation, optimize
from swarmwright.runs.optimization import audit
from swarmwright.runs.store import StoreReader
from swarmwright.servers.evaluation.base import BudgetSpent
from swarmwright.servers.evaluation.in_process import PythonBackend

WORDS = "repeated evaluations gave different results"


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
    assert ", the first in generation " in text
    assert "docs/how-to/own-simulation.md" in text


def test_both_checks_of_a_batch_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    run(Together, tmp_path)
    (text,) = warnings(caplog)
    assert "try swarmwright.testing.check_simulation and check_batch_simulation, see " in text
    assert "servers" not in text, "there are none"


@pytest.mark.slow
@pytest.mark.parametrize("error", [BudgetSpent(), InputError("no"), RunError("no"), KeyboardInterrupt()])
def test_a_run_whose_episodes_cannot_be_repeated_is_finished(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless it is interrupted."""
    asked = []

    def fail(*_arguments: Any) -> Any:
        asked.append(error)
        raise error

    monkeypatch.setattr(PythonBackend, "repeat", fail)
    if type(error) is KeyboardInterrupt:
        with pytest.raises(KeyboardInterrupt):
            run(Settled, tmp_path, validate=False)
    else:
        run(Settled, tmp_path, validate=False)
    assert asked == [error]
    if type(error) is not KeyboardInterrupt:
        assert [one.outcome for one in StoreReader(tmp_path / "run").sessions()] == ["done"]
        assert Run.open(tmp_path / "run").audit is None


class Rare(Settled):
    """Random numbers without a seed have a part in 12 % of the episodes."""

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.is_random = np.random.default_rng(seed).random() < 0.12
        return super().reset(parameters, seed)

    def fitness(self) -> float:
        return self.sum + (np.random.default_rng().random() if self.is_random else 0.0)


class Forgetful(Settled):
    """What an episode of one agent leaves behind changes the next one, if that has another seed."""

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        before, self.seed = getattr(self, "seed", seed), seed
        self.left_behind = 1e-9 * before
        return super().reset(parameters, seed)

    def fitness(self) -> float:
        return self.sum + self.left_behind


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Rare, Forgetful])
def test_faults_that_show_rarely_are_found(
    kind: type, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    method = {"kind": "random_search", "population": 20, "generations": 5}
    for seed in range(5):
        folder = tmp_path / str(seed)
        folder.mkdir()
        ranking = {"episodes": 2, "seeds": "new"}
        run(kind, folder, method=method, ranking=ranking, seed=seed, validate=False)
        assert len(warnings(caplog)) == seed + 1
        found = Run.open(folder / "run").audit
        assert found is not None
        assert found["evaluations"] == audit.MIN_EVALUATIONS
        assert (found["episodes"], found["failed"], found["elsewhere"]) == (2 * audit.MIN_EVALUATIONS, 0, 0)
        assert found["differ"] > 0


def test_the_chance_to_find_a_fault_is_what_the_documentation_says() -> None:
    assert 0.97 < 1 - 0.88**audit.MIN_EVALUATIONS < 0.98


@pytest.mark.slow
def test_the_record_does_not_depend_on_the_audit(tmp_path: Path) -> None:
    digests = []
    for share in (0, "auto", 0.5):
        folder = tmp_path / str(share)
        folder.mkdir()
        run(Settled, folder, faults={"audit": share}, validate=False)
        done = Run.open(folder / "run")
        digests.append(done.digest)
        assert (done.audit is None) == (share == 0)
    assert len(set(digests)) == 1


@pytest.mark.slow
def test_other_servers_repeat_what_one_has_evaluated(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A server of which all results are wrong by a little is named."""
    (tmp_path / "apart.py").write_text(
        "import os, sys, json\nfrom swarmwright import Simulation\n\n"
        "class Apart(Simulation):\n"
        "    sensors = actuators = 1\n"
        "    wrong = False\n"
        "    if sys.argv[2:] and sys.argv[2].startswith('{'):  # in a server process, not in pytest\n"
        "        wrong = json.loads(sys.argv[2])['id'] % 3 == 0\n"
        "    def reset(self, parameters, seed):\n"
        "        self.sum = 0.0\n"
        "        return [[1.0]]\n"
        "    def step(self, actions):\n"
        "        self.sum += float(actions.sum())\n"
        "        return [[1.0]]\n"
        "    def done(self): return True\n"
        "    def fitness(self): return self.sum + 1e-9 * self.wrong\n"
    )
    method = {"kind": "random_search", "population": 40, "generations": 1}
    run(f"{tmp_path}/apart.py:Apart", tmp_path, servers=3, method=method, validate=False)
    found = Run.open(tmp_path / "run").audit
    assert found is not None
    assert found["episodes"] == found["elsewhere"] == audit.MIN_EVALUATIONS
    (text,) = warnings(caplog)
    # Which server gets what is a matter of time: 3 may have been compared with one of the others alone.
    named = (
        ", or server 3, involved in every difference, computes differently; try",
        ", or the servers compute differently; try",
    )
    assert any(words in text for words in named)


@pytest.mark.parametrize(
    ("servers", "words"),
    [
        ([{1, 3}, {2, 3}, {1, 3}], ", or server 3, involved in every difference, computes differently"),
        ([{1, 3}, {1, 3}], ", or the servers compute differently"),
        ([{1, 3}, {1, 2}, {2, 3}], ", or the servers compute differently"),
        ([{1, 3}, set()], ""),
    ],
)
def test_the_server_that_all_differences_share_is_named(servers: list[set[int]], words: str) -> None:
    assert audit._suspect_servers(servers) == words


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_command_that_ignores_its_seed_is_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run(drawing(tmp_path, "None"), tmp_path, controller=SPEED)
    (text,) = warnings(caplog)
    assert "the output of the command does not depend on parameters and seed alone; derive" in text
    assert "or set simulation.determinism to none" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "definition"),
    [("sys.argv[1]", {}), ("None", {"determinism": "none"}), ("None", {"determinism": "statistical"})],
)
def test_other_commands_are_not(
    seed: str, definition: dict[str, Any], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run(drawing(tmp_path, seed, **definition), tmp_path, controller=SPEED)
    assert not warnings(caplog)


@pytest.mark.slow
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
    assert "an episode of the environment does not depend on parameters and seed alone" in text
    assert "reset(seed=..) must seed all random numbers" in text


def test_an_audit_that_takes_long_is_announced(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(audit, "_ANNOUNCED_S", 0.01)
    with caplog.at_level(logging.INFO, logger="swarmwright"):
        run(Slow, tmp_path)
    assert any(text.startswith("audit: repeating ") for text in caplog.messages)


def test_beyond_the_least_number_an_audit_ends_with_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    method = {"kind": "random_search", "population": 50, "generations": 2}
    repeated = []
    for time_share in (0.0, 1.0):
        monkeypatch.setattr(audit, "_MAX_TIME_SHARE", time_share)
        folder = tmp_path / str(time_share)
        folder.mkdir()
        run(Slow, folder, method=method, faults={"audit": 0.5}, validate=False)
        found = Run.open(folder / "run").audit
        repeated.append(None if found is None else found["evaluations"])
    assert repeated == [30, 50]


def test_a_module_that_keeps_a_list_is_reported(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "tired.py").write_text(
        "import numpy as np\n"
        "from swarmwright.controllers.modules import Behaviour\n\n"
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
    assert "docs/how-to/plug-ins.md" in text
