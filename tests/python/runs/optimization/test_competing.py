"""Runs of competitions: their record, on any servers, and after an interruption."""

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmwright
from swarmwright import Experiment, InputError, Run, RunError
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.kinds.team import Team
from swarmwright.methods.competition import FIRST_OPPONENT
from swarmwright.runs.matches import play, play_all, slices_of
from swarmwright.runs.repeat import repeat
from swarmwright.runs.verification import verify

MINISIM: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {
        "numAgents": 2,
        "numDefenders": 2,
        "placement": "random",
        "defenderSteering": "controller",
    },
    "controller": {"hidden": [2]},
    "method": {"population": 5, "generations": 4},
    "validate": False,
}
POPULATIONS = {
    **MINISIM,
    "populations": {"agents": {}, "defenders": {"method": {"kind": "snes", "population": 4}}},
    "ranking": {"pairing": "hall_of_fame", "rounds": 2, "episodes": 2},
}
TOURNAMENT = {**MINISIM, "ranking": {"kind": "tournament", "pairing": "swiss", "episodes": 2}}


def network(seed: int) -> dict[str, Any]:
    """Return an external controller, as a file has it."""
    representation = Experiment.from_mapping(TOURNAMENT).representation()
    assert isinstance(representation, Team)
    part = representation.parts["agents"]
    return part.specification(part.initial(Stream(seed, "test", 0, 0)))


OPPONENTS = {**TOURNAMENT, "ranking": {**TOURNAMENT["ranking"], "opponents": [network(1), network(2)]}}
"""One population, which also plays against two opponents."""
ARCHIVE = {**POPULATIONS, "ranking": {"pairing": "pareto_archive", "rounds": 3, "episodes": 2}}
ALONE = {
    **MINISIM,
    "controller": {"hidden": [3]},
    "populations": {"agents": {}},
    "ranking": {"episodes": 2, "opponents": {"defenders": [network(1), network(2)]}},
}
"""A population that plays one side, against two opponents with other controllers."""
COMPETITIONS = pytest.mark.parametrize(
    "experiment",
    [POPULATIONS, TOURNAMENT, OPPONENTS, ALONE, ARCHIVE],
    ids=["populations", "swiss", "opponents", "alone", "archive"],
)


def record(run: Run, folder: Path) -> bytes:
    file = folder / f"{run.path.name}.csv"
    run.export(file)
    return file.read_bytes()


@pytest.mark.slow
@COMPETITIONS
@pytest.mark.parametrize(
    "where", [{"servers": 2}, {"servers": 3, "mode": "stepwise"}], ids=["two", "stepwise"]
)
def test_the_record_is_the_same_on_servers(
    experiment: dict[str, Any], where: dict[str, Any], tmp_path: Path
) -> None:
    alone = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "alone")
    served = swarmwright.optimize({**experiment, **where}, out=tmp_path / "served")
    assert record(served, tmp_path) == record(alone, tmp_path)


@COMPETITIONS
def test_a_resumed_run_has_the_same_record(experiment: dict[str, Any], tmp_path: Path) -> None:
    whole = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "whole")
    swarmwright.optimize(
        experiment, lambda report: report.generation < 1, servers="in-process", out=tmp_path / "cut"
    )
    resumed = swarmwright.resume(tmp_path / "cut", servers="in-process")
    assert record(resumed, tmp_path) == record(whole, tmp_path)


def test_a_finished_run_goes_on_to_more_generations(tmp_path: Path) -> None:
    short = {**POPULATIONS, "method": {"population": 5, "generations": 2}}
    swarmwright.optimize(short, servers="in-process", out=tmp_path / "extended")
    extended = swarmwright.resume(tmp_path / "extended", generations=4, servers="in-process")
    whole = swarmwright.optimize(POPULATIONS, servers="in-process", out=tmp_path / "whole")
    assert record(extended, tmp_path) == record(whole, tmp_path)


@COMPETITIONS
def test_the_last_match_of_a_generation_is_that_of_the_champions(
    experiment: dict[str, Any], tmp_path: Path
) -> None:
    run = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "run")
    slices = slices_of(run.experiment)
    best = {side: run.champions(side) for side in slices}
    assert [champion.generation for champion in best["agents"]] == [0, 1, 2, 3]
    assert run.best.generation == 3
    last = np.concatenate([champions[-1].genome for champions in best.values()])
    fitness = play(run.experiment, last[np.newaxis], [0, 1], servers="in-process")
    assert fitness.shape == (1, 2, 2)
    assert fitness[0, :, 0].mean() == run.best.fitness
    assert (fitness[..., 1] == -fitness[..., 0]).all()


