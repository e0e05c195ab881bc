"""The best candidates of a run on held-out seeds, when it has ended."""

import logging
import math
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from swarmwright import Experiment, InputError, Run, Simulation, compare, evaluate, optimize, resume
from swarmwright.cli._commands import program
from swarmwright.cli._validation import validation_lines
from swarmwright.experiment.checks import find_setting_warnings
from swarmwright.runs.post_evaluation import ControllerEvaluation, PostEvaluation, choose_unseen_seeds
from swarmwright.runs.store import StoreReader, StoreWriter
from swarmwright.runs.store.database import seal_facts
from swarmwright.runs.validation import Validation

NOISY: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 3, "numDefenders": 3, "placement": "random", "speedDefenders": 0.5},
    "method": {"kind": "cma_es", "population": 20, "generations": 15, "step": 0.5},
    "ranking": {"episodes": 2, "seeds": "new"},
    "servers": "local",
}
ASKED: dict[str, Any] = {"episodes": 60, "candidates": 3}


def run_of(tmp_path: Path, **changes: Any) -> Run:
    folder = tmp_path / f"run-{len(list(tmp_path.iterdir()))}"
    return optimize(Experiment.from_mapping(NOISY).replace(**changes), out=folder)


def again(run: Run, number: int, seeds: list[int]) -> list[float]:
    """The fitness of an evaluation's genome in an episode of each seed, by another way."""
    changed = run.experiment.replace(ranking={"seeds": "same", "episodes": 1})
    genome = run.evaluation(number).genome[np.newaxis]
    return [float(evaluate(changed.replace(parameters={"seed": seed}), genome)[0]) for seed in seeds]


def stored(run: Run) -> dict[str, Any]:
    values = run._store.validation()
    assert values is not None
    return values


def test_a_noisy_run_ends_with_it(tmp_path: Path) -> None:
    run = run_of(tmp_path)
    validation = run.validation
    assert validation is not None
    best = run.unseen
    assert best is validation.best
    assert len(best.episodes) == 30  # a twentieth of 15 x 20 x 2
    assert len(validation.candidates) == 1, "for others there are no episodes left"
    assert not run._store.collect_seeds() & set(best.seeds)
    assert best.episodes.tolist()[:5] == again(run, best.number, best.seeds[:5])
    assert best.recorded == run.best.fitness
    assert best.fitness.mean == pytest.approx(np.mean(best.episodes))
    assert best.fitness.mean < run.best.fitness - 2, "it was the luckiest"
    opened = Run.open(run.path).validation
    assert opened is not None
    assert opened.to_mapping() == validation.to_mapping()


def test_the_best_ones_of_the_whole_run_are_validated_in_the_same_episodes(tmp_path: Path) -> None:
    run = run_of(tmp_path, validate=ASKED)
    validation = run.validation
    assert validation is not None
    genomes = np.unique(run.record.genomes, axis=0)
    assert len(genomes) > 3
    order = np.argsort(-run.record.fitness, kind="stable")[:3]
    assert [one.number for one in validation.candidates] == order.tolist()
    for one in validation.candidates:
        assert one.seeds == list(range(1_000_000_000, 1_000_000_060))
        assert one.episodes.tolist()[::20] == again(run, one.number, one.seeds[::20])
        assert one.recorded == run.evaluation(one.number).fitness
    means = [one.fitness.mean for one in validation.candidates]
    assert validation.leading.fitness.mean == max(means)
    if validation.leading is not validation.best:
        lead = validation.lead
        assert lead is not None
        assert lead.mean == pytest.approx(max(means) - means[0])


