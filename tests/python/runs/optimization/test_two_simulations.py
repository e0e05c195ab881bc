"""Runs that evaluate some candidates in a second, slow simulation: whole, resumed, with killed servers."""

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, RunError, optimize, post_evaluate, resume
from tests.python.records import same_record

SLOW: dict[str, Any] = {"name": "harder", "parameters": {"numDefenders": 5, "speedDefenders": 0.8}}
VALUES: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 3, "numDefenders": 3, "placement": "random", "speedDefenders": 0.3},
    "method": {"kind": "nnga", "population": 16, "generations": 6},
    "ranking": {"kind": "multi_fidelity", "slow": SLOW, "share": 0.2, "episodes": 3, "seeds": "new"},
    "servers": "local",
    "validate": {"episodes": 20, "candidates": 2},
}
FRAGILE = """
from swarmwright import Simulation


class Fragile(Simulation):
    sensors, actuators = 4, 1
    parameters = {}

    def reset(self, parameters, seed):
        self.result = None
        return [[0.5, -0.5, 0.25, seed % 5 / 5]]

    def step(self, actuators):
        self.result = float(actuators[0][0])
        if self.result > ABOVE:
            raise ValueError("the motor is too hot")
        return [[0.5, -0.5, 0.25, 0.5]]

    def done(self):
        return self.result is not None

    def fitness(self):
        return self.result
"""


def experiment(**changes: Any) -> Experiment:
    return Experiment.from_mapping({**VALUES, **changes})


def ranking(**changes: Any) -> dict[str, Any]:
    return {**VALUES["ranking"], **changes}


def in_harder(run: Run) -> Experiment:
    """The experiment that has the slow simulation as its own."""
    return run.experiment.replace(ranking={"kind": "absolute", "episodes": 3}, parameters=SLOW["parameters"])


def made(method: str, folder: Path, **changes: Any) -> Run:
    options = {"kind": method, "population": 16, "generations": 6}
    return optimize(experiment(method=options, **changes), out=folder / "run")


