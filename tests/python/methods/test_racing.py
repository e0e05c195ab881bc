"""Iterated racing: what its races promise, and how they are spread over the budget."""

import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmwright import InputError
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers import Representation
from swarmwright.methods.racing import Entrant, Race, Racing, RacingOptions, Rules, find_near_equals
from swarmwright.methods.rankings.race import ranks_of
from swarmwright.testing import check_method
from swarmwright.testing._common import representation
from swarmwright.testing._methods import Choices
from tests.python.methods.functions import ten_genes

RULES = Rules(test="friedman", level=0.05, first_test=5, each_test=1, patience=2, survivors=1)


def racing(subject: Representation | None = None, seed: int = 1, **options: Any) -> Racing:
    return Racing(RacingOptions(**options), subject or ten_genes(), seed=seed)


def entrants(count: int) -> list[Entrant]:
    return [Entrant(np.full(1, index, np.float32)) for index in range(count)]


def raced(race: Race, score: Any, left: int = 10**9) -> list[tuple[int, list[int]]]:
    """Run a race; return who was evaluated on which instance."""
    seen = []
    while (missing := race.find_missing(left)) is not None:
        instance = race.instance
        who = [int(one.genome[0]) for one in missing]
        seen.append((instance, who))
        race.tell(missing, np.array([score(one, instance) for one in who], np.float64))
        left -= len(missing)
    return seen


@pytest.mark.slow
def test_it_is_a_method() -> None:
    check_method("racing")


def test_a_clearly_worse_candidate_goes_at_the_first_test() -> None:
    rng = np.random.default_rng(1)
    race = Race(entrants(6), [], 0, 10_000, RULES)
    seen = raced(race, lambda one, _: rng.normal() * 0.1 - 10 * (one == 3))
    assert [len(who) for _, who in seen[:5]] == [6] * 5
    assert 3 not in seen[5][1]
    assert [instance for instance, _ in seen] == list(range(len(seen)))
    assert race.unseen == len(seen)


def test_the_only_best_is_never_dropped() -> None:
    for seed in range(50):
        rng = np.random.default_rng(seed)
        best = int(rng.integers(8))
        race = Race(entrants(8), [], 0, 400, RULES)
        raced(race, lambda one, _, rng=rng, best=best: rng.normal() + 3 * (one == best))
        found = race.find_best()
        assert found is not None
        assert found.genome[0] == best


def test_equal_candidates_race_until_patience_or_the_budget_ends() -> None:
    race = Race(entrants(4), [], 0, 10_000, RULES)
    # The first test does not count for patience, as in irace.
    assert len(raced(race, lambda *_: 1.0)) == 7
    assert len(race.alive) == 4
    race = Race(entrants(4), [], 0, 37, Rules("friedman", 0.05, 5, 1, 0, 1))
    seen = raced(race, lambda *_: 1.0)
    assert sum(len(who) for _, who in seen) == 36, "the budget of a race is not exceeded after the first test"
    race = Race(entrants(4), [], 0, 10_000, RULES)
    assert sum(len(who) for _, who in raced(race, lambda *_: 1.0, left=10)) == 8, (
        "nor is that of the run ever"
    )


def test_a_failed_candidate_goes_at_once() -> None:
    race = Race(entrants(5), [], 0, 10_000, RULES)
    seen = raced(race, lambda one, instance: math.nan if (one, instance) == (2, 1) else 1.0)
    assert seen[1][1] == [0, 1, 2, 3, 4]
    assert seen[2][1] == [0, 1, 3, 4]
    race = Race(entrants(3), [], 0, 10_000, RULES)
    assert len(raced(race, lambda *_: math.nan)) == 1
    assert race.alive == []
    assert race.find_best() is None
    assert race.rank() == []


def with_elites(count: int, instances: int, *, others: int) -> list[Entrant]:
    made = entrants(count + others)
    for one in made[:count]:
        one.scores = dict.fromkeys(range(instances), 1.0)
    return made


