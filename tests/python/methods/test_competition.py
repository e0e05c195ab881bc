"""Competitions: pairings, and the fitness that methods get."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright import Experiment, InputError
from swarmwright.controllers.kinds.team import Team
from swarmwright.methods.competition import FIRST_OPPONENT, Competition

MINISIM = {
    "simulation": "minisim",
    "parameters": {"numAgents": 1, "numDefenders": 1, "defenderSteering": "controller"},
    "controller": {"hidden": [2]},
    "servers": "in-process",
    "method": {"population": 7, "generations": 30},
}
ONE = (
    "round_robin",
    "swiss",
    "multi_swiss",
    "merge_sort",
    "random",
    "hall_of_fame",
    "best",
    "pareto_archive",
)
SEVERAL = ("round_robin", "random", "hall_of_fame", "best", "pareto_archive")


def create(populations: bool = False, **options: Any) -> Competition:
    values: dict[str, Any] = {**MINISIM, "ranking": {"kind": "tournament", **options}}
    if populations:
        values["populations"] = {"agents": {}, "defenders": {"method": {"population": 5}}}
    method = Experiment.from_mapping(values).new_method()
    assert isinstance(method, Competition)
    return method


def play(method: Competition) -> NDArray[np.intp]:
    """Play a generation in which the larger first gene wins; return who met, (matches, sides)."""
    half = method.representation.genome_size // 2
    rounds, met = method.matches(), []
    matches = next(rounds)
    while True:
        strengths = matches.genomes[:, [0, half]].astype(np.float64)
        met.append(matches.candidates)
        try:
            matches = rounds.send(strengths - strengths[:, ::-1])
        except StopIteration:
            method.finish()
            return np.concatenate(met)


@pytest.mark.parametrize("pairing", ONE)
@pytest.mark.parametrize("both_sides", [True, False])
def test_every_candidate_of_one_population_plays(pairing: str, both_sides: bool) -> None:
    method = create(pairing=pairing, both_sides=both_sides)
    for generation in range(3):
        bound = method.most_matches
        met = play(method)
        assert len(met) <= bound or generation == 0
        assert {*range(7)} <= {*met.ravel().tolist()}
        assert met.min() >= -generation, "only champions of finished generations are opponents"
        lone = met[:-1]
        if both_sides:
            assert sorted(map(tuple, lone.tolist())) == sorted(map(tuple, lone[:, ::-1].tolist()))
        assert met[-1, 0] == met[-1, 1], "the champion meets itself"


def test_pairings_of_frevo_say_who_plays_which_side() -> None:
    method = create(pairing="frevo_full_tournament", both_sides=False, score="points", win=2, draw=1)
    met = play(method)[:-1]
    assert met.tolist() == [list(pair) for pair in combinations(range(7), 2)]
    assert method.population_fitness.sum() == 2 * len(met)


@pytest.mark.parametrize("score", ["points", "win_rate", "fitness", "elo", "bradley_terry", "order"])
def test_the_strongest_of_a_round_robin_has_the_best_score(score: str) -> None:
    method = create(pairing="round_robin", score=score)
    play(method)
    strengths = method._members[0][:, 0]
    assert method.population_fitness.argmax() == strengths.argmax()


@pytest.mark.parametrize(
    ("pairing", "score"),
    [("swiss", "bradley_terry"), ("multi_swiss", "bradley_terry"), ("random", "fitness")],
)
def test_the_default_score_is_that_of_the_pairing(pairing: str, score: str) -> None:
    scores = []
    for options in ({}, {"score": None}, {"score": score}, {"score": "points"}):
        method = create(pairing=pairing, **options)
        play(method)
        scores.append(method.population_fitness.tolist())
    assert scores[0] == scores[1] == scores[2] != scores[3]


@pytest.mark.parametrize("pairing", SEVERAL)
def test_every_candidate_of_each_population_plays(pairing: str) -> None:
    method = create(populations=True, pairing=pairing, rounds=3)
    for _ in range(3):
        met = play(method)
        assert {*range(7)} <= {*met[:, 0].tolist()}
        assert {*range(5)} <= {*met[:, 1].tolist()}


@pytest.mark.parametrize("populations", [True, False])
@pytest.mark.parametrize("pairing", SEVERAL)
@pytest.mark.parametrize("score", ["fitness", "points"])
def test_the_stronger_win_over_generations(pairing: str, score: str, populations: bool) -> None:
    method = create(populations=populations, pairing=pairing, rounds=3, score=score)
    strengths = []
    half = method.representation.genome_size // 2
    for _ in range(30):
        rounds = method.matches()
        matches = next(rounds)
        while True:
            pair = matches.genomes[:, [0, half]].astype(np.float64)
            try:
                matches = rounds.send(pair - pair[:, ::-1])
            except StopIteration:
                break
        method.finish()
        strengths.append(pair[-1].max())
    assert max(strengths[-3:]) > strengths[0]


def test_the_same_results_make_the_same_genomes() -> None:
    methods = [create(populations=True, pairing="hall_of_fame") for _ in range(2)]
    for _ in range(4):
        first, second = (play(method) for method in methods)
        assert (first == second).all()


def network(gene: float) -> dict[str, Any]:
    """Return a controller whose strength is its first gene."""
    method = create()
    assert isinstance(method.representation, Team)
    part = method.representation.parts["agents"]
    return {**part.architecture(), "weights": [gene, *[0.0] * (part.genome_size - 1)]}


@pytest.mark.parametrize("pairing", [*ONE, "opponents"])
@pytest.mark.parametrize("both_sides", [True, False])
def test_every_candidate_of_one_population_meets_the_opponents(pairing: str, both_sides: bool) -> None:
    method = create(pairing=pairing, both_sides=both_sides, opponents=[network(1), network(-1), network(0)])
    sides = []
    for generation in range(3):
        bound = method.most_matches
        met = play(method)
        assert len(met) <= bound or generation == 0
        outside = [tuple(row) for row in met.tolist() if min(row) <= FIRST_OPPONENT]
        assert len({*outside}) == len(outside) == 7 * 3 * (2 if both_sides else 1)
        assert {max(row) for row in outside} == {*range(7)}
        assert {min(row) for row in outside} == {FIRST_OPPONENT - number for number in range(3)}
        assert met[-1].min() >= 0, "the last match is that of the champions"
        sides += [row.index(FIRST_OPPONENT) for row in outside if FIRST_OPPONENT in row]
    assert {*sides} == {0, 1}, "an opponent plays both sides"
    if pairing == "opponents":
        assert len(met) == len(outside) + 1


def test_opponents_of_a_side_play_that_side() -> None:
    opponents = {"defenders": [network(1)], "agents": [network(2), network(3)]}
    method = create(pairing="opponents", both_sides=False, opponents=opponents)
    met = play(method)[:-1]
    assert {*met[met[:, 0] <= FIRST_OPPONENT, 0].tolist()} == {FIRST_OPPONENT, FIRST_OPPONENT - 1}
    assert {*met[met[:, 1] <= FIRST_OPPONENT, 1].tolist()} == {FIRST_OPPONENT - 2}


@pytest.mark.parametrize("pairing", [*SEVERAL, "opponents"])
def test_populations_meet_the_opponents_of_the_other_side(pairing: str) -> None:
    opponents = {"agents": [network(1)], "defenders": [network(2), network(3)]}
    method = create(populations=True, pairing=pairing, rounds=3, opponents=opponents)
    for generation in range(3):
        bound = method.most_matches
        met = play(method)
        assert len(met) <= bound or generation == 0
        for side, count, numbers in ((0, 5, [0]), (1, 7, [1, 2])):
            outside = met[met[:, side] <= FIRST_OPPONENT]
            assert {*map(tuple, outside.tolist())} == {
                tuple([candidate, FIRST_OPPONENT - number][:: 1 if side else -1])
                for candidate in range(count)
                for number in numbers
            }


@pytest.mark.parametrize("score", ["points", "fitness"])
def test_a_population_evolves_against_opponents_alone(score: str) -> None:
    values = {**MINISIM, "populations": {"defenders": {}}, "method": {"population": 10, "generations": 30}}
    values["ranking"] = {"opponents": {"agents": [network(1), network(2)]}, "score": score}
    method = Experiment.from_mapping(values).new_method()
    assert isinstance(method, Competition)
    means = []
    for _ in range(30):
        assert method.most_matches == 21
        met = play(method)
        assert {*met[:, 0].tolist()} == {FIRST_OPPONENT, FIRST_OPPONENT - 1}
        means.append(method.population_fitness.mean())
    assert means[-1] > means[0]


@pytest.mark.parametrize("score", ["points", "win_rate", "fitness", "elo", "bradley_terry", "order"])
def test_who_beats_strong_opponents_is_better(score: str) -> None:
    """Without matches of candidates with each other, opponents alone tell who is stronger."""
    opponents = [network(strength) for strength in np.linspace(-2, 2, 15).tolist()]
    method = create(pairing="opponents", opponents=opponents, score=score)
    play(method)
    strengths, scores = method._members[0][:, 0], method.population_fitness
    assert scores[strengths.argmax()] == scores.max()
    assert scores[strengths.argmin()] == scores.min()
    assert scores.min() < scores.max()


def test_failed_matches_do_not_count() -> None:
    method = create(pairing="round_robin", both_sides=False)
    rounds = method.matches()
    matches = next(rounds)
    results = np.ones(matches.candidates.shape)
    involved = (matches.candidates == 3).any(axis=1)
    results[involved] = np.nan
    final = rounds.send(results)
    assert (final.candidates != 3).all()
    scores = method.scores_of(matches)
    assert np.isnan(scores[matches.candidates == 3]).all()
    assert np.isfinite(scores[matches.candidates != 3]).all()


@pytest.mark.parametrize("pairing", ["hall_of_fame", "best"])
def test_candidates_play_each_side_against_earlier_champions(pairing: str) -> None:
    method = create(pairing=pairing, both_sides=False, rounds=2)
    play(method)
    places = set()
    for _ in range(2):
        earlier = play(method)[:-1] < 0
        assert (earlier.sum(axis=1) == 1).all()
        places |= set(np.flatnonzero(earlier.any(axis=0)).tolist())
    assert places == {0, 1}


def test_ask_and_tell_are_refused_with_the_way_to_do_it() -> None:
    with pytest.raises(InputError, match=r"matches in place of genomes: call matches\(\) and finish\(\)"):
        create().ask()


def play_numbers(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return who wins the intransitive numbers game of Watson and Pollack 2001, (matches,)."""
    differences = first - second
    nearest = np.abs(differences).argmin(axis=1)
    return np.asarray(np.sign(differences[np.arange(len(differences)), nearest]))


