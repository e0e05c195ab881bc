"""Runs with races: by the method `racing`, and with the ranking `race`."""

import json
import math
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, Generation, InputError, Run, RunError, optimize, resume
from swarmwright.servers.evaluation.evaluate import evaluate
from swarmwright.servers.rows import Journal
from tests.python.records import same_record

NOISY: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {
        "numAgents": 3,
        "numDefenders": 3,
        "placement": "random",
        "speedDefenders": 0.5,
        "maxSteps": 15,
    },
    "servers": "local",
    "seed": 3,
}
RACING = {**NOISY, "method": {"kind": "racing", "evaluations": 900, "survivors": 4}}
RACE = {
    **NOISY,
    "method": {"kind": "nnga", "population": 16, "generations": 6},
    "ranking": {"kind": "race", "episodes": 12, "seeds": "new"},
}
BROKEN = """
from swarmwright import Simulation


class Fails(Simulation):
    sensors, actuators = 2, 1

    def reset(self, parameters, seed):
        self.seed, self.result = seed, None
        return [[0.5, -0.5]]

    def step(self, actuators):
        self.result = float(actuators[0][0]) + self.seed % 3
        if self.seed >= FROM and actuators[0][0] > ABOVE:
            raise ValueError("the motor is too hot")
        return [[0.5, -0.5]]

    def done(self):
        return self.result is not None

    def fitness(self):
        return self.result
"""


def shown(run: Run, *more: str) -> str:
    """What `swarmwright runs show` prints."""
    command = [sys.executable, "-m", "swarmwright", "runs", "show", str(run.path), *more]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=100).stdout


def experiment(values: dict[str, Any], **changes: Any) -> Experiment:
    return Experiment.from_mapping({**values, **changes})


@pytest.fixture(scope="module", params=["racing", "race", "racing with more episodes"])
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """An undisturbed run."""
    values = RACE if request.param == "race" else RACING
    if request.param.endswith("episodes"):
        values = {**RACING, "ranking": {"episodes": 3, "aggregate": "worst"}}
    return optimize(experiment(values), out=tmp_path_factory.mktemp("whole") / "run")


@pytest.mark.slow
def test_the_record_does_not_depend_on_servers(whole: Run, tmp_path: Path) -> None:
    for servers in (1, 3):
        same_record(optimize(whole.experiment, servers=servers, out=tmp_path / str(servers)), whole)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 1.0])
def test_it_goes_on_in_the_middle_of_a_race(share: float, whole: Run, tmp_path: Path) -> None:
    at = max(1, int(share * (whole.generations - 1)))
    part = optimize(whole.experiment, lambda now: now.generation + 1 < at, out=tmp_path / "run")
    assert part.generations == at
    told: list[int] = []
    run = resume(part, lambda now: told.append(now.generation), servers=2)
    assert told == list(range(at, whole.generations))
    same_record(run, whole)
    assert run.best == whole.best
    assert run.ended == whole.ended


@pytest.mark.slow
def test_it_goes_on_after_being_killed(whole: Run, tmp_path: Path) -> None:
    code = f"""if True:
        import os, signal
        from pathlib import Path
        from swarmwright import Experiment, optimize
        def ends(now):
            if now.generation == {whole.generations // 2}:
                os.kill(os.getpid(), signal.SIGKILL)
        experiment = Experiment.from_mapping({whole.experiment.to_mapping()!r})
        optimize(experiment, ends, out=Path({str(tmp_path / "run")!r}))
    """
    ended = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "SWARMWRIGHT_PLOT": "0"},
        timeout=100,
        check=False,
    )
    assert ended.returncode == -signal.SIGKILL
    assert Run.open(tmp_path / "run").generations < whole.generations
    same_record(resume(tmp_path / "run"), whole)


@pytest.fixture(scope="module")
def racing(tmp_path_factory: pytest.TempPathFactory) -> Run:
    values = {**RACING, "validate": {"episodes": 20, "candidates": 4}}
    return optimize(experiment(values), out=tmp_path_factory.mktemp("racing") / "run")


def test_the_best_of_a_racing_run_is_the_elite_with_the_mean_of_its_instances(racing: Run) -> None:
    record = racing.record
    of = Counter(genome.tobytes() for genome in record.genomes)
    best = racing.evaluation()
    own = [
        float(row[0])
        for row, genome in zip(record.episodes, record.genomes, strict=True)
        if genome.tobytes() == best.genome.tobytes()
    ]
    assert len(own) == max(of.values()) > 10
    assert racing.best.fitness == math.fsum(own) / len(own)
    assert racing.best.fitness == racing.history[-1].best_so_far
    assert record.fitness.max() > racing.best.fitness, "others had luck on their first instances"
    assert racing.evaluations == len(record.fitness) <= 900
    assert racing.ended == "evaluations"


