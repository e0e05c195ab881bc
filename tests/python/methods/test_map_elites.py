"""MAP-Archive: what it asks for, and that it fills its archive."""

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from swarmwright import InputError
from swarmwright.common.arrays import Genomes
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods import METHODS, Method
from swarmwright.methods.archive import Archive, Axis, Grid
from swarmwright.methods.emitters import Emitters, Thresholds
from swarmwright.methods.map_elites import MapElites, MapElitesOptions
from tests.python.methods.functions import new, sphere, ten_genes

MEASURES = {"x": {"range": [-5, 5], "bins": 20}, "y": {"range": [-5, 5], "bins": 20}}


def told(method: Method, genomes: Genomes) -> None:
    """Tell it that the first two genes are the measures, and the first one the fitness."""
    points = genomes.astype(np.float64)
    method.tell(points[:, 0], metrics=points[:, :2] if method.options.needed_metrics else None)


def evolved(seed: int = 1, generations: int = 60, **options: Any) -> MapElites:
    """Illuminate the sphere: measures are the first two genes, fitness is the distance of the others."""
    method = new(
        "map_elites", seed=seed, population=50, generations=generations, measures=MEASURES, **options
    )
    assert isinstance(method, MapElites)
    while not method.done:
        points = method.ask().astype(np.float64)
        method.tell(-sphere(points[:, 2:]), metrics=points[:, :2])
    return method


def at_random(seed: int, generations: int = 60) -> Archive:
    """The archive that random search fills with as many evaluations."""
    options = METHODS.get("map_elites").options_model.model_validate({"measures": MEASURES})
    assert isinstance(options, MapElitesOptions)
    elites = options.new_archive()
    assert isinstance(elites, Archive)
    method = new("random_search", seed=seed, population=50, generations=generations)
    while not method.done:
        points = method.ask().astype(np.float64)
        fitness = -sphere(points[:, 2:])
        elites.add(range(len(points)), fitness, points[:, :2])
        method.tell(fitness)
    return elites


@pytest.mark.parametrize("variation", ["line", "mutation"])
@pytest.mark.parametrize("seed", [1, 2])
def test_it_fills_more_cells_than_random_search_and_with_better_candidates(variation: str, seed: int) -> None:
    found, rest = evolved(seed, variation=variation).archive, at_random(seed)
    assert len(found) > 2 * len(rest)
    ours = dict(zip(found.cells.tolist(), found.fitness.tolist(), strict=True))
    theirs = dict(zip(rest.cells.tolist(), rest.fitness.tolist(), strict=True))
    shared = sorted(ours.keys() & theirs.keys())
    assert len(shared) > 100
    assert np.mean([ours[cell] for cell in shared]) > np.mean([theirs[cell] for cell in shared]) + 1.0


def test_the_first_generations_are_random_as_those_of_every_method() -> None:
    method = new("map_elites", population=8, initial=20, measures=MEASURES)
    other = new("random_search", population=8)
    for _ in range(3):
        asked = method.ask()
        assert asked.tobytes() == other.ask().tobytes()
        told(method, asked)
        told(other, asked)
    assert method.ask().tobytes() != other.ask().tobytes()


def test_genes_stay_within_bounds() -> None:
    class Bounded(type(ten_genes())):  # type: ignore[misc] # a class that is looked up
        @property
        def bounds(self) -> tuple[Any, Any]:
            return np.full(10, -3.0), np.full(10, 3.0)

    base = ten_genes()
    subject = Bounded(base.options, sensors=9, actuators=1)
    method = new("map_elites", subject=subject, population=40, step=5.0, line=5.0, measures=MEASURES)
    for _ in range(5):
        asked = method.ask()
        assert np.abs(asked).max() <= 3.0
        told(method, asked)


def test_candidates_without_fitness_or_measures_are_no_parents() -> None:
    method = new("map_elites", population=6, variation="mutation", severity=0.0, measures=MEASURES)
    asked = method.ask()
    fitness = np.array([np.nan, 1, 2, 3, 4, 5])
    metrics = asked[:, :2].astype(np.float64)
    metrics[2:5, 0] = [np.nan, np.inf, -np.inf]
    method.tell(fitness, metrics=metrics)
    parents = {row.tobytes() for row in asked[[1, 5]]}
    assert {row.tobytes() for row in method.ask()} <= parents
    assert sorted(method.population_fitness.tolist()) == [1, 5]


