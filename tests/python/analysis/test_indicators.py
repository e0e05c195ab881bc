"""Comparisons of fronts and archives."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymoo.indicators.hv import Hypervolume

from swarmwright import Experiment, InputError, Run, compare, optimize
from swarmwright.analysis import indicators
from swarmwright.analysis.indicators import find_quick_indicators, find_shared_indicators
from swarmwright.analysis.sweep.result import sweep
from swarmwright.common.statistics import mean
from tests.python.analysis.runs import KnownRun

BASE: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 3, "numDefenders": 2, "placement": "random", "maxSteps": 12},
    "ranking": {"episodes": 2},
    "servers": "in-process",
}
GOALS = {"steps": "minimize", "distance": "minimize"}
FRONT = {"kind": "nsga2", "population": 10, "generations": 4, "objectives": GOALS}
MEASURES = {"steps": {"range": [0, 12], "bins": 6}, "distance": {"range": [0, 30], "bins": 5}}
ARCHIVE = {"kind": "map_elites", "population": 10, "generations": 4, "measures": MEASURES}


def made(folder: Path, method: dict[str, Any], seeds: int = 2, **changes: Any) -> list[Run]:
    folder.mkdir(exist_ok=True)
    return [
        optimize(
            Experiment.from_mapping({**BASE, "method": {**method, **changes}, "seed": seed}),
            out=folder / f"{'-'.join(map(str, changes.values())) or 'base'}-{seed}".replace("{", "_"),
        )
        for seed in range(seeds)
    ]


@pytest.fixture(scope="module")
def fronts(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    folder = tmp_path_factory.mktemp("fronts")
    return [*made(folder, FRONT), *made(folder, FRONT, severity=0.9)]


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    folder = tmp_path_factory.mktemp("archives")
    return [*made(folder, ARCHIVE), *made(folder, ARCHIVE, step=0.3)]


def evaluated(run: Run, at: int | None = None) -> list[tuple[float, ...]]:
    """Fitness, steps and distance of each evaluation, by the columns of the record."""
    columns = [[run.record[f"{name}_{episode}"] for episode in (0, 1)] for name in ("steps", "distance")]
    return [
        (float(fitness), *(mean([float(one[row]) for one in of]) for of in columns))
        for row, fitness in enumerate(run.record.fitness[:at])
    ]


def costs(run: Run, at: int | None = None) -> np.ndarray[Any, np.dtype[np.float64]]:
    """What `nsga2` minimizes, of those that no other one dominates."""
    rows = {(-fitness, *metrics) for fitness, *metrics in evaluated(run, at)}
    return np.array(
        [
            row
            for row in rows
            if not any(
                other != row and all(a <= b for a, b in zip(other, row, strict=True)) for other in rows
            )
        ]
    )


def elites(run: Run, at: int | None = None) -> dict[tuple[int, int], float]:
    """The best fitness in each cell."""
    best: dict[tuple[int, int], float] = {}
    for fitness, steps, distance in evaluated(run, at):
        cell = min(int(steps // 2), 5), min(int(distance // 6), 4)
        best[cell] = max(fitness, best.get(cell, -np.inf))
    return best


@pytest.mark.parametrize("at", [None, 25])
def test_hypervolume_is_scaled_to_what_all_fronts_have(fronts: list[Run], at: int | None) -> None:
    found = compare(fronts, by="hypervolume", at=at)
    of_runs = [costs(run, at) for run in fronts]
    best, worst = np.concatenate(of_runs).min(axis=0), np.concatenate(of_runs).max(axis=0)
    theirs = Hypervolume(ref_point=np.full(3, 1.1))
    expected = [theirs((front - best) / (worst - best)) for front in of_runs]
    assert [value for one in found.groups for value in one.final] == pytest.approx(expected, rel=1e-9)
    ranges, point = found.indicator.ranges, found.indicator.reference
    assert ranges is not None
    assert point is not None
    assert list(ranges) == list(point) == ["fitness", "steps", "distance"]
    for name, sign, low, high in zip(ranges, (-1, 1, 1), best, worst, strict=True):
        assert ranges[name] == (sign * high, sign * low)
        assert point[name] == pytest.approx(sign * (high + 0.1 * (high - low)))
    assert {one.evaluations for one in found.groups} == {(at or 40, at or 40)}
    assert [one.label for one in found.groups] == ["severity 0.2", "severity 0.9"]
    assert [len(one.runs) for one in found.groups] == [2, 2]
    assert "reference point: fitness " in str(found)
    assert not any("only the best fitness" in note for note in found.notes)


def test_a_reference_point_is_in_the_units_of_the_objectives(fronts: list[Run]) -> None:
    point = {"distance": 9, "fitness": -9.0, "steps": 11.5}
    found = compare(fronts, by="hypervolume", reference=point)
    theirs = Hypervolume(ref_point=np.array([9, 11.5, 9]))
    expected = [theirs(costs(run)) for run in fronts]
    assert [value for one in found.groups for value in one.final] == pytest.approx(expected, rel=1e-9)
    assert "in the units of its objectives; reference point: fitness -9, steps 11.5, distance 9." in str(
        found
    )
    behind = sum(int((costs(run) >= [9, 11.5, 9]).any(axis=1).sum()) for run in fronts)
    assert any(f"{behind} of " in note and "add nothing" in note for note in found.notes) == (behind > 0)
    # A value of one run does not depend on the others.
    assert compare(fronts[:1], by="hypervolume", reference=point).groups[0].final[0] == pytest.approx(
        expected[0]
    )


@pytest.mark.parametrize("at", [None, 25])
def test_archives_are_compared_by_qd_score_and_coverage(archives: list[Run], at: int | None) -> None:
    of_runs = [elites(run, at) for run in archives]
    lowest = min(min(one.values()) for one in of_runs)
    found = compare(archives, by="qd_score", at=at)
    assert found.indicator.offset == lowest < 0
    expected = [sum(value - lowest for value in one.values()) for one in of_runs]
    assert [value for one in found.groups for value in one.final] == pytest.approx(expected)
    assert f"an offset of {lowest:.6g}, the lowest fitness of an elite of these runs." in str(found)
    given = compare(archives, by="qd_score", at=at, offset=-50)
    expected = [sum(value + 50 for value in one.values()) for one in of_runs]
    assert [value for one in given.groups for value in one.final] == pytest.approx(expected)
    assert str(given).startswith(
        "QD score of each run's archive: the sum over its elites of fitness minus an"
    )
    assert "an offset of -50.\n" in str(given)
    covered = compare(archives, by="coverage", at=at)
    assert [value for one in covered.groups for value in one.final] == [len(one) / 30 for one in of_runs]
    assert str(covered).startswith("Coverage of each run's archive: the share of its cells")


def test_an_offset_that_punishes_elites_is_noted(archives: list[Run]) -> None:
    assert any("above the lowest fitness" in one for one in compare(archives, by="qd_score", offset=0).notes)


def test_plain_values_and_the_figure_name_what_is_compared(archives: list[Run], fronts: list[Run]) -> None:
    found = compare(archives, by="qd_score", offset=-50)
    shown = json.loads(json.dumps(found.to_mapping()))
    assert (shown["by"], shown["offset"], shown["reference"], shown["ranges"]) == (
        "qd_score",
        -50,
        None,
        None,
    )
    assert shown["groups"][0]["runs"][0]["qd_score"] == found.groups[0].final[0]
    assert found.figure().axes[1].get_ylabel() == "QD score of each run, at the end"
    shown = compare(fronts, by="hypervolume").to_mapping()
    assert set(shown["reference"]) == set(shown["ranges"]) == {"fitness", "steps", "distance"}
    assert compare(fronts).to_mapping()["by"] == "fitness"


def test_curves_end_at_what_is_compared(fronts: list[Run], archives: list[Run]) -> None:
    for runs, by in ((fronts, "hypervolume"), (archives, "qd_score"), (archives, "coverage")):
        found = compare(runs, by=by)  # type: ignore[arg-type]
        values = found.indicator.curve(runs[0])
        assert list(values) == [0, 1, 2, 3]
        assert values[3] == found.groups[0].final[0]
        if by != "qd_score":  # earlier elites can have less fitness than the offset
            assert list(values.values()) == sorted(values.values())
        axes = found.figure(x="generations").axes[0]
        assert axes.get_ylabel() == f"{found.indicator.words} (more is better)"
        middle = np.median([list(found.indicator.curve(run).values()) for run in runs[:2]], axis=0)
        assert axes.lines[0].get_ydata() == pytest.approx(middle)
    first = compare(archives, by="coverage").indicator.curve(archives[0])
    assert first[1] == len(elites(archives[0], 20)) / 30


def test_the_note_of_a_comparison_by_fitness_names_the_option(fronts: list[Run], archives: list[Run]) -> None:
    assert any("--by hypervolume` compares these" in note for note in compare(fronts).notes)
    assert any("--by qd_score` compares these (or --by coverage)" in one for one in compare(archives).notes)


def test_what_cannot_be_compared(fronts: list[Run], archives: list[Run], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"made by map_elites, and has no hypervolume; only runs of nsga2"):
        compare([*fronts, *archives], by="hypervolume")
    with pytest.raises(InputError, match=r"made by nsga2, and has no QD score; only runs of map_elites"):
        compare(fronts, by="qd_score")
    other = made(tmp_path, FRONT, 1, objectives={"steps": "maximize"})
    with pytest.raises(
        InputError,
        match=r"different objectives.*: fitness \(maximize\), distance \(minimize\), steps \(minimize\); "
        r"fitness \(maximize\), steps \(maximize\)\. Name",
    ):
        compare([*fronts, *other], by="hypervolume")
    wider = {**MEASURES, "steps": {"range": [0, 14], "bins": 6}}
    other = made(tmp_path, ARCHIVE, 1, measures=wider)
    with pytest.raises(InputError, match=r"different cells.*steps 0 to 12 in 6 bins; .* 0 to 14 in 6 bins"):
        compare([*archives, *other], by="coverage")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"by": "best"}, "by: must be one of fitness, hypervolume, qd_score, coverage, not 'best'"),
        ({"by": ["fitness"]}, "by: must be one of"),
        ({"by": "hypervolume", "held_out": True}, "held_out: compares fitness"),
        ({"by": "coverage", "offset": 1.0}, "offset: .* by='qd_score'"),
        ({"reference": {"fitness": 1}}, "reference: .* by='hypervolume'"),
        ({"by": "hypervolume", "reference": {"fitness": 1}}, "no value of steps and distance; the reference"),
        (
            {"by": "hypervolume", "reference": {"speed": 1}},
            "'speed' is not an objective of .*: fitness, steps",
        ),
        ({"by": "hypervolume", "reference": 3}, "reference: must be a mapping"),
        (
            {"by": "hypervolume", "reference": {"fitness": 1, "steps": np.nan, "distance": 1}},
            "reference.steps: must be a finite number",
        ),
    ],
)
def test_wrong_options(fronts: list[Run], options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        compare(fronts, **options)


def test_empty_fronts_and_archives(fronts: list[Run], archives: list[Run]) -> None:
    for (run, *others), by in ((fronts, "hypervolume"), (archives, "qd_score"), (archives, "coverage")):
        empty = Run.open(run.path)
        vars(empty)["elites"] = replace(run.elites, candidates=[])
        found = compare([empty], by=by)  # type: ignore[arg-type]
        assert found.groups[0].final.tolist() == [0.0]
        json.dumps(found.to_mapping(), allow_nan=False)
        groups = compare([empty, *others], by=by).groups  # type: ignore[arg-type]
        values = [pair for group in groups for pair in zip(group.runs, group.final, strict=True)]
        assert [value for one, value in values if one.path == empty.path] == [0.0]


@pytest.mark.slow
def test_a_sweep_has_what_its_runs_share(tmp_path: Path) -> None:
    base = {**BASE, "method": {**ARCHIVE, "generations": 2}}
    found = sweep({"experiment": base, "grid": {"method.step": [0.01, 0.3]}, "seeds": 2}, out=tmp_path / "a")
    rows = found.table()
    scores, coverages = (found.compare(by=by) for by in ("qd_score", "coverage"))
    for of, name in ((scores, "qd_score"), (coverages, "coverage")):
        values = {
            str(run.path): value for one in of.groups for run, value in zip(one.runs, one.final, strict=True)
        }
        assert {row["run"]: row[name] for row in rows} == values
    assert "hypervolume" not in rows[0]


def test_what_takes_long_is_left_to_the_user(
    fronts: list[Run], archives: list[Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert find_shared_indicators(fronts) == find_quick_indicators(fronts) == ("hypervolume",)
    assert find_shared_indicators(archives) == find_quick_indicators(archives) == ("qd_score", "coverage")
    assert find_shared_indicators([*fronts, *archives]) == ()
    largest = max(len(run.elites.candidates) for run in fronts)
    monkeypatch.setattr(indicators, "_QUICK_FRONT_SIZES", {3: largest})
    assert find_quick_indicators(fronts) == ("hypervolume",)
    monkeypatch.setattr(indicators, "_QUICK_FRONT_SIZES", {3: largest - 1})
    assert find_quick_indicators(fronts) == ()
    for reference in (None, {"fitness": -9.0, "steps": 99.0, "distance": 99.0}):
        found = compare(fronts, by="hypervolume", reference=reference)
        assert min(found.groups[0].final) > 0
        assert found.figure().axes[0].get_ylabel() == "best recorded fitness so far (more is better)"
    assert any("--by hypervolume` compares these" in note for note in compare(fronts).notes)
    many = dict.fromkeys(("steps", "distance", "caught", "arrived"), "minimize")
    experiment = Experiment.from_mapping({**BASE, "method": {**FRONT, "objectives": many}})
    known = KnownRun(Path("many"), [[1.0]], **experiment.to_mapping())
    assert find_shared_indicators([known]) == ("hypervolume",)
    assert find_quick_indicators([known]) == ()