def test_candidates_are_as_many_as_there_are_genomes(tmp_path: Path) -> None:
    """FREVO's elite is kept: the same genomes come again and again."""
    same = {"start_from": None, "method": {"kind": "random_search", "population": 2, "generations": 1}}
    run = run_of(tmp_path, validate={"episodes": 10, "candidates": 7}, **same)
    assert run.validation is not None
    assert len(run.validation.candidates) == 2
    members = {"kind": "nnga", "population": 10, "generations": 8}
    run = run_of(tmp_path, validate=ASKED, method=members, ranking={"reevaluate": True, "episodes": 2})
    assert run.validation is not None
    found = run.validation.candidates
    assert found[0].number == run.evaluation().number
    assert {one.generation for one in found} == {7}, "with re-evaluation, those of the last generation"
    assert len({run.evaluation(one.number).genome.tobytes() for one in found}) == 3


def test_genomes_of_the_same_controller_count_once(tmp_path: Path) -> None:
    evolved = {"evasion": {"type": "categorical", "choices": ["left", "right"]}}
    run = run_of(
        tmp_path,
        parameters={"steering": "rule"},
        controller={"kind": "parameter_set", "parameters": evolved},
        method={"kind": "nnga", "population": 20, "generations": 3},
        validate=ASKED,
    )
    assert len(np.unique(run.record.genomes, axis=0)) > 2
    assert run.validation is not None
    assert len(run.validation.candidates) == 2, "left and right"


@pytest.mark.slow
def test_it_changes_nothing_of_the_record_and_does_not_depend_on_servers(tmp_path: Path) -> None:
    run, without, plain = (run_of(tmp_path, validate=one) for one in (ASKED, False, None))
    servers = run_of(tmp_path, servers=2, validate=ASKED)
    assert without.validation is None
    assert run.digest == without.digest == servers.digest == plain.digest
    assert stored(servers) == stored(run)
    assert run.record.fitness.tobytes() == without.record.fitness.tobytes()


@pytest.mark.parametrize("seed", [None, 0, 5, 1_000_000_004])
def test_its_seeds_are_none_of_the_run(seed: int | None, tmp_path: Path) -> None:
    run = run_of(tmp_path, validate={"episodes": 40, "candidates": 1, "seed": seed})
    assert run.validation is not None
    assert run._store.collect_seeds() == set(range(30))
    seeds = run.validation.seeds
    assert not run._store.collect_seeds() & set(seeds)
    assert len(set(seeds)) == 40
    assert min(seeds) == {None: 1_000_000_000, 0: 30, 5: 30}.get(seed, seed)


def test_unseen_seeds_are_none_that_were_used() -> None:
    assert choose_unseen_seeds(3, {1_000_000_004, 7}, 3) == [1_000_000_003, 1_000_000_005, 1_000_000_006]
    assert choose_unseen_seeds(3, {8, 9}, 3, 7) == [7, 10, 11]
    assert max(choose_unseen_seeds(2**63 - 1, set(), 4)) < 2**63
    numbers = np.random.default_rng(1)
    for _ in range(200):
        used = {int(one) for one in numbers.integers(0, 50, size=30)}
        found = choose_unseen_seeds(0, used, 20, int(numbers.integers(0, 50)))
        assert not used & set(found)
        assert found == sorted(set(found))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        # One seed, learned by heart.
        ({"ranking": {"seeds": "same", "episodes": 1}, "method": {"population": 30}}, True),
        ({"ranking": {"seeds": "same", "episodes": 4}}, True),
        ({"parameters": {"placement": "fixed"}, "ranking": {"seeds": "same", "episodes": 1}}, None),
        ({"parameters": {"placement": "fixed"}, "ranking": {"seeds": "same", "episodes": 4}}, False),
        ({"parameters": {"placement": "fixed"}}, False),
        ({"parameters": {"placement": "fixed"}, "validate": {"episodes": 80}}, False),
        ({"method": {"generations": 3}}, None),  # too few evaluations for it
        ({"method": {"operation": "steady_state", "kind": "random_search", "population": 20,
                     "generations": 15}, "ranking": {"seeds": "same"}}, True),
    ],
)  # fmt: skip
def test_it_is_told_whether_fitness_depends_on_the_seed(
    changes: dict[str, Any], told: bool | None, tmp_path: Path
) -> None:
    run = run_of(tmp_path, **changes)
    validation = run.validation
    if told is None and validation is not None:  # one episode each: depends on how long it is
        told = False
    assert (None if validation is None else validation.depends_on_seed) is told
    assert (run.unseen is not None) is bool(told)
    if told is False:
        assert validation is not None
        count = len(validation.seeds)
        assert count == 80 if "validate" in changes else 5 < count <= 20, "the trial was all"
        assert {value for one in validation.candidates for value in one.episodes.tolist()} <= set(
            run.record.fitness.tolist()
        )


