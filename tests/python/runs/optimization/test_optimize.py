"""Whole runs: the goal is reached, the record does not depend on who evaluated, nothing is left behind."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import (
    Experiment,
    Generation,
    InputError,
    Run,
    RunError,
    Simulation,
    evaluate,
    evaluate_episodes,
    optimize,
    repeat,
    resume,
    simulate,
)
from swarmwright.runs import picture
from swarmwright.runs.optimization.optimize import leave_reports_to_caller
from swarmwright.simulations import catalogue
from tests.python.records import same_record

SMALL: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"maxSteps": 6},
    "method": {"population": 12, "generations": 3},
    "timeouts": {"discovery": 5, "step": 10},
}


def small(**changes: Any) -> Experiment:
    return Experiment.from_mapping(SMALL | changes)


def test_the_published_example_reaches_the_goal(root: Path, tmp_path: Path) -> None:
    run = optimize(
        Experiment.load(root / "experiments" / "minisim.yaml"), servers="local", out=tmp_path / "run"
    )
    assert run.best.fitness == 0
    assert run.generations <= 20


def test_a_run_begins_where_its_simulation_cannot_be_described(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> Any:
        raise KeyError("the environment's own error")

    monkeypatch.setattr(catalogue, "channels", fails)
    run = optimize(small(), servers="local", out=tmp_path / "run")
    assert run.state == "done"
    assert run._store.channels() is None


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The run that all others must equal."""
    return optimize(small(), servers="local", out=tmp_path_factory.mktemp("local") / "run")


@pytest.mark.slow
@pytest.mark.parametrize("servers", [1, 2, 8])
def test_the_record_is_the_same_bytes_on_any_number_of_servers(
    servers: int, any_broker: str, expected: Run, tmp_path: Path
) -> None:
    run = optimize(small(), broker=any_broker, servers=servers, out=tmp_path / "run")
    same_record(run, expected)
    episodes = [vars(attempt) for attempt in run.attempts()]
    assert sum(entry["candidates"] * entry["episodes"] for entry in episodes) >= run.evaluations
    assert 1 <= len({entry["server"] for entry in episodes}) <= servers


@pytest.mark.slow
def test_without_a_broker_one_is_started(expected: Run, tmp_path: Path) -> None:
    run = optimize(small(), servers=2, out=tmp_path / "run")
    assert run.digest == expected.digest


def test_another_seed_is_another_run(expected: Run, tmp_path: Path) -> None:
    run = optimize(small(), servers="local", seed=2, out=tmp_path / "run")
    assert run.digest != expected.digest
    assert run.experiment.seed == 2


@pytest.mark.slow
def test_callbacks_tell_how_far_it_is(tmp_path: Path) -> None:
    generations: list[Generation] = []
    progress: list[tuple[int, int, str]] = []
    run = optimize(
        small(ranking={"episodes": 2}),
        generations.append,
        on_progress=lambda *now: progress.append(now),
        servers=2,
        out=tmp_path / "run",
    )
    assert [one.generation for one in generations] == [0, 1, 2]
    assert [one.evaluations for one in generations] == [one.evaluations for one in run.history]
    assert [one.seconds_left > 0 for one in generations] == [True, True, False]
    assert all(one.evaluations_per_second > 0 for one in generations)
    assert generations[-1].best_so_far == run.best.fitness
    assert progress
    assert all(0 <= done <= total and total in {24, 14} for done, total, _ in progress)


def test_a_callback_can_end_it(tmp_path: Path) -> None:
    run = optimize(
        small(), lambda generation: generation.generation < 1, servers="local", out=tmp_path / "run"
    )
    assert run.generations == 2
    assert not run.interrupted


def test_an_experiment_may_be_a_mapping(tmp_path: Path) -> None:
    values = small().to_mapping()
    run = optimize(values, servers="local", out=tmp_path / "run")
    assert run.digest == optimize(small(), servers="local", out=tmp_path / "other").digest
    genomes = run.record.genomes[:3]
    found = evaluate(values, genomes, servers="local")
    assert found.tolist() == run.record.fitness[:3].tolist()
    assert evaluate_episodes(values, genomes, servers="local").fitness.tolist() == found.tolist()
    assert simulate(values, run.best.controller, servers="local") == simulate(
        run.experiment, run.best.controller, servers="local"
    )
    assert repeat(run, experiment=values, servers="local").same
    with pytest.raises(InputError, match=r"method\.populaton: unknown key"):
        optimize({"simulation": "minisim", "method": {"populaton": 3}})


