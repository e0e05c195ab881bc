"""Machines of modules in Python on simulation servers: whose records are those of this process."""

import os
import shutil
import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, RunError, _engine, evaluate, optimize, resume, simulate
from swarmwright.runs.repeat import repeat
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.launched.starting import pack_code
from swarmwright.servers.evaluation.module_code import import_modules, names_of
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.servers.evaluation.through_broker import BrokerBackend
from swarmwright.servers.launchers import Specification
from swarmwright.servers.launchers._slot import Slot
from swarmwright.servers.launchers.process import ProcessOptions
from tests.python.cli.processes import gone
from tests.python.cli.test_services import events
from tests.python.controllers.modules.conftest import CODE, forget, written
from tests.python.records import same_record

MODULES = "parts/own.py:Wander,parts/own.py:Timer"
TEXT = """simulation: arena
parameters: {mission: aac, robot: e-puck-rm1.2, robots: 4, duration: 6}
controller:
  kind: modules
  behaviours: [parts/own.py:Wander, exploration]
  conditions: [parts/own.py:Timer, black_floor]
  states: 2
method: {kind: nnga, population: 8, generations: 3}
ranking: {episodes: 2}
validate: false
seed: 4
"""

pytestmark = pytest.mark.usefixtures("place")


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    written(tmp_path / "parts")
    (tmp_path / "wander.yaml").write_text(TEXT)
    return Experiment.load(tmp_path / "wander.yaml")


@pytest.fixture
def here(experiment: Experiment, tmp_path: Path) -> Run:
    return optimize(experiment, out=tmp_path / "here", progress=False)


def genomes(experiment: Experiment, count: int = 12) -> Any:
    representation = experiment.representation(9, 2)
    lower, upper = representation.bounds
    return np.random.default_rng(3).uniform(lower, upper, (count, len(lower))).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize("servers", [1, 2, "process:2"])
def test_the_record_is_that_of_this_process(
    servers: int | str, experiment: Experiment, here: Run, tmp_path: Path
) -> None:
    run = optimize(experiment, out=tmp_path / "there", servers=servers, progress=False)
    same_record(run, here)
    assert {attempt.mode for attempt in run.attempts()} == {"offloaded"}


@pytest.mark.slow
@pytest.mark.parametrize("form", ["machine", "tree"])
def test_any_number_of_servers_gives_the_same_bits(form: str, experiment: Experiment) -> None:
    changes = {"form": "tree", "transitions": 1} if form == "tree" else {}
    one = experiment.replace(controller=changes)
    expected = evaluate(one, genomes(one))
    assert len(set(expected)) > 3
    for servers in (1, 3):
        assert evaluate(one, genomes(one), servers=servers).tobytes() == expected.tobytes()


@pytest.mark.slow
def test_metrics_and_fitness_expressions_are_those_of_this_process(experiment: Experiment) -> None:
    one = experiment.replace(fitness="on_black - order / 2")
    expected = evaluate(one, genomes(one))
    assert evaluate(one, genomes(one), servers=2).tobytes() == expected.tobytes()


@pytest.mark.slow
def test_servers_that_were_started_by_hand_evaluate(
    start: Any, any_broker: str, experiment: Experiment, here: Run, tmp_path: Path
) -> None:
    serving = start(
        "serve", "arena", "--modules", MODULES, "--broker", any_broker, "--id", "60", "--count", "2", "--json"
    )
    assert {event["server"] for event in events(serving, "ready", 2)} == {60, 61}
    (one, _) = _engine.servers(any_broker)
    announced = one["capabilities"]["swarmwright"]
    assert announced["controllers"][-1] == "python_modules"
    known = {(each["role"], each["name"], each["file"]) for each in announced["modules"]}
    assert known == {("behaviour", "Wander", "own.py"), ("condition", "Timer", "own.py")}
    run = optimize(experiment, out=tmp_path / "there", broker=any_broker, progress=False)
    same_record(run, here)
    best = run.best.controller
    assert simulate(experiment, best, broker=any_broker, seed=7) == simulate(experiment, best, seed=7)
    # What the engine computes is evaluated as ever.
    plain = Experiment.from_mapping(
        {"simulation": "arena", "parameters": experiment.parameters, "controller": {"kind": "evostick"}}
    )
    rows = (
        np.random.default_rng(1).normal(size=(5, plain.representation(9, 2).genome_size)).astype(np.float32)
    )
    assert evaluate(plain, rows, broker=any_broker).tobytes() == evaluate(plain, rows).tobytes()
    serving.send_signal(signal.SIGTERM)
    _, err = serving.communicate(timeout=15)
    assert (serving.returncode, err) == (0, "")


