"""Evaluating genomes and single controllers."""

import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from swarmwright import (
    Controller,
    Experiment,
    InputError,
    RunError,
    _engine,
    evaluate,
    evaluate_episodes,
    optimize,
    simulate,
)
from swarmwright.common.random_numbers import Stream
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.evaluate import prepare_evaluation
from swarmwright.servers.evaluation.opening import open_backend

MINISIM = Experiment.from_mapping(
    {
        "simulation": "minisim",
        "parameters": {"placement": "random"},
        "ranking": {"episodes": 3},
        "servers": "local",
    }
)


def genomes(count: int, experiment: Experiment = MINISIM) -> np.ndarray[Any, np.dtype[np.float32]]:
    representation = experiment.representation()
    return np.stack([representation.initial(Stream(1, "test", 0, index)) for index in range(count)])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["layered", "fully_meshed"])
def test_fitness_does_not_depend_on_where_it_is_computed(kind: str) -> None:
    experiment = MINISIM.replace(controller={"kind": kind})
    rows = genomes(40, experiment)
    here = evaluate(experiment, rows)
    assert here.shape == (40,)
    assert here.dtype == np.float64
    assert np.isfinite(here).all()
    assert evaluate(experiment, rows, servers=2).tobytes() == here.tobytes()


def test_candidates_do_not_touch_each_other() -> None:
    rows = genomes(50)
    whole = evaluate(MINISIM, rows)
    assert evaluate(MINISIM, rows[::-1]).tolist() == whole.tolist()[::-1]
    assert evaluate(MINISIM, rows[7:8]).tolist() == [whole[7]]


def test_episodes_have_their_own_seeds() -> None:
    rows = genomes(5)
    singles = [
        evaluate(MINISIM.replace(ranking={"episodes": 1}, parameters={"seed": 40 + episode}), rows)
        for episode in range(3)
    ]
    together = evaluate(MINISIM.replace(parameters={"seed": 40}), rows)
    assert together == pytest.approx(np.mean(singles, axis=0), rel=1e-12)
    assert len({values.tobytes() for values in singles}) == 3


def test_nothing_to_evaluate() -> None:
    assert evaluate(MINISIM, np.empty((0, 49))).shape == (0,)
    found = evaluate_episodes(MINISIM, np.empty((0, 49)), metrics=["steps"])
    assert (found.fitness.shape, found.episodes.shape, found.metrics.shape) == ((0,), (0, 3), (0, 3, 1))


@pytest.mark.parametrize("fitness", [None, "-distance"])  # by the engine alone, and with a part in Python
def test_generations_have_the_seeds_of_a_run(fitness: str | None, tmp_path: Path) -> None:
    experiment = MINISIM.replace(
        fitness=fitness, method={"population": 5, "generations": 3}, ranking={"seeds": "new"}
    )
    run = optimize(experiment, out=tmp_path / "run")
    for generation in range(3):
        of_it = run.record.generation == generation
        again = evaluate(experiment, run.record.genomes[of_it], generation=generation)
        assert again.tobytes() == run.record.fitness[of_it].tobytes()
    same = MINISIM.replace(fitness=fitness)
    rows = genomes(3)
    assert evaluate(same, rows, generation=7).tobytes() == evaluate(same, rows).tobytes()


@pytest.mark.parametrize(
    ("generation", "words"),
    [
        (-1, "generation: must be at least 0, not -1"),
        (2**62, r"generation: \d+ is too large; its seeds would exceed 2\*\*63"),
        (1.5, "generation: must be an integer, not 1.5"),
    ],
)
def test_generations_that_there_are_not(generation: Any, words: str) -> None:
    experiment = MINISIM.replace(ranking={"seeds": "new"})
    for function in (evaluate, evaluate_episodes):
        with pytest.raises(InputError, match=words):
            function(experiment, genomes(1), generation=generation)


@pytest.mark.parametrize(("kind", "options"), [("multi_fidelity", {}), ("transferability", {"threshold": 1})])
def test_rankings_with_a_second_simulation_are_refused(kind: str, options: dict[str, Any]) -> None:
    slow = {"name": "slow", "parameters": {"seed": 3}}
    experiment = MINISIM.replace(ranking={"kind": kind, "slow": slow, **options})
    for function in (evaluate, evaluate_episodes):
        with pytest.raises(InputError, match=rf"^ranking: {kind} needs a second simulation .*'absolute'"):
            function(experiment, genomes(1))


