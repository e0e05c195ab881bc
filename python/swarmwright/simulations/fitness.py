"""Fitness expressions over the metrics of a simulation (D6.1, section 4.1.3).

Every operation is an IEEE 754 binary64 operation in the order written, so that the fitness is bit-identical
on every machine. Therefore exp and log are missing, whose last bits differ between mathematics libraries, and
exponents are integers: x ** 3 is x * x * x.

The syntax is Python's. The text is parsed into a tree in which only the elements listed here are allowed; it
is never executed as Python.
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
from swarmwright.simulations.ros.expression import parse_expression

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
    """The text is not a valid fitness expression."""


def parse(text: str) -> ast.expr:
    """Parse an expression. Raises ExpressionError if it is not valid, or too long."""
    if len(text) > LONGEST:
        raise ExpressionError(f"has {len(text)} characters; at most {LONGEST} are possible")
    try:
        tree: ast.expr = parse_expression(text.strip())
        return tree
    except SyntaxError as error:
        message = str(error.msg).split(". Perhaps")[0]
        column = f" (column {error.offset})" if error.offset else ""
        raise ExpressionError(f"{_shorten(text)!r} is not a valid expression: {message}{column}") from None
    except (ValueError, RecursionError, MemoryError):
        raise ExpressionError(f"{_shorten(text)!r} is not a valid expression") from None


# The operators of expressions; each is a single IEEE operation or a selection.
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


def _minimum(first: Numbers, *others: Numbers) -> Numbers:
    # Returns the first among equals, as Python's min does, which distinguishes 0.0 and -0.0.
    for other in others:
        first = np.where(other < first, other, first)
    return first


def _maximum(first: Numbers, *others: Numbers) -> Numbers:
    for other in others:
        first = np.where(other > first, other, first)
    return first


def _clip(value: Numbers, low: Numbers, high: Numbers) -> Numbers:
    return _minimum(_maximum(value, low), high)


@dataclass(frozen=True)
class _Function:
    compute: Callable[..., Numbers]
    least: int
    """Fewest arguments."""
    most: int
    usage: str


FUNCTIONS: dict[str, _Function] = {
    "abs": _Function(np.abs, 1, 1, "abs(x)"),
    "clip": _Function(_clip, 3, 3, "clip(x, low, high)"),
    "max": _Function(_maximum, 2, 20, "max(a, b, ...)"),
    "min": _Function(_minimum, 2, 20, "min(a, b, ...)"),
    "sqrt": _Function(np.sqrt, 1, 1, "sqrt(x)"),
}
"""The functions that an expression may call."""


def check(node: ast.expr, text: str, names: set[str], depth: int) -> None:
    """Raise ExpressionError for elements that are not allowed; collect the names."""
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
    """Return a constant as a float. Raises ExpressionError if it is not a number."""
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
    """Return an exponent. Raises ExpressionError if it is not a small integer."""
    negative = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)
    constant = node.operand if isinstance(node, ast.UnaryOp) and negative else node
    value = constant.value if isinstance(constant, ast.Constant) else None
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _LARGEST_EXPONENT:
        raise ExpressionError(
            f"the exponent {source(node, text)!r} must be a whole number from -{_LARGEST_EXPONENT} to "
            f"{_LARGEST_EXPONENT}, because the last bits of other powers differ between machines; "
            "write sqrt(x) for the square root"
        )
    return -value if negative else value


def _arguments(
    function: ast.expr, arguments: list[ast.expr], keywords: list[ast.keyword], text: str
) -> list[ast.expr]:
    name = function.id if isinstance(function, ast.Name) else None
    if name not in FUNCTIONS:
        usages = ", ".join(entry.usage for entry in FUNCTIONS.values())
        hint = did_you_mean(name, FUNCTIONS) if name else ""
        raise ExpressionError(
            f"there is no function {source(function, text)!r}{hint or ';'} available: {usages}"
        )
    usage = FUNCTIONS[name]
    starred = any(isinstance(argument, ast.Starred) for argument in arguments)
    if keywords or starred or not usage.least <= len(arguments) <= usage.most:
        raise ExpressionError(f"{name} is used as {usage.usage}, with numbers as arguments")
    return arguments


def source(node: ast.expr, text: str) -> str:
    """Return the source text of a node, shortened."""
    return _shorten(ast.get_source_segment(text.strip(), node) or text)


def _shorten(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."


def _weights(node: ast.expr) -> dict[str, float] | None:
    """Return the factor of each name, and the constant as that of ""; None for other than a weighted sum."""
    match node:
        case ast.Constant(value=value):
            return {"": number_of(value)}
        case ast.Name(id=name):
            return {name: 1.0}
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=operand):
            return _scale(_weights(operand), -1.0 if isinstance(sign, ast.USub) else 1.0)
        case ast.BinOp(left=left, op=operation, right=right):
            first, second = _weights(left), _weights(right)
            return None if first is None or second is None else _combine(operation, first, second)
    return None


def _combine(
    operation: ast.operator, first: dict[str, float], second: dict[str, float]
) -> dict[str, float] | None:
    if isinstance(operation, ast.Add | ast.Sub):
        sign = 1.0 if isinstance(operation, ast.Add) else -1.0
        return {
            name: first.get(name, 0.0) + sign * second.get(name, 0.0)
            for name in dict.fromkeys([*first, *second])
        }
    if isinstance(operation, ast.Mult) and first.keys() <= {""}:
        first, second = second, first
    if not isinstance(operation, ast.Mult | ast.Div) or not second.keys() <= {""}:
        return None
    factor = second[""]
    if isinstance(operation, ast.Div):
        return {name: value / factor for name, value in first.items()} if factor else None
    return _scale(first, factor)


def _scale(weights: dict[str, float] | None, factor: float) -> dict[str, float] | None:
    return None if weights is None else {name: factor * value for name, value in weights.items()}


FITNESS_NAME = "fitness"
"""The name of the simulation's own fitness."""


