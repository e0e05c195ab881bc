"""Conditions over sensors and constant expressions, in the syntax that ECMAScript and Python share."""

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.bool_]
Thresholds = dict[int, list[float]]
"""Sensor -> thresholds between intervals, ascending."""

_MOST_CHARACTERS = 10_000
"""Longest condition, in characters."""
_DEEPEST_NESTING = 100
"""Deepest nesting of parentheses."""
_LARGEST_BINARY32 = float(np.finfo(np.float32).max)
_WORDS = {"&&": " and ", "||": " or ", "!==": "!=", "===": "==", "true": " True ", "false": " False "}
_WORD = re.compile(r"&&|\|\||!==|!=|===|!|\btrue\b|\bfalse\b")
_STRING = re.compile(r"'[^']*'|\"[^\"]*\"")
_BRACKET = re.compile(r"[()]")
_LONG_WORD = re.compile(r"\w{1001}")
"""Python refuses to convert integers of more than 4300 digits."""
_NEGATION = re.compile(r"!\s*\(")
_COMPARISON = re.compile(r"\s*(?:[<>]|[=!]=)")
_BINARY: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_MIRRORED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.Gt,
    ast.LtE: ast.GtE,
    ast.Gt: ast.Lt,
    ast.GtE: ast.LtE,
    ast.Eq: ast.Eq,
    ast.NotEq: ast.NotEq,
}


class ConditionError(ValueError):
    """The text is not a condition or constant of the supported subset."""


@dataclass(frozen=True)
class Above:
    """Whether a sensor is above a threshold, a float32."""

    sensor: int
    threshold: float


@dataclass(frozen=True)
class Active:
    """Whether a state is active, `In('state')`."""

    state: str


@dataclass(frozen=True)
class Combined:
    """A disjunction or conjunction of conditions, or the negation of a condition."""

    how: str
    """`and`, `or` or `not`."""
    parts: tuple["Condition", ...]


Condition = Above | Active | Combined | bool