def test_without_any_elite_it_goes_on_at_random() -> None:
    method = new("map_elites", population=4, measures=MEASURES)
    asked = method.ask()
    method.tell(np.full(4, np.nan), metrics=np.full((4, 2), np.nan))
    assert np.isnan(method.population_fitness).all()
    assert method.ask().tobytes() != asked.tobytes()


def test_telling_it_needs_metrics_of_the_right_shape() -> None:
    method = new("map_elites", population=4, measures=MEASURES)
    method.ask()
    with pytest.raises(
        InputError, match=r"map_elites needs metrics: tell\(fitness, metrics=\.\.\.\), with columns x, y"
    ):
        method.tell(np.zeros(4))
    with pytest.raises(InputError, match=r"metrics: shape is \(4, 3\); expected \(4, 2\)"):
        method.tell(np.zeros(4), metrics=np.zeros((4, 3)))
    method.tell(np.zeros(4), metrics=np.zeros((4, 2)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"measures": {"x": {"range": [1, 1]}}},
            r"range must be \[low, high\] with low < high, not \[1, 1\]",
        ),
        (
            {"measures": {"x": {"range": [-1e308, 1e308]}}},
            r"range \[-1e\+308, 1e\+308\] is too wide: its width is not a finite number",
        ),
        ({"measures": {"x": {"range": [0, 1e-308], "bins": 9}}}, "is too narrow for 9 bins"),
        ({"measures": {"x": {"range": [0, 1, 2]}}}, "at most 2 items"),
        (
            {"measures": {name: {"range": [0, 1], "bins": 200} for name in "abc"}},
            "measures make 8,000,000 cells, more than 1,000,000; use fewer bins",
        ),
        (
            {"measures": MEASURES, "archive": {"kind": "cvt"}},
            r"measures\.x\.bins: only a grid has bins, not archive\.kind cvt; leave it out and set ",
        ),
        ({"archive": {"kind": "cvt", "cells": 0}}, "greater than or equal to 1"),
        ({"archive": {"kind": "cvt", "cells": 1_000_000}}, "less than or equal to 10000"),
        (
            {"archive": {"kind": "unstructured"}, "population": 200_000},
            "population: 200,000 candidates take too long .*; use at most 100,000, and more generations",
        ),
        (
            {"population": 9, "reevaluate": 0.1},
            "reevaluate: 0.1 of a population of 9 is less than one candidate; increase it or the population",
        ),
        ({"archive": {"kind": "unstructured", "threshold": math.nan}}, "finite number"),
        ({"archive": {"kind": "unstructured", "threshold": 0}}, "greater than or equal to"),
        ({"archive": {"kind": "grid", "cells": 5}}, "Extra inputs are not permitted"),
        ({"archive": {"kind": "octree"}}, "does not match any of the expected tags"),
    ],
)
def test_wrong_measures(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        METHODS.get("map_elites").options_model.model_validate(options)


@pytest.mark.parametrize(
    "archive", [{"kind": "cvt", "cells": 60}, {"kind": "unstructured", "threshold": 0.1}]
)
def test_other_archives(archive: dict[str, Any]) -> None:
    ranges = {name: {"range": [-5, 5]} for name in ("x", "y")}

    def evolved(generations: int) -> MapElites:
        method = new("map_elites", population=40, generations=generations, measures=ranges, archive=archive)
        assert isinstance(method, MapElites)
        before = -math.inf
        while not method.done:
            points = method.ask().astype(np.float64)
            method.tell(-sphere(points[:, 2:]), metrics=points[:, :2])
            score = float((method.archive.fitness + 1e6).sum())
            assert score >= before
            before = score
        return method

    first, after = evolved(3).archive, evolved(30).archive
    assert 10 < len(first) < len(after)
    assert after.fitness.max() > first.fitness.max()
    assert after.numbers.tolist() == evolved(30).archive.numbers.tolist()


def test_the_same_seed_gives_the_same_archive() -> None:
    def stored(method: MapElites) -> list[tuple[int, int, float]]:
        elites = method.archive
        return list(zip(elites.cells.tolist(), elites.numbers.tolist(), elites.fitness.tolist(), strict=True))

    assert stored(evolved(3, 10)) == stored(evolved(3, 10))
    assert stored(evolved(3, 10)) != stored(evolved(4, 10))


def test_genes_that_are_choices_are_mutated() -> None:
    class Choices(type(ten_genes())):  # type: ignore[misc] # a class that is looked up
        continuous = False

        def mutations(self, parents: Genomes, *_: Any, **options: float) -> Genomes:
            assert options == {"severity": 0.3, "probability": 0.3}
            return parents + 1

    subject = Choices(ten_genes().options, sensors=9, actuators=1)
    method = new("map_elites", subject=subject, population=5)
    first = method.ask()
    told(method, first)
    assert {row.tobytes() for row in method.ask()} == {(first[first[:, 0].argmax()] + 1).tobytes()}
    with pytest.raises(InputError, match=r"method\.variation: line needs numeric genes"):
        new("map_elites", subject=subject, variation="line")


def illuminated(**options: Any) -> MapElites:
    """An archive of a fitness that is highest at the edge of the measures, by 6,000 evaluations."""
    measures = {name: {"range": [-3, 3], "bins": 20} for name in ("x", "y")}
    method = new("map_elites", population=60, generations=100, **{"measures": measures, **options})
    assert isinstance(method, MapElites)
    while not method.done:
        points = method.ask().astype(np.float64)
        method.tell(100 - sphere(points - 2), metrics=points[:, [0, 5]] / 2 + points[:, [1, 6]] / 2)
    return method


@pytest.mark.parametrize(
    "options",
    [
        {"variation": "cma_me"},
        {"variation": "cma_mae", "threshold_min": 0.0, "learning_rate": 0.5},
        {"variation": "cma_me", "archive": {"kind": "unstructured", "threshold": 0.05}},
    ],
)
def test_emitters_illuminate_better_than_lines(options: dict[str, Any]) -> None:
    if "archive" in options:
        options["measures"] = {name: {"range": [-3, 3]} for name in ("x", "y")}

    def score(method: MapElites) -> float:
        return float(method.archive.fitness.sum())

    lines = {name: value for name, value in options.items() if name in ("archive", "measures")}
    emitted = illuminated(**options)
    assert score(emitted) > 1.02 * score(illuminated(**lines))
    again = illuminated(**options)
    assert emitted.archive.fitness.tobytes() == again.archive.fitness.tobytes()


def test_emitters_that_learn_nothing_begin_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[int] = []
    begin = Emitters._begin

    def note(self: Emitters, center: Any) -> Any:
        begun.append(1)
        return begin(self, center)

    monkeypatch.setattr(Emitters, "_begin", note)
    method = new("map_elites", population=12, generations=9, emitters=2, variation="cma_me")
    fitness = iter([np.arange(12.0), np.zeros(12), np.full(12, np.nan), np.arange(12.0) + 90, np.zeros(12)])
    counts = []
    for values in fitness:
        method.ask()
        method.tell(values)
        counts.append(len(begun))
    # After random candidates both begin; what did not improve anything begins anew, unless all failed.
    assert counts == [0, 2, 4, 4, 4]


def test_thresholds_follow_the_mean_of_accepted_candidates() -> None:
    thresholds = Thresholds(Grid((Axis(0, 2, 2),)), learning_rate=0.1, least=0.0)
    measures = np.array([[0.5], [0.5], [0.5], [1.5], [np.nan]])
    first = thresholds.improve(np.array([10.0, 20.0, -5.0, 4.0, 9.0]), measures)
    assert first.values[:4].tolist() == [10, 20, -5, 4]
    assert np.isnan(first.values[4])
    second = thresholds.improve(np.full(5, 50.0), measures)
    assert second.values[:4] == pytest.approx([50 - 15 * (1 - 0.9**2)] * 3 + [50 - 0.4])


@pytest.mark.parametrize("variation", ["cma_me", "cma_mae"])
def test_emitters_need_two_numeric_genes(variation: str) -> None:
    class Choices(type(ten_genes())):  # type: ignore[misc] # a class that is looked up
        continuous = False

    subject = Choices(ten_genes().options, sensors=9, actuators=1)
    with pytest.raises(InputError, match=rf"method\.variation: {variation} needs numeric genes"):
        new("map_elites", subject=subject, variation=variation, threshold_min=0.0)


def test_covariance_matrices_of_many_emitters_are_refused() -> None:
    layered = REPRESENTATIONS.get("layered")
    subject = layered(layered.options_model.model_validate({"hidden": []}), sensors=1999, actuators=1)
    with pytest.raises(InputError, match=r"method\.emitters: 40 covariance .* 2,000 genes .* at most 31"):
        new("map_elites", subject=subject, variation="cma_me", emitters=40, population=400)