@pytest.mark.slow
def test_a_server_says_what_it_offers(start: Any, embedded_broker: str, experiment: Experiment) -> None:  # noqa: ARG001
    serving = start("serve", "arena", "--modules", MODULES, "--broker", embedded_broker)
    assert "is ready: arena with Wander, Timer on" in serving.stdout.readline()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("modules", "words"),
    [
        ("parts/own.py:Wandre", "has no class 'Wandre'; did you mean 'Wander'?"),
        ("parts/none.py:Wander", "there is no such file"),
        (
            "wandering",
            "modules: 'wandering' is unknown (no module is installed); for a module in a file, write",
        ),
        ("exploration", "modules: 'exploration' is built in; every server has it"),
    ],
)
def test_modules_that_are_not_there_are_named_before_a_server_starts(
    modules: str,
    words: str,
    program: Any,
    experiment: Experiment,  # noqa: ARG001
) -> None:
    result = program("serve", "arena", "--modules", modules, "--broker", "mqtt://127.0.0.1:9")
    assert result.returncode == 2
    assert words in result.stderr


@pytest.mark.slow
def test_a_server_without_the_modules_is_not_used(
    start: Any, embedded_broker: str, experiment: Experiment
) -> None:
    serving = start("serve", "arena", "--broker", embedded_broker, "--id", "5", "--json")
    events(serving, "ready")
    one = experiment.replace(timeouts={"discovery": 1})
    with pytest.raises(RunError) as error:
        evaluate(one, genomes(one, 2), broker=embedded_broker)
    assert "server 5: has no behaviour 'own.py:Wander'; start it with --modules own.py:Wander" in str(
        error.value
    )


@pytest.mark.slow
def test_a_server_with_other_code_is_not_used(
    start: Any, embedded_broker: str, experiment: Experiment, tmp_path: Path
) -> None:
    written(tmp_path / "other/parts", speed="SPEED = 0.25\n")
    names = MODULES.replace("parts", "other/parts")
    serving = start("serve", "arena", "--modules", names, "--broker", embedded_broker, "--id", "6", "--json")
    events(serving, "ready")
    one = experiment.replace(timeouts={"discovery": 1})
    with pytest.raises(RunError) as error:
        evaluate(one, genomes(one, 2), broker=embedded_broker)
    assert "server 6: has different code for behaviour 'own.py:Wander' (SHA-256 " in str(error.value)
    # Beside one that has the code it gets no work.
    right = start("serve", "arena", "--modules", MODULES, "--broker", embedded_broker, "--id", "7", "--json")
    events(right, "ready")
    expected = evaluate(experiment, genomes(experiment))
    assert evaluate(experiment, genomes(experiment), broker=embedded_broker).tobytes() == expected.tobytes()
    # One that has both takes the right one.
    right.send_signal(signal.SIGTERM)
    right.wait(15)
    both = start(
        *("serve", "arena", "--modules", names, "--modules", MODULES, "--broker", embedded_broker),
        *("--id", "8", "--json"),
    )
    events(both, "ready")
    assert evaluate(experiment, genomes(experiment), broker=embedded_broker).tobytes() == expected.tobytes()


