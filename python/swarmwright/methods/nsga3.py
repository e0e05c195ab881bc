"""NSGA-III: optimization of many objectives."""

import math
from itertools import combinations, pairwise
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright.controllers import Representation
from swarmwright.methods._base import DrawStreams, MethodOptions
from swarmwright.methods._pareto import ParetoMethod, ParetoOptions
from swarmwright.methods.archive import Values, ranks
from swarmwright.methods.constraints import is_infeasible

_SMALL = 1e-6
"""Range of an objective below which the front does not scale it."""
_LARGEST = 1e140
"""Limit of costs, so that squares of scaled ones are finite."""
_BLOCK = 1_000_000
"""Distances that are computed at once."""
_OTHER_WEIGHT = 1e6
"""Weight of the other objectives in the search for the extreme point of one."""


class Nsga3Options(ParetoOptions):
    """Multi-objective, for three or more objectives: members are spread along reference directions."""

    kind: Literal["nsga3"] = "nsga3"
    crossover: float = Field(default=1.0, ge=0, le=1)
    """Probability of a child of two members, which is then mutated; other children are mutated copies."""
    crossover_index: float = Field(default=30, ge=0, le=1000)
    """sbx: distribution index of crossovers; the larger, the closer children are to their parents."""
    partitions: int | None = Field(default=None, ge=1, le=4_000)
    """Parts into which the reference directions of Das and Dennis divide each objective: 12 gives 91 of them
    for three objectives. Default: as many as give at most `population` directions."""

    @property
    def directions(self) -> Values:
        """The reference directions, (directions, 1 + objectives), each with a sum of 1."""
        count = 1 + len(self.objectives)
        parts = self.partitions or _fitting_partitions(count, self.population)
        rows = []
        for bars in combinations(range(parts + count - 1), count - 1):
            borders = (-1, *bars, parts + count - 1)
            rows.append([after - before - 1 for before, after in pairwise(borders)])
        return np.array(rows[::-1], dtype=np.float64) / parts


def count_directions(objectives: int, partitions: int) -> int:
    """Return the number of reference directions of Das and Dennis."""
    return math.comb(partitions + objectives - 1, objectives - 1)


def _fitting_partitions(objectives: int, population: int) -> int:
    """Return the largest number of partitions with at most `population` directions, at least 1."""
    if objectives == 1:
        return 1
    partitions = 1
    while count_directions(objectives, partitions + 1) <= population:
        partitions += 1
    return partitions