def test_the_fitness_of_the_first_seeds_alone_does_not_mean_that_it_is_always_so(tmp_path: Path) -> None:
    """All of the best arrive wherever they start; others do not."""
    easy = {"placement": "random", "numAgents": 1, "numDefenders": 0, "maxSteps": 60}
    run = run_of(
        tmp_path,
        parameters=easy,
        method={"kind": "cma_es", "population": 20, "generations": 40},
        ranking={"episodes": 20, "seeds": "new"},
        validate={"episodes": 20, "candidates": 1},
        seed=5,
    )
    assert run.validation is not None
    assert set(run.validation.best.episodes.tolist()) == {0.0}
    assert run.validation.depends_on_seed


class Slips(Simulation):
    """What is solved fails in one of twenty seeds."""

    sensors = actuators = 1

    def reset(self, _parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        self.slips = np.random.default_rng(seed).random() < 0.05
        self.at = 0.0
        return np.ones((1, 1))

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        self.at = float(actions[0, 0])
        return np.ones((1, 1))

    def done(self) -> bool:
        return self.at != 0.0

    def fitness(self) -> float:
        return float(self.at > 0.5 and not self.slips)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_all_episodes_that_are_asked_for_are_evaluated(seed: int, tmp_path: Path) -> None:
    values = {
        "simulation": Slips, "seed": seed, "parameters": {"seed": 10_000 * seed}, "servers": "in-process",
        "controller": {"hidden": []}, "method": {"kind": "random_search", "population": 20, "generations": 3},
        "ranking": {"episodes": 2}, "validate": {"episodes": 200, "candidates": 1},
    }  # fmt: skip
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "run")
    assert run.best.fitness == 1.0
    assert run.unseen is not None
    assert len(run.unseen.episodes) == 200
    assert 0.85 < run.unseen.mean.mean < 1.0


@pytest.mark.parametrize("at", [0, 10, 26, 50])
def test_an_interrupted_one_goes_on_with_the_same_result(at: int, tmp_path: Path) -> None:
    whole = run_of(tmp_path, validate=ASKED)
    changed = Experiment.from_mapping(NOISY).replace(validate=ASKED)
    told: list[tuple[int, int]] = []

    def progress(done: int, total: int, _: str) -> None:
        if total == 180:
            told.append((done, total))
            if done >= at * 3:
                raise KeyboardInterrupt

    folder = tmp_path / "broken"
    with pytest.raises(KeyboardInterrupt):
        optimize(changed, on_progress=progress, out=folder)
    broken = Run.open(folder)
    assert broken.state == "done"
    assert broken.validation is None
    due = [broken.validation_is_due]
    so_far = len(stored(broken)["candidates"][0]["episodes"])
    assert so_far < 60
    done: list[int] = []
    again = resume(broken, on_progress=lambda now, *_: done.append(now))
    assert stored(again) == stored(whole)
    assert again.digest == whole.digest
    assert not again.validation_is_due
    assert [*due, broken.validation_is_due] == [True, False], "it tells what is missing now"
    assert broken.validation is None
    assert done, "what was left was evaluated"
    assert min(done) >= so_far * 3, "what was stored was not evaluated again"
    opened = len(again.sessions)
    assert len(resume(again).sessions) == opened, "nothing is left"


