"""What a fitness expression may be made of.

The syntax is Python's, read as a tree of which only the parts listed here are allowed. Nothing of an
expression is ever executed as Python.
"""

import ast
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.suggestions import did_you_mean
from swarmwright.simulations.ros.expression import parsed

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
    for one in inner:
        check(one, text, names, depth + 1)


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
        known = ", ".join(one.usage for one in FUNCTIONS.values())
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