class Nsga3(ParetoMethod):
    """NSGA-III, which sorts members and children by fronts, and within a front by reference directions.

    Of the last front that survives in part, members with directions that have the fewest survivors stay.
    Objectives are scaled by the best values so far and the intercepts of the plane through the extreme
    points. Parents are chosen at random.

    Source: Deb and Jain, "An evolutionary many-objective optimization algorithm using
    reference-point-based nondominated sorting approach, part I", IEEE Transactions on Evolutionary
    Computation 18(4), 2014; directions of Das and Dennis, SIAM Journal on Optimization 8(3), 1998; the
    treatment of degenerate planes is that of pymoo 0.6.
    """

    kind: ClassVar[str] = "nsga3"
    options_model = Nsga3Options
    options: Nsga3Options

    def __init__(self, options: Nsga3Options, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._directions = options.directions
        count = self._directions.shape[1]
        self._best, self._worst = np.full(count, np.inf), np.full(count, -np.inf)
        """Lowest and highest cost of each objective so far."""
        self._extremes: Values = np.empty((0, count))

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Refuse more reference directions than members."""
        invalid = super().problems(options, representation)
        assert isinstance(options, Nsga3Options)
        if options.partitions is not None:
            objectives = 1 + len(options.objectives)
            count = count_directions(objectives, options.partitions)
            if count > options.population:
                default = _fitting_partitions(objectives, options.population)
                invalid["partitions"] = (
                    f"{options.partitions} makes {count:,} reference directions for {objectives} objectives, "
                    f"more than population ({options.population}); leave the key out for "
                    f"{count_directions(objectives, default):,} directions"
                )
        return invalid

    def _choose_pairs(self, count: int, streams: DrawStreams) -> NDArray[np.int64]:
        return self._shuffle(2 * count, streams).reshape(count, 2)

    def _select(self, values: Values) -> list[int]:
        costs, fronts = np.clip(-values, -_LARGEST, _LARGEST), ranks(values)
        usable: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(values), axis=1)
        usable &= ~is_infeasible(values[:, 0])
        if usable.any():
            nadir = self._update_scale(costs[usable], costs[usable & (fronts == 0)])
            niches, distances = self._associate(np.where(usable[:, np.newaxis], costs, 0.0), nadir)
        else:
            niches, distances = np.zeros(len(costs), dtype=np.int64), np.zeros(len(costs))
        selected: list[int] = []
        for front in range(int(fronts.max()) + 1):
            rows = np.flatnonzero(fronts == front)
            free = self.options.population - len(selected)
            if len(rows) > free:
                counts = np.bincount(niches[selected], minlength=len(self._directions))
                rows = np.sort(self._fill_niches(rows, free, counts, niches, distances))
            selected.extend(rows.tolist())
            if len(selected) == self.options.population:
                break
        return selected

    def _update_scale(self, costs: Values, front: Values) -> Values:
        """Update the ideal and the extreme points; return the nadir point, (objectives,)."""
        self._best = np.minimum(self._best, costs.min(axis=0))
        self._worst = np.maximum(self._worst, costs.max(axis=0))
        points = np.concatenate([self._extremes, front])
        above = points - self._best
        above = np.where(above < 1e-3, 0.0, above)
        weights = np.where(np.eye(len(self._best)) > 0, 1.0, _OTHER_WEIGHT)
        extremes = (above[:, np.newaxis] * weights).max(axis=2).argmin(axis=0)
        self._extremes = points[extremes]
        plane = solve(self._extremes - self._best, np.ones(len(self._best)))
        nadir = front.max(axis=0)
        if plane is not None and (plane > 0).all() and (1 / plane > _SMALL).all():
            nadir = np.minimum(self._best + 1 / plane, self._worst)
        return np.asarray(np.where(nadir - self._best <= _SMALL, costs.max(axis=0), nadir))

    def _associate(self, costs: Values, nadir: Values) -> tuple[NDArray[np.int64], Values]:
        """Return the nearest direction of each row, and the squared distance from it, (n,) each."""
        width = np.where(nadir > self._best, nadir - self._best, 1e-12)
        scaled = (costs - self._best) / width
        nearest, squares = np.empty(len(costs), dtype=np.int64), np.empty(len(costs))
        step = max(_BLOCK // len(self._directions), 1)
        for begin in range(0, len(costs), step):
            block = slice(begin, begin + step)
            nearest[block], squares[block] = self._find_directions(scaled[block])
        return nearest, squares

    def _find_directions(self, points: Values) -> tuple[NDArray[np.int64], Values]:
        """Return the nearest direction of scaled costs, (n, objectives), and the squared distance from it."""
        directions, columns = self._directions, range(points.shape[1])
        # Sums in the order of the objectives, the same on every machine.
        along = sum(points[:, column, np.newaxis] * directions[:, column] for column in columns)
        share = np.asarray(along) / sum(directions[:, column] ** 2 for column in columns)
        squares = np.asarray(
            sum((points[:, column, np.newaxis] - share * directions[:, column]) ** 2 for column in columns)
        )
        nearest = squares.argmin(axis=1)
        return nearest, squares[np.arange(len(points)), nearest]

    def _fill_niches(
        self,
        rows: NDArray[np.int64],
        free: int,
        counts: NDArray[np.int64],
        niches: NDArray[np.int64],
        distances: Values,
    ) -> NDArray[np.int64]:
        """Return `free` of the rows of a front, from directions with the fewest survivors.

        counts: survivors of each direction. niches, distances: direction of each candidate, and distance.
        """
        order = self.stream("nsga3.members").unit(len(rows)).argsort()
        waiting: dict[int, list[int]] = {}
        for row in rows[order].tolist():
            waiting.setdefault(int(niches[row]), []).append(row)
        chosen: list[int] = []
        turn = 0
        while len(chosen) < free:
            present = np.array(sorted(waiting))
            fewest = present[counts[present] == counts[present].min()]
            shuffled = fewest[self.stream("nsga3.niches", turn).unit(len(fewest)).argsort()]
            for niche in shuffled[: free - len(chosen)].tolist():
                members = waiting[niche]
                # The nearest for a direction without survivors, else a random one.
                row = min(members, key=lambda row: distances[row]) if counts[niche] == 0 else members[0]
                members.remove(row)
                if not members:
                    del waiting[niche]
                chosen.append(row)
                counts[niche] += 1
            turn += 1
        return np.array(chosen, dtype=np.int64)


def solve(matrix: Values, right: Values) -> Values | None:
    """Solve linear equations by Gaussian elimination, in a fixed order; None if there is no solution.

    matrix: (n, n). right: (n,).
    """
    rows = [[*line, value] for line, value in zip(matrix.tolist(), right.tolist(), strict=True)]
    count = len(rows)
    for column in range(count):
        pivot = max(range(column, count), key=lambda row: abs(rows[row][column]))
        if not abs(rows[pivot][column]) > 0:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        for row in range(column + 1, count):
            factor = rows[row][column] / rows[column][column]
            rows[row] = [value - factor * above for value, above in zip(rows[row], rows[column], strict=True)]
    solution = [0.0] * count
    for row in reversed(range(count)):
        rest = rows[row][count]
        for column in range(row + 1, count):
            rest -= rows[row][column] * solution[column]
        solution[row] = rest / rows[row][row]
    values = np.array(solution)
    return values if np.isfinite(values).all() else None