def test_a_run_that_was_killed_before_it_is_validated_when_it_goes_on(tmp_path: Path) -> None:
    whole = run_of(tmp_path, validate=ASKED)
    folder = tmp_path / "killed"
    shutil.copytree(whole.path, folder)
    with StoreWriter.resume(folder) as store, store._writing():
        store._store.connection.execute("UPDATE session SET outcome = NULL, seconds = NULL")
        store._store.connection.execute("DELETE FROM fact WHERE name IN ('validation', 'ended')")
        seal_facts(store._store.connection)
    assert Run.open(folder).state == "killed"
    again = resume(folder)
    assert again.state == "done"
    assert stored(again) == stored(whole)


def interrupt_before_validation(patch: pytest.MonkeyPatch) -> None:
    """Let Ctrl-C arrive when a run has ended, and is not validated yet."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    patch.setattr(StoreWriter, "save_best", interrupted)


def test_a_run_that_was_interrupted_just_before_it_is_validated_later(tmp_path: Path) -> None:
    whole = run_of(tmp_path, validate=ASKED)
    folder = tmp_path / "interrupted"
    with pytest.MonkeyPatch.context() as patch:
        interrupt_before_validation(patch)
        with pytest.raises(KeyboardInterrupt):
            optimize(Experiment.from_mapping(NOISY).replace(validate=ASKED), out=folder)
    broken = Run.open(folder)
    assert broken.state == "done"
    assert broken.validation is None
    assert broken.validation_is_due
    with pytest.raises(InputError, match=f"`swarmwright resume {folder}` does it"):
        compare([broken], held_out=True)
    result = CliRunner().invoke(program, ["runs", "show", str(folder)])
    assert f"not validated yet; run `swarmwright resume {folder}`" in result.output
    again = resume(folder)
    assert stored(again) == stored(whole)
    assert again.digest == whole.digest
    assert not again.validation_is_due


def test_a_prolonged_run_that_was_interrupted_just_before_it_is_validated_later(tmp_path: Path) -> None:
    whole = run_of(tmp_path, validate=ASKED)
    run = run_of(tmp_path, validate=ASKED, method={"generations": 3})
    assert stored(run)["candidates"][0]["number"] != stored(whole)["candidates"][0]["number"]
    with pytest.MonkeyPatch.context() as patch:
        interrupt_before_validation(patch)
        with pytest.raises(KeyboardInterrupt):
            resume(run, generations=15)
    broken = Run.open(run.path)
    assert broken.state == "done"
    assert broken.validation_is_due
    assert stored(resume(broken)) == stored(whole)


def test_a_run_that_goes_on_has_it_anew(tmp_path: Path) -> None:
    run = run_of(tmp_path, method={"generations": 11})
    longer = resume(run, generations=15)
    assert stored(longer) == stored(run_of(tmp_path))


def test_it_can_be_asked_for_later_and_otherwise(tmp_path: Path) -> None:
    run = run_of(tmp_path, validate=False)
    assert not run.validation_is_due
    assert len(resume(run).sessions) == 1, "it is switched off"
    later = resume(run, settings=["validate.episodes=60", "validate.candidates=3"])
    assert stored(later) == stored(run_of(tmp_path, validate=ASKED))
    assert later.experiment.validate.episodes == 60
    other = resume(later, settings=["validate.seed=77"])
    assert other.validation is not None
    assert other.validation.seeds[0] == 77
    assert other.digest == run.digest


def test_a_failure_does_not_take_the_run_with_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "seeded.py"
    file.write_text(SEEDED)
    experiment = Experiment.from_mapping(
        {
            "simulation": f"{file}:Seeded",
            "controller": {"kind": "layered", "hidden": []},
            "method": {"kind": "random_search", "population": 5, "generations": 2},
            "servers": "in-process",
            "validate": {"episodes": 12, "candidates": 2},
        }
    )
    with caplog.at_level(logging.WARNING):
        run = optimize(experiment, out=tmp_path / "run")
    assert "the best candidate was not evaluated on held-out seeds: every episode failed" in caplog.text
    assert f"`swarmwright resume {run.path}` repeats the validation" in caplog.text
    assert run.state == "done"
    assert run.validation_is_due
    part = experiment.replace(validate={"episodes": 12, "seed": 95})
    run = optimize(part, out=tmp_path / "part")
    assert run.validation is not None
    assert run.validation.best.failed == 7
    assert run.validation.lead is None
    assert math.isfinite(run.validation.best.fitness.mean)


SEEDED = """
from swarmwright import Simulation