def test_elites_are_not_evaluated_again_and_are_safe_until_they_were_compared() -> None:
    race = Race(with_elites(2, 9, others=6), [9, *range(8, -1, -1)], 10, 10_000, RULES)
    rng = np.random.default_rng(2)
    alive: list[int] = []

    def score(one: int, _: int) -> float:
        alive.append(sum(entrant.genome[0] < 2 for entrant in race.alive))
        return 100 + rng.normal() if one >= 2 else 1.0

    seen = raced(race, score)
    assert seen[0] == (9, list(range(8))), "first everybody on the new instance"
    assert all(min(who) >= 2 for _, who in seen[1:10]), "elites have been on the others"
    assert [instance for instance, _ in seen[:10]] == [9, 8, 7, 6, 5, 4, 3, 2, 1, 0]
    # Worse from the beginning, and tested since the fifth instance, they go after the tenth only.
    assert {one.genome[0] for one in race.alive}.isdisjoint({0, 1})
    assert set(alive) == {2, 0} or set(alive) == {2}


def test_elites_with_different_instances_are_safe_until_their_own_have_passed() -> None:
    made = entrants(5)
    made[0].scores = {0: 1.0, 1: 1.0, 2: 1.0}
    made[1].scores = dict.fromkeys(range(8), 1.0)
    race = Race(made, [8, 0, 1, 2, 3, 4, 5, 6, 7], 9, 10_000, RULES)
    rng = np.random.default_rng(4)
    left: dict[int, list[int]] = {}

    def score(one: int, instance: int) -> float:
        left[instance] = [int(entrant.genome[0]) for entrant in race.alive]
        return 50 + rng.normal() if one >= 2 else 1.0

    raced(race, score)
    assert 0 in left[3], "it is there at the fifth instance, the one of the first test"
    assert 0 not in left[4], "and went with it, when its own three had passed"
    assert 1 in left[7], "the other one had eight"


@given(st.integers(0, 10**6), st.integers(2, 20), st.integers(1, 4), st.sampled_from(["friedman", "t"]))
@settings(max_examples=60, deadline=None)
def test_what_every_race_keeps(seed: int, count: int, survivors: int, test: Any) -> None:
    rng = np.random.default_rng(seed)
    quality = rng.normal(size=count) * rng.choice([0, 1, 5])
    rules = Rules(test, 0.05, 5, int(rng.integers(1, 3)), int(rng.integers(0, 4)), survivors)
    made = entrants(count)
    elites = int(rng.integers(0, min(count, 5)))
    old = int(rng.integers(1, 9))
    for one in made[:elites]:
        one.scores = {number: float(rng.normal()) for number in range(old)}
    order = [old, *rng.permutation(old).tolist()] if elites else []
    before = {id(one): set(one.scores) for one in made}
    budget = int(rng.integers(count * 6, count * 40))
    race = Race(made, order, old + 1 if elites else 0, budget, rules)
    seen = raced(race, lambda one, _: float(quality[one] + rng.normal()))
    assert race.alive
    pairs = Counter((instance, one) for instance, who in seen for one in who)
    assert max(pairs.values(), default=1) == 1, "nobody is evaluated twice on an instance"
    alive_instances = [instance for instance, _ in seen]
    for one in made:
        new = {instance for instance, who in seen if one.genome[0] in who}
        assert set(one.scores) == before[id(one)] | new
    ranked = race.rank()
    assert len(ranked) == len(race.alive)
    counts = [len(one.scores) for one in ranked]
    assert counts == sorted(counts, reverse=True)
    assert race.find_best() is ranked[0]
    assert race.unseen == max([old if elites else -1, *alive_instances]) + 1
    best = [one for one in ranked if len(one.scores) == counts[0]]
    if test == "friedman" and best[0].scores and len({frozenset(one.scores) for one in best}) == 1:
        scores = np.array([[one.scores[number] for one in best] for number in sorted(best[0].scores)])
        sums = ranks_of(scores).sum(axis=0)
        assert sums[0] == sums.min()


def conversation(
    method: Racing, quality: Any, noise: float = 1.0
) -> list[tuple[int, int, NDArray[np.float32]]]:
    """Run it on instances with an effect of their own; return race, instance and genomes of each step."""
    steps = []
    while not method.done:
        genomes = method.ask()
        steps.append((method.race, method.instance, genomes))
        rng = np.random.default_rng([method.seed, method.instance, method.race])
        effect = np.random.default_rng([method.seed, method.instance]).normal()
        method.tell(quality(genomes.astype(np.float64)) + effect + noise * rng.normal(size=len(genomes)))
    return steps


