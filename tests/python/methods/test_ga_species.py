"""GASpecies: members of similar genomes share their fitness."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from swarmwright import InputError
from swarmwright.common.arrays import Genomes
from swarmwright.methods.ga_species import GaSpecies
from tests.python.methods.functions import new, rastrigin, sphere


def species(**options: Any) -> GaSpecies:
    method = new("ga_species", **options)
    assert isinstance(method, GaSpecies)
    return method


def distance(one: Genomes, other: Genomes) -> float:
    return float(np.abs(one.astype(np.float64) - other).sum())


def test_defaults_are_those_of_frevo_except_for_smaller_mutations() -> None:
    options = species().options
    assert (options.population, options.generations, options.compatibility) == (50, 200, 0.5)
    assert (options.survival, options.mutate, options.within) == (0.4, 0.3, 0.001)
    assert (options.crossover_only, options.severity, options.probability) == (0.2, 0.3, 1.0)


def test_the_best_found_the_species_of_what_is_similar() -> None:
    method = species(population=40)
    genomes = method.ask()
    fitness = -sphere(genomes.astype(np.float64))
    method.tell(fitness)
    members = method.members
    ranked = genomes[np.argsort(-fitness, kind="stable")]
    assert members.genomes.tobytes() == ranked.tobytes()
    founders = [rows[0] for rows in members.species]
    assert founders == sorted(founders)
    threshold = members._threshold
    for number, rows in enumerate(members.species):
        for row in rows[1:]:
            apart = [distance(ranked[row], ranked[founder]) for founder in founders]
            assert next(index for index, value in enumerate(apart) if value < threshold) == number
        assert all(distance(ranked[rows[0]], ranked[founder]) >= threshold for founder in founders[:number])


def test_the_threshold_adapts_to_a_tenth_as_many_species() -> None:
    method = species(population=60, generations=30)
    counts = []
    while not method.done:
        method.tell(-rastrigin(method.ask().astype(np.float64)))
        counts.append(len(method.members.species))
    assert 4 <= np.median(counts[5:]) <= 8
    assert method.members._threshold != 0.5


def test_crowded_species_lose_members_and_the_best_is_never_lost() -> None:
    method = species(population=4, compatibility=1.0)
    members = method.members
    start = np.zeros((4, 10), dtype=np.float32)
    start[3] = 5  # alone, and the worst
    assert members.update(start, np.array([4.0, 3.0, 2.0, 1.0])).tolist() == [0, 1, 2, 3]
    members._threshold = 1.0
    children = np.full((2, 10), 0.01, dtype=np.float32)
    # Shared values of ranks 6 to 1: species of five, 6/5 .. 2/5, and 1/1 of the one apart.
    kept = members.update(children, np.array([4.0, 3.0, 2.0, 1.0, 5.0, 6.0]))
    assert kept.tolist() == [5, 4, 0, 3]
    assert [rows.tolist() for rows in members.species] == [[0, 1, 2], [3]]


def test_failed_candidates_are_no_members() -> None:
    method = species(population=6)
    genomes = method.ask()
    method.tell(np.array([np.nan, 1, np.nan, 2, np.nan, np.nan]))
    assert method.population_fitness.tolist() == [2, 1]
    assert method.survivors().tobytes() == genomes[[3, 1]].tobytes()
    method.ask()
    method.tell(np.full(6, np.nan), survivors=[np.nan, 5.0])
    assert method.population_fitness.tolist() == [5]
    everything = species(population=6)
    everything.ask()
    everything.tell(np.full(6, np.nan))
    assert np.isnan(everything.population_fitness).all()
    assert np.isfinite(everything.ask()).all()


def test_ways_of_children() -> None:
    made: Counter[str] = Counter()
    method = species(population=1000, mutate=0.3, crossover_only=0.25, survival=1.0, compatibility=15)
    for name in ("mutations", "crossovers"):
        original = getattr(method.representation, name)

        def counting(*arguments: Any, name: str = name, original: Any = original, **options: Any) -> Any:
            children = original(*arguments, **options)
            made[name] += len(children)
            return children

        setattr(method.representation, name, counting)
    method.tell(-sphere(method.ask().astype(np.float64)))
    assert len(method.ask()) == 1000
    crossed = made["crossovers"] / 1000
    single = sum(len(rows) for rows in method.members.species if len(rows) == 1) / 1000
    assert crossed == pytest.approx(0.7 * (1 - single), abs=0.06)
    assert made["mutations"] / 1000 == pytest.approx(1 - crossed * 0.25, abs=0.06)


def test_mothers_are_the_best_of_their_species() -> None:
    method = species(population=50, mutate=1.0, severity=0.0, compatibility=15)
    genomes = method.ask()
    method.tell(-sphere(genomes.astype(np.float64)))
    parents = {
        method.members.genomes[row].tobytes()
        for rows in method.members.species
        for row in rows[: max(int((len(rows) - 1) * 0.4), 1)]
    }
    children = {child.tobytes() for child in method.ask()}
    assert children <= parents
    assert len(children) > len(parents) / 2
    assert len(parents) < 30


@pytest.mark.parametrize("seed", [1, 2])
def test_it_gets_better(seed: int) -> None:
    method = species(seed=seed, generations=40)
    best = []
    while not method.done:
        method.tell(-sphere(method.ask().astype(np.float64)))
        best.append(method.population_fitness[0])
    assert best == sorted(best)
    assert best[-1] > best[0] / 10


def test_populations_that_take_too_long_are_refused() -> None:
    with pytest.raises(InputError, match=r"method\.population: 30,000 genomes of 10 genes .* at most 22,360"):
        new("ga_species", population=30_000)