@pytest.mark.slow
def test_a_killed_server_does_not_change_the_record(
    experiment: Experiment, here: Run, tmp_path: Path
) -> None:
    killed: list[int] = []

    def kill(record: Any) -> None:
        if record.generation in {0, 1}:
            from swarmwright.servers.supervision.local_servers import _running

            (servers,) = _running.values()
            killed.append(servers.pids[0])
            os.kill(killed[-1], signal.SIGKILL)

    run = optimize(experiment, kill, out=tmp_path / "there", servers=2, progress=False)
    same_record(run, here)
    assert killed
    assert gone(killed)


def failing(condition: str) -> str:
    line = "        turning = state[:, 0] > 0\n"
    assert line in CODE
    return CODE.replace(line, f"        if {condition}:\n            raise ValueError('no wheels')\n{line}")


@pytest.mark.slow
def test_a_module_that_fails_is_reported_with_file_and_line(
    start: Any, embedded_broker: str, tmp_path: Path
) -> None:
    written(tmp_path / "parts", failing("True"))
    (tmp_path / "wander.yaml").write_text(TEXT)
    one = Experiment.load(tmp_path / "wander.yaml")
    serving = start("serve", "arena", "--modules", MODULES, "--broker", embedded_broker, "--json")
    events(serving, "ready")
    rows = genomes(one)
    rows[:, 1] = 0  # all begin with Wander
    assert np.isnan(evaluate(one, rows, broker=embedded_broker)).all()
    (failure,) = events(serving, "failure")
    assert failure["message"] == "parts/own.py:16: Wander: act: ValueError: no wheels"
    assert failure["traceback"].startswith("Traceback (most recent call last):\n")
    assert "raise ValueError('no wheels')" in failure["traceback"]
    assert "swarmwright/controllers" not in failure["traceback"]
    run = optimize(one, out=tmp_path / "run", broker=embedded_broker, progress=False)
    failed = [attempt for attempt in run.attempts() if attempt.error]
    assert failed
    for attempt in failed:
        assert attempt.error is not None
        assert attempt.error.endswith("parts/own.py:16: Wander: act: ValueError: no wheels")
    assert any("raise ValueError('no wheels')" in (attempt.stack or "") for attempt in failed)
    # The server goes on.
    rows[:, 1] = 1
    rows[:, 0] = 1
    assert np.isfinite(evaluate(one, rows, broker=embedded_broker)).all()


@pytest.mark.slow
def test_only_episodes_whose_module_fails_fail(experiment: Experiment, tmp_path: Path) -> None:
    rows = genomes(experiment, 40)
    expected = evaluate(experiment, rows)
    written(tmp_path / "parts", failing("(parameters['chance'] > 0.4).any()"))
    forget()
    one = Experiment.load(tmp_path / "wander.yaml")
    with pytest.raises(RunError, match="no wheels"):
        evaluate(one, rows)
    found = evaluate(one, rows, servers=2)
    fails = np.isnan(found)
    assert 0 < fails.sum() < len(rows)
    assert found[~fails].tobytes() == expected[~fails].tobytes()


@pytest.mark.slow
def test_a_run_goes_on_and_is_repeated_on_servers(experiment: Experiment, here: Run, tmp_path: Path) -> None:
    short = optimize(
        experiment.replace(method={"generations": 2}), out=tmp_path / "there", servers=1, progress=False
    )
    # The code of the run is that of its folder.
    shutil.rmtree(tmp_path / "parts")
    forget()
    longer = resume(short.path, settings=["method.generations=3"], servers=2, progress=False)
    assert longer.history == here.history
    forget()
    assert repeat(Run.open(short.path), generation=1, candidate=2, servers=1).same