def test_the_budget_is_spread_over_races_and_used() -> None:
    for budget in (200, 1000, 5000):
        method = racing(evaluations=budget)
        steps = conversation(method, lambda genomes: -(genomes**2).sum(axis=1))
        spent = sum(len(genomes) for _, _, genomes in steps)
        assert budget - 5 < spent <= budget, "what fits no race is for the elites, five of them"
        assert method.evaluations == spent
        first = sum(len(genomes) for race, _, genomes in steps if race == 1)
        # 2 + log2(10) races.
        assert first <= budget // 5
        assert max(race for race, _, _ in steps) >= 5


def test_elites_get_what_fits_no_race() -> None:
    method = racing(evaluations=200, candidates=10)
    steps = conversation(method, lambda genomes: -(genomes**2).sum(axis=1))
    elites = len(steps[-1][2])
    assert 200 - elites < method.evaluations <= 200
    last = [genomes.tobytes() for _, _, genomes in steps[-5:]]
    assert set(last) == {last[0]}, "all of them, without tests"
    instances = [instance for _, instance, _ in steps]
    assert instances[-5:] == list(range(max(instances) - 4, max(instances) + 1)), "unseen ones"
    incumbent = method.incumbent
    assert incumbent is not None
    assert incumbent.evaluation >= method.evaluations - elites


def test_the_first_race_has_as_many_candidates_as_irace_would_give_it() -> None:
    # A fifth of the budget, for 5 + 1 instances of each.
    assert len(racing(evaluations=5000).ask()) == 166
    assert len(racing(evaluations=10**6).ask()) == 1024
    assert len(racing(evaluations=10**6, candidates=60).ask()) == 60


def test_too_small_a_budget_is_refused_with_what_is_needed() -> None:
    # 2 + log2(10) = 5 survive.
    with pytest.raises(InputError, match=r"method\.evaluations: 35 are too few .* at least 36: "):
        racing(evaluations=35)
    method = racing(evaluations=36)
    assert conversation(method, lambda genomes: -(genomes**2).sum(axis=1))
    with pytest.raises(InputError, match=r"method\.candidates: 5 are too few for a race that ends with 5"):
        racing(candidates=5)