@dataclass(frozen=True)
class Fault:
    """An evaluation for which the expression has no value."""

    index: int
    """Index of the evaluation."""
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
        self.metrics = tuple(sorted(names - {FITNESS_NAME}))
        """Names of the metrics that the expression uses, sorted."""
        self.uses_simulation_fitness = FITNESS_NAME in names
        """Whether the expression uses the simulation's own fitness."""
        if not names:
            raise ExpressionError("uses no metric, so it is the same for every controller")

    def unknown(self, available: Sequence[str], simulation: str) -> str | None:
        """Return a message about metrics that are not in `available`; None if all are.

        simulation: its name, for the message.
        """
        strange = [name for name in self.metrics if name not in available]
        if not strange:
            return None
        names = [*available, FITNESS_NAME]
        hints = [f"{name!r} is not a metric of {simulation}{did_you_mean(name, names)}" for name in strange]
        message = "; ".join(hints)
        return f"{message}{' ' if message.endswith('?') else '; '}available: {', '.join(names)}"

    def split_weighted_sum(self) -> tuple[float, dict[str, float]] | None:
        """Return the constant and the factor of each name if the expression is a weighted sum; else None.

        A mission has such a fitness in its file: `offset` and `factors`.
        """
        weights = _weights(self._root)
        if weights is None or not all(map(math.isfinite, weights.values())):
            return None
        offset = weights.pop("", 0.0)
        return offset, weights

    def __call__(self, fitness: Numbers, metrics: Numbers) -> tuple[Numbers, list[Fault]]:
        """Compute the expression for some evaluations.

        Args:
            fitness: (evaluations,), the simulation's own, finite.
            metrics: (evaluations, len(self.metrics)), finite.

        Returns:
            The values, (evaluations,), NaN where there is no finite value; and the faults, by index.
        """
        columns = {FITNESS_NAME: fitness, **dict(zip(self.metrics, metrics.T, strict=True))}
        run = _Evaluation(self.text, columns, len(fitness))
        with np.errstate(all="ignore"):
            values = run.value(self._root, np.arange(len(fitness)))
        faults = [Fault(int(index), run.reasons[int(index)]) for index in sorted(run.reasons)]
        values[[fault.index for fault in faults]] = np.nan
        return values + 0.0, faults


