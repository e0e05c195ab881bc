"""A simulation in Python gives one record, however it is computed, and that of the engine's where it is the
same."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, evaluate, optimize, resume
from tests.python.records import same_record
from tests.python.simulations import minisim
from tests.python.simulations.troubled import Alone, Drifting, Function, InTurn, Rule, Walk

HERE = Path(__file__).parent
PARAMETERS = {"placement": "random", "numAgents": 3, "numDefenders": 2, "maxSteps": 12}


def experiment(simulation: Any, **changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": simulation,
            "parameters": PARAMETERS,
            "controller": {"kind": "layered", "hidden": [5]},
            "method": {"population": 8, "generations": 2},
            "ranking": {"episodes": 3},
            **changes,
        }
    )


@pytest.fixture(scope="module")
def built_in(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The engine's run, which all others must equal."""
    folder = tmp_path_factory.mktemp("engine") / "run"
    return optimize(experiment("minisim"), servers="in-process", out=folder)


def test_the_sines_are_those_of_decision_002() -> None:
    a = np.linspace(-1, 1, 2**16 + 1, dtype=np.float32)
    assert abs(minisim.sin_pi(a) - np.sin(np.pi * a.astype(float))).max() <= 2e-7
    assert abs(minisim.cos_pi(a) - np.cos(np.pi * a.astype(float))).max() <= 2e-7


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
@pytest.mark.parametrize("servers", [1, 2])
def test_the_record_is_that_of_the_engine(mode: str, servers: int, built_in: Run, tmp_path: Path) -> None:
    run = optimize(experiment(minisim.Minisim, mode=mode), servers=servers, out=tmp_path / "run")
    same_record(run, built_in)
    assert {attempt.mode for attempt in run.attempts()} == {mode}


def test_in_this_process(built_in: Run, tmp_path: Path) -> None:
    run = optimize(experiment(minisim.Minisim), servers="in-process", out=tmp_path / "run")
    same_record(run, built_in)
    assert list(run.attempts()) == []


@pytest.mark.slow
def test_a_run_is_read_without_its_simulation_and_resumed_with_it(
    built_in: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "mine.py"
    source.write_text((HERE / "minisim.py").read_text())
    folder = tmp_path / "run"
    file = tmp_path / "x.yaml"
    experiment("minisim", method={"population": 8, "generations": 1}).save(file)
    file.write_text(
        file.read_text()
        .replace("simulation: minisim", "simulation: mine.py:Minisim")
        .replace("sensors: 4\n", "")
    )
    first = Experiment.load(file)
    assert (first.simulation, first.label, first.sensors) == (f"{source}:Minisim", "Minisim", 4)
    optimize(first, servers="in-process", out=folder)
    away = source.rename(tmp_path / "away.py")
    assert Run.open(folder).generations == 1
    away.rename(source)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    same_record(resume(folder, generations=2, servers=1), built_in)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_fitness_from_metrics(mode: str, tmp_path: Path) -> None:
    fitness = "arrived - caught - 0.01 * steps + 0.001 * distance"
    expected = optimize(experiment("minisim", fitness=fitness), servers="in-process", out=tmp_path / "engine")
    assert expected.metrics == ["arrived", "caught", "distance", "steps"]
    for servers in ("in-process", 1):
        one = experiment(minisim.Minisim, fitness=fitness, mode=mode)
        same_record(optimize(one, servers=servers, out=tmp_path / f"{servers}"), expected)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_agents_that_steer_themselves(mode: str) -> None:
    tuned = {"kind": "parameter_set", "parameters": {"drift": {"type": "real", "range": [-1, 1]}}}
    one = experiment(Drifting, parameters={}, controller=tuned, mode=mode)
    genomes = np.array([[0.1], [0.5], [0.8]], np.float32)
    here = evaluate(one, genomes, servers="in-process")
    assert evaluate(one, genomes, servers=1).tobytes() == here.tobytes()
    assert len(set(here)) == 3
    walk = {"kind": "parameter_set", "parameters": {"steps": {"type": "integer", "range": [1, 4]}}}
    with pytest.raises(
        InputError, match="parameter_set controls no agents, but agents of walk must be controlled"
    ):
        experiment(Walk, parameters={}, controller=walk)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_episodes_that_end_at_their_start(mode: str) -> None:
    tuned = {"kind": "parameter_set", "parameters": {"x": {"type": "real", "range": [-5, 5]}}}
    one = experiment(Function, parameters={}, controller=tuned, mode=mode)
    genomes = np.array([[0.5], [0.6], [0.9]], np.float32)
    here = evaluate(one, genomes, servers="in-process")
    assert here == pytest.approx([-1, 0, -9], abs=1e-5)
    assert evaluate(one, genomes, servers=1).tobytes() == here.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_simulations_without_sensors_and_actuators(mode: str, tmp_path: Path) -> None:
    tuned = {"kind": "parameter_set", "parameters": {"x": {"type": "real", "range": [-5, 5]}}}
    one = experiment(Rule, parameters={}, controller=tuned, mode=mode, fitness="fitness + 0 * steps")
    assert (one.sensors, one.actuators, one.genome_size) == (None, None, 1)
    genomes = np.array([[0.5], [0.6], [0.9]], np.float32)
    here = evaluate(one, genomes, servers="in-process")
    assert here == pytest.approx([-1, 0, -9], abs=1e-5)
    assert evaluate(one, genomes, servers=1).tobytes() == here.tobytes()
    run = optimize(one, servers=1, out=tmp_path / "run")
    same_record(run, optimize(one, servers="in-process", out=tmp_path / "here"))
    assert Experiment.load(tmp_path / "run" / "experiment.yaml").replace(seed=2).genome_size == 1
    with pytest.raises(
        InputError, match=r"controller\.kind: layered controls agents, but agents of rule control"
    ):
        experiment(Rule, parameters={})


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_agents_in_turn(mode: str) -> None:
    one = experiment(InTurn, parameters={"seed": 3}, mode=mode)
    genomes = np.random.default_rng(1).normal(size=(5, one.genome_size)).astype(np.float32)
    here = evaluate(one, genomes, servers="in-process")
    assert len(set(here)) == 5
    assert evaluate(one, genomes, servers=1).tobytes() == here.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["batched", "offloaded"])
def test_one_object_is_enough_where_there_can_be_no_other(mode: str) -> None:
    one = experiment(Alone, parameters={}, mode=mode)
    genomes = np.random.default_rng(1).normal(size=(5, one.genome_size)).astype(np.float32)
    assert np.isfinite(evaluate(one, genomes, servers=1)).all()
