"""Matchings of general graphs: pairs of vertices, each vertex in one at most."""

from collections import deque
from collections.abc import Callable, Sequence


def improve_matching(partners: list[int], may_pair: Callable[[int, int], bool]) -> None:
    """Change a matching until it has as many pairs as possible; vertices that are paired remain so.

    Each unpaired vertex, from the last to the first, gets a partner by an augmenting path, among the shortest
    ones, whose vertices prefer partners with numbers close to theirs.

    Source: Edmonds, "Paths, trees, and flowers", Canadian Journal of Mathematics 17, 1965.

    Args:
        partners: the partner of each vertex; -1 for none. Is changed.
        may_pair: whether two vertices may be paired; symmetric.
    """
    for vertex in reversed(range(len(partners))):
        if partners[vertex] < 0:
            _Search(partners, may_pair, vertex).augment()


class _Search:
    """The search for an augmenting path from an unpaired vertex."""

    def __init__(self, partners: list[int], may_pair: Callable[[int, int], bool], root: int) -> None:
        self._partners = partners
        self._may_pair = may_pair
        self._root = root
        count = len(partners)
        self._parents = [-1] * count
        """The vertex before, on the path from the root, of those an odd number of edges away."""
        self._bases = list(range(count))
        """The vertex by which the path from the root enters the odd cycle that a vertex belongs to."""
        self._reached = [vertex == root for vertex in range(count)]
        """Those an even number of edges away."""
        self._queue = deque([root])

    def augment(self) -> None:
        """Exchange the pairs along a path to another unpaired vertex, if there is one."""
        last = self._find_end()
        while last >= 0:
            before = self._parents[last]
            following = self._partners[before]
            self._partners[last], self._partners[before] = before, last
            last = following

    def _find_end(self) -> int:
        partners, parents = self._partners, self._parents
        while self._queue:
            vertex = self._queue.popleft()
            for other in self._neighbours(vertex):
                if self._bases[vertex] == self._bases[other] or partners[vertex] == other:
                    continue
                if other == self._root or (partners[other] >= 0 and parents[partners[other]] >= 0):
                    self._contract(vertex, other)
                elif parents[other] < 0:
                    parents[other] = vertex
                    if partners[other] < 0:
                        return other
                    self._reach(partners[other])
        return -1

    def _neighbours(self, vertex: int) -> Sequence[int]:
        others = sorted(range(len(self._partners)), key=lambda other: (abs(other - vertex), other))
        return [other for other in others[1:] if self._may_pair(vertex, other)]

    def _reach(self, vertex: int) -> None:
        if not self._reached[vertex]:
            self._reached[vertex] = True
            self._queue.append(vertex)

    def _contract(self, first: int, second: int) -> None:
        """Treat the odd cycle that an edge closes as one vertex."""
        base = self._find_base(first, second)
        inside: set[int] = set()
        self._mark(first, base, second, inside)
        self._mark(second, base, first, inside)
        for vertex, own in enumerate(self._bases):
            if own in inside:
                self._bases[vertex] = base
                self._reach(vertex)

    def _find_base(self, first: int, second: int) -> int:
        """Return where the paths from the root to two vertices part."""
        on_path: set[int] = set()
        vertex = self._bases[first]
        on_path.add(vertex)
        while self._partners[vertex] >= 0:
            vertex = self._bases[self._parents[self._partners[vertex]]]
            on_path.add(vertex)
        vertex = self._bases[second]
        while vertex not in on_path:
            vertex = self._bases[self._parents[self._partners[vertex]]]
        return vertex

    def _mark(self, vertex: int, base: int, child: int, inside: set[int]) -> None:
        """Collect the cycle from a vertex down to its base, and let paths go around it, by way of `child`."""
        while self._bases[vertex] != base:
            partner = self._partners[vertex]
            inside |= {self._bases[vertex], self._bases[partner]}
            self._parents[vertex] = child
            child = partner
            vertex = self._parents[partner]
