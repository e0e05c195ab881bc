"""Matchings of general graphs."""

from itertools import combinations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.methods.rankings._matching import improve_matching

Edges = set[frozenset[int]]


def match(count: int, edges: Edges, partners: list[int] | None = None) -> list[int]:
    result = list(partners or [-1] * count)
    improve_matching(result, lambda one, other: frozenset((one, other)) in edges)
    for vertex, other in enumerate(result):
        assert other == -1 or (result[other] == vertex and frozenset((vertex, other)) in edges)
    return result


def count_most_pairs(edges: list[frozenset[int]]) -> int:
    """Try all matchings."""
    if not edges:
        return 0
    first, *rest = edges
    return max(count_most_pairs(rest), 1 + count_most_pairs([edge for edge in rest if not edge & first]))


@given(st.integers(1, 8), st.floats(0, 1), st.integers(0, 10_000))
def test_matchings_have_as_many_pairs_as_possible(count: int, density: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    edges = {frozenset(pair) for pair in combinations(range(count), 2) if random.random() < density}
    most = count_most_pairs(sorted(edges, key=sorted)[:16])
    few = set(sorted(edges, key=sorted)[:16])
    partners = match(count, few)
    assert sum(other >= 0 for other in partners) == 2 * most
    begun = next(
        ([-1 if vertex not in edge else sum(edge) - vertex for vertex in range(count)] for edge in few), None
    )
    if begun is not None:
        continued = match(count, few, begun)
        assert sum(other >= 0 for other in continued) == 2 * most
        assert all(other >= 0 for other, first in zip(continued, begun, strict=True) if first >= 0)


def test_petersens_graph_has_a_perfect_matching() -> None:
    outer = [(index, (index + 1) % 5) for index in range(5)]
    inner = [(5 + index, 5 + (index + 2) % 5) for index in range(5)]
    spokes = [(index, 5 + index) for index in range(5)]
    assert -1 not in match(10, {frozenset(edge) for edge in outer + inner + spokes})


def test_flowers_are_paired_through_their_cycles() -> None:
    """Three triangles in a chain, in which an augmenting path goes around each."""
    edges = [(0, 1), (1, 2), (2, 0), (2, 3), (3, 4), (4, 5), (5, 3), (5, 6), (6, 7), (7, 8), (8, 6), (8, 9)]
    assert -1 not in match(10, {frozenset(edge) for edge in edges}, [-1, 2, 1, 4, 3, 6, 5, 8, 7, -1])