def evolve_numbers(pairing: str, seed: int, **values: Any) -> tuple[float, float]:
    """Let candidates play the numbers game for 100 generations.

    Return how many champions of one side lose to earlier champions of the other, and the smaller gene of the
    last champions: what counts, as every gene can decide a game.
    """
    values |= {**MINISIM, "method": {"population": 20, "generations": 100}, "seed": seed}
    values |= {"ranking": {"kind": "tournament", "pairing": pairing, "rounds": 8}}
    method = Experiment.from_mapping(values).new_method()
    assert isinstance(method, Competition)
    half = method.representation.genome_size // 2
    champions = []
    for _ in range(100):
        rounds = method.matches()
        matches = next(rounds)
        while True:
            first, second = (matches.genomes[:, [at, at + 1]].astype(np.float64) for at in (0, half))
            won = play_numbers(first, second)
            try:
                matches = rounds.send(np.stack([won, -won], axis=1))
            except StopIteration:
                break
        method.finish()
        champions.append((first[-1], second[-1]))
    later, earlier = np.tril_indices(20, -1)
    own = np.array([champion for champion, _ in champions[::5]])
    other = np.array([champion for _, champion in champions[::5]])
    return float((play_numbers(own[later], other[earlier]) < 0).mean()), float(own[-4:].min(axis=1).mean())