def test_it_finds_better_candidates_under_noise_than_the_same_number_at_random() -> None:
    def quality(genomes: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(-((genomes - 1) ** 2).sum(axis=1))

    def found(kind: Racing) -> float:
        conversation(kind, quality, noise=5.0)
        best = kind._race.find_best()  # type: ignore[union-attr]
        assert best is not None
        return float(quality(best.genome[np.newaxis].astype(np.float64))[0])

    values = [found(racing(evaluations=3000, seed=seed)) for seed in range(5)]
    # 3000 random genomes, the best of which is known without noise.
    rng = np.random.default_rng(0)
    best_of_random = [float(quality(rng.uniform(-3, 3, (3000, 10))).max()) for _ in range(5)]
    assert np.median(values) > np.median(best_of_random)


def test_the_incumbent_has_the_most_instances_and_their_mean() -> None:
    method = racing(evaluations=2000)
    numbers: dict[bytes, list[float]] = {}
    rows: list[bytes] = []
    while not method.done:
        genomes = method.ask()
        fitness = np.random.default_rng(method.generation).normal(size=len(genomes)) - np.abs(genomes[:, 0])
        for genome, value in zip(genomes, fitness.tolist(), strict=True):
            rows.append(genome.tobytes())
            numbers.setdefault(rows[-1], []).append(value)
        method.tell(fitness)
        expected = [math.fsum(numbers[one.tobytes()]) / len(numbers[one.tobytes()]) for one in genomes]
        assert method.instance_means.tolist() == expected
        incumbent = method.incumbent
        assert incumbent is not None
        mine = numbers[rows[incumbent.evaluation]]
        assert incumbent.fitness == math.fsum(mine) / len(mine)
        assert rows[incumbent.evaluation] not in rows[incumbent.evaluation + 1 :], "it is the last evaluation"
    assert len(mine) == max(map(len, numbers.values()))
    assert len(mine) > 15, "an elite has been through several races"


def test_each_instance_has_a_number_of_its_own_and_nobody_sees_it_twice() -> None:
    method = racing(evaluations=3000)
    steps = conversation(method, lambda genomes: -(genomes**2).sum(axis=1))
    pairs = Counter((instance, one.tobytes()) for _, instance, genomes in steps for one in genomes)
    assert max(pairs.values()) == 1
    seen: set[int] = set()
    for race, instance, _ in steps:
        if instance not in seen:
            assert instance == len(seen), "unseen instances come in order"
        seen.add(instance)
        assert race >= 1
    firsts = {race: instance for race, instance, _ in reversed(steps)}
    assert all(firsts[race] > firsts[race - 1] for race in range(2, max(firsts) + 1)), (
        "each begins with an unseen one"
    )


def test_sampling_narrows_around_elites() -> None:
    method = racing(evaluations=6000)
    steps = conversation(method, lambda genomes: -(genomes**2).sum(axis=1), noise=0.1)
    first = {race: genomes for race, _, genomes in reversed(steps)}
    spread = [float(first[race].std(axis=0).mean()) for race in sorted(first)]
    assert spread[-1] < spread[2] < spread[0]


@pytest.mark.parametrize("subject", ["choices", "mealy_fsm", "modules", "parameter_set"])
def test_it_evolves_choices_categories_and_machines(subject: str) -> None:
    if subject == "choices":
        made: Representation = Choices()
    else:
        sensors, actuators = (9, 2) if subject == "modules" else (4, 1)
        made = representation(subject, sensors=sensors, actuators=actuators)
    goal = made.likeness(np.array([made.initial(Stream(99, "goal"))]))[0]

    def quality(genomes: NDArray[np.float64]) -> NDArray[np.float64]:
        rows = made.likeness(genomes.astype(np.float32))
        return np.asarray(-(np.abs(rows - goal) > 0.1).mean(axis=1)) * 20

    method = racing(made, evaluations=4000)
    steps = conversation(method, quality, noise=0.5)
    best = method._race.find_best()  # type: ignore[union-attr]
    assert best is not None
    random = quality(steps[0][2].astype(np.float64))
    assert quality(best.genome[np.newaxis].astype(np.float64))[0] >= random.max()


def test_sampling_becomes_wider_where_candidates_are_the_same() -> None:
    one = {"rule": {"type": "categorical", "choices": ["a", "b", "c"]}}
    options = {"parameters": one}
    subject = representation("parameter_set", options=options)
    method = racing(subject, evaluations=500, survivors=2)
    conversation(method, lambda genomes: -np.abs(genomes[:, 0] - 0.5))
    assert method.widened > 0, "three categories cannot make different candidates"
    assert racing(subject, evaluations=500, survivors=2, soft_restart=False).widened == 0


def test_the_same_seed_gives_the_same_race_and_another_one_another() -> None:
    def asked(seed: int) -> list[bytes]:
        steps = conversation(
            racing(evaluations=1000, seed=seed), lambda genomes: -np.abs(genomes).sum(axis=1)
        )
        return [genomes.tobytes() for _, _, genomes in steps]

    assert asked(1) == asked(1)
    assert asked(1) != asked(2)


def test_the_target_is_compared_with_the_mean_after_the_first_test() -> None:
    method = racing(evaluations=5000, target=50.0)
    while not method.done:
        genomes = method.ask()
        method.tell(np.full(len(genomes), 60.0))
    assert method.reached
    assert method.generation == 4
    method = racing(evaluations=1000, target=50.0)
    instances = 0
    while not method.done:
        genomes = method.ask()
        instances += 1
        method.tell(np.full(len(genomes), 60.0 if instances == 2 else 0.0))
    assert not method.reached, "a single lucky instance is no reason to end"


@given(st.integers(0, 10**6))
@settings(max_examples=40)
def test_rows_that_are_nearly_equal(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.random((int(rng.integers(2, 40)), int(rng.integers(1, 6))))
    copies = rng.integers(len(rows), size=5)
    near = rows[copies] + rng.uniform(-2e-4, 2e-4, (5, rows.shape[1]))
    rows = np.concatenate([rows, near])
    expected = [
        index
        for index, row in enumerate(rows)
        if any(np.abs(row - other).max() <= 1e-4 for at, other in enumerate(rows) if at != index)
    ]
    assert find_near_equals(rows).tolist() == expected
