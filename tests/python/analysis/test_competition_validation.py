"""Validation of competitions: what champions reach against opponents that evolution has not met."""

import io
import json
import shutil
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, RunError, optimize
from swarmwright.analysis.competition_validation import (
    CompetitionValidation,
    SideResult,
    validate_competition,
)
from swarmwright.cli import run as run_command
from swarmwright.runs.matches import play
from tests.python.analysis.test_league import ROLES, TOURNAMENT, TRIO, options, pulling
from tests.python.experiment.test_opponents import bundle


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs with other seeds, a run with roles, and controllers that pull with 0.1 and 0.99."""
    path = tmp_path_factory.mktemp("validation")
    long = {"method": {"population": 4, "generations": 5}}
    for seed in (1, 2):
        optimize(
            Experiment.from_mapping({**TOURNAMENT, **long, "seed": seed}),
            servers="in-process",
            out=path / f"run-{seed}",
        )
    optimize(Experiment.from_mapping(ROLES), servers="in-process", out=path / "roles")
    for strength in (0.1, 0.99):
        (path / f"pull-{strength}.json").write_text(json.dumps(pulling(strength)))
    return path


def validate(folder: Path, name: str, *against: str, **changes: Any) -> CompetitionValidation:
    run = Run.open(folder / name)
    experiment = changes.pop("experiment", run.experiment)
    champions = changes.pop("champions", 1)
    paths = [str(folder / each) if each else "" for each in against]
    return validate_competition(run, experiment, paths, options(**changes), champions=champions)


def test_its_matches_are_those_of_play(folder: Path) -> None:
    result = validate(folder, "run-1", "pull-0.1.json", "pull-0.99.json", "run-2", champions=2, seed=None)
    run = Run.open(folder / "run-1")
    assert result.generations == (0, 4)
    assert not set(result.seeds) & run._store.collect_seeds()
    assert [opponent.name.rpartition("/")[2] for opponent in result.opponents] == [
        "pull-0.1.json",
        "pull-0.99.json",
        "run-2",
    ]
    champions = [run.champions("left")[generation].genome for generation in result.generations]
    others = [opponent.sides[0].weights for opponent in result.opponents]
    for side, order in (("left", 1), ("right", -1)):
        joined = [np.concatenate([own, other][::order]) for own in champions for other in others]
        expected = play(run.experiment, joined, result.seeds, servers="in-process")[..., ::order]
        assert result.fitness[side].reshape(expected.shape).tolist() == expected.tolist()
        last = result.champions[side][-1]
        own, other = expected.reshape(2, 3, 4, 2)[-1].transpose(2, 0, 1)
        assert last.mean == pytest.approx(own.mean())
        counts = [int(np.count_nonzero(each)) for each in (own > other, own == other, own < other)]
        assert [last.wins, last.draws, last.losses] == counts
        assert sum(part.wins for _, part in result.by_opponent[side]) == last.wins


def test_strong_opponents_are_told_from_weak_ones(folder: Path) -> None:
    result = validate(folder, "run-1", "pull-0.1.json", "pull-0.99.json", episodes=20)
    for results in result.by_opponent.values():
        (_, weak), (_, strong) = results
        assert weak.wins > strong.wins


def test_sides_with_other_tasks_meet_those_that_fit(folder: Path) -> None:
    """Of a single controller, sensors say which side it plays; a team plays both."""
    (folder / "left.json").write_text(json.dumps(pulling(0.3, 2)))
    result = validate(folder, "roles", "left.json", "pull-0.1.json")
    assert {
        side: [name.rpartition("/")[2] for name, _ in rows] for side, rows in result.by_opponent.items()
    } == {
        "left": ["pull-0.1.json"],
        "right": ["left.json"],
    }
    assert np.isnan(result.fitness["left"][:, 0]).all()
    assert result.champions["left"][0].failed == 0


def test_opponents_alone_are_not_validated(folder: Path, tmp_path: Path) -> None:
    """A side without a population has no champions of its own."""
    values = {
        **ROLES,
        "populations": {"left": {}},
        "ranking": {"opponents": {"right": [pulling(0.2)]}},
        "seed": 3,
    }
    optimize(Experiment.from_mapping(values), servers="in-process", out=tmp_path / "alone")
    opponents = [str(folder / "pull-0.1.json"), str(folder / "pull-0.99.json")]
    (tmp_path / "met.json").write_text(json.dumps(pulling(0.2)))
    result = validate(tmp_path, "alone", *opponents, "met.json")
    assert list(result.fitness) == ["left"]
    (left_out,) = result.left_out
    assert "met.json: is from this evolution, or was met in it" in left_out.reason
    assert f"Left out: {left_out.reason}" in str(result)


def test_failed_episodes_do_not_count(folder: Path) -> None:
    experiment = Run.open(folder / "run-1").experiment
    tearing = experiment.replace(parameters={"tears": 0.3})
    result = validate(folder, "run-1", "pull-0.1.json", experiment=tearing, episodes=20)
    failed = sum(results[0].failed for results in result.champions.values())
    assert failed
    assert f"{failed} episode" in str(result)
    for (last,) in result.champions.values():
        assert last.wins + last.draws + last.losses + last.failed == 20
    with pytest.raises(RunError, match="every episode failed"):
        validate(folder, "run-1", "pull-0.99.json", experiment=experiment.replace(parameters={"tears": 9.0}))


def test_mistakes_are_a_message(folder: Path, tmp_path: Path) -> None:
    for against, message in [
        (
            ["run-1"],
            r"no opponent can play against the champions of .*run-1: is from this evolution, or was met",
        ),
        (["run-1:0:1"], r"run-1:0:1: is from this evolution"),
        ([""], r"opponent: its name is empty"),
        (["nothing"], r"no opponent can play .*nothing: there is no such file"),
    ]:
        with pytest.raises(InputError, match=message):
            validate(folder, "run-1", *against)
    optimize(Experiment.from_mapping(TRIO), servers="in-process", out=tmp_path / "trio")
    with pytest.raises(InputError, match=r"two sides, .*, but the run has first, second, third"):
        validate(tmp_path, "trio", str(folder / "run-1"))
    optimize(
        {"simulation": "minisim", "method": {"generations": 1}}, servers="in-process", out=tmp_path / "one"
    )
    with pytest.raises(
        InputError, match="is not a competition; validate it on held-out seeds: swarmwright resume"
    ):
        validate(tmp_path, "one", str(folder / "run-1"))


def test_the_command_prints_tables_and_json(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("run-1", "run-2"):
        shutil.copytree(folder / name, name)
    bundle(Path("\x1b[2J.zip"), pulling(0.8))  # of another simulation
    text = io.StringIO()
    arguments = ["--episodes", "3", "--seed", "5", "--servers", "in-process", "--trust"]
    with redirect_stdout(text), redirect_stderr(text):
        assert run_command(["validate", "run-1", "run-2", "\x1b[2J.zip", *arguments]) == 1
    lines = text.getvalue().splitlines()
    assert "Champions of run-1 against 1 opponent that it has not met, 3 episodes each, seeds 5 to 7" in lines
    assert r"\x1b[2J.zip: was evolved in minisim, not in Duel" in text.getvalue()
    assert "Side left" in lines
    text = io.StringIO()
    with redirect_stdout(text):
        assert run_command(["validate", "run-1", "run-2", *arguments, "--json"]) == 0
    values = json.loads(text.getvalue())
    assert values["seeds"] == [5, 6, 7]
    assert values["opponents"][0]["name"] == "run-2"
    assert np.shape(values["sides"]["right"]["fitness"]) == (1, 1, 3, 2)
    assert run_command(["validate", "run-1"]) == 2


def test_intervals_take_opponents_and_seeds_into_account() -> None:
    """A mean of few opponents is as uncertain as they differ, however many episodes there are."""
    random = np.random.default_rng(1)
    inside = 0
    for _ in range(100):
        own = random.normal(size=(8, 1)) + 0.1 * random.normal(size=(8, 40))
        result = SideResult.of(own, -own)
        assert result.low is not None
        assert result.high is not None
        inside += result.low <= 0.0 <= result.high
    assert 80 <= inside <= 99, "about 95 %"
    assert SideResult.of(np.full((1, 1), 2.0), np.zeros((1, 1))).low is None
    same = SideResult.of(np.array([[2.0, np.nan, 2.0]]), np.zeros((1, 3)))
    assert (same.mean, same.low, same.high, same.wins, same.failed) == (2.0, 2.0, 2.0, 2, 1)