class JudgedEpisode:
    """An episode in this process whose fitness is the value of an expression; NaN if it has none."""

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
        """Advance by one step."""
        self._episode.step()

    def step_observed(self) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]:
        """Advance by one step; return the agents that acted, their sensors and their actuators."""
        return self._episode.step_observed()

    def machine_states(self) -> NDArray[np.int32] | None:
        """Return the state of each agent's state machine, -1 without one; None for other controllers."""
        return self._episode.machine_states()

    def metrics(self, names: list[str]) -> list[float]:
        """Return the named metrics so far."""
        return self._episode.metrics(names)

    @property
    def metric_names(self) -> list[str]:
        """Names of all metrics of the simulation."""
        return self._episode.metric_names

    def scene(self) -> "SceneFields":
        """Return the scene."""
        return self._episode.scene()

    def scene_arrays(self) -> "SceneArrays":
        """Return the scene as arrays."""
        return self._episode.scene_arrays()

    def text(self, columns: int, color: bool, rows: int = 24, unicode: bool = True) -> str:
        """Return the scene as lines of text."""
        return self._episode.text(columns, color, rows, unicode)


class _Evaluation:
    """A computation for many evaluations. Branches that if, and, or skip are not computed, as in Python."""

    def __init__(self, text: str, columns: Mapping[str, Numbers], count: int) -> None:
        self._text = text
        self._columns = columns
        self._broken = np.zeros(count, dtype=bool)
        self.reasons: dict[int, str] = {}
        """Index of an evaluation -> its first operation without a finite value."""

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
                return self._record_faults(node, rows, _power(base, exponent_of(right, self._text)), base)
            case ast.BinOp(left=left, op=operator_, right=right):
                first, second = self.value(left, rows), self.value(right, rows)
                result = BINARY[type(operator_)](first, second)
                return self._record_faults(node, rows, result, second)
            case ast.BoolOp(op=connective, values=[first_node, *others]):
                return self._evaluate_boolean(isinstance(connective, ast.And), first_node, others, rows)
            case ast.Compare(left=left, ops=operations, comparators=comparators):
                return self._evaluate_comparison(self.value(left, rows), operations, comparators, rows)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self._evaluate_conditional(self.value(test, rows) != 0.0, body, orelse, rows)
            case ast.Call(func=ast.Name(id=name), args=arguments):
                numbers = [self.value(argument, rows) for argument in arguments]
                return self._record_faults(node, rows, FUNCTIONS[name].compute(*numbers), numbers[0])
        raise AssertionError(ast.dump(node))

    def _evaluate_conditional(
        self, condition: NDArray[np.bool_], body: ast.expr, orelse: ast.expr, rows: NDArray[np.intp]
    ) -> Numbers:
        result = np.empty(len(rows))
        for mask, branch in ((condition, body), (~condition, orelse)):
            if mask.any():
                result[mask] = self.value(branch, rows[mask])
        return result

    def _evaluate_boolean(
        self, both: bool, first: ast.expr, others: list[ast.expr], rows: NDArray[np.intp]
    ) -> Numbers:
        result = self.value(first, rows).copy()
        for other in others:
            goes_on = (result != 0.0) == both
            if goes_on.any():
                result[goes_on] = self.value(other, rows[goes_on])
        return result

    def _evaluate_comparison(
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

    def _record_faults(
        self, node: ast.expr, rows: NDArray[np.intp], result: Numbers, operand: Numbers
    ) -> Numbers:
        """Record the evaluations for which an operation has no finite result; `operand` is the cause."""
        bad = ~np.isfinite(result) & ~self._broken[rows]
        for index in np.flatnonzero(bad).tolist():
            self.reasons[int(rows[index])] = f"{_why(node, operand[index])} in {source(node, self._text)!r}"
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
    """Multiply from left to right; a negative exponent gives the reciprocal."""
    result = np.ones_like(base)
    for _ in range(abs(exponent)):
        result = result * base
    return 1.0 / result if exponent < 0 else result