@pytest.mark.slow
def test_an_interrupt_is_told_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def interrupt(generation: Generation) -> None:
        if generation.generation == 1:
            raise KeyboardInterrupt

    run = optimize(small(), interrupt, servers="local", out=tmp_path / "run")
    assert run.state == "interrupted"
    call = f"swarmwright.resume({str(run.path)!r})"
    assert caplog.messages == [
        f"{run.path}: interrupted after generation 1; finished generations are kept; continue with {call}"
    ]
    caplog.clear()
    with leave_reports_to_caller():
        optimize(small(), interrupt, servers="local", out=tmp_path / "quiet")
    assert resume(run).state == "done"
    assert not caplog.messages


def test_interrupted_before_the_first_generation_it_leaves_nothing(tmp_path: Path) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        optimize(small(), on_progress=interrupt, servers="local", out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_failure_before_the_first_generation_is_told_as_it_is(tmp_path: Path) -> None:
    """It is not its own cause: whoever looks for what it came of would look for ever."""
    failure = RunError("no server can do this work")

    def fail(*_: object) -> None:
        raise failure

    with pytest.raises(RunError) as caught:
        optimize(small(), on_progress=fail, servers="local", out=tmp_path / "run")
    assert caught.value is failure
    assert caught.value.__cause__ is None


def test_a_target_ends_it(tmp_path: Path) -> None:
    experiment = small(method={"population": 12, "generations": 3, "target": -1000.0})
    assert optimize(experiment, servers="local", out=tmp_path / "run").generations == 1


SCRIPT = """
    import sys
    import swarmwright
    experiment = swarmwright.Experiment.from_mapping({
        "simulation": "minisim",
        "parameters": {"placement": "random", "numAgents": 3},
        "method": {"generations": 1_000_000},
        "ranking": {"episodes": 2},
    })

    def tell(generation):
        # One call, so that no signal comes between a number and the end of its line.
        sys.stdout.write(f"{generation.generation}\\n")
        sys.stdout.flush()

    if __name__ == "__main__":
        run = swarmwright.optimize(experiment, tell, servers=2, out=sys.argv[1])
        print("kept", run.interrupted, run.generations, run.best.fitness, flush=True)
"""


def children(parent: int) -> list[int]:
    text = Path(f"/proc/{parent}/task/{parent}/children").read_text()
    return [int(child) for child in text.split()]


def alive(pid: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def start_script(tmp_path: Path) -> "subprocess.Popen[str]":
    (tmp_path / "script.py").write_text(textwrap.dedent(SCRIPT))
    process = subprocess.Popen(
        [sys.executable, tmp_path / "script.py", tmp_path / "run"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    while process.stdout.readline().strip() != "2":
        assert process.poll() is None, process.communicate()[1]
    return process


def gone(pids: list[int], seconds: float = 8) -> bool:
    deadline = time.monotonic() + seconds
    while any(map(alive, pids)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not any(map(alive, pids))


@pytest.mark.slow
@pytest.mark.usefixtures("plots")
def test_ctrl_c_keeps_the_results_so_far(tmp_path: Path) -> None:
    process = start_script(tmp_path)
    servers = children(process.pid)
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert time.monotonic() - began < 10
    assert process.returncode == 0, err
    assert "Traceback" not in err
    words = out.splitlines()[-1].split()
    assert words[:2] == ["kept", "True"]
    run = Run.open(tmp_path / "run")
    assert run.interrupted
    assert run.generations == int(words[2]) >= 3
    assert len(run.record.fitness) == run.evaluations
    assert (tmp_path / "run" / "fitness.png").exists()
    assert len(servers) == 2
    assert gone(servers)


@pytest.mark.slow
def test_a_killed_run_leaves_its_results_and_no_servers(tmp_path: Path) -> None:
    process = start_script(tmp_path)
    servers = children(process.pid)
    process.kill()
    process.communicate()
    run = Run.open(tmp_path / "run")
    assert run.interrupted
    assert run.generations >= 3
    assert (
        evaluate(run.experiment, run.record.genomes[:20], servers="local").tolist()
        == run.record.fitness[:20].tolist()
    )
    assert len(servers) == 2
    assert gone(servers)


@pytest.mark.slow
@pytest.mark.usefixtures("plots")
def test_a_server_that_dies_is_started_again(tmp_path: Path) -> None:
    def kill_one(generation: Generation) -> None:
        if generation.generation == 0:
            os.kill(children(os.getpid())[0], signal.SIGKILL)

    # Step by step and long enough that the death is noticed before the run is over.
    experiment = small(
        mode="stepwise",
        parameters={"maxSteps": 200, "numDefenders": 0, "speedAgents": 0.01},
        method={"population": 12, "generations": 8},
        timeouts={"step": 1, "discovery": 5},
    )
    local = optimize(experiment, servers="local", out=tmp_path / "local")
    picture.wait()  # its process is a child, too
    run = optimize(experiment, kill_one, servers=2, out=tmp_path / "run")
    assert run.digest == local.digest
    assert any(
        "a simulation server was killed by SIGKILL; it is started again" in e.text for e in run.events()
    )


@pytest.mark.slow
@pytest.mark.usefixtures("plots")
def test_when_all_servers_die_they_are_started_again(tmp_path: Path) -> None:
    def kill_all(_: Generation) -> None:
        for child in children(os.getpid()):
            os.kill(child, signal.SIGKILL)

    expected = optimize(small(), servers="local", out=tmp_path / "expected")
    picture.wait()  # its process is a child, too
    run = optimize(small(), kill_all, servers=1, out=tmp_path / "run")
    assert run.digest == expected.digest
    picture.wait()
    assert not children(os.getpid())


def test_no_broker_there(unused_port: int, tmp_path: Path) -> None:
    address = f"127.0.0.1:{unused_port}"
    with pytest.raises(RunError, match=address):
        optimize(small(), broker=f"mqtt://{address}", out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_broker_that_refuses_the_password(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from swarmwright import _engine

    (tmp_path / "users").write_text(f"ada:{_engine.hash_password('s3cret')}\n")
    broker = _engine.Broker(users=str(tmp_path / "users"))
    try:
        monkeypatch.setenv("SWARMWRIGHT_USERNAME", "ada")
        monkeypatch.setenv("SWARMWRIGHT_PASSWORD", "wr0ng")
        with pytest.raises(RunError, match="refuses") as caught:
            simulate(small(), broker=broker.url, servers=1)
        assert "SWARMWRIGHT_PASSWORD" in str(caught.value)
        assert "wr0ng" not in str(caught.value)
        monkeypatch.setenv("SWARMWRIGHT_PASSWORD", "s3cret")
        run = optimize(small(), broker=broker.url, servers=1, out=tmp_path / "run")
    finally:
        broker.stop()
    for file in run.path.iterdir():
        assert b"s3cret" not in file.read_bytes(), file


@pytest.mark.slow
def test_requirements_that_no_server_fulfils(embedded_broker: str, start: Any) -> None:
    process = start("serve", "minisim", "--broker", embedded_broker, "--count", "1", "--json")
    assert json.loads(process.stdout.readline())["event"] == "ready"
    experiment = small(requirements={"dimensions": 3}, timeouts={"discovery": 2})
    with pytest.raises(RunError, match=r"required: .*3 dimensions.*found: .*2 dimensions"):
        simulate(experiment, broker=embedded_broker)


def test_requirements_that_what_is_started_here_cannot_fulfil(embedded_broker: str) -> None:
    experiment = small(requirements={"dimensions": 3})
    with pytest.raises(InputError, match="requirements: minisim has 2 dimensions, not 3"):
        simulate(experiment, broker=embedded_broker, servers=1)


@pytest.mark.slow
def test_no_server_fits(any_broker: str, tmp_path: Path) -> None:
    experiment = small(timeouts={"discovery": 0.5})
    with pytest.raises(RunError, match="minisim"):
        optimize(experiment, broker=any_broker, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_near_miss_that_no_server_offers(embedded_broker: str) -> None:
    experiment = small(
        simulation="minisym", parameters={}, sensors=4, actuators=1, timeouts={"discovery": 0.5}
    )
    with pytest.raises(RunError, match=r"minisym.*did you mean 'minisim'\?"):
        simulate(experiment, broker=embedded_broker)


@pytest.mark.parametrize("servers", ["local", 2, "auto"])
def test_an_unknown_simulation_without_a_broker(servers: Any, tmp_path: Path) -> None:
    experiment = small(simulation="minisym", parameters={})
    with pytest.raises(
        InputError, match=r"unknown simulation 'minisym'; did you mean 'minisim'\? available: .*minisim"
    ):
        optimize(experiment, servers=servers, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_local_and_a_broker_exclude_each_other() -> None:
    with pytest.raises(InputError, match="cannot be combined with servers: local"):
        evaluate(small(), np.zeros((1, 49)), servers="local", broker="mqtt://localhost")
    with pytest.raises(InputError, match="broker: must begin with one of"):
        evaluate(small(), np.zeros((1, 49)), broker="localhost")


WANDERER = """
import os
from swarmwright import Simulation


class Wanderer(Simulation):
    title, sensors, actuators = "wanderer", 2, 1
    metrics = ("episode", "seed")

    def reset(self, parameters, seed):
        os.chdir("/")
        self.result = None
        return [[0.5, -0.5]]

    def step(self, actuators):
        self.result = float(actuators[0][0])
        return [[0.5, -0.5]]

    def done(self):
        return self.result is not None

    def fitness(self):
        return self.result

    def measure(self):
        return {"episode": 1.0, "seed": 2.0}
"""


def test_a_simulation_that_changes_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wanderer.py").write_text(WANDERER)
    monkeypatch.chdir(tmp_path)
    experiment = Experiment.from_mapping(
        {
            "simulation": "wanderer.py:Wanderer",
            "controller": {"kind": "layered", "hidden": []},
            "method": {"population": 4, "generations": 3},
            "ranking": {"episodes": 2},
            "fitness": "fitness + episode + seed",
            "servers": "in-process",
        }
    )
    part = optimize(experiment, lambda now: now.generation < 1, out="run")
    assert (part.path, part.generations) == (tmp_path / "run", 2)
    monkeypatch.chdir(tmp_path)
    run = resume("run")
    assert (run.path, run.generations, run.state) == (tmp_path / "run", 3, "done")
    monkeypatch.chdir(tmp_path)
    run = resume("run", generations=5)  # whose experiment is written with the place of the class's copy
    assert (run.generations, run.state) == (5, "done")
    assert run.experiment.simulation == str(tmp_path / "run/code/1/simulation/wanderer.py:Wanderer")
    # Metrics with the names of other columns have others in tables.
    metrics = ["metric_episode_0", "metric_episode_1", "metric_seed_0", "metric_seed_1"]
    assert list(run.record)[3:9] == ["episode_0", "episode_1", *metrics]
    run.export(tmp_path / "run.csv")
    header = (tmp_path / "run.csv").read_text().splitlines()[0].split(",")
    assert header == list(run.record)
    assert len(set(header)) == len(header)


def test_an_environment_that_takes_other_parameters_is_refused_before_there_is_a_folder(
    tmp_path: Path,
) -> None:
    pytest.importorskip("gymnasium")
    values = {
        "simulation": "gymnasium:Pendulum-v1",
        "parameters": {"gg": 5},
        "method": SMALL["method"],
        "servers": "local",
    }
    with pytest.raises(
        InputError, match=r"parameters: gg: .* keyword argument 'gg'.*; its constructor takes g$"
    ):
        optimize(Experiment.from_mapping(values), out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


class Broken(Simulation):
    """Cannot begin an episode."""

    sensors = actuators = 1

    def reset(self, _parameters: dict[str, Any], _seed: int) -> Any:
        raise ValueError("not yet")

    def step(self, _actions: Any) -> Any:
        raise NotImplementedError

    def done(self) -> bool:
        return False

    def fitness(self) -> float:
        return 0.0


def test_a_run_without_a_finished_generation_is_replaced(tmp_path: Path) -> None:
    out = tmp_path / "run"
    values = {"method": SMALL["method"], "servers": "in-process"}
    with pytest.raises(RunError):
        optimize(Experiment.from_mapping({"simulation": Broken, **values}), out=out)
    assert (out / "run.sqlite").exists()
    run = optimize(Experiment.from_mapping({"simulation": "minisim", **values}), out=out)
    assert run.experiment.simulation == "minisim"
    with pytest.raises(InputError, match="already holds a run, and results are never overwritten"):
        optimize(run.experiment, out=out)


def test_a_run_without_a_finished_generation_beside_other_files_stays(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    broken = Experiment.from_mapping(
        {"simulation": Broken, "method": SMALL["method"], "servers": "in-process"}
    )
    out = tmp_path / "run"
    for _ in range(3):
        with pytest.raises(RunError):
            optimize(broken, out=out)
    assert caplog.text.count("replacing a run without finished generations") == 2
    for foreign in (out / "notes.txt", out / "code" / "notes.txt"):
        foreign.write_text("mine")
        before = sorted(out.rglob("*"))
        with pytest.raises(InputError, match="already holds a run, and results are never overwritten"):
            optimize(broken, out=out)
        assert sorted(out.rglob("*")) == before
        foreign.unlink()
    with pytest.raises(RunError):
        optimize(broken, out=out)


def test_a_folder_that_cannot_be_used_is_an_error_of_the_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be used for results: File name too long"):
        optimize(Experiment.from_mapping({"simulation": "minisim"}), out=tmp_path / ("x" * 300))
