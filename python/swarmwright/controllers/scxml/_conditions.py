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
"""Sensor -> where one interval ends and the next begins, ascending."""

_MOST_CHARACTERS = 10_000
"""Of a condition."""
_DEEPEST_NESTING = 100
"""Levels of parentheses."""
_LARGEST_BINARY32 = float(np.finfo(np.float32).max)
_WORDS = {"&&": " and ", "||": " or ", "!==": "!=", "===": "==", "true": " True ", "false": " False "}
_WORD = re.compile(r"&&|\|\||!==|!=|===|!|\btrue\b|\bfalse\b")
_STRING = re.compile(r"'[^']*'|\"[^\"]*\"")
_BRACKET = re.compile(r"[()]")
_LONG_WORD = re.compile(r"\w{1001}")
"""Python does not write integers of more than 4300 digits."""
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
    """The text is not a condition or a constant of the subset. The message says why."""


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
    """Conditions of which one, or all, or the only one does not hold."""

    how: str
    """`and`, `or` or `not`."""
    parts: tuple["Condition", ...]


Condition = Above | Active | Combined | bool


def parse(text: str) -> ast.expr:
    """Return an expression as a tree. Raises ConditionError where it is none."""
    if len(text) > _MOST_CHARACTERS:
        raise ConditionError(f"has {len(text)} characters; at most {_MOST_CHARACTERS} are possible")
    if _LONG_WORD.search(text):
        raise ConditionError("has a name or a number of more than 1000 characters")
    plain_text = _STRING.sub(lambda found: found[0][0] + " " * (len(found[0]) - 2) + found[0][0], text)
    if "#" in plain_text:
        raise ConditionError(f"{text!r}: # begins no comment here, and is not an operator; leave it out")
    if (negated := _negated_and_compared(plain_text)) is not None:
        raise ConditionError(
            f"{text!r}: {negated} is negated first, and then compared; write all that is negated in "
            "brackets, !(x > 0.5)"
        )
    if re.search(r"!(?![=\s(]|\s+\()", text):
        raise ConditionError(f"{text!r}: write what is negated in brackets, !(..)")
    plain = _WORD.sub(lambda found: _WORDS.get(found[0], found[0] if found[0] == "!=" else " not "), text)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(plain.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ConditionError(f"{text!r} is not a valid expression") from None


def _negated_and_compared(text: str) -> str | None:
    """Return a negation in brackets that a comparison follows, which Python would negate; None for none.

    ECMAScript compares the negation, true or false, with what follows.

    text: without what is inside of strings.
    """
    ends: dict[int, int] = {}
    opened: list[int] = []
    for bracket in _BRACKET.finditer(text):
        if bracket[0] == "(":
            opened.append(bracket.start())
        elif opened:
            ends[opened.pop()] = bracket.start()
    for found in _NEGATION.finditer(text):
        end = ends.get(found.end() - 1)
        if end is not None and _COMPARISON.match(text, end + 1):
            return text[found.start() : end + 1]
    return None


def constant(node: ast.expr, constants: Mapping[str, float], depth: int = 0) -> float:
    """Return the value of an expression of numbers. Raises ConditionError where it is another one."""
    value = math.nan
    if depth > _DEEPEST_NESTING:
        raise ConditionError("is nested too deeply")
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            value = float(number) if abs(number) <= _LARGEST_BINARY32 else math.inf
        case ast.Name(id=name) if name in constants:
            value = constants[name]
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
            inside = constant(inner, constants, depth + 1)
            value = -inside if isinstance(sign, ast.USub) else inside
        case ast.BinOp(left=left, op=operation, right=right) if type(operation) in _BINARY:
            two = constant(left, constants, depth + 1), constant(right, constants, depth + 1)
            try:
                value = _BINARY[type(operation)](*two)
            except ZeroDivisionError:
                raise ConditionError(f"{ast.unparse(node)!r} divides by zero") from None
        case _:
            raise ConditionError(f"{ast.unparse(node)!r} found, expected a number")
    if not math.isfinite(value) or abs(value) > _LARGEST_BINARY32:
        raise ConditionError(f"{ast.unparse(node)!r} is not a finite number")
    return value


def condition(
    node: ast.expr, sensor: Callable[[ast.expr], int | None], constants: Mapping[str, float], depth: int = 0
) -> Condition:
    """Return a condition.

    Args:
        node: the expression.
        sensor: the number of the sensor that an expression names; None for another expression.
        constants: named numbers.
        depth: of this expression in the whole one.

    Raises ConditionError where it is not made of comparisons of a sensor with a number.
    """
    if depth > _DEEPEST_NESTING:
        raise ConditionError("is nested too deeply")
    match node:
        case ast.Constant(value=bool() as value):
            return value
        case ast.BoolOp(op=how, values=values):
            parts = tuple(condition(expression, sensor, constants, depth + 1) for expression in values)
            return Combined("and" if isinstance(how, ast.And) else "or", parts)
        case ast.UnaryOp(op=ast.Not(), operand=inner):
            return Combined("not", (condition(inner, sensor, constants, depth + 1),))
        case ast.Call(func=ast.Name(id="In"), args=[ast.Constant(value=str() as name)], keywords=[]):
            return Active(name)
        case ast.Compare(left=left, ops=[operation], comparators=[right]) if type(operation) in _MIRRORED:
            kind: type[ast.cmpop] = type(operation)
            if (number := sensor(left)) is not None:
                return _compared(number, kind, constant(right, constants))
            if (number := sensor(right)) is not None:
                return _compared(number, _MIRRORED[kind], constant(left, constants))
        case ast.Compare(ops=[_, _, *_]):
            raise ConditionError(f"{ast.unparse(node)!r}: write two comparisons, a < x && x < b")
    raise ConditionError(
        f"{ast.unparse(node)!r} found, expected a comparison of a sensor with a number, such as x > 0.5"
    )


def _compared(sensor: int, kind: type[ast.cmpop], bound: float) -> Condition:
    """Return a comparison; sensors are float32, so that each one is exactly one with a float32 threshold."""
    above, reaches = Above(sensor, _at_most(bound)), Above(sensor, _below(bound))
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


def _at_most(bound: float) -> float:
    """Return the largest float32 that is not above a number."""
    nearest = np.float32(bound)
    if float(nearest) > bound:
        nearest = np.nextafter(nearest, np.float32(-np.inf))
    return float(nearest) + 0.0


def _below(bound: float) -> float:
    """Return the largest float32 that is below a number."""
    nearest = np.float32(bound)
    if float(nearest) >= bound:
        nearest = np.nextafter(nearest, np.float32(-np.inf))
    return float(nearest) + 0.0


def collect(test: Condition, thresholds: dict[int, set[float]]) -> None:
    """Add the thresholds of a condition."""
    if isinstance(test, Above):
        thresholds.setdefault(test.sensor, set()).add(test.threshold)
    elif isinstance(test, Combined):
        for part in test.parts:
            collect(part, thresholds)


def named(test: Condition) -> set[str]:
    """Return the states that a condition asks for."""
    if isinstance(test, Active):
        return {test.state}
    return {name for part in test.parts for name in named(part)} if isinstance(test, Combined) else set()


def holds(
    test: Condition, thresholds: Thresholds, intervals: NDArray[np.int64], active: Container[str] = ()
) -> Bits:
    """Return whether a condition holds, for each combination of intervals, (sensors, combinations).

    active: the states that are active.
    """
    if isinstance(test, bool | Active):
        return np.full(intervals.shape[1], test if isinstance(test, bool) else test.state in active)
    if isinstance(test, Above):
        found: Any = intervals[test.sensor] > thresholds[test.sensor].index(test.threshold)
        return np.asarray(found, dtype=np.bool_)
    parts = [holds(part, thresholds, intervals, active) for part in test.parts]
    if test.how == "not":
        return ~parts[0]
    combined: Bits = (np.logical_and if test.how == "and" else np.logical_or).reduce(parts)
    return combined