def parse_expression(text: str) -> ast.expr:
    """Parse an expression. Raises ConditionError for invalid text."""
    if len(text) > _MOST_CHARACTERS:
        raise ConditionError(f"has {len(text)} characters; the limit is {_MOST_CHARACTERS}")
    if _LONG_WORD.search(text):
        raise ConditionError("has a name or a number of more than 1000 characters")
    plain_text = _STRING.sub(lambda match: match[0][0] + " " * (len(match[0]) - 2) + match[0][0], text)
    if "#" in plain_text:
        raise ConditionError(f"{text!r}: comments are not supported; remove the text from # on")
    if (negated := _find_compared_negation(plain_text)) is not None:
        raise ConditionError(
            f"{text!r}: {negated} is negated before the comparison; put the whole comparison in brackets, "
            "!(x > 0.5)"
        )
    if re.search(r"!(?![=\s(]|\s+\()", text):
        raise ConditionError(f"{text!r}: put the negated expression in brackets, !(..)")
    python_text = _WORD.sub(
        lambda match: _WORDS.get(match[0], match[0] if match[0] == "!=" else " not "), text
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(python_text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ConditionError(f"{text!r} is not a valid expression") from None


def _find_compared_negation(text: str) -> str | None:
    """Return a bracketed negation that a comparison follows; None if there is none.

    ECMAScript compares the negation, true or false; Python would negate the comparison.

    text: the expression, with blank strings.
    """
    ends: dict[int, int] = {}
    opened: list[int] = []
    for bracket in _BRACKET.finditer(text):
        if bracket[0] == "(":
            opened.append(bracket.start())
        elif opened:
            ends[opened.pop()] = bracket.start()
    for negation in _NEGATION.finditer(text):
        end = ends.get(negation.end() - 1)
        if end is not None and _COMPARISON.match(text, end + 1):
            return text[negation.start() : end + 1]
    return None


def evaluate_constant(node: ast.expr, constants: Mapping[str, float], depth: int = 0) -> float:
    """Evaluate a constant expression. Raises ConditionError for other expressions."""
    value = math.nan
    if depth > _DEEPEST_NESTING:
        raise ConditionError("is nested too deeply")
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            value = float(number) if abs(number) <= _LARGEST_BINARY32 else math.inf
        case ast.Name(id=name) if name in constants:
            value = constants[name]
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
            operand_value = evaluate_constant(inner, constants, depth + 1)
            value = -operand_value if isinstance(sign, ast.USub) else operand_value
        case ast.BinOp(left=left, op=operation, right=right) if type(operation) in _BINARY:
            operands = (
                evaluate_constant(left, constants, depth + 1),
                evaluate_constant(right, constants, depth + 1),
            )
            try:
                value = _BINARY[type(operation)](*operands)
            except ZeroDivisionError:
                raise ConditionError(f"{ast.unparse(node)!r} divides by zero") from None
        case _:
            raise ConditionError(f"{ast.unparse(node)!r} found, expected a number")
    if not math.isfinite(value) or abs(value) > _LARGEST_BINARY32:
        raise ConditionError(f"{ast.unparse(node)!r} is not a finite number")
    return value


def convert_condition(
    node: ast.expr, sensor: Callable[[ast.expr], int | None], constants: Mapping[str, float], depth: int = 0
) -> Condition:
    """Convert an expression into a condition.

    Args:
        node: the expression.
        sensor: the number of the sensor that an expression names; None for another expression.
        constants: named numbers.
        depth: nesting depth of this expression.

    Raises ConditionError for anything but comparisons of a sensor with a number.
    """
    if depth > _DEEPEST_NESTING:
        raise ConditionError("is nested too deeply")
    match node:
        case ast.Constant(value=bool() as value):
            return value
        case ast.BoolOp(op=how, values=values):
            parts = tuple(
                convert_condition(expression, sensor, constants, depth + 1) for expression in values
            )
            return Combined("and" if isinstance(how, ast.And) else "or", parts)
        case ast.UnaryOp(op=ast.Not(), operand=inner):
            return Combined("not", (convert_condition(inner, sensor, constants, depth + 1),))
        case ast.Call(func=ast.Name(id="In"), args=[ast.Constant(value=str() as name)], keywords=[]):
            return Active(name)
        case ast.Compare(left=left, ops=[operation], comparators=[right]) if type(operation) in _MIRRORED:
            kind: type[ast.cmpop] = type(operation)
            if (number := sensor(left)) is not None:
                return _compare(number, kind, evaluate_constant(right, constants))
            if (number := sensor(right)) is not None:
                return _compare(number, _MIRRORED[kind], evaluate_constant(left, constants))
        case ast.Compare(ops=[_, _, *_]):
            raise ConditionError(f"{ast.unparse(node)!r}: write two comparisons, a < x && x < b")
    raise ConditionError(
        f"{ast.unparse(node)!r} found, expected a comparison of a sensor with a number, such as x > 0.5"
    )


def _compare(sensor: int, kind: type[ast.cmpop], bound: float) -> Condition:
    """Return a comparison with an equivalent float32 threshold, since sensors are float32."""
    above, reaches = (
        Above(sensor, _largest_float32_up_to(bound)),
        Above(sensor, _largest_float32_below(bound)),
    )
    if kind is ast.Gt:
        return above
    if kind is ast.GtE:
        return reaches
    if kind is ast.Lt:
        return Combined("not", (reaches,))
    if kind is ast.LtE:
        return Combined("not", (above,))
    equal = Combined("and", (reaches, Combined("not", (above,))))
    return equal if kind is ast.Eq else Combined("not", (equal,))


def _largest_float32_up_to(bound: float) -> float:
    """Return the largest float32 that is at most a number."""
    nearest = np.float32(bound)
    if float(nearest) > bound:
        nearest = np.nextafter(nearest, np.float32(-np.inf))
    return float(nearest) + 0.0


def _largest_float32_below(bound: float) -> float:
    """Return the largest float32 that is below a number."""
    nearest = np.float32(bound)
    if float(nearest) >= bound:
        nearest = np.nextafter(nearest, np.float32(-np.inf))
    return float(nearest) + 0.0


def collect_thresholds(test: Condition, thresholds: dict[int, set[float]]) -> None:
    """Add the thresholds of a condition to `thresholds`."""
    if isinstance(test, Above):
        thresholds.setdefault(test.sensor, set()).add(test.threshold)
    elif isinstance(test, Combined):
        for part in test.parts:
            collect_thresholds(part, thresholds)


def state_names(test: Condition) -> set[str]:
    """Return the names of the states that a condition tests."""
    if isinstance(test, Active):
        return {test.state}
    return (
        {name for part in test.parts for name in state_names(part)} if isinstance(test, Combined) else set()
    )


def evaluate_condition(
    test: Condition, thresholds: Thresholds, intervals: NDArray[np.int64], active: Container[str] = ()
) -> Bits:
    """Evaluate a condition for each combination of intervals, (sensors, combinations).

    active: the states that are active.
    """
    if isinstance(test, bool | Active):
        return np.full(intervals.shape[1], test if isinstance(test, bool) else test.state in active)
    if isinstance(test, Above):
        above: Any = intervals[test.sensor] > thresholds[test.sensor].index(test.threshold)
        return np.asarray(above, dtype=np.bool_)
    parts = [evaluate_condition(part, thresholds, intervals, active) for part in test.parts]
    if test.how == "not":
        return ~parts[0]
    combined: Bits = (np.logical_and if test.how == "and" else np.logical_or).reduce(parts)
    return combined
