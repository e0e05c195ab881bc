"""Fitness from metrics: an expression of the experiment over what simulations measure (D6.1, section 4.1.3).

Every operation is one of IEEE 754 binary64 in the order written, so that the fitness is the same to the bit
on every machine. That is why there is no exp and no log, whose last bits differ between mathematics
libraries, and why an exponent is a whole number: x ** 3 is x * x * x.
"""

import ast
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.suggestions import did_you_mean
from swarmwright.simulations.expression import (
    BINARY,
    COMPARISONS,
    FUNCTIONS,
    ExpressionError,
    Numbers,
    check,
    exponent_of,
    number_of,
    parse,
    source,
)

if TYPE_CHECKING:
    from swarmwright._engine import Episode
    from swarmwright.common.engine_types import SceneArrays, SceneFields
    from swarmwright.controllers.modules.played import PlayedEpisode

OWN = "fitness"
"""The name of the simulation's own fitness."""


@dataclass(frozen=True)
class Fault:
    """An evaluation for which the expression has no value."""

    index: int
    """Which of the evaluations."""
    reason: str


class FitnessExpression:
    """A fitness expression, checked.

    Args:
        text: such as "arrived - 0.01 * steps".

    Raises:
        ExpressionError: the text is not a valid expression.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self._root = parse(text)
        names: set[str] = set()
        check(self._root, text, names, 0)
        self.metrics = tuple(sorted(names - {OWN}))
        """Names of the metrics that it needs, sorted."""
        self.uses_own = OWN in names
        """Whether it needs the simulation's own fitness."""
        if not names:
            raise ExpressionError("uses no metric, so that it is the same for every controller")

    def unknown(self, known: Sequence[str], whose: str) -> str | None:
        """Return what is wrong with the names when there are the metrics `known`; None if nothing."""
        strange = [name for name in self.metrics if name not in known]
        if not strange:
            return None
        there = [*known, OWN]
        hints = [f"{name!r} is not a metric of {whose}{did_you_mean(name, there)}" for name in strange]
        said = "; ".join(hints)
        return f"{said}{' ' if said.endswith('?') else '; '}available: {', '.join(there)}"

    def __call__(self, fitness: Numbers, metrics: Numbers) -> tuple[Numbers, list[Fault]]:
        """Compute the expression for some evaluations.

        Args:
            fitness: (evaluations,), the simulation's own, finite.
            metrics: (evaluations, len(self.metrics)), finite.

        Returns:
            (evaluations,), NaN where it has no finite value, and for those the reasons, by index.
        """
        columns = {OWN: fitness, **dict(zip(self.metrics, metrics.T, strict=True))}
        run = _Evaluation(self.text, columns, len(fitness))
        with np.errstate(all="ignore"):
            values = run.value(self._root, np.arange(len(fitness)))
        faults = [Fault(int(index), run.reasons[int(index)]) for index in sorted(run.reasons)]
        values[[fault.index for fault in faults]] = np.nan
        return values + 0.0, faults


class JudgedEpisode:
    """An episode run in this process whose fitness is the experiment's, NaN where it has no value."""

    def __init__(self, episode: "Episode | PlayedEpisode", expression: FitnessExpression) -> None:
        self._episode = episode
        self._expression = expression

    @property
    def done(self) -> bool:
        """Whether the episode has ended."""
        return self._episode.done

    @property
    def fitness(self) -> float:
        """The value of the expression so far."""
        metrics = self._episode.metrics(list(self._expression.metrics))
        values, _ = self._expression(np.array([self._episode.fitness]), np.array([metrics]))
        return float(values[0])

    @property
    def step_size(self) -> float:
        """Seconds between two frames when shown."""
        return self._episode.step_size

    def step(self) -> None:
        """Move on by one step."""
        self._episode.step()

    def step_observed(self) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]:
        """Move on by one step; agents, what they sensed and what they did."""
        return self._episode.step_observed()

    def machine_states(self) -> NDArray[np.int32] | None:
        """The state of each agent's state machine, -1 where it has none; None for other controllers."""
        return self._episode.machine_states()

    def metrics(self, names: list[str]) -> list[float]:
        """The named metrics so far."""
        return self._episode.metrics(names)

    @property
    def metric_names(self) -> list[str]:
        """Names of all metrics of the simulation."""
        return self._episode.metric_names

    def scene(self) -> "SceneFields":
        """The scene."""
        return self._episode.scene()

    def scene_arrays(self) -> "SceneArrays":
        """The scene as arrays."""
        return self._episode.scene_arrays()

    def text(self, columns: int, color: bool, rows: int = 24, unicode: bool = True) -> str:
        """The scene as lines of text."""
        return self._episode.text(columns, color, rows, unicode)