@pytest.mark.parametrize("experiment", [POPULATIONS, TOURNAMENT], ids=["populations", "swiss"])
def test_a_server_that_knows_only_the_deliverable_plays_matches(
    experiment: dict[str, Any], embedded_broker: str, foreign: Any, tmp_path: Path
) -> None:
    """It announces neither groups nor sides: the file maps agents to them, and the match is zero-sum."""
    groups = {name: {"agents": 1, "hidden": [2]} for name in ("agents", "defenders")}
    changes = {
        "simulation": "tug",
        "parameters": {},
        "requirements": {"dimensions": 1},
        "sensors": 2,
        "actuators": 1,
        "controller": {"kind": "team", "groups": groups},
    }
    with foreign(embedded_broker, "tug", agents=2) as server:
        run = swarmwright.optimize({**experiment, **changes}, broker=embedded_broker, out=tmp_path / "run")
    assert server.episodes >= run.evaluations * 2
    assert run.experiment.to_mapping()["ranking"]["sides"] == {"agents": "fitness", "defenders": "-fitness"}
    metrics = run.record.metrics
    assert (metrics[..., 1] == -metrics[..., 4]).all()


def test_opponents_are_copied_into_the_run(tmp_path: Path) -> None:
    """Everything works without their files: resuming, repeating, verifying."""
    first = swarmwright.optimize(TOURNAMENT, servers="in-process", out=tmp_path / "first")
    file = tmp_path / "champion.json"
    file.write_text(json.dumps(network(1)))
    ranking = {**TOURNAMENT["ranking"], "opponents": [str(first.path), str(file)]}
    experiment = {**TOURNAMENT, "ranking": ranking}
    whole = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "whole")
    swarmwright.optimize(
        experiment, lambda report: report.generation < 1, servers="in-process", out=tmp_path / "cut"
    )
    shutil.rmtree(first.path)
    file.unlink()
    resumed = swarmwright.resume(tmp_path / "cut", servers="in-process")
    assert record(resumed, tmp_path) == record(whole, tmp_path)
    candidates = resumed.record.metrics[:, 0, -6::3]
    row = int(np.flatnonzero((candidates == FIRST_OPPONENT - 1).any(axis=1))[0])
    assert repeat(resumed, row, 0, servers="in-process").same
    assert verify(resumed.path).problems == []


@pytest.mark.parametrize("both_sides", [True, False])
def test_the_record_names_opponents_and_has_their_genes(both_sides: bool, tmp_path: Path) -> None:
    ranking = {**OPPONENTS["ranking"], "both_sides": both_sides}
    run = swarmwright.optimize({**OPPONENTS, "ranking": ranking}, servers="in-process", out=tmp_path / "run")
    slices = list(slices_of(run.experiment).values())
    table = run.record
    met = set()
    for row, candidates in enumerate(table.metrics[:, 0, -6::3]):
        for side, candidate in enumerate(candidates.tolist()):
            if candidate <= FIRST_OPPONENT:
                number = int(FIRST_OPPONENT - candidate)
                genes = table.genomes[row, slices[side]]
                assert genes.tobytes() == np.array(network(1 + number)["weights"], np.float32).tobytes()
                met.add((table.generation[row], side, number, candidates[1 - side]))
    legs = 2 if both_sides else 1
    assert len(met) == 4 * 2 * legs * 5, "all of 5 meet 2 opponents in each of 4 generations"


def test_a_side_without_a_value_fails_the_match_with_a_reason(tmp_path: Path) -> None:
    sides = {"agents": "fitness", "defenders": "1 / (caught - 1)"}
    experiment = {**TOURNAMENT, "ranking": {**TOURNAMENT["ranking"], "sides": sides}}
    run = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "run")
    assert 0 < run.failed_evaluations < run.evaluations
    assert any("fitness of defenders" in event.text for event in run.events())
    resumed = swarmwright.resume(run.path, generations=5, servers="in-process")
    assert resumed.generations == 5
    stopping = {**experiment, "ranking": {**experiment["ranking"], "failed": "stop"}}
    with pytest.raises(RunError, match=r"ranking\.failed is 'stop'"):
        swarmwright.optimize(stopping, servers="in-process", out=tmp_path / "stopping")


@pytest.mark.parametrize("experiment", [POPULATIONS, ALONE], ids=["populations", "alone"])
def test_a_side_that_always_fails_ends_the_run_with_the_reason(
    experiment: dict[str, Any], tmp_path: Path
) -> None:
    sides = {"agents": "fitness", "defenders": "1 / (caught - caught)"}
    failing = {**experiment, "ranking": {**experiment["ranking"], "sides": sides}}
    with pytest.raises(RunError, match=r"failed; the last reason: fitness of defenders: division by zero"):
        swarmwright.optimize(failing, servers="in-process", out=tmp_path / "run")
    counted = {**failing, "ranking": {**failing["ranking"], "failed": -9}}
    run = swarmwright.optimize(counted, servers="in-process", out=tmp_path / "counted")
    assert run.failed_evaluations == run.evaluations
    assert (run.record.fitness == -9).all()