@pytest.fixture(scope="module", params=["nnga", "cma_es", "snes", "random_search"])
def ranked(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """An undisturbed run of two fidelities; the engine would evolve all but the first by itself."""
    return made(request.param, tmp_path_factory.mktemp("ranked"))


TRANSFERABILITY: dict[str, Any] = {
    "kind": "transferability",
    "slow": SLOW,
    "threshold": 0.5,
    "transfers": 3,
    "episodes": 3,
    "seeds": "new",
}


@pytest.fixture(scope="module", params=["multi_fidelity", "transferability"])
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """An undisturbed run with one of the rankings."""
    values = VALUES["ranking"] if request.param == "multi_fidelity" else TRANSFERABILITY
    return made("nnga", tmp_path_factory.mktemp("whole"), ranking=values)


def test_the_record_has_what_both_simulations_said(ranked: Run) -> None:
    record = ranked.record
    assert ranked.metrics == ["slow_fitness"]
    slow = record.metrics[:, :, 0]
    harder = ranked.experiment.replace(
        ranking={"kind": "absolute", "episodes": 3}, parameters=SLOW["parameters"]
    )
    for generation in range(ranked.generations):
        rows = np.flatnonzero(record.generation == generation)
        count_measured = [row for row in rows if np.isfinite(slow[row]).all()]
        assert len(count_measured) == max(1, math.floor(0.2 * len(rows) + 0.5))
        fast = record.episodes[rows].mean(axis=1)
        assert fast[np.isin(rows, count_measured)].min() >= fast[~np.isin(rows, count_measured)].max() - 1e-9
        for row in count_measured:
            assert record.fitness[row] == pytest.approx(slow[row].mean())
        seeds = ranked.seeds(generation)
        again = post_evaluate(
            ranked, int(count_measured[0] - rows[0]), generation, experiment=harder, episodes=3, seed=seeds[0]
        )
        assert again.episodes.tolist() == slow[count_measured[0]].tolist(), "the same seeds"
    best = ranked.evaluation()
    assert np.isfinite(slow[best.number]).all()
    assert ranked.best.fitness == record.fitness.max()
    assert ranked.slow_evaluations == int(np.isfinite(slow).all(axis=1).sum())


def test_disparities_are_learned(tmp_path: Path) -> None:
    run = made("cma_es", tmp_path, ranking={**TRANSFERABILITY, "every": 2})
    record = run.record
    assert run.metrics == ["arrived", "caught", "distance", "steps", "slow_fitness"]
    slow = record.metrics[:, :, -1]
    count_measured = np.asarray(np.isfinite(slow).all(axis=1))
    counts = [
        int(count_measured[record.generation == generation].sum()) for generation in range(run.generations)
    ]
    assert counts == [3, 0, 3, 0, 3, 0]
    fast = record.episodes.mean(axis=1)
    disparity = np.abs(slow.mean(axis=1) - fast)
    expected = fast - np.maximum(0, disparity - 0.5)
    assert record.fitness[count_measured] == pytest.approx(expected[count_measured])
    assert (record.fitness[~count_measured] <= fast[~count_measured]).all()
    assert (record.fitness[~count_measured] < fast[~count_measured] - 0.01).any(), (
        "some are predicted not to transfer"
    )
    assert count_measured[run.evaluation().number]
    assert run.best.fitness == record.fitness.max()


@pytest.mark.slow
def test_the_descriptor_may_be_metrics_that_the_fitness_needs(tmp_path: Path) -> None:
    few = {**TRANSFERABILITY, "descriptor": ["steps", "arrived"]}
    run = made("nnga", tmp_path, ranking=few, fitness="arrived - 0.01 * distance")
    assert run.metrics == ["arrived", "distance", "steps", "slow_fitness"]
    part = optimize(run.experiment, lambda now: now.generation < 2, out=tmp_path / "part")
    same_record(resume(part, servers=2), run)


@pytest.mark.slow
def test_a_simulation_without_metrics_is_described_by_its_fitness(tmp_path: Path) -> None:
    (tmp_path / "fragile.py").write_text(f"ABOVE = 2\n{FRAGILE}")
    simulation = f"{tmp_path}/fragile.py:Fragile"
    values = {**TRANSFERABILITY, "slow": {"simulation": "minisim"}}
    run = made("nnga", tmp_path, simulation=simulation, parameters={}, ranking=values)
    assert run.metrics == ["slow_fitness"]
    same_record(resume(optimize(run.experiment, lambda _: False, out=tmp_path / "part")), run)


@pytest.mark.slow
def test_the_record_does_not_depend_on_servers(whole: Run, tmp_path: Path) -> None:
    for servers in (1, 2):
        same_record(optimize(whole.experiment, servers=servers, out=tmp_path / str(servers)), whole)


@pytest.mark.slow
@pytest.mark.parametrize("at", [1, 3, 6])
def test_it_goes_on_after_an_interruption(at: int, whole: Run, tmp_path: Path) -> None:
    part = optimize(whole.experiment, lambda now: now.generation + 1 < at, out=tmp_path / "run")
    assert part.generations == at
    same_record(resume(part, servers=2), whole)


@pytest.mark.slow
def test_it_goes_on_after_being_killed(whole: Run, tmp_path: Path) -> None:
    whole.experiment.save(tmp_path / "again.yaml")
    code = f"""if True:
        import os, signal
        from pathlib import Path
        from swarmwright import Experiment, optimize
        def ends(now):
            if now.generation == 3:
                os.kill(os.getpid(), signal.SIGKILL)
        optimize(Experiment.load({str(tmp_path / "again.yaml")!r}), ends, out=Path({str(tmp_path / "run")!r}))
    """
    environment = {**os.environ, "SWARMWRIGHT_PLOT": "0"}
    ended = subprocess.run([sys.executable, "-c", code], env=environment, timeout=50, check=False)
    assert ended.returncode == -signal.SIGKILL
    same_record(resume(tmp_path / "run"), whole)


def children() -> set[int]:
    """Processes that this one has started."""
    found: set[int] = set()
    for task in Path("/proc/self/task").iterdir():
        found |= {int(one) for one in (task / "children").read_text().split()}
    return found


@pytest.mark.slow
def test_servers_of_the_slow_simulation_that_are_killed_change_nothing(tmp_path: Path) -> None:
    values = experiment(ranking=ranking(slow={**SLOW, "servers": 2}))
    expected = optimize(values, out=tmp_path / "expected")
    before, killed = children(), []

    def kills(now: Any) -> None:
        if now.generation == 2:
            servers = children() - before
            assert servers
            killed.append(max(servers))
            os.kill(killed[0], signal.SIGKILL)

    run = optimize(values, kills, out=tmp_path / "run")
    assert killed
    assert run.digest == expected.digest
    assert run.best == expected.best


@pytest.mark.slow
def test_the_best_are_validated_in_the_slow_simulation(whole: Run) -> None:
    validation = whole.validation
    assert validation is not None
    best = validation.best
    harder = whole.experiment.replace(
        ranking={"kind": "absolute", "episodes": 3}, parameters=SLOW["parameters"]
    )
    expected = post_evaluate(whole, experiment=harder, episodes=20)
    assert best.episodes.tolist() == expected.episodes.tolist()
    assert best.recorded == whole.best.fitness
    command = [sys.executable, "-m", "swarmwright", "runs", "show", str(whole.path)]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=50).stdout
    assert f"{whole.slow_evaluations} of {whole.evaluations} candidates were also evaluated in harder" in said
    assert "20 episodes with held-out seeds in harder" in said


def fragile(tmp_path: Path, above: float, **changes: Any) -> Experiment:
    (tmp_path / "fragile.py").write_text(f"ABOVE = {above}\n{FRAGILE}")
    (tmp_path / "fragile.yaml").write_text("simulation: fragile.py:Fragile\n")
    path = tmp_path / "experiment.yaml"
    values = {**VALUES, "ranking": ranking(slow="fragile.yaml", **changes), "validate": False}
    path.write_text(json.dumps(values))
    return Experiment.load(path)