@pytest.mark.slow
def test_servers_elsewhere_get_the_code(experiment: Experiment, embedded_broker: str) -> None:
    """As workers of a cluster do: the code is unpacked in a folder of its own."""
    expected = evaluate(experiment, genomes(experiment))
    architecture = experiment.representation(9, 2).architecture()
    name, modules, code = pack_code("arena", names_of([architecture]), ProcessOptions())
    slot = Slot(Specification(name, embedded_broker, code=code, modules=modules), 3, None)
    beside = threading.Thread(target=slot.run)
    beside.start()
    try:
        assert (
            evaluate(experiment, genomes(experiment), broker=embedded_broker).tobytes() == expected.tobytes()
        )
    finally:
        slot.stop()
        beside.join(20)
    assert not beside.is_alive()


@pytest.mark.slow
def test_installed_modules_are_offered_by_their_names(own: Path, experiment: Experiment) -> None:
    one = experiment.replace(
        controller={"behaviours": ["wander", "stop"], "conditions": ["timer", "black_floor"]}
    )
    expected = evaluate(one, genomes(one))
    environment = dict(os.environ)
    os.environ["PYTHONPATH"] = f"{own.parent}:{environment.get('PYTHONPATH', '')}"
    try:
        found = evaluate(one, genomes(one), servers=2)
    finally:
        os.environ.clear()
        os.environ.update(environment)
    assert found.tobytes() == expected.tobytes()
    assert set(import_modules(["wander", "timer"])) == {("behaviour", "wander"), ("condition", "timer")}


@pytest.mark.slow
def test_simulations_in_python_have_machines_too(tmp_path: Path) -> None:
    """An episode that fails once, the second one of a process, is repeated everywhere."""
    written(tmp_path / "parts")
    (tmp_path / "track.py").write_text(
        '''"""Robots on a line."""

import numpy as np
from swarmwright import Simulation


class Track(Simulation):
    title, dimensions, sensors, actuators = "track", 1, 9, 2
    episodes = 0

    def reset(self, parameters, seed):
        Track.episodes += 1
        self.random = np.random.default_rng(seed)
        self.x, self.left = np.zeros(3), 10
        return self.seen()

    def seen(self):
        rows = np.zeros((3, 9))
        rows[:, 8] = self.random.random(3)
        rows[:, 4] = self.x > 1
        return rows

    def step(self, actions):
        if Track.episodes == 2:
            raise ValueError("not yet")
        self.x += actions.sum(axis=1)
        self.left -= 1
        return self.seen()

    def done(self):
        return self.left == 0

    def fitness(self):
        return float(np.abs(self.x).sum())
'''
    )
    one = Experiment.from_mapping(
        {
            "simulation": f"{tmp_path}/track.py:Track",
            "controller": {
                "kind": "modules",
                "behaviours": [f"{tmp_path}/parts/own.py:Wander", "stop"],
                "conditions": [f"{tmp_path}/parts/own.py:Timer"],
                "states": 2,
            },
        }
    )
    expected = evaluate(one, genomes(one))
    assert len(set(expected)) > 2
    assert np.isfinite(expected).all()
    assert evaluate(one, genomes(one), servers=2).tobytes() == expected.tobytes()


def test_what_servers_cannot_do_is_refused(experiment: Experiment) -> None:
    for mode in ("stepwise", "batched"):
        with pytest.raises(
            InputError, match=f"mode: {mode} is not possible: behaviours and conditions in Python run in"
        ):
            evaluate(experiment.replace(mode=mode), genomes(experiment), servers=1)
    with pytest.raises(InputError, match="visual: behaviours and conditions in Python"):
        simulate(experiment, visual=True, servers=1)


@pytest.mark.slow
def test_pieces_are_large_enough_for_numpy(experiment: Experiment) -> None:
    one = experiment.replace(parameters={"duration": 2})
    with open_backend(one, servers=1) as backend:
        assert isinstance(backend, BrokerBackend)
        controllers = Controllers.from_genomes(one.representation(9, 2), genomes(one, 600))
        results = backend.evaluate(controllers, [1], lambda *_: None)
        sizes = sorted(attempt.candidates for attempt in results.journal.attempts)
    assert sizes[-1] >= 64