def test_episodes_and_their_metrics_are_those_of_a_run(tmp_path: Path) -> None:
    experiment = MINISIM.replace(
        fitness="arrived - 0.01 * steps",
        method={"population": 5, "generations": 2},
        ranking={"seeds": "new", "aggregate": "worst"},
    )
    run = optimize(experiment, out=tmp_path / "run")
    second = run.record.generation == 1
    found = evaluate_episodes(experiment, run.record.genomes[second], metrics=["distance"], generation=1)
    assert found.fitness.tobytes() == run.record.fitness[second].tobytes()
    assert found.episodes.tobytes() == run.record.episodes[second].tobytes()
    assert list(found.names) == [*run.metrics, "distance"]
    assert found.metrics[:, :, :2].tobytes() == run.record.metrics[second].tobytes()
    assert list(found.seeds) == run.seeds(1)


@pytest.mark.slow
def test_metrics_do_not_depend_on_where_they_are_measured() -> None:
    here, there = (evaluate_episodes(MINISIM, genomes(4), metrics="all", servers=one) for one in ("local", 1))
    assert set(here.names) == {"arrived", "caught", "distance", "steps"}
    assert here.names == there.names
    assert here.metrics.tobytes() == there.metrics.tobytes()
    assert here.fitness.tobytes() == there.fitness.tobytes() == evaluate(MINISIM, genomes(4)).tobytes()


@pytest.mark.parametrize(
    ("metrics", "words"),
    [
        (["distanze"], "metrics: unknown metric 'distanze'; did you mean 'distance'"),
        ("distance", r"metrics: must be a list of names of metrics, not 'distance'; write \['distance'\]"),
        ([1], "metrics: must be a list of names, not 1"),
    ],
)
def test_metrics_that_there_are_not(metrics: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        evaluate_episodes(MINISIM, genomes(1), metrics=metrics)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (np.zeros(49), r"have the shape \(49,\); expected \(candidates, genome_size\)"),
        (np.zeros((2, 50)), "have 50 genes; this experiment's controllers have 49"),
        (np.full((2, 49), np.nan), "row 0 has a gene that is not finite"),
        ([["a"] * 49], "must be an array of numbers"),
    ],
)
def test_wrong_genomes(rows: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        evaluate(MINISIM, rows)


@pytest.mark.slow
def test_one_episode_of_one_controller() -> None:
    rows = genomes(1)
    single = MINISIM.replace(ranking={"episodes": 1})
    controller = Controller(single.representation().specification(rows[0]))
    assert simulate(single, controller) == evaluate(single, rows)[0]
    assert simulate(single, controller, servers=1) == evaluate(single, rows)[0]


def test_without_a_controller_a_random_one_drives() -> None:
    experiment = MINISIM.replace(ranking={"episodes": 1}, method={"population": 5})
    first = experiment.new_method(experiment.representation()).ask()[:1]
    assert simulate(experiment) == evaluate(experiment, first)[0]
    assert simulate(experiment.replace(seed=2)) != simulate(experiment)


def test_a_controller_of_another_size() -> None:
    other = Experiment.from_mapping({"simulation": "x", "sensors": 3, "actuators": 2}).representation()
    controller = Controller(other.specification(other.initial(Stream(1, "x"))))
    with pytest.raises(InputError, match="has 3 sensors and 2 actuators; minisim has 4 and 1"):
        simulate(MINISIM, controller)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("notebook", "mode", "here"), [(True, "auto", True), (True, "stepwise", False), (False, "auto", False)]
)
def test_automatic_servers_in_a_notebook_are_none(
    monkeypatch: pytest.MonkeyPatch, notebook: bool, mode: str, here: bool
) -> None:
    # A program that imports the package, as this one's other tests may have, is no notebook.
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    shell = SimpleNamespace(kernel=None) if notebook else None
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    experiment = MINISIM.replace(servers="auto", mode=mode)
    with open_backend(experiment) as backend:
        assert (backend.description == "in this process") is here


@pytest.mark.parametrize("servers", ["2", "02"])
def test_a_number_of_servers_is_no_text(servers: str) -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim"})
    with pytest.raises(InputError, match=f"servers: '{servers}' is a text; write the number 2"):
        evaluate(experiment, np.zeros((1, experiment.genome_size)), servers=servers)