@pytest.mark.slow
def test_candidates_that_fail_in_a_class_in_python_have_failed(tmp_path: Path) -> None:
    run = optimize(fragile(tmp_path, 0.2, share=0.5), out=tmp_path / "run")
    failed = np.isnan(run.record.fitness)
    assert failed.any()
    assert np.isfinite(run.record.episodes[failed]).all(), "in the fast simulation they did not"
    assert any("fragile.yaml" in event.text and "too hot" in event.text for event in run.events())
    (tmp_path / "fragile.yaml").unlink()
    same_record(resume(optimize(run.experiment, lambda now: now.generation < 2, out=tmp_path / "part")), run)


@pytest.mark.slow
def test_a_run_whose_slow_simulation_fails_always_ends(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"every candidate of generation 0 failed; the last reason: .*too hot"):
        optimize(fragile(tmp_path, -2), out=tmp_path / "run")


@pytest.mark.slow
def test_a_changed_class_is_not_used_silently(tmp_path: Path) -> None:
    part = optimize(fragile(tmp_path, 0.9), lambda now: now.generation < 2, out=tmp_path / "run")
    (tmp_path / "fragile.py").write_text(f"ABOVE = 0.1\n{FRAGILE}")
    with pytest.raises(InputError, match=r"fragile\.py"):
        resume(part)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"ranking": {"kind": "multi_fidelity"}}, r"x\.yaml:\d+: ranking\.slow: is missing"),
        ({"ranking": ranking(share=0)}, r"x\.yaml:\d+: ranking\.share: must be greater than 0"),
        ({"ranking": ranking(share=2)}, r"x\.yaml:\d+: ranking\.share: must be at most 1"),
        (
            {"ranking": ranking(slow="gone.yaml")},
            r"x\.yaml:\d+: ranking\.slow: .*gone\.yaml: there is no such",
        ),
        (
            {"ranking": ranking(slow={"parameters": {"speed": 1}})},
            r"x\.yaml:\d+: ranking\.slow\.parameters\.speed: unknown",
        ),
        ({"ranking": ranking(slow={"method": {}})}, r"method: does not belong to a target"),
        (
            {"ranking": ranking(slow={"simulation": "emergency_exit"})},
            r"x\.yaml:\d+: ranking\.slow: .*controllers have 4 sensors and 1 actuators, but agents of emerg",
        ),
        (
            {"method": {"kind": "nnga", "operation": "steady_state"}},
            r"x\.yaml:\d+: ranking\.kind: steady state has no generations",
        ),
        ({"method": {"kind": "racing"}}, r"x\.yaml:\d+: ranking\.kind: racing races its candidates"),
        (
            {"ranking": {**TRANSFERABILITY, "descriptor": ["arived"]}},
            r"x\.yaml:\d+: ranking\.descriptor\[0\]: unknown metric 'arived'; did you mean 'arrived'",
        ),
        (
            {"ranking": {"kind": "transferability", "slow": SLOW}},
            r"x\.yaml:\d+: ranking\.threshold: is missing",
        ),
    ],
)
def test_mistakes_have_their_line(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(json.dumps({**VALUES, **changes}, indent=1))
    with pytest.raises(InputError, match=said):
        Experiment.load(path)


def test_a_simulation_that_is_nowhere_is_found_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ranking: minisin: .*did you mean 'minisim'"):
        optimize(experiment(ranking=ranking(slow="minisin")), out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_both_cannot_have_the_same_servers(any_broker: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="harder is the same simulation on the same broker"):
        optimize(experiment(servers="auto", broker=any_broker), out=tmp_path / "run")


@pytest.mark.slow
def test_two_simulators_on_a_broker(any_broker: str, foreign: Callable[..., Any], tmp_path: Path) -> None:
    """Both are servers that only know D6.1; the slow one is found on the broker of the fast one."""
    values = Experiment.from_mapping(
        {
            "simulation": "line", "sensors": 2, "actuators": 1, "requirements": {"dimensions": 1},
            "method": {"kind": "random_search", "population": 8, "generations": 2},
            "controller": {"hidden": [2]}, "validate": False, "faults": {"audit": 0},
            "timeouts": {"discovery": 3},
            "ranking": {
                "kind": "multi_fidelity", "share": 0.25, "episodes": 2,
                "slow": {"name": "longer", "simulation": "long line", "requirements": {"dimensions": 1}},
            },
        }
    )  # fmt: skip
    other = foreign(any_broker, "long line", steps=9, server=5)
    with foreign(any_broker, "line") as here, other as there:
        run = optimize(values, out=tmp_path / "run", broker=any_broker)
        assert (here.episodes, there.episodes) == (8 * 2 * 2, 2 * 2 * 2)
    assert run.slow_evaluations == 4
    slow = run.record.metrics[:, :, 0]
    assert (slow[np.isfinite(slow)] != run.record.episodes[np.isfinite(slow)]).any()
    with foreign(any_broker, "line"), pytest.raises(RunError, match="slow: longer: no server fits"):
        optimize(values, out=tmp_path / "without", broker=any_broker)