def test_each_instance_has_its_own_seeds_and_no_candidate_sees_them_twice(racing: Run) -> None:
    rows: Counter[tuple[bytes, int]] = Counter()
    for generation in range(racing.generations):
        (seed,) = racing.seeds(generation)
        for one in racing.record.genomes[racing.record.generation == generation]:
            rows[one.tobytes(), seed] += 1
    assert max(rows.values()) == 1
    seeds = {seed for _, seed in rows}
    assert seeds == set(range(len(seeds)))


@pytest.mark.slow
def test_those_validated_are_the_elites(racing: Run) -> None:
    validation = racing.validation
    assert validation is not None
    assert len(validation.candidates) == 4
    of = Counter(genome.tobytes() for genome in racing.record.genomes)
    counts = [
        of[racing.evaluation(one.candidate, one.generation).genome.tobytes()] for one in validation.candidates
    ]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] >= sorted(of.values())[-6]
    assert set(validation.seeds).isdisjoint(set(range(racing.generations)))
    said = shown(racing)
    assert f"(mean of the {max(counts)} instances it was evaluated on)" in said
    assert f"{racing.generations} generations (an instance each)" in said


def test_callbacks_see_every_instance(racing: Run, tmp_path: Path) -> None:
    seen: list[Generation] = []
    run = optimize(racing.experiment, seen.append, out=tmp_path / "run")
    assert [one.generation for one in seen] == list(range(run.generations))
    assert [one.best_so_far for one in seen] == [one.best_so_far for one in run.history]
    assert seen[-1].budget == "evaluations"
    assert seen[-1].share > 0.9


def test_a_racing_run_cannot_be_prolonged(racing: Run) -> None:
    with pytest.raises(InputError, match=r"method\.evaluations: cannot be changed.*start_from=") as caught:
        resume(racing, evaluations=2000)
    assert str(racing.path) in str(caught.value)
    again = optimize(
        experiment(
            RACING, start_from=[{"run": str(racing.path)}], method={**RACING["method"], "evaluations": 200}
        ),
        lambda _: False,
        out=racing.path.parent / "again",
    )
    assert again.record.genomes[0].tobytes() == racing.evaluation().genome.tobytes()