@pytest.mark.parametrize("population", [3, 4, 5])
@pytest.mark.parametrize("pairing", ["round_robin", "swiss", "multi_swiss", "merge_sort", "random"])
def test_any_number_of_candidates_plays(population: int, pairing: str, tmp_path: Path) -> None:
    experiment = {
        **TOURNAMENT,
        "method": {"kind": "random_search", "population": population, "generations": 2},
        "ranking": {"kind": "tournament", "pairing": pairing},
    }
    run = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "run")
    scores = run.record.metrics[:, 0, -6:]
    assert {*scores[:, 0].tolist()} == {*range(population)}
    assert np.isfinite(scores[:, 2]).all()


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("experiment", [OPPONENTS, ALONE, ARCHIVE], ids=["opponents", "alone", "archive"])
def test_a_run_that_is_killed_has_the_same_record(experiment: dict[str, Any], tmp_path: Path) -> None:
    """Killed at different moments and continued on two servers, then on one."""
    long = Experiment.from_mapping({**experiment, "method": {"population": 5, "generations": 300}})
    whole = swarmwright.optimize(long, servers="in-process", out=tmp_path / "whole")
    long.save(tmp_path / "x.yaml")
    for number, kills in enumerate(
        [["optimize", "x.yaml", "--out", "run"], ["resume", "run"], ["resume", "run"]]
    ):
        command = [sys.executable, "-m", "swarmwright", *kills, "--json", "--servers", str(2 - number % 2)]
        with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for _ in range(3 + 5 * number):
                process.stdout.readline()
            process.kill()
        assert process.returncode == -signal.SIGKILL
    assert 0 < Run.open(tmp_path / "run").generations < 300
    resumed = swarmwright.resume(tmp_path / "run", servers=2)
    assert record(resumed, tmp_path) == record(whole, tmp_path)


def test_matches_are_counted_in_reports(tmp_path: Path) -> None:
    reports: list[Any] = []
    run = swarmwright.optimize(TOURNAMENT, reports.append, servers="in-process", out=tmp_path / "run")
    assert [report.evaluations for report in reports][-1] == run.evaluations
    assert reports[-1].seconds_left == 0.0
    assert run.experiment.new_method().budget >= run.evaluations


def test_budgets_count_matches(tmp_path: Path) -> None:
    limited = {**TOURNAMENT, "method": {"population": 5, "evaluations": 40}}
    run = swarmwright.optimize(limited, servers="in-process", out=tmp_path / "run")
    assert 0 < run.evaluations <= 40


def test_only_competitions_have_champions(tmp_path: Path) -> None:
    run = swarmwright.optimize(MINISIM | {"parameters": {}}, servers="in-process", out=tmp_path / "run")
    with pytest.raises(InputError, match="not a competition"):
        run.champions("agents")


def test_unknown_sides_and_wrong_genomes_are_a_message(tmp_path: Path) -> None:
    run = swarmwright.optimize(TOURNAMENT, servers="in-process", out=tmp_path / "run")
    with pytest.raises(InputError, match="'left' is none of agents, defenders"):
        run.champions("left")
    with pytest.raises(InputError, match=r"genomes: shape is \(1, 3\); expected \(matches, 26\)"):
        play(run.experiment, np.zeros((1, 3)), [0], servers="in-process")


@pytest.mark.parametrize("side", ["agents", "defenders"])
def test_all_meet_all_in_chunks(side: str, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = swarmwright.Experiment.from_mapping(POPULATIONS)
    slices = slices_of(experiment)
    size = max(cut.stop for cut in slices.values())
    genomes = np.random.default_rng(1).uniform(-1, 1, (3, size)).astype(np.float32)
    agents, defenders = (genomes[:, cut] for cut in slices.values())
    joined = [
        np.concatenate([own, other] if side == "agents" else [other, own])
        for own in (agents if side == "agents" else defenders)
        for other in (defenders if side == "agents" else agents)
    ]
    expected = play(experiment, joined, [1, 2], servers="in-process")
    monkeypatch.setattr("swarmwright.runs.matches._CHUNK", 5)
    reports: list[tuple[int, int]] = []
    values = play_all(
        experiment,
        genomes,
        side,
        [1, 2],
        servers="in-process",
        on_progress=lambda done, whole, _: reports.append((done, whole)),
    )
    assert values.shape == (3, 3, 2, 2)
    assert values.reshape(9, 2, 2).tolist() == expected.tolist()
    assert reports == sorted(reports)
    assert reports[-1] == (18, 18)


def test_comparisons_say_that_opponents_differ(tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 2)):
        swarmwright.optimize(TOURNAMENT, seed=seed, servers="in-process", out=tmp_path / name)
    comparison = str(swarmwright.compare([tmp_path / "a", tmp_path / "b"]))
    assert "swarmwright league FOLDER" in comparison
    assert "is too high where fitness depends on the seed" not in comparison
