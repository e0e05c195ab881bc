"""NNGA: FREVO's numbers and its intended distribution."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from swarmwright.common.arrays import Genome, Genomes
from swarmwright.common.errors import InputError
from swarmwright.controllers.kinds.layered import Layered, LayeredOptions
from swarmwright.methods import METHODS
from swarmwright.methods.nnga import Nnga, NngaOptions, Shares
from swarmwright.testing._common import representation


def new(seed: int = 1, **options: Any) -> Nnga:
    return Nnga(NngaOptions(**options), representation(), seed=seed)


def test_defaults_are_those_of_frevo() -> None:
    assert NngaOptions().shares() == Shares(elite=8, random=5, mutate=20, crossover=15, renew=2)
    # 50 at first, then 37 new ones in each of 299 generations.
    assert new(generations=300).budget == 11_113


def test_only_new_members_are_evaluated() -> None:
    method = new(generations=4)
    sizes = []
    while not method.done:
        genomes = method.ask()
        sizes.append(len(genomes))
        method.tell(-np.abs(genomes.astype(np.float64)).sum(axis=1))
    assert sizes == [50, 37, 37, 37]
    assert len(method.population_fitness) == 50


def test_the_elite_stays_and_the_best_never_gets_worse() -> None:
    method = new(generations=20)
    best = -np.inf
    while not method.done:
        genomes = method.ask()
        before = method.population_fitness
        method.tell(-np.abs(genomes.astype(np.float64)).sum(axis=1))
        after = method.population_fitness
        assert after.max() >= best
        if len(before):
            # Asking keeps 8 of the elite and 5 others.
            assert len(before) == 13
            assert set(before) <= set(after)
        best = after.max()


def test_it_finds_what_random_search_does_not() -> None:
    def best_of(kind: str) -> float:
        component = METHODS.get(kind)
        method = component(component.options_model(generations=60), representation(), seed=3)
        best = -np.inf
        while not method.done and method.evaluations < 2000:
            fitness = -((method.ask().astype(np.float64) - 0.5) ** 2).sum(axis=1)
            method.tell(fitness)
            best = max(best, fitness.max())
        return best

    assert best_of("nnga") > 0.5 * best_of("random_search")
    assert best_of("nnga") > -20


def test_survivors_are_different_members() -> None:
    method = new(elite=0.1, random=0.5, mutate=0.2, crossover=0.1, renew=0.1)
    fitness = np.arange(50.0)
    method.ask()
    method.tell(fitness)
    method.ask()
    survivors = method.population_fitness.tolist()
    assert len(survivors) == len(set(survivors)) == 30
    assert survivors[:5] == [49, 48, 47, 46, 45]


def test_failed_members_never_stay() -> None:
    method = new()
    fitness = np.full(50, np.nan)
    fitness[[7, 20, 33]] = [-5, 100, -1e300]
    method.ask()
    method.tell(fitness)
    assert len(method.ask()) == 47
    assert sorted(method.population_fitness) == [-1e300, -5, 100]


def test_fitness_may_have_any_sign_and_scale() -> None:
    for scale in (1e-300, -1.0, 1e300):
        method = new(generations=3)
        while not method.done:
            method.tell(scale * np.linspace(1, 2, len(method.ask())))


def test_equal_members_do_not_stop_it() -> None:
    # All survivors the same: every crossover gives the same child again, and random members take the places.
    method = new(severity=0.0)
    method.ask()
    fitness = np.full(50, np.nan)
    fitness[0] = 1
    method.tell(fitness)
    children = method.ask()
    assert len(children) == 49
    assert len({child.tobytes() for child in children[20:]}) == 29


def test_partners_are_the_most_different() -> None:
    def spread(partners: int) -> float:
        method = new(
            partners=partners, elite=0.2, random=0.0, mutate=0.0, crossover=0.8, renew=0.0, population=200
        )
        genomes = method.ask()
        method.tell(np.arange(len(genomes), dtype=np.float64))
        children = method.ask()
        return float(np.abs(children[:, None] - children[None]).sum(axis=2).mean())

    assert spread(30) > spread(1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"elite": 0.5}, "must add up to 1, not 1.35"),
        ({"population": 2}, "no new candidates are created"),
        ({"islands": 1000, "population": 100_000}, "1000 populations of 100000 have more than 10000000"),
        (
            {"elite": 0.0, "random": 0.0, "mutate": 1.0, "crossover": 0.0, "renew": 0.0},
            "no candidate survives",
        ),
    ],
)
def test_shares_that_make_no_population_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        NngaOptions(**options)


@given(st.integers(3, 500), st.lists(st.integers(0, 100), min_size=5, max_size=5).filter(any))
def test_shares_always_fill_the_population(population: int, parts: list[int]) -> None:
    shares = dict(
        zip(
            ("elite", "random", "mutate", "crossover", "renew"),
            (part / sum(parts) for part in parts),
            strict=True,
        )
    )
    try:
        counts = NngaOptions.model_validate({"population": population, **shares}).shares()
    except ValidationError:
        # Refused only where nobody would stay or nobody new would come.
        survivors = shares["elite"] + shares["random"]
        assert survivors * population < 2 or (1 - survivors) * population < 5
        return
    assert counts.survivors + counts.new == population
    assert min(counts.elite, counts.random, counts.mutate, counts.crossover, counts.renew) >= 0


def told(method: Nnga, generations: int) -> list[Genomes]:
    """The genomes asked for, each told its length; a few fail."""
    asked = []
    for _ in range(generations):
        asked.append(method.ask())
        fitness = -np.abs(asked[-1].astype(np.float64)).sum(axis=1)
        fitness[3::11] = np.nan
        method.tell(fitness)
    return asked


def test_populations_evolve_side_by_side() -> None:
    # The first of several is the same as one alone, unless genes are exchanged.
    alone = told(new(generations=9), 8)
    method = new(generations=9, islands=3, exchange_interval=0)
    assert method.budget == 3 * (50 + 8 * 37)
    several = told(method, 8)
    sizes = [len(genomes) for genomes in several]
    assert [one.tobytes() for one in alone] != [one.tobytes() for one in several]
    for generation, (one, all_of_them) in enumerate(zip(alone, several, strict=True)):
        assert sizes[generation] > 2 * len(one)
        assert len({genome.tobytes() for genome in all_of_them}) == len(all_of_them)
    # What fails differs from the second generation on, for it goes by the index among all.
    assert several[0][:50].tobytes() == alone[0].tobytes()
    assert several[1][: len(alone[1])].tobytes() == alone[1].tobytes()
    assert len(method.population_fitness) == 150


@pytest.mark.parametrize(
    ("interval", "exchanging"), [(0, []), (1, [1, 2, 3, 4, 5]), (2, [1, 3, 5]), (10, [1])]
)
def test_exchange_happens_at_its_interval(interval: int, exchanging: list[int]) -> None:
    def foreign(genomes: Genomes) -> bool:
        # Population 0 is all positive, population 1 all negative; only crossovers between them mix signs.
        half = len(genomes) // 2
        signs = np.sign(genomes[:half]).sum(axis=1), np.sign(genomes[half:]).sum(axis=1)
        size = genomes.shape[1]
        return bool((signs[0] < size).any() or (signs[1] > -size).any())

    method = new(islands=2, exchange_interval=interval, mutate=0.0, crossover=0.7, renew=0.0, random=0.15)
    first = np.abs(method.initials(range(100))) + np.float32(0.1)
    first[50:] *= -1
    method.start_from(first)
    method.ask()
    method.tell(np.arange(100.0))
    found = []
    for generation in range(1, 6):
        children = method.ask()
        if foreign(children):
            found.append(generation)
        method.tell(np.full(len(children), np.nan))  # so that the first members stay
    assert found == exchanging


def test_exchange_says_how_many_fathers_come_from_anywhere() -> None:
    def foreigners(exchange: float) -> int:
        method = new(islands=4, exchange_interval=1, exchange=exchange, elite=0.2, random=0.0, mutate=0.0,
                     crossover=0.8, renew=0.0, population=200, partners=1)  # fmt: skip
        parents = np.repeat(np.arange(1, 5, dtype=np.float32), 200)[:, None] * np.ones(
            (1, method.representation.genome_size), dtype=np.float32
        ) + np.linspace(0, 0.5, 800, dtype=np.float32)[:, None]  # fmt: skip
        method.start_from(parents)
        method.ask()
        method.tell(np.arange(800.0))
        children = np.floor(method.ask())
        return int((children.min(axis=1) != children.max(axis=1)).sum())

    # 640 children, three of four populations are not the mother's own.
    assert foreigners(0.0) == 0
    assert foreigners(0.5) == pytest.approx(240, abs=60)
    assert foreigners(1.0) == pytest.approx(480, abs=60)


def test_a_population_that_failed_as_a_whole_starts_anew() -> None:
    method = new(islands=2, exchange_interval=1)
    method.ask()
    fitness = np.arange(100.0)
    fitness[50:] = np.nan
    method.tell(fitness)
    asked = method.ask()
    assert len(asked) == 37 + 50
    assert np.isfinite(asked).all()
    method.tell(np.zeros(87))
    assert len(method.population_fitness) == 100


def test_errors_of_operators_in_python_come_through() -> None:
    class Failing(Layered):
        def mutate(self, *_: Any, **__: Any) -> Genome:
            raise ArithmeticError("no mutant today")

    class Short(Layered):
        def crossovers(self, mothers: Genomes, *_: Any) -> Genomes:
            return mothers[:, 1:]

    for kind, error, words in (
        (Failing, ArithmeticError, "no mutant today"),
        (Short, InputError, r"matings: returned the shape \[15, \d+\], expected \[15, \d+\]"),
    ):
        method = Nnga(NngaOptions(), kind(LayeredOptions(hidden=[2]), sensors=2, actuators=1), seed=1)
        assert not method.ahead
        method.tell(np.zeros(len(method.ask())))
        with pytest.raises(error, match=words):
            method.ask()


def steady(fitness: Any, **options: Any) -> Nnga:
    """A method in steady state whose first members have this fitness."""
    method = new(operation="steady_state", in_flight=1, population=len(fitness), **options)
    for value in fitness:
        method.ask_next()
        method.tell_next(value)
    return method


def test_steady_state_replaces_the_worst_and_keeps_the_best() -> None:
    method = steady([3.0, np.nan, 1.0, 2.0, 5.0, 4.0, 6.0, 7.0, 8.0, 9.0])
    told = [0.5, np.nan, 2.5, -7.0, -8.0]
    # The failed one goes first; the failed child is not let in; a bad child is the next to go.
    left = [[0.5, 1, 2], [0.5, 1, 2], [1, 2, 2.5], [-7, 2, 2.5], [-8, 2, 2.5]]
    for value, lowest in zip(told, left, strict=True):
        method.ask_next()
        method.tell_next(value)
        assert sorted(method.population_fitness)[:3] == sorted(lowest)
    assert method.population_fitness.max() == 9


def test_steady_state_makes_children_in_the_ratio_of_the_shares() -> None:
    made = {"mutations": 0, "crossover": 0, "initials": 0}
    method = steady(range(50), generations=20)
    for name in made:
        original = getattr(method.representation, name)

        def counting(*arguments: Any, name: str = name, original: Any = original, **given: Any) -> Any:
            made[name] += 1
            return original(*arguments, **given)

        setattr(method.representation, name, counting)
    while not method.done:
        method.ask_next()
        method.tell_next(0.0)
    total = sum(made.values())
    for name, share in (("mutations", 40 / 75), ("crossover", 30 / 75), ("initials", 5 / 75)):
        assert made[name] / total == pytest.approx(share, abs=0.05)


def test_steady_state_gets_better() -> None:
    method = new(operation="steady_state", generations=40)
    best = []
    while not method.done:
        _, genome = method.ask_next()
        method.tell_next(-float(((genome.astype(np.float64) - 0.5) ** 2).sum()))
        best.append(np.nanmax(method.population_fitness))
    assert best == sorted(best)
    assert best[-1] > best[49] / 4


def test_steady_state_has_one_population() -> None:
    with pytest.raises(ValidationError, match="steady state allows only one population"):
        NngaOptions(operation="steady_state", islands=2)