def test_too_few_evaluations_are_refused_with_the_line(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("simulation: minisim\nmethod:\n  kind: racing\n  evaluations: 20\n")
    with pytest.raises(InputError, match=r"x\.yaml:4: method\.evaluations: 20 are too few for a race"):
        Experiment.load(path)


def broken(tmp_path: Path, start: int, above: float, **changes: Any) -> Experiment:
    file = tmp_path / "fails.py"
    file.write_text(f"FROM, ABOVE = {start}, {above}\n{BROKEN}")
    values = {"simulation": f"{file}:Fails", "servers": "local", **changes}
    return Experiment.from_mapping(values)


METHOD = {"kind": "racing", "evaluations": 300, "survivors": 3}


@pytest.mark.slow
def test_a_run_ends_when_all_that_are_left_fail(tmp_path: Path) -> None:
    failing = broken(tmp_path, 3, -2, method=METHOD)
    with pytest.raises(RunError, match=r"every candidate of generation 3 failed; the last reason: .*too hot"):
        optimize(failing, out=tmp_path / "run")
    assert Run.open(tmp_path / "run").generations == 3


@pytest.mark.slow
def test_those_that_fail_are_dropped_and_the_others_race_on(tmp_path: Path) -> None:
    run = optimize(broken(tmp_path, 2, 0.2, method=METHOD), out=tmp_path / "run")
    record = run.record
    assert run.ended == "evaluations"
    failed = {record.genomes[index].tobytes() for index in np.flatnonzero(np.isnan(record.fitness))}
    assert failed
    for genome in failed:
        rows = [index for index, one in enumerate(record.genomes) if one.tobytes() == genome]
        assert np.isnan(record.fitness[rows[-1]])
        assert np.isfinite(record.fitness[rows[:-1]]).all()
    assert run.evaluation().genome.tobytes() not in failed


@pytest.mark.slow
def test_a_race_saves_episodes_and_says_how_many(tmp_path: Path) -> None:
    run = optimize(experiment(RACE), out=tmp_path / "run")
    record = run.record
    missing = int(np.isnan(record.episodes).sum())
    assert 0 < missing == run.episodes_saved
    assert np.isfinite(record.fitness).all()
    # No candidate has a gap: it is dropped once and for all, after the first test at the earliest.
    gone = np.isnan(record.episodes)
    assert (gone == np.maximum.accumulate(gone, axis=1)).all()
    assert not gone[:, :5].any()
    for generation in range(run.generations):
        rows = record.generation == generation
        best = np.flatnonzero(rows)[int(np.argmax(record.fitness[rows]))]
        assert not gone[best].any()
        assert record.fitness[best] == pytest.approx(record.episodes[best].mean())
        dropped = rows & gone.any(axis=1)
        if dropped.any():
            assert record.fitness[dropped].max() <= record.fitness[rows & ~gone.any(axis=1)].min()
    said = shown(run)
    every = run.evaluations * 12
    assert f"races saved {missing:,} of {every:,} episodes ({100 * missing / every:.0f} %)" in said
    assert json.loads(shown(run, "--json"))["episodes_saved"] == missing


def test_a_race_finds_the_same_survivors_as_all_episodes_would(tmp_path: Path) -> None:
    """Evaluating everything and ranking it gives the fitness that the race has."""
    values = {**RACE, "method": {"kind": "random_search", "population": 20, "generations": 1}}
    run = optimize(experiment(values), out=tmp_path / "run")
    assert run.episodes_saved > 0
    fitness = evaluate(run.experiment, run.record.genomes)
    assert fitness.tobytes() == run.record.fitness.tobytes()


@pytest.mark.slow
def test_failures_in_a_race_have_their_episode(tmp_path: Path) -> None:
    values = {"kind": "random_search", "population": 12, "generations": 1}
    race = {"kind": "race", "episodes": 10}
    failing = broken(tmp_path, 7, 0.1, method=values, ranking=race)
    run = optimize(failing, servers="in-process", out=tmp_path / "run")
    record = run.record
    failed = np.isnan(record.fitness)
    assert failed.any()
    assert np.isfinite(record.episodes[failed][:, :7]).all()
    assert np.isnan(record.episodes[failed][:, 7:]).all()
    other = optimize(failing, servers=2, out=tmp_path / "other")
    same_record(other, run)
    for ended in (run, other):
        errors = [one for one in ended.attempts() if one.error is not None]
        assert {(one.candidate, one.episode) for one in errors} == {
            (one, 7) for one in np.flatnonzero(failed).tolist()
        }


@pytest.mark.parametrize(
    ("method", "ranking", "words"),
    [
        ({"kind": "racing"}, {"kind": "race"}, r"ranking\.kind: racing already races its candidates"),
        ({"operation": "steady_state"}, {"kind": "race"}, r"ranking\.kind: steady state has no gen"),
        (
            {},
            {"kind": "race", "reevaluate": True},
            "reevaluate: survivors and new candidates have different episodes",
        ),
        ({"kind": "racing"}, {"reevaluate": True}, r"ranking\.reevaluate: racing has no survivors"),
        ({"kind": "racing", "operation": "steady_state"}, {}, "it tests candidates together"),
    ],
)
def test_what_does_not_go_together_is_refused(method: Any, ranking: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Experiment.from_mapping({"simulation": "minisim", "method": method, "ranking": ranking})


def test_repeating_compares_the_episodes_that_were_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from swarmwright import repeat
    from swarmwright.cli._main import run as swarmwright

    run = optimize(Experiment.from_mapping(RACE), out=tmp_path / "run")
    counts = [int(np.isfinite(run.evaluation(which, 0).episodes).sum()) for which in range(16)]
    dropped = int(np.argmin(counts))
    assert counts[dropped] < max(counts) == 12
    found = repeat(run, dropped, 0)
    assert found.same
    assert (len(found.recorded), found.left_out) == (counts[dropped], 12 - counts[dropped])
    assert repeat(run, int(np.argmax(counts)), 0).left_out == 0
    capsys.readouterr()
    which = ["--generation", "0", "--candidate", str(dropped)]
    assert swarmwright(["evaluate", str(run.path), *which]) == 0
    words = f"It was dropped from the race after {counts[dropped]} of 12 episodes, which are compared."
    assert words in capsys.readouterr().out


def test_candidates_that_were_dropped_do_not_hide_that_the_ranking_failed() -> None:
    from swarmwright.methods.rankings.race import Race, RaceOptions
    from swarmwright.runs.optimization.evaluators import RaceEvaluator
    from swarmwright.servers.evaluation.base import Results

    ranking = Race(RaceOptions(episodes=6, first_test=3))
    evaluator = RaceEvaluator(ranking)
    episodes = np.add.outer([4.0, 3.0, 2.0, 1.0], np.zeros(6))
    episodes[ranking.count_episodes(episodes)[:, np.newaxis] <= np.arange(6)] = np.nan
    assert np.isnan(episodes).any()
    metrics = np.empty((4, 6, 0))
    assert "all of their episodes succeeded" in evaluator.explain_failure(
        Results(episodes, metrics, Journal())
    )
    episodes[0, 1] = np.inf
    assert evaluator.explain_failure(Results(episodes, metrics, Journal())) == ""


@pytest.mark.slow
def test_huge_fitness_does_not_end_a_race(tmp_path: Path) -> None:
    file = tmp_path / "fails.py"
    huge = "return 1.7e308 * (1 if self.result > 1 else -1)\n"
    file.write_text("FROM, ABOVE = 10**9, 0\n" + BROKEN.replace("return self.result\n", huge))
    values = {"simulation": f"{file}:Fails", "servers": "local", "ranking": RACE["ranking"]}
    raced = Experiment.from_mapping({**values, "method": {"population": 6, "generations": 1}})
    run = Run.open(optimize(raced, out=tmp_path / "run").path)
    assert run.history[0].failed == 0
    assert np.isfinite(run.best.fitness)