class _Evaluation:
    """One computation for many evaluations; what if, and, or do not choose is not computed, as in Python."""

    def __init__(self, text: str, columns: Mapping[str, Numbers], count: int) -> None:
        self._text = text
        self._columns = columns
        self._broken = np.zeros(count, dtype=bool)
        self.reasons: dict[int, str] = {}
        """By index of the evaluation: the first thing computed that has no finite value."""

    def value(self, node: ast.expr, rows: NDArray[np.intp]) -> Numbers:
        """Return the value of a node for the evaluations of the given indices."""
        match node:
            case ast.Constant(value=value):
                return np.full(len(rows), number_of(value))
            case ast.Name(id=name):
                return self._columns[name][rows]
            case ast.UnaryOp(op=operation, operand=operand):
                number = self.value(operand, rows)
                if isinstance(operation, ast.Not):
                    return np.where(number == 0.0, 1.0, 0.0)
                return -number if isinstance(operation, ast.USub) else number
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                base = self.value(left, rows)
                return self._seen(node, rows, _power(base, exponent_of(right, self._text)), base)
            case ast.BinOp(left=left, op=operator_, right=right):
                first, second = self.value(left, rows), self.value(right, rows)
                result = BINARY[type(operator_)](first, second)
                return self._seen(node, rows, result, second)
            case ast.BoolOp(op=connective, values=[first_node, *others]):
                return self._connected(isinstance(connective, ast.And), first_node, others, rows)
            case ast.Compare(left=left, ops=operations, comparators=comparators):
                return self._compared(self.value(left, rows), operations, comparators, rows)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self._chosen(self.value(test, rows) != 0.0, body, orelse, rows)
            case ast.Call(func=ast.Name(id=name), args=arguments):
                numbers = [self.value(argument, rows) for argument in arguments]
                return self._seen(node, rows, FUNCTIONS[name].compute(*numbers), numbers[0])
        raise AssertionError(ast.dump(node))

    def _chosen(
        self, condition: NDArray[np.bool_], body: ast.expr, orelse: ast.expr, rows: NDArray[np.intp]
    ) -> Numbers:
        result = np.empty(len(rows))
        for mask, branch in ((condition, body), (~condition, orelse)):
            if mask.any():
                result[mask] = self.value(branch, rows[mask])
        return result

    def _connected(
        self, both: bool, first: ast.expr, others: list[ast.expr], rows: NDArray[np.intp]
    ) -> Numbers:
        result = self.value(first, rows).copy()
        for other in others:
            goes_on = (result != 0.0) == both
            if goes_on.any():
                result[goes_on] = self.value(other, rows[goes_on])
        return result

    def _compared(
        self,
        left: Numbers,
        operations: list[ast.cmpop],
        comparators: list[ast.expr],
        rows: NDArray[np.intp],
    ) -> Numbers:
        result = np.ones(len(rows), dtype=bool)
        for operation, comparator in zip(operations, comparators, strict=True):
            right = self.value(comparator, rows)
            result &= COMPARISONS[type(operation)](left, right)
            left = right
        return result.astype(np.float64)

    def _seen(self, node: ast.expr, rows: NDArray[np.intp], result: Numbers, operand: Numbers) -> Numbers:
        """Note for which evaluations an operation has no finite result; `operand` tells why."""
        bad = ~np.isfinite(result) & ~self._broken[rows]
        for place in np.flatnonzero(bad).tolist():
            self.reasons[int(rows[place])] = f"{_why(node, operand[place])} in {source(node, self._text)!r}"
        self._broken[rows[bad]] = True
        return result


def _why(node: ast.expr, operand: float) -> str:
    divides = isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div | ast.Pow)
    if divides and operand == 0.0:
        return "division by zero"
    if isinstance(node, ast.Call) and operand < 0.0:
        return "the square root of a negative number"
    if math.isnan(operand):
        return "a value that is not a number (NaN)"
    return "a number too large"


def _power(base: Numbers, exponent: int) -> Numbers:
    """Multiply from left to right; a negative exponent is one over that."""
    result = np.ones_like(base)
    for _ in range(abs(exponent)):
        result = result * base
    return 1.0 / result if exponent < 0 else result
