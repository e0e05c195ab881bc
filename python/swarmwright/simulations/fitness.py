"""Fitness from metrics: an expression of the experiment over what simulations measure (D6.1, section 4.1.3).

Every operation is one of IEEE 754 binary64 in the order written, so that the fitness is the same to the bit
on every machine. That is why there is no exp and no log, whose last bits differ between mathematics
libraries, and why an exponent is a whole number: x ** 3 is x * x * x.

What a fitness expression may be made of.

The syntax is Python's, read as a tree of which only the parts listed here are allowed. Nothing of an
expression is ever executed as Python.
"""

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.suggestions import did_you_mean
from swarmwright.simulations.ros.expression import parsed

if TYPE_CHECKING:
    from swarmwright._engine import Episode
    from swarmwright.common.engine_types import SceneArrays, SceneFields
    from swarmwright.controllers.modules.played import PlayedEpisode


LONGEST = 1000
"""Characters of an expression, at most."""
_DEEPEST_NESTING = 100
_LARGEST_EXPONENT = 64

Numbers = NDArray[np.float64]


class ExpressionError(ValueError):
    """The text is not a valid fitness expression.

    The message says what is wrong and what would be right.
    """


def parse(text: str) -> ast.expr:
    """Return the expression as a tree. Raises ExpressionError where it is not one, or too long."""
    if len(text) > LONGEST:
        raise ExpressionError(f"has {len(text)} characters; at most {LONGEST} are possible")
    try:
        tree: ast.expr = parsed(text.strip())
        return tree
    except SyntaxError as error:
        message = str(error.msg).split(". Perhaps")[0]
        place = f" (column {error.offset})" if error.offset else ""
        raise ExpressionError(f"{_shortened(text)!r} is not a valid expression: {message}{place}") from None
    except (ValueError, RecursionError, MemoryError):
        raise ExpressionError(f"{_shortened(text)!r} is not a valid expression") from None


# What may stand in an expression; each line is one IEEE operation, or chooses among numbers.
BINARY: dict[type[ast.operator], Callable[[Numbers, Numbers], Numbers]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
COMPARISONS: dict[type[ast.cmpop], Callable[[Numbers, Numbers], NDArray[np.bool_]]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_OPERATORS = "+ - * / **, < <= > >= == !=, and or not, a if condition else b"


def _least(first: Numbers, *others: Numbers) -> Numbers:
    # Python's min: of equals the first, which tells 0.0 and -0.0 apart where np.minimum does not.
    for other in others:
        first = np.where(other < first, other, first)
    return first


def _largest(first: Numbers, *others: Numbers) -> Numbers:
    for other in others:
        first = np.where(other > first, other, first)
    return first


def _clip(value: Numbers, low: Numbers, high: Numbers) -> Numbers:
    return _least(_largest(value, low), high)


@dataclass(frozen=True)
class _Function:
    compute: Callable[..., Numbers]
    least: int
    """Arguments, at least."""
    most: int
    usage: str


FUNCTIONS: dict[str, _Function] = {
    "abs": _Function(np.abs, 1, 1, "abs(x)"),
    "clip": _Function(_clip, 3, 3, "clip(x, low, high)"),
    "max": _Function(_largest, 2, 20, "max(a, b, ...)"),
    "min": _Function(_least, 2, 20, "min(a, b, ...)"),
    "sqrt": _Function(np.sqrt, 1, 1, "sqrt(x)"),
}
"""The functions that an expression may call."""


def check(node: ast.expr, text: str, names: set[str], depth: int) -> None:
    """Refuse whatever is not on the lists; collect the names."""
    if depth > _DEEPEST_NESTING:
        raise ExpressionError(f"is nested too deeply; at most {_DEEPEST_NESTING} levels are possible")
    inner: list[ast.expr] = []
    match node:
        case ast.Constant(value=value):
            number_of(value)
        case ast.Name(id=name):
            names.add(name)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            exponent_of(right, text)
            inner = [left]
        case ast.BinOp(left=left, op=operation, right=right) if type(operation) in BINARY:
            inner = [left, right]
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() | ast.Not(), operand=operand):
            inner = [operand]
        case ast.BoolOp(values=values):
            inner = values
        case ast.IfExp(test=test, body=body, orelse=orelse):
            inner = [test, body, orelse]
        case ast.Compare(left=left, ops=operations, comparators=others) if all(
            type(operation) in COMPARISONS for operation in operations
        ):
            inner = [left, *others]
        case ast.Call(func=function, args=arguments, keywords=keywords):
            inner = _arguments(function, arguments, keywords, text)
        case _:
            _refuse(node, text)
    for expression in inner:
        check(expression, text, names, depth + 1)


def _refuse(node: ast.expr, text: str) -> NoReturn:
    raise ExpressionError(
        f"{source(node, text)!r} is not allowed in a fitness expression; allowed: names of metrics, numbers, "
        f"{_OPERATORS}, and {', '.join(function.usage for function in FUNCTIONS.values())}"
    )


def number_of(value: object) -> float:
    """Return a constant of an expression. Raises ExpressionError for all that is not a number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ExpressionError(f"{value!r} is not a number; use names of metrics, and numbers such as 0.5")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ExpressionError("a number is too large; at most 1.7e308 is possible")
    return number


def exponent_of(node: ast.expr, text: str) -> int:
    """Return an exponent. Raises ExpressionError where it is not a small whole number."""
    negative = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)
    constant = node.operand if isinstance(node, ast.UnaryOp) and negative else node
    value = constant.value if isinstance(constant, ast.Constant) else None
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _LARGEST_EXPONENT:
        raise ExpressionError(
            f"the exponent {source(node, text)!r} must be a whole number from -{_LARGEST_EXPONENT} to "
            f"{_LARGEST_EXPONENT} (of others the last bits differ from machine to machine); "
            "sqrt(x) is the square root"
        )
    return -value if negative else value


def _arguments(
    function: ast.expr, arguments: list[ast.expr], keywords: list[ast.keyword], text: str
) -> list[ast.expr]:
    name = function.id if isinstance(function, ast.Name) else None
    if name not in FUNCTIONS:
        known = ", ".join(entry.usage for entry in FUNCTIONS.values())
        hint = did_you_mean(name, FUNCTIONS) if name else ""
        raise ExpressionError(
            f"there is no function {source(function, text)!r}{hint or ';'} available: {known}"
        )
    known_function = FUNCTIONS[name]
    starred = any(isinstance(argument, ast.Starred) for argument in arguments)
    if keywords or starred or not known_function.least <= len(arguments) <= known_function.most:
        raise ExpressionError(f"{name} is used as {known_function.usage}, with numbers in their places")
    return arguments


def source(node: ast.expr, text: str) -> str:
    """The part of the expression that a node stands for, shortened."""
    return _shortened(ast.get_source_segment(text.strip(), node) or text)


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."


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
