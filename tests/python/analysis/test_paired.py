"""Two controllers in the same episodes."""

import csv
import io
import json
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import (
    Controller,
    Experiment,
    InputError,
    Run,
    RunError,
    compare_controllers,
    optimize,
    post_evaluate,
)
from swarmwright.cli import run as run_command
from swarmwright.common.statistics import estimate

NOISY: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 3, "numDefenders": 3, "placement": "random", "speedDefenders": 0.5},
    "method": {"kind": "random_search", "population": 20, "generations": 3},
    "ranking": {"episodes": 2, "seeds": "new"},
    "validate": False,
    "servers": "local",
}
FAILING = {"fitness": "1/caught", "parameters": {"numAgents": 4, "numDefenders": 2, "placement": "random"}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs a and b of the same task; fixed, which does not depend on the seed; failing; exit, another one."""
    path = tmp_path_factory.mktemp("paired")
    experiment = Experiment.from_mapping(NOISY)
    optimize(experiment, out=path / "a")
    # It has used held-out seeds of a.
    optimize(experiment.replace(parameters={"seed": 1_000_000_000}, seed=2), out=path / "b")
    optimize(Experiment.from_mapping({**NOISY, "parameters": {"placement": "fixed"}}), out=path / "fixed")
    optimize(Experiment.from_mapping({**NOISY, **FAILING}), out=path / "failing")
    small = {"population": 4, "generations": 1}
    optimize(
        Experiment.from_mapping({"simulation": "emergency_exit", "method": small, "servers": "local"}),
        out=path / "exit",
    )
    Controller.load(path / "b").save(path / "mine.json")
    return path


def command(*arguments: str | Path, status: int = 0) -> str:
    """Run `swarmwright compare`; return what it has said."""
    text = io.StringIO()
    with redirect_stdout(text), redirect_stderr(text):
        assert run_command(["compare", *map(str, arguments)]) == status, text.getvalue()
    return text.getvalue()


def test_both_get_seeds_that_neither_run_used(folder: Path) -> None:
    found = compare_controllers(folder / "a", folder / "b", episodes=30)
    used = Run.open(folder / "b")._store.collect_seeds()
    assert 1_000_000_000 in used
    assert not used & set(found.seeds)
    assert found.held_out
    for one, run in ((found.first, "a"), (found.second, "b")):
        alone = post_evaluate(folder / run, seed=found.seeds[0], episodes=30, experiment=found.experiment)
        assert (one.seeds, one.episodes.tolist()) == (alone.seeds, alone.episodes.tolist())
    differences = found.first.episodes - found.second.episodes
    assert found.differences.tolist() == differences.tolist()
    assert found.difference == estimate(differences.tolist())
    assert found.test is not None
    assert (found.test.better, found.test.worse) == ((differences > 0).sum(), (differences < 0).sum())
    assert found.is_reportable
    assert found.depends_on_seed
    again = compare_controllers(folder / "b", folder / "a", episodes=30, seed=found.seeds[0])
    assert again.difference.mean == pytest.approx(-found.difference.mean)
    assert again.test is not None
    assert again.test.p == found.test.p
    assert again.test.effect == pytest.approx(-found.test.effect)
    known = compare_controllers(folder / "a", folder / "b", seed=0, episodes=3)
    assert not known.held_out
    assert any("the evolution of A used 3 of these 3 seeds" in note for note in known.caveats)


def test_candidates_files_and_controllers_are_the_same(folder: Path) -> None:
    run = Run.open(folder / "b")
    best = run.best
    expected = compare_controllers(folder / "a", run, episodes=10)
    for second in (
        f"{folder / 'b'}:{best.generation}:{best.candidate}",
        folder / "mine.json",
        folder / "b" / "best.json",
        Controller(best.controller.specification),
    ):
        seed = expected.seeds[0]
        found = compare_controllers(folder / "a", second, episodes=10, seed=seed)
        assert found.differences.tolist() == expected.differences.tolist()
    # Where A is no run, the experiment is B's.
    swapped = compare_controllers(folder / "mine.json", folder / "a", episodes=10, seed=expected.seeds[0])
    assert swapped.differences.tolist() == (-expected.differences).tolist()
    other = compare_controllers(folder / "a", f"{folder / 'a'}:0:3", episodes=4)
    assert other.names == (str(folder / "a"), f"{folder / 'a'}:0:3")
    assert other.second.episodes.tolist() == post_evaluate(folder / "a", 3, 0, episodes=4).episodes.tolist()


def test_a_folder_may_be_called_like_a_candidate(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "x:0:3").symlink_to(folder / "a")
    found = compare_controllers(tmp_path / "x:0:3", folder / "a", episodes=2)
    assert found.differences.tolist() == [0.0, 0.0]


def test_same_controllers_have_no_interval(folder: Path) -> None:
    found = compare_controllers(folder / "b", folder / "mine.json", episodes=10)
    assert (found.difference.mean, found.difference.low, found.difference.high) == (0.0, None, None)
    assert found.test is not None
    assert (found.test.p, found.test.equal) == (1.0, 10)
    assert "A and B are the same controller" in found.caveats
    assert "the difference is the same in all 10 episodes, so there is no interval" in found.caveats


def test_fitness_without_chance_has_no_interval_and_no_test(folder: Path) -> None:
    found = compare_controllers(folder / "fixed", folder / "fixed:1:4", episodes=12)
    assert found.depends_on_seed is False
    assert found.difference.mean != 0
    assert (found.difference.low, found.difference.standard_error, found.test) == (None, None, None)
    text = str(found)
    assert "does not seem to depend on the seed" in text
    assert "Wilcoxon" not in text
    assert "confidence" not in text
    single = compare_controllers(folder / "a", folder / "b", episodes=2, seed=7)
    assert "2 differences cannot be significant" in str(single)


def test_one_episode_says_nothing_of_others(folder: Path) -> None:
    experiment = Run.open(folder / "a").experiment.replace(ranking={"episodes": 1})
    found = compare_controllers(folder / "a", folder / "b", episodes=1, experiment=experiment)
    assert (found.depends_on_seed, found.test, found.difference.low) == (None, None, None)
    assert "one episode says nothing about others" in str(found)


def test_pairs_with_a_failed_episode_are_named_and_not_reportable(folder: Path) -> None:
    first, second = folder / "failing", folder / "failing:0:0"
    found = compare_controllers(first, second, episodes=40)
    failed = [np.isnan(one.episodes) for one in (found.first, found.second)]
    assert 0 < failed[0].sum() < 40
    both = failed[0] | failed[1]
    assert np.isnan(found.differences).tolist() == both.tolist()
    assert found.left_out == [seed for seed, one in zip(found.seeds, both, strict=True) if one]
    assert not found.is_reportable
    text = str(found)
    seeds = [seed for seed, one in zip(found.seeds, failed[0], strict=True) if one]
    assert f"Note: A failed in {len(seeds)} of 40 episodes (seeds {seeds[0]}" in text
    assert f"left out ({both.sum()} of 40), so do not report these figures" in text
    assert "significant" not in text
    values = found.to_mapping()
    assert (values["reportable"], values["failed"]) == (False, [int(one.sum()) for one in failed])

    worth = Run.open(first).experiment.replace(ranking={"failed": -1})
    counted = compare_controllers(first, second, episodes=40, experiment=worth)
    assert counted.is_reportable
    expected = np.where(failed[0], -1, found.first.episodes) - np.where(failed[1], -1, found.second.episodes)
    assert counted.differences.tolist() == expected.tolist()
    assert f"A failed in {len(seeds)} of 40 episodes" in str(counted)
    assert "and counts as -1 there" in str(counted)
    assert "do not report" not in str(counted)


def test_one_that_fails_in_every_episode_is_named(folder: Path) -> None:
    broken = {**NOISY, "fitness": "1/(steps - steps)"}
    with pytest.raises(RunError, match=r"^A \(.*a\): every episode failed; the last reason: "):
        compare_controllers(folder / "a", folder / "b", episodes=3, experiment=broken)
    worth = {**broken, "ranking": {"episodes": 2, "failed": -3}}
    found = compare_controllers(folder / "a", folder / "b", episodes=3, experiment=worth)
    assert (found.difference.mean, found.first.failed, found.second.failed) == (0.0, 3, 3)
    assert "B failed in 3 of 3 episodes" in str(found)


def test_fitness_that_is_no_mean_is_compared_as_well(folder: Path) -> None:
    worst = Run.open(folder / "a").experiment.replace(ranking={"aggregate": "worst"})
    found = compare_controllers(folder / "a", folder / "b", episodes=20, experiment=worst)
    rows = [one.episodes.reshape(10, 2).min(axis=1) for one in (found.first, found.second)]
    assert found.fitness_difference == estimate((rows[0] - rows[1]).tolist())
    assert "Difference of fitness (worst of 2 episodes): " in str(found)
    assert compare_controllers(folder / "a", folder / "b", episodes=2).fitness_difference is None


def test_what_does_not_fit_is_refused(folder: Path) -> None:
    a, b = folder / "a", folder / "b"
    with pytest.raises(InputError, match=r"neither A nor B is a run .* --experiment FILE"):
        compare_controllers(folder / "mine.json", b / "best.json")
    with pytest.raises(InputError, match=r"was evolved in minisim, B .* in emergency_exit; name the exp"):
        compare_controllers(a, folder / "exit")
    with pytest.raises(InputError, match=r"^B \(.*exit\): has .* sensors .*; minisim has 4 and 1"):
        compare_controllers(a, folder / "exit", experiment=NOISY)
    with pytest.raises(InputError, match=r"^B \(.*mine.json\): has 4 sensors .*; emergency_exit has"):
        compare_controllers(folder / "exit", folder / "mine.json")
    with pytest.raises(InputError, match="has generations 0 to 2, but no generation 9"):
        compare_controllers(a, f"{a}:9:0")
    with pytest.raises(InputError, match="file not found"):
        compare_controllers(a, folder / "nothing.json")
    with pytest.raises(InputError, match="B: must be the path of a run folder or a controller"):
        compare_controllers(a, 3)  # type: ignore[arg-type]
    worst = Run.open(a).experiment.replace(ranking={"aggregate": "worst"})
    with pytest.raises(InputError, match=r"episodes: must be at least ranking\.episodes \(2\)"):
        compare_controllers(a, b, episodes=1, experiment=worst)


def test_other_conditions_of_the_runs_are_named(folder: Path) -> None:
    found = compare_controllers(folder / "a", folder / "fixed", episodes=2)
    note = next(one for one in found.notes if "evolved under different conditions" in one)
    assert "parameters.numAgents: A 3, B 1" in note
    assert "parameters.seed" not in note
    same = compare_controllers(folder / "a", folder / "b", episodes=2)
    assert not same.notes, "they differ in seeds alone"


def test_progress_counts_the_episodes_of_both(folder: Path) -> None:
    seen: list[tuple[int, int]] = []
    compare_controllers(
        folder / "a", folder / "b", episodes=4, on_progress=lambda done, total, _: seen.append((done, total))
    )
    assert seen[-1] == (8, 8)
    assert seen == sorted(seen)


def test_the_command(folder: Path, tmp_path: Path) -> None:
    experiment = folder / "a" / "experiment.yaml"
    table, picture = tmp_path / "t.csv", tmp_path / "f.png"
    arguments = (folder / "a", folder / "mine.json", "--episodes", "12")
    text = command(*arguments, "--csv", table, "--save", picture)
    assert "12 episodes of minisim, the same for both (held-out seeds 1000000000 to 1000000011)" in text
    assert "(Student's t of the differences)" in text
    assert "Wilcoxon signed-rank test: W " in text
    assert picture.read_bytes().startswith(b"\x89PNG")
    values = json.loads(command(*arguments, "--json"))
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [float(row["difference"]) for row in rows] == values["differences"]
    assert [int(row["seed"]) for row in rows] == values["seeds"]
    assert [float(row["first"]) for row in rows] == values["first"]["values"]
    files = command(folder / "a" / "best.json", folder / "mine.json", "--experiment", experiment,
                    "--episodes", "12", "--json")  # fmt: skip
    assert json.loads(files)["differences"] == values["differences"]
    harder = json.loads(command(*arguments, "--set", "parameters.speedDefenders=0.9", "--json"))
    assert harder["settings"] == ["parameters.speedDefenders=0.9"]
    assert harder["differences"] != values["differences"]


def test_mistakes_of_the_command(folder: Path, tmp_path: Path) -> None:
    a = folder / "a"
    assert "'nothing' does not exist" in command(a, "nothing", status=2)
    assert "does not exist" in command(a, "nothing:0:1", status=2)
    assert "is a file where a folder is expected" in command(a, f"{a}/best.json:0:1", status=2)
    assert "name one: --experiment FILE" in command(a / "best.json", folder / "mine.json", status=2)
    assert "does not affect how a candidate is evaluated" in command(
        a, a, "--set", "method.generations=2", status=2
    )
    assert "unknown suffix of a figure; use .png, .svg or .pdf" in command(
        a, a, "--save", tmp_path / "x.txt", status=2
    )
    assert "this table ends with .csv" in command(a, a, "--csv", tmp_path / "x.txt", status=2)


@pytest.mark.parametrize("failed", [None, -1.0])
def test_the_figure_draws_pairs_that_count(folder: Path, failed: float | None) -> None:
    experiment = Run.open(folder / "failing").experiment
    if failed is not None:
        experiment = experiment.replace(ranking={"failed": failed})
    found = compare_controllers(
        folder / "failing", folder / "failing:0:0", episodes=20, experiment=experiment
    )
    pairs, ordered = found.figure().axes
    drawn = np.concatenate([line.get_ydata() for line in pairs.lines if line.get_marker() == "o"])
    assert len(drawn) == len(found.paired)
    points = np.concatenate([line.get_ydata() for line in ordered.lines if line.get_marker() == "o"])
    assert points.tolist() == sorted(found.paired.tolist())
    title = ordered.get_title(loc="left")
    lost = found.first.failed + found.second.failed
    expected = f"; {len(found.left_out)} excluded" if failed is None else f"; {lost} failures count as -1"
    assert expected in title


def test_drawn_without_any_pair(folder: Path, tmp_path: Path) -> None:
    found = compare_controllers(folder / "a", folder / "b", episodes=2)
    failed = replace(found.first, episodes=np.full(2, np.nan), metrics={})
    empty = replace(found, first=failed, second=failed)
    assert "Difference A - B: not known" in str(empty)
    assert empty.plot(tmp_path / "f.svg").is_file()
    assert json.dumps(empty.to_mapping())
