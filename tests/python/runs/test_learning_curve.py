"""What a run would have returned, on held-out seeds."""

import csv
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError, learning_curve, post_evaluate, resume
from tests.python.runs.test_post_evaluation import run_of

PLAIN: dict[str, Any] = {"method": {"kind": "cma_es", "population": 6, "generations": 7}}
AGAIN: dict[str, Any] = {
    "method": {"kind": "nnga", "population": 10, "generations": 7},
    "ranking": {"reevaluate": True, "episodes": 2, "seeds": "new"},
}
FRONT: dict[str, Any] = {
    "method": {"kind": "nsga2", "population": 8, "generations": 7, "objectives": {"steps": "minimize"}}
}
STEADY: dict[str, Any] = {
    "method": {"kind": "nnga", "population": 6, "generations": 7, "operation": "steady_state"},
    "ranking": {"seeds": "same"},
}


@pytest.mark.parametrize("changes", [PLAIN, AGAIN, FRONT, STEADY], ids=["plain", "again", "front", "steady"])
def test_a_point_is_what_a_run_that_ends_there_returns(tmp_path: Path, changes: dict[str, Any]) -> None:
    run = run_of(tmp_path, validate=False, **changes)
    curve = learning_curve(run, 3, episodes=5, seed=10_000)
    assert [one.generation for one in curve.points] == [0, 3, 6]
    for point in curve.points:
        shorter = run_of(
            tmp_path,
            validate=False,
            **{**changes, "method": {**changes["method"], "generations": point.generation + 1}},
        )
        assert point.evaluations == shorter.evaluations
        best = post_evaluate(shorter, episodes=5, seed=10_000)
        assert point.best.label == best.label
        assert point.best.recorded == best.recorded
        assert point.best.episodes.tolist() == best.episodes.tolist()


def test_points_of_a_race_and_of_a_run_that_went_on(tmp_path: Path) -> None:
    race = run_of(
        tmp_path, method={"kind": "racing", "evaluations": 60}, ranking={"episodes": 1, "seeds": "same"}
    )
    curve = learning_curve(race, 1000, episodes=3)
    assert [one.generation for one in curve.points] == list(range(race.generations))
    assert [one.best.recorded for one in curve.points] == [one.best_so_far for one in race.history]
    assert curve.points[-1].best.label == post_evaluate(race, episodes=3).label
    run = run_of(tmp_path, **PLAIN)
    assert len(learning_curve(resume(run, generations=9), 20, episodes=2).points) == 9


def test_it_is_drawn_and_written(tmp_path: Path) -> None:
    run = run_of(tmp_path, validate={"episodes": 6}, **PLAIN)
    curve = learning_curve(run.path, points=1, episodes=4)
    assert [one.generation for one in curve.points] == [6]
    assert curve.points[0].best.validated == 4, "the seeds are those of the validation"
    curve = learning_curve(run, points=7, episodes=4)
    axes = curve.figure().axes[0]
    lines = {str(line.get_label()): list(line.get_ydata()) for line in axes.lines}  # type: ignore[arg-type]
    assert lines["recorded fitness of the best so far"] == [one.best_so_far for one in run.history]
    assert lines["its fitness on held-out seeds"] == [one.best.fitness.mean for one in curve.points]
    assert curve.plot(tmp_path / "curve.svg").stat().st_size > 1000
    rows = list(csv.DictReader(curve.export(tmp_path / "curve.csv").read_text().splitlines()))
    assert [float(row["held-out"]) for row in rows] == [one.best.fitness.mean for one in curve.points]
    assert [int(row["evaluations"]) for row in rows] == [6, 12, 18, 24, 30, 36, 42]
    assert curve.to_mapping()["points"][2]["best"]["fitness"] == curve.points[2].best.fitness.mean
    assert "held-out" in curve._repr_html_()


def test_one_episode_has_no_interval_and_is_drawn(tmp_path: Path) -> None:
    curve = learning_curve(run_of(tmp_path, **PLAIN, validate=False, ranking={"episodes": 1}), 3, episodes=1)
    assert curve.points[0].best.fitness.low is None
    assert curve.plot(tmp_path / "curve.png").stat().st_size > 1000


def test_mistakes(tmp_path: Path) -> None:
    run = run_of(tmp_path, validate=False, **PLAIN)
    with pytest.raises(InputError, match="points: must be at least 1, not 0"):
        learning_curve(run, 0)
    with pytest.raises(InputError, match=r"points: must be an integer, not 2\.5"):
        learning_curve(run, 2.5)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="episodes: must be at least 1"):
        learning_curve(run, episodes=0)
    median = run_of(tmp_path, validate=False, **PLAIN, ranking={"episodes": 3, "aggregate": "median"})
    with pytest.raises(InputError, match=r"episodes: must be at least ranking\.episodes \(3\)"):
        learning_curve(median, episodes=2)
    other = run.experiment.replace(controller={"hidden": [3]})
    with pytest.raises(InputError, match="genes"):
        learning_curve(run, experiment=other)
    with pytest.raises(InputError, match="nothing"):
        learning_curve(tmp_path / "nothing")
