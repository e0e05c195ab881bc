"""Novelty search: what it selects and archives, and that it finds more behaviours than fitness does."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from swarmwright import InputError
from swarmwright.common.arrays import Genomes
from swarmwright.methods import METHODS
from swarmwright.methods.archive import Archive, Grid, ranks
from swarmwright.methods.novelty import Novelty, NoveltyOptions
from tests.python.methods.functions import new, sphere

MEASURES = {"x": {"range": [-5, 5], "bins": 20}, "y": {"range": [0, 1]}}
MANY = {f"m{number}": {"range": [0, 1], "bins": 1} for number in range(20)}
ROUND = {"x": {"range": [-5, 5], "bins": 20}, "y": {"range": [-5, 5], "bins": 20}}


def novelty(**options: Any) -> Novelty:
    method = new("novelty", **{"measures": MEASURES, **options})
    assert isinstance(method, Novelty)
    return method


def tell(method: Novelty, genomes: Genomes, **changes: Any) -> Any:
    """Tell it that the first genes are the measures, and the distance of the others the fitness."""
    points = genomes.astype(np.float64)
    fitness = -sphere(points[:, 2:])
    method.tell(**{"fitness": fitness, "metrics": points[:, :2], **changes})
    return fitness


def collect(seed: int, generations: int = 60, **options: Any) -> Archive:
    """Return the elites of a run."""
    method = novelty(seed=seed, measures=ROUND, population=50, generations=generations, **options)
    elites = Archive(Grid(method.options.elites.axes))
    while not method.done:
        points = method.ask().astype(np.float64)
        fitness = -sphere(points[:, 2:])
        elites.add(range(len(points)), fitness, points[:, :2])
        method.tell(fitness, metrics=points[:, :2])
    return elites


@pytest.mark.parametrize("seed", [1, 2])
def test_it_finds_more_behaviours_than_fitness_does(seed: int) -> None:
    by_fitness = collect(seed, objective="mixed", weight=1.0)
    rules: list[dict[str, Any]] = [
        {"species": {}},
        *({"archive": {"kind": kind}} for kind in ("threshold", "none")),
    ]
    for options in rules:
        assert len(collect(seed, **options)) > 1.1 * len(by_fitness), options
    assert len(collect(seed)) > 1.5 * len(by_fitness)
    for objective in ("mixed", "local_competition"):
        both = collect(seed, objective=objective)
        assert len(both) > 1.3 * len(by_fitness)
        assert both.fitness.max() > collect(seed).fitness.max()
        assert both.fitness.mean() > collect(seed).fitness.mean()


def naive(points: NDArray[np.float64], archive: NDArray[np.float64], count: int = 15) -> Any:
    """Novelty, and the nearest others."""
    everyone = np.concatenate([archive, points])
    distances = np.sqrt(((points[:, np.newaxis] - everyone) ** 2).sum(axis=2))
    distances[np.arange(len(points)), len(archive) + np.arange(len(points))] = np.inf
    order = np.argsort(distances, axis=1, kind="stable")[:, :count]
    return np.take_along_axis(distances, order, axis=1).mean(axis=1), order


def scaled(genomes: Genomes) -> NDArray[np.float64]:
    return genomes[:, :2].astype(np.float64) / [10, 1]


@pytest.mark.parametrize("objective", ["novelty", "mixed", "local_competition"])
@pytest.mark.parametrize("islands", [1, 2])
def test_survivors_are_those_with_the_highest_scores(objective: str, islands: int) -> None:
    """Recomputed by comparing all with all, over several generations."""
    method = novelty(population=40, islands=islands, elite=0.25, random=0.0, renew=0.05, objective=objective)
    members, before, archive = method.ask(), 0, method.archive
    fitness = tell(method, members)
    for _ in range(6):
        scores, neighbours = naive(scaled(members), archive.points[:before])
        if objective == "mixed":
            scores = 0.5 * scale(scores) + 0.5 * scale(fitness)
        if objective == "local_competition":
            everyone = np.concatenate([archive.fitness[:before], fitness])
            worse = (everyone[neighbours] < fitness[:, np.newaxis]).sum(axis=1)
            scores = -ranks(np.column_stack([scores, worse.astype(float)])).astype(float)
        children = method.ask()
        kept = [row.tobytes() for row in method.survivors()]
        rows = np.array([[row.tobytes() for row in members].index(row) for row in kept])
        assert method.population_fitness.tolist() == fitness[rows].tolist()
        if islands == 1:
            missing = np.setdiff1d(np.arange(len(members)), rows)
            assert scores[rows].min() >= scores[missing].max() - 1e-12
            assert len(rows) == 10
        before = len(archive)
        fitness = np.concatenate([fitness[rows], tell(method, children)])
        members = np.concatenate([members[rows], children])
        if islands == 2:
            half = len(rows) // 2, len(children) // 2
            parts = [(0, half[0]), (len(rows), len(rows) + half[1])]
            parts += [(half[0], len(rows)), (len(rows) + half[1], len(members))]
            order = np.concatenate([np.arange(*part) for part in parts])
            fitness, members = fitness[order], members[order]


def scale(values: Any) -> Any:
    return (values - values.min()) / (values.max() - values.min())


def test_candidates_that_failed_are_no_members() -> None:
    method = novelty(population=8, archive={"kind": "random", "probability": 1.0})
    genomes = method.ask()
    fitness, metrics = np.arange(8.0), genomes[:, :2].astype(np.float64)
    fitness[2], metrics[5, 1] = np.nan, np.inf
    method.tell(fitness, metrics=metrics)
    assert len(method.archive) == 6
    assert sorted(method.archive.fitness.tolist()) == [0, 1, 3, 4, 6, 7]
    for _ in range(3):
        children = method.ask()
        assert not {genomes[2].tobytes(), genomes[5].tobytes()} & {
            row.tobytes() for row in method.survivors()
        }
        tell(method, children)


@pytest.mark.parametrize("species", [None, {}])
def test_without_any_member_it_goes_on_at_random(species: Any) -> None:
    method = novelty(population=6, species=species)
    tell(method, method.ask(), fitness=np.full(6, np.nan))
    genomes = method.ask()
    assert len(genomes) == 6
    assert np.isnan(method.population_fitness).all()
    tell(method, genomes)
    assert np.isfinite(tell(method, method.ask())).all()


def test_huge_measures_do_no_harm() -> None:
    method = novelty(population=6, neighbours=2)
    genomes = method.ask()
    metrics = np.array([[1e308, -1e308], [-1e308, 1e308], [0, 0], [1, 1], [1, 1], [1e-308, 0]])
    tell(method, genomes, metrics=metrics)
    assert len(method.ask()) > 0


def test_criteria_rank_those_that_meet_them_first() -> None:
    method = novelty(
        population=40,
        elite=0.5,
        random=0.0,
        mutate=0.5,
        crossover=0.0,
        renew=0.0,
        criteria={"fitness": {"at_least": 10}, "x": {"at_most": 5}, "speed": {"at_least": 0, "at_most": 2}},
        archive={"kind": "random", "probability": 1.0},
    )
    assert method.options.needed_metrics == ("x", "y", "speed")
    method.ask()
    fitness = np.arange(40.0)
    metrics = np.column_stack([np.arange(40) % 10, np.arange(40) * 1000.0, np.full(40, 1.0)])
    metrics[30, 2], metrics[31, 2] = np.nan, 2.5
    method.tell(fitness, metrics=metrics)
    meets = [row for row in range(40) if row >= 10 and row % 10 <= 5 and row not in (30, 31)]
    assert len(meets) == 16
    assert method.archive.fitness.tolist() == meets
    method.ask()
    assert set(method.population_fitness.tolist()) >= set(map(float, meets))


def test_the_archive_takes_a_share_of_new_candidates() -> None:
    method = novelty(population=100, generations=50, archive={"kind": "random", "probability": 0.1})
    while not method.done:
        tell(method, method.ask())
    assert len(method.archive) / method.evaluations == pytest.approx(0.1, abs=0.02)
    small = novelty(population=100, generations=50, archive={"kind": "random", "size": 20})
    while not small.done:
        tell(small, small.ask())
    assert len(small.archive) == 20


def test_survivors_that_were_evaluated_again_have_the_new_fitness() -> None:
    every: list[Any] = [None, {}]
    for species in every:
        method = novelty(population=10, species=species, objective="mixed", weight=1.0)
        tell(method, method.ask())
        genomes = method.ask()
        again = np.linspace(1, 2, len(method.survivors()))
        tell(method, genomes, survivors=again)
        method.ask()
        assert method.population_fitness.max() == 2


def test_the_same_seed_gives_the_same_candidates() -> None:
    every: list[dict[str, Any]] = [{}, {"species": {}}, {"objective": "local_competition", "islands": 2}]
    for options in every:
        runs = []
        for seed in (3, 3, 4):
            method = novelty(seed=seed, population=30, generations=6, **options)
            asked = []
            while not method.done:
                asked.append(method.ask())
                tell(method, asked[-1])
            runs.append(np.concatenate(asked).tobytes())
        assert runs[0] == runs[1]
        assert runs[0] != runs[2]


def test_the_first_generation_is_random_as_that_of_every_method() -> None:
    first = new("random_search", population=20).ask().tobytes()
    assert novelty(population=20).ask().tobytes() == first
    assert novelty(population=20, species={}).ask().tobytes() == first


def test_elites_are_those_of_an_archive_over_the_measures_with_bins() -> None:
    model = NoveltyOptions.model_validate
    assert model({"measures": MEASURES}).elites.measures.keys() == {"x", "y"}
    single = {"range": [0, 1], "bins": 1}
    assert model({"measures": {"a": single, **MEASURES}}).elites.measures.keys() == {"x", "y"}
    assert model({"measures": {"a": single, "b": single}}).elites.measures.keys() == {"a"}
    model({"measures": {f"m{number}": single for number in range(200)}})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"neighbours": 50, "population": 50}, "neighbours: must be below the population of 50, not 50"),
        ({"neighbours": 9999, "population": 100_000}, "neighbours: 9,999 neighbours of 100,000 members"),
        ({"measures": MANY, "population": 4000}, "population: 4,000 members .* at most 2,500 members"),
        (
            {"measures": MANY, "archive": {"kind": "random", "size": 200_000}},
            r"archive\.size: 200,000 is too large with 20 measures; use at most 100,000, or 12 measures",
        ),
        ({"weight": 0.5}, "weight needs objective: mixed"),
        ({"objective": "mixed", "weight": 1.1}, "less than or equal to 1"),
        ({"objective": "mixed", "weight": -0.1}, "greater than or equal to 0"),
        ({"criteria": {"fitness": {}}}, "needs at_least, at_most or both"),
        ({"criteria": {"fitness": {"at_least": 2, "at_most": 1}}}, "at_least 2 is above at_most 1"),
        ({"criteria": ["speed"]}, r"must map each metric to limits, such as \{speed: \{at_least: 0\}\}"),
        ({"measures": ["speed"]}, r"must map each metric to a range, such as \{speed: \{range: \[0, 1\]"),
        ({"archive": {"kind": "threshold", "threshold": 0}}, "greater than 0"),
        ({"archive": {"kind": "random", "size": -1}}, "greater than or equal to 0"),
        ({"objective": "local_competition", "population": 5000}, "limited to a population of 4,000"),
        ({"species": {}, "islands": 2}, "species need a single population; leave islands out"),
        ({"species": {"survival": 2}}, "less than or equal to 1"),
        (
            {"measures": {name: {"range": [0, 1], "bins": 200} for name in "abc"}},
            "measures make 8,000,000 cells, .*; measures with bins: 1 do not divide the archive",
        ),
    ],
)
def test_wrong_options(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        METHODS.get("novelty").options_model.model_validate(options)


def test_species_of_too_many_genomes_are_refused() -> None:
    with pytest.raises(InputError, match=r"method\.population: 30,000 genomes .* use at most 22,360"):
        novelty(species={}, population=30_000)


def test_telling_it_needs_metrics() -> None:
    method = novelty(population=5)
    method.ask()
    with pytest.raises(InputError, match=r"novelty needs metrics: tell.*, with columns x, y"):
        method.tell(np.zeros(5))


def test_steady_state_is_refused() -> None:
    with pytest.raises(InputError, match="novelty cannot work in steady state"):
        novelty(operation="steady_state")