class Seeded(Simulation):
    sensors = actuators = 1
    metrics = ["seven"]

    def reset(self, parameters, seed):
        if seed >= 100:
            raise ValueError("no such seed")
        self.seed, self.value, self.over = seed, 0.0, False
        return [[1.0]]

    def step(self, actuators):
        self.value, self.over = float(actuators[0][0]) * (1 + self.seed % 7), True
        return [[1.0]]

    def done(self):
        return self.over

    def fitness(self):
        return self.value

    def measure(self):
        return {"seven": self.seed % 7}
"""


@pytest.mark.parametrize(
    ("validate", "message"),
    [
        (100, "validate: must be a mapping such as {episodes: 100}, or false, not 100"),
        (
            {"episodes": -1},
            "validate.episodes: must be auto or a number of episodes from 0 to 100,000, not -1",
        ),
        ({"episodes": "atuo"}, "not 'atuo'; did you mean 'auto'?"),
        ({"episods": 3}, "validate.episods: unknown key; did you mean 'episodes'?"),
        ({"candidates": 0}, "validate.candidates: must be at least 1, not 0"),
        ({"seed": -1}, "validate.seed: must be at least 0, not -1"),
        ({"episodes": 100_000, "candidates": 100}, "episodes of 100 candidates are more than 1,000,000"),
    ],
)
def test_a_mistake_is_reported(validate: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        Experiment.from_mapping({**NOISY, "validate": validate})
    assert message in str(caught.value)


def test_a_fitness_needs_as_many_episodes_as_the_ranking_takes() -> None:
    worst = {**NOISY, "ranking": {"episodes": 8, "aggregate": "worst"}}
    with pytest.raises(
        InputError, match=r"validate.episodes: must be at least ranking.episodes, 8, for one fitness value"
    ):
        Experiment.from_mapping({**worst, "validate": {"episodes": 7}})
    assert Experiment.from_mapping({**worst, "validate": {"episodes": 8}}).validate.episodes == 8


def test_what_is_switched_off_survives_the_file(tmp_path: Path) -> None:
    for value, episodes in ((False, 0), (True, "auto"), (None, "auto"), ({"episodes": 3}, 3)):
        experiment = Experiment.from_mapping({**NOISY, "validate": value})
        experiment.save(tmp_path / "file.yaml")
        assert Experiment.load(tmp_path / "file.yaml").validate.episodes == episodes
        assert Experiment.load(tmp_path / "file.yaml") == experiment


@pytest.mark.slow
def test_the_leading_ones_are_read_without_all_genomes(tmp_path: Path) -> None:
    run = run_of(tmp_path)
    reader = StoreReader(run.path)
    found = reader.leading(12)
    assert [one.number for one in found] == np.argsort(-run.record.fitness, kind="stable")[:12].tolist()
    assert [one.fitness for one in reader.leading(1)] == [run.best.fitness]


def test_the_luckiest_of_equal_ones_is_seldom_called_better(tmp_path: Path) -> None:
    """Its interval is one of as many as there are others: at most one of 40 lines should be wrong."""
    run = run_of(tmp_path, validate={"episodes": 40, "candidates": 5})
    assert run.validation is not None
    random = np.random.default_rng(1)
    better = 0
    for _ in range(400):
        equal = [
            replace(one, episodes=random.standard_normal(len(one.seeds))) for one in run.validation.candidates
        ]
        lead = replace(run.validation, candidates=equal).lead
        better += lead is not None and lead.low is not None and lead.low > 0
    assert better <= 400 * 0.05


def test_of_many_equal_ones_the_first_lead(tmp_path: Path) -> None:
    options = {"method": {"kind": "random_search", "population": 300, "generations": 3}, "fitness": "arrived"}
    run = run_of(tmp_path, **options, validate=False)
    order = np.argsort(-run.record.fitness, kind="stable")
    assert len(set(run.record.fitness.tolist())) < 30
    for count in (2, 5, 17):  # with other numbers of evaluations that are looked at
        found = StoreReader(run.path).leading(count)
        assert [one.number for one in found] == order[:count].tolist()


def test_it_is_exported_as_a_table(tmp_path: Path) -> None:
    run = run_of(tmp_path, validate=ASKED, fitness="arrived - 0.1 * distance")
    assert run.validation is not None
    run.validation.export(tmp_path / "table.csv")
    rows = (tmp_path / "table.csv").read_text().splitlines()
    assert rows[0] == "generation,candidate,recorded,seed,fitness,arrived,distance"
    assert len(rows) == 1 + 3 * 60
    for index, row in enumerate(rows[1:]):
        one, episode = run.validation.candidates[index // 60], index % 60
        generation, candidate, recorded, seed, fitness, arrived, distance = row.split(",")
        assert (int(generation), int(candidate), int(seed)) == (
            one.generation,
            one.candidate,
            one.seeds[episode],
        )
        assert (float(recorded), float(fitness)) == (one.recorded, one.episodes[episode])
        assert float(fitness) == float(arrived) - 0.1 * float(distance)
    with pytest.raises(InputError, match="a validation can only be exported to"):
        run.validation.export(tmp_path / "table.parquet")


@pytest.mark.slow
@pytest.mark.parametrize(("block", "joined"), [(64, 1), (64, 200), (64, 1 << 18), (1 << 22, 1 << 18)])
def test_the_best_are_found_whatever_the_blocks_and_equals(
    block: int, joined: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmwright.runs.store.blocks._BLOCK_BYTES", block)
    monkeypatch.setattr("swarmwright.runs.store.generations._JOINED", joined)
    run = run_of(tmp_path, validate=False, fitness="arrived + caught", method={"kind": "random_search"})
    fitness = run.record.fitness
    assert len(np.unique(fitness)) < len(fitness) / 2
    order = np.argsort(-fitness, kind="stable")
    with StoreReader(run.path)._generations() as generations:
        for most in (1, 7, 50, 10_000):
            assert generations.rank_by_fitness(0, most).tolist() == order[:most].tolist()
        assert generations.rank_by_fitness(33, 9).tolist() == order[order >= 33][:9].tolist()


def test_a_notebook_shows_it(tmp_path: Path) -> None:
    run = run_of(tmp_path)
    assert run.unseen is not None
    assert f"{run.unseen.fitness.mean:.4g} (30 episodes, 95 % confidence interval" in run._repr_html_()
    assert "held-out" not in run_of(tmp_path, validate=False)._repr_html_()


class Peak(Simulation):
    """The controller with all weights 0 is the best one by far."""

    sensors, actuators = 1, 1

    def reset(self, _parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        self.noise = 0.001 * np.random.default_rng(seed).normal()
        self.steps, self.wrong = 0, 0.0
        return np.ones((1, 1))

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        self.steps += 1
        self.wrong += abs(float(actions[0, 0]))
        return np.ones((1, 1))

    def done(self) -> bool:
        return self.steps == 2

    def fitness(self) -> float:
        return self.noise - self.wrong


PEAK: dict[str, Any] = {
    "simulation": Peak,
    "controller": {"kind": "layered", "hidden": []},
    "method": {"kind": "cma_es", "generations": 3, "step": 3.0},
    "start_from": {
        "architecture": {
            "version": 1, "kind": "layered", "sensors": 1, "actuators": 1, "hidden": [], "activation": "tanh",
            "output_range": [-1.0, 1.0],
        },
        "weights": [0.0, 0.0],
    },
    "servers": "in-process",
    "validate": {"episodes": 30, "candidates": 2},
}  # fmt: skip


@pytest.mark.slow
def test_the_controller_that_a_search_started_from_is_compared_with_the_best(tmp_path: Path) -> None:
    run = optimize(Experiment.from_mapping(PEAK), out=tmp_path / "run")
    validation = run.validation
    assert validation is not None
    assert validation.start is not None
    noise = [0.001 * np.random.default_rng(seed).normal() for seed in validation.seeds]
    assert validation.start.episodes.tolist() == noise
    assert validation.gain is not None
    assert validation.gain.mean == pytest.approx(validation.best.fitness.mean - np.mean(noise))
    assert validation.to_mapping()["start"]["fitness"] == validation.start.fitness.mean
    said = "\n".join(validation_lines(validation, run))
    assert "The starting controller on these 30 episodes: " in said
    assert f"The best of the run is worse than that by {-validation.gain.mean:.2g}, 95 % interval" in said
    assert "A smaller method.step samples nearer to it; nnga, de and pso keep it among" in said
    near = optimize(Experiment.from_mapping(PEAK), out=tmp_path / "near", seed=2).validation
    assert near is not None
    assert near.start is not None
    assert near.start.episodes.tolist() == noise, "the same seeds for every run"


@pytest.mark.parametrize(
    ("kind", "best", "start", "words"),
    [
        ("cma_es", [5.0], [5.0], ["on this episode: 5."]),
        ("cma_es", [5.0], [np.nan], ["The starting controller failed in this episode."]),
        ("cma_es", [1.0] * 2, [np.nan] * 2, ["The starting controller failed in all of these 2"]),
        (
            "openai_es",
            [4.0],
            [5.0],
            ["on this episode: 5.", "worse than that by 1: ", "smaller method.noise "],
        ),
        ("snes", [4.0], [5.0], ["on this episode: 5.", "worse than that by 1: ", "smaller method.step "]),
    ],
)
def test_a_comparison_with_the_start_in_few_episodes(
    kind: str, best: list[float], start: list[float], words: list[str]
) -> None:
    experiment = Experiment.from_mapping({**PEAK, "method": {"kind": kind}})
    seeds = list(range(9, 9 + len(best)))
    shared: dict[str, Any] = {"seeds": seeds, "ranking": experiment.new_ranking(), "metrics": {}}
    chosen = PostEvaluation(
        number=0, generation=0, candidate=0, recorded=5.0, seen=0, episodes=np.array(best), **shared
    )
    begun = ControllerEvaluation(episodes=np.array(start), **shared)
    found = Validation(candidates=[chosen], depends_on_seed=True, start=begun)
    _, _, *said = validation_lines(found, cast("Run", SimpleNamespace(experiment=experiment)))
    assert len(said) == (1 if len(words) == 1 else 2)
    assert all(one in " ".join(said) for one in words)


@pytest.mark.slow
def test_a_controller_among_the_candidates_is_not_evaluated_again(tmp_path: Path) -> None:
    experiment = Experiment.from_mapping(
        PEAK | {"method": {"kind": "nnga", "population": 8, "generations": 2}}
    )
    run = optimize(experiment, out=tmp_path / "run")
    assert run.validation is not None
    assert run.validation.start is None
    assert "start" not in stored(run)


def test_without_a_validation_a_warning_says_that_the_start_is_not_kept() -> None:
    experiment = Experiment.from_mapping(PEAK | {"validate": False})
    assert [
        one
        for one in find_setting_warnings(experiment)
        if one.startswith("start_from: cma_es samples around")
    ]
    assert not find_setting_warnings(Experiment.from_mapping(PEAK))