def average_numbers(pairing: str, **values: Any) -> tuple[float, float]:
    """Return the means of `evolve_numbers` over six seeds."""
    lost, smaller = np.mean([evolve_numbers(pairing, seed, **values) for seed in range(6)], axis=0).tolist()
    return lost, smaller


@pytest.mark.slow
def test_archives_remember_earlier_opponents() -> None:
    """As in Rosin and Belew 1997, where champions of coevolution without it lose to their ancestors."""
    populations: dict[str, Any] = {"populations": {"agents": {}, "defenders": {}}}
    lost, _ = average_numbers("best", **populations)
    for pairing in ("hall_of_fame", "pareto_archive"):
        assert average_numbers(pairing, **populations)[0] < 0.7 * lost


@pytest.mark.slow
def test_an_archive_of_pareto_coevolution_gets_on_in_all_genes() -> None:
    """As in de Jong 2007; with the last champion alone, one gene grows while the other is forgotten."""
    assert average_numbers("pareto_archive")[1] > 1.5 * average_numbers("best")[1] > 0


@pytest.mark.parametrize("populations", [True, False])
@pytest.mark.parametrize("both_sides", [True, False])
def test_learners_of_an_archive_meet_new_champions(populations: bool, both_sides: bool) -> None:
    method = create(populations=populations, pairing="pareto_archive", rounds=3, both_sides=both_sides)
    for _ in range(6):
        archives = [(set(archive.learners), set(archive.tests)) for archive in method._pareto]
        bound, generation = method.most_matches, method.generation
        met = play(method)
        assert len(met) <= bound
        for (learners, tests), population in zip(archives, method.populations, strict=True):
            assert max(len(learners), len(tests)) <= 3
            opponents = {
                opponent
                for side in population.sides
                for opponent in met[met[:, side] == met[-1, side], 1 - side].tolist()
            }
            if generation:
                assert {-generation} <= opponents, "the last champion is an opponent"
            if generation and len(tests) < 3:
                assert {-1 - test for test in tests} <= opponents
            assert {-1 - learner for learner in learners} <= {*met[met >= -99].tolist()}
