"""CEA2D: FREVO's shares on a torus."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from swarmwright.methods.cea2d import Cea2d, Cea2dOptions
from swarmwright.testing._common import representation


def new(seed: int = 1, **options: Any) -> Cea2d:
    return Cea2d(Cea2dOptions(**options), representation(), seed=seed)


def told(method: Cea2d, fitness: Any) -> Cea2d:
    method.ask()
    method.tell(np.asarray(fitness, dtype=np.float64))
    return method


def test_defaults_are_those_of_frevo() -> None:
    options = Cea2dOptions()
    assert (options.width, options.height, options.generations) == (10, 10, 200)
    assert (options.elite, options.mutate, options.crossover, options.renew) == (0.11, 0.59, 0.30, 0.0)
    assert (options.severity, options.probability) == (0.3, 1.0)
    assert len(new().ask()) == 100


def test_neighbours_lie_around_a_cell_on_a_torus() -> None:
    method = new(width=5, height=4)
    for cell, (x, y) in enumerate(product(range(5), range(4))):
        around = [((x + dx) % 5) * 4 + (y + dy) % 4 for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
        assert method.neighbours[cell] == sorted(set(around) - {cell})
        assert len(method.neighbours[cell]) == 8


def test_a_narrow_torus_counts_each_neighbour_once() -> None:
    assert new(width=2, height=2).neighbours == [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]


def test_random_neighbours_are_drawn_once() -> None:
    method = new(neighbourhood="random")
    assert all(1 <= len(near) <= 8 and cell not in near for cell, near in enumerate(method.neighbours))
    assert method.neighbours == new(neighbourhood="random").neighbours
    assert method.neighbours != new(2, neighbourhood="random").neighbours


def test_obstacles_hold_nobody() -> None:
    method = new(obstacles=30)
    assert len(method.ask()) == 70
    assert sum(map(len, method.neighbours)) == pytest.approx(70 * 8 * 0.7, rel=0.1)
    assert all(near in range(70) for around in method.neighbours for near in around)
    mutual = all(cell in method.neighbours[near] for cell in range(70) for near in method.neighbours[cell])
    assert mutual


def test_only_the_best_of_a_neighbourhood_stay() -> None:
    fitness = np.zeros(100)
    fitness[[33, 77]] = 5, 4  # (3, 3) and (7, 7): not neighbours, so both stay
    method = told(new(), fitness)
    before = method.population_fitness
    asked = method.ask()
    # Of equal ones the later cell is ahead; each that is ahead of all 8 around it stays, too.
    stay = [
        cell for cell in range(100) if all(ahead(fitness, cell, near) for near in method.neighbours[cell])
    ]
    assert {33, 77} < set(stay)
    assert len(asked) == 100 - len(stay)
    method.tell(np.full(len(asked), -1.0))
    after = method.population_fitness
    assert np.array_equal(after[stay], before[stay])
    assert (np.delete(after, stay) == -1).all()


def ahead(fitness: Any, one: int, other: int) -> bool:
    return bool(fitness[one] > fitness[other] or (fitness[one] == fitness[other] and one > other))


def test_close_fitness_is_not_reordered() -> None:
    # FREVO adds up to 1e-4 to these and lets the last cell of them win.
    fitness = np.linspace(2e-9, 1e-9, 100)
    method = told(new(width=100, height=2, obstacles=100), fitness)
    for cell in range(100):
        elite = method._torus.elite(fitness, cell)
        assert elite == [min([cell, *method.neighbours[cell]])][: len(elite)]


def test_new_members_come_from_neighbours() -> None:
    fitness = np.zeros(100)
    fitness[55] = 1
    method = told(new(severity=0.0, mutate=0.89, crossover=0.0), fitness)
    genomes = new(severity=0.0, mutate=0.89, crossover=0.0).ask()
    children = method.ask()
    # Mutations of severity 0 are copies: the best spreads to its 8 neighbours and to nobody else.
    copies = sum(child.tobytes() == genomes[55].tobytes() for child in children)
    assert copies == 8


def test_shares_say_how_members_come_about() -> None:
    made = {"mutations": 0, "crossovers": 0, "initials": 0}
    method = new(width=40, height=40, elite=0.11, mutate=0.49, crossover=0.2, renew=0.2)
    told(method, np.arange(1600.0))
    for name in made:
        original = getattr(method.representation, name)

        def counting(*arguments: Any, name: str = name, original: Any = original, **options: Any) -> Any:
            genomes = original(*arguments, **options)
            made[name] += len(genomes)
            return genomes

        setattr(method.representation, name, counting)
    total = len(method.ask())
    assert sum(made.values()) == total
    for name, share in (("mutations", 0.49), ("crossovers", 0.2), ("initials", 0.2)):
        assert made[name] / total == pytest.approx(share / 0.89, abs=0.04)


def test_failed_members_are_no_parents() -> None:
    fitness = np.full(100, np.nan)
    fitness[55] = -1e300
    method = told(new(severity=0.0), fitness)
    first = new(severity=0.0).ask()
    children = method.ask()
    assert len(children) == 99
    known = {genome.tobytes() for genome in first}
    kinds = [child.tobytes() in known for child in children]
    # Around the one that worked its copies, everywhere else new random members.
    assert sum(kinds) == 8
    assert sum(child.tobytes() == first[55].tobytes() for child in children) == 8


def test_a_population_of_elite_only_is_left() -> None:
    method = new(width=2, height=2, obstacles=2, elite=0.9, mutate=0.1, crossover=0.0)
    told(method, [1.0, 2.0])
    assert len(method.ask()) == 1
    method.tell(np.array([3.0]))
    assert method.population_fitness.tolist() == [3.0, 2.0]


def test_it_finds_what_random_search_does_not() -> None:
    from tests.python.methods.functions import evaluations_to, sphere
    from tests.python.methods.functions import new as of_kind

    found = evaluations_to(of_kind("cea2d", generations=100), sphere, 1.0)
    assert found is not None
    assert evaluations_to(of_kind("random_search", generations=200), sphere, 1.0) is None


def test_steady_state_sweeps_over_the_cells_that_do_not_stay() -> None:
    method = new(width=3, height=3, operation="steady_state", in_flight=1)
    for index in range(9):
        assert method.ask_next()[0] == index
        method.tell_next(float(index == 5))
    swept: list[int] = []
    for _ in range(16):
        method.ask_next()
        swept.extend(method._target_cells.values())
        method.tell_next(-1.0)
    assert swept == [cell for cell in range(9) if cell != 5] * 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"elite": 0.5}, "must add up to 1, not 1.39"),
        ({"elite": 1.0, "mutate": 0.0, "crossover": 0.0}, "no new candidates are created"),
        ({"obstacles": 99}, "must leave at least 2 of 100 cells"),
    ],
)
def test_shares_that_make_no_population_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Cea2dOptions(**options)


@pytest.mark.parametrize("in_flight", [1, 16, 100])
def test_in_steady_state_the_best_member_stays(in_flight: int) -> None:
    """Also where several candidates for one cell are in flight."""
    method = new(3, width=3, height=3, generations=40, operation="steady_state", in_flight=in_flight)
    best = -np.inf
    while not method.done:
        while method.can_ask:
            method.ask_next()
        fitness = float(np.sin(method.evaluations * 12.9898) * 43758.5453 % 1)
        best = max(best, fitness)
        method.tell_next(fitness)
        assert np.nanmax(method.population_fitness) == best