def test_no_servers_at_all_are_refused() -> None:
    with pytest.raises(
        InputError, match="servers: must be auto, local, in-process or a number of at least 1, not 0"
    ):
        evaluate(MINISIM, genomes(1), servers=0)


SIGNALLING = """
from pathlib import Path
from swarmwright import Simulation

class Signalling(Simulation):
    sensors, actuators, dimensions = 1, 1, 2

    def reset(self, parameters, seed):
        Path(__file__).with_name("begun").touch()
        return [[0.0]]

    def step(self, actuators):
        return [[0.0]]

    def done(self):
        return True

    def fitness(self):
        return 1.0
"""


@pytest.mark.slow
@pytest.mark.parametrize("raises", [False, True])
def test_servers_work_while_the_caller_does_something_else(tmp_path: Path, raises: bool) -> None:
    """A generation is stored while servers evaluate the next one; an error of storing it is raised."""
    (tmp_path / "signalling.py").write_text(SIGNALLING)
    experiment = Experiment.from_mapping({"simulation": f"{tmp_path / 'signalling.py'}:Signalling"})
    calls = []

    def wait_for_the_server() -> None:
        calls.append(1)
        until = time.monotonic() + 20
        while not (tmp_path / "begun").exists():
            assert time.monotonic() < until, "no episode begins before this is done"
            time.sleep(0.01)
        if raises:
            raise RunError("the disk is full")

    representation = experiment.representation(1, 1)
    controllers = Controllers.from_genomes(
        representation, genomes(3, experiment.replace(sensors=1, actuators=1))
    )
    with open_backend(experiment, servers=1) as backend:
        if raises:
            with pytest.raises(RunError, match="the disk is full"):
                backend.evaluate(controllers, [0], lambda *_: None, wait_for_the_server)
        else:
            results = backend.evaluate(controllers, [0], lambda *_: None, wait_for_the_server)
            assert results.fitness.tolist() == [[1.0]] * 3
        # The connection to the servers goes on.
        again = backend.evaluate(controllers, [0], lambda *_: None)
    assert again.fitness.tolist() == [[1.0]] * 3
    assert calls == [1]


BROKEN = """\
import numpy as np
from swarmwright import Simulation

class Broken(Simulation):
    sensors = actuators = 1
    def reset(self, parameters, seed):
        return np.ones((1, 1))
    def step(self, actions):
        raise ValueError("a wheel came off")
    def done(self):
        return False
    def fitness(self):
        return 0.0
"""


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["in-process", "local"])
def test_it_is_told_why_candidates_fail(
    servers: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "wheel_comes_off.py").write_text(BROKEN)
    experiment = Experiment.from_mapping(
        {"simulation": f"{tmp_path}/wheel_comes_off.py:Broken", "controller": {"hidden": []}}
    )
    assert np.isnan(evaluate(experiment, genomes(3, experiment), servers=servers)).all()
    told = [one.getMessage() for one in caplog.records if one.name == "swarmwright"]
    assert len(told) == 1
    assert "an episode failed" in told[0]
    assert "Broken.step: ValueError: a wheel came off" in told[0]


def test_an_aggregate_that_is_no_number_is_told(tmp_path: Path) -> None:
    (tmp_path / "huge.py").write_text(
        BROKEN.replace("Broken", "Huge")
        .replace('raise ValueError("a wheel came off")', "return np.ones((1, 1))")
        .replace("return False", "return True")
        .replace("return 0.0", "return 1e308")
    )
    values = {"simulation": f"{tmp_path}/huge.py:Huge", "controller": {"hidden": []}}
    experiment = Experiment.from_mapping({**values, "ranking": {"episodes": 2, "aggregate": "sum"}})
    with pytest.raises(
        RunError, match="all of their episodes succeeded, but the ranking's result is not finite"
    ):
        optimize(experiment, servers="in-process", out=tmp_path / "run")


ROWS = np.random.default_rng(5).uniform(-2, 2, (300, 49)).astype(np.float32)


def minisim(**changes: Any) -> Experiment:
    values = {"simulation": "minisim", "parameters": {"placement": "random"}, "servers": "in-process"}
    return Experiment.from_mapping({**values, **changes})


def step_by_step(experiment: Experiment, rows: np.ndarray[Any, np.dtype[np.float32]]) -> Any:
    """Evaluate, rank: what `evaluate` does where Python has a part in it."""
    ranking = experiment.new_ranking()
    with open_backend(experiment) as backend:
        controllers = Controllers.from_genomes(experiment.representation(), rows)
        results = backend.evaluate(controllers, ranking.seeds(experiment.first_seed), lambda *_: None)
    return ranking.score(results.fitness)


@pytest.mark.parametrize("aggregate", ["mean", "sum", "median", "worst", "quantile", "cvar"])
@pytest.mark.parametrize("episodes", [1, 4])
def test_fitness_is_that_of_the_ranking(aggregate: str, episodes: int) -> None:
    experiment = minisim(ranking={"episodes": episodes, "aggregate": aggregate, "level": 0.3})
    assert prepare_evaluation(experiment) is not None
    expected = step_by_step(experiment, ROWS)
    assert evaluate(experiment, ROWS).tobytes() == expected.tobytes()
    assert evaluate(experiment, ROWS.astype(np.float64)).tobytes() == expected.tobytes()
    assert evaluate(experiment, np.asfortranarray(ROWS)).tobytes() == expected.tobytes()
    assert evaluate(experiment, ROWS[::-2]).tobytes() == expected[::-2].tobytes()
    assert evaluate(experiment, ROWS[:0]).shape == (0,)


def test_rankings_and_genes_that_python_has_a_part_in_are_left_to_it() -> None:
    assert prepare_evaluation(minisim(fitness="-distance")) is None
    assert prepare_evaluation(minisim(controller={"kind": "mealy_fsm"})) is None


def test_experiments_that_differ_are_prepared_on_their_own() -> None:
    experiment = minisim()
    before = evaluate(experiment, ROWS)
    shorter = experiment.replace(parameters={"maxSteps": 3})
    short = evaluate(shorter, ROWS)
    assert short.tolist() != before.tolist()
    assert short.tobytes() == step_by_step(shorter, ROWS).tobytes()
    seeded = shorter.replace(parameters={"seed": 7})
    assert evaluate(seeded, ROWS).tobytes() == step_by_step(seeded, ROWS).tobytes()
    again = seeded.replace(parameters={"maxSteps": None, "seed": None})
    assert evaluate(again, ROWS).tobytes() == before.tobytes()
    assert prepare_evaluation(again) is prepare_evaluation(experiment)  # equal experiments share evaluators
    with pytest.raises(InputError, match="have 49 genes; this experiment's controllers have 61"):
        evaluate(experiment.replace(controller={"hidden": [8, 2]}), ROWS)


def test_many_experiments_are_not_confused() -> None:
    experiments = [minisim(parameters={"maxSteps": steps}) for steps in range(1, 40)]
    expected = [step_by_step(experiment, ROWS[:9]).tobytes() for experiment in experiments]
    for _ in range(2):
        assert [evaluate(experiment, ROWS[:9]).tobytes() for experiment in experiments] == expected


@pytest.mark.parametrize("place", [(0, 0), (150, 48), (299, 7)])
@pytest.mark.parametrize("episodes", [1, 3])
def test_genes_that_are_not_finite_are_named(place: tuple[int, int], episodes: int) -> None:
    rows = ROWS.copy()
    rows[place] = np.inf
    rows[299, 48] = np.nan
    experiment = minisim(ranking={"episodes": episodes})
    with pytest.raises(InputError, match=f"^genomes: row {place[0]} has a gene that is not finite"):
        evaluate(experiment, rows)
    with open_backend(experiment) as backend:
        evaluator = backend.evaluator(dict(experiment.representation().architecture()))
    assert evaluator is not None
    with pytest.raises(
        _engine.InputError, match=rf"^genomes\[{place[0]}\]\[{place[1]}\] is NaN or infinite$"
    ):
        evaluator.evaluate(rows, [0])


def test_progress_is_reported() -> None:
    calls: list[tuple[int, int, str]] = []
    evaluate(minisim(), ROWS, on_progress=lambda *call: calls.append(call))
    assert calls[-1] == (300, 300, "")


def test_what_a_callback_raises_is_raised() -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(minisim(), ROWS, on_progress=stop)
