"""Expressions over metrics, with the syntax of fitness expressions: `collisions > 0 or distance < 0.1`.

They were checked when the experiment was read; this module evaluates them where Swarmwright is not installed.
"""

from __future__ import annotations

import ast
import io
import math
import operator
import tokenize
import warnings
from typing import Any, Callable, Mapping, Sequence


def mean(values: Sequence[float]) -> float:
    """Return the mean."""
    return math.fsum(values) / len(values)


def std(values: Sequence[float]) -> float:
    """Return the population standard deviation."""
    center = mean(values)
    return math.sqrt(math.fsum((value - center) * (value - center) for value in values) / len(values))


FUNCTIONS: dict[str, Callable[[Sequence[float]], float]] = {
    "last": lambda values: values[-1],
    "first": lambda values: values[0],
    "mean": mean,
    "sum": math.fsum,
    "min": min,
    "max": max,
    "std": std,
    "count": lambda values: float(len(values)),
}
"""Reductions of at least one value, by name."""


_BINARY: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: lambda base, exponent: _power(base, int(exponent)),
}
_COMPARISONS: dict[type, Callable[[float, float], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_FUNCTIONS: dict[str, Callable[..., float]] = {
    "abs": abs,
    "clip": lambda value, low, high: min(max(value, low), high),
    "max": max,
    "min": min,
    "sqrt": math.sqrt,
}


class Expression:
    """An expression over metrics. Raises SyntaxError if the text is not an expression."""

    def __init__(self, text: str) -> None:
        self.text = text
        self._root = parse_expression(text.strip())

    def __call__(self, values: Mapping[str, float]) -> float:
        """Return the value; true is 1, false 0. Raises ArithmeticError or ValueError if there is none."""
        return float(self._value(self._root, values))

    def _value(self, node: Any, values: Mapping[str, float]) -> float:
        def evaluate(inner: Any) -> float:
            return self._value(inner, values)

        if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
            return float(node.value)
        if isinstance(node, ast.Name) and node.id in values:
            return values[node.id]
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            return _BINARY[type(node.op)](evaluate(node.left), evaluate(node.right))
        if isinstance(node, ast.UnaryOp):
            value = evaluate(node.operand)
            return float(not value) if isinstance(node.op, ast.Not) else -value if _is_minus(node) else value
        if isinstance(node, ast.BoolOp):
            return self._evaluate_boolean(node, values)
        if isinstance(node, ast.Compare):
            return float(self._evaluate_comparison(node, values))
        if isinstance(node, ast.IfExp):
            return evaluate(node.body) if evaluate(node.test) else evaluate(node.orelse)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS:
            return float(_FUNCTIONS[node.func.id](*map(evaluate, node.args)))
        raise ValueError(f"{self.text!r} is not an expression over {', '.join(values)}")

    def _evaluate_boolean(self, node: ast.BoolOp, values: Mapping[str, float]) -> float:
        """Return the deciding value of `and` or `or`, as Python does."""
        value = 0.0
        for expression in node.values:
            value = self._value(expression, values)
            if bool(value) != isinstance(node.op, ast.And):
                break
        return value

    def _evaluate_comparison(self, node: ast.Compare, values: Mapping[str, float]) -> bool:
        left = self._value(node.left, values)
        for operation, other in zip(node.ops, node.comparators):
            right = self._value(other, values)
            if not _COMPARISONS[type(operation)](left, right):
                return False
            left = right
        return True


def parse_expression(text: str) -> Any:
    """Parse an expression, which may span several lines, as in YAML's "|" blocks, and have comments.

    Raises SyntaxError.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return ast.parse(text, mode="eval").body
        except SyntaxError:
            if len(text.splitlines()) < 2:
                raise
            bracketed = "\n".join(["(", *text.splitlines(), ")"])
            tree = ast.parse(bracketed, mode="eval").body
            if _closes_early(bracketed):
                raise
            return tree


def _closes_early(bracketed: str) -> bool:
    """Return whether the first bracket is closed before the last line."""
    depth = 0
    for token in tokenize.generate_tokens(io.StringIO(bracketed).readline):
        if token.type == tokenize.OP:
            depth += (token.string in "([{") - (token.string in ")]}")
            if depth == 0:
                return token.start[0] < len(bracketed.splitlines())
    return False


def _power(base: float, exponent: int) -> float:
    """Multiply from left to right, which gives the same result on every machine."""
    result = 1.0
    for _ in range(abs(exponent)):
        result = result * base
    return 1.0 / result if exponent < 0 else result


def _is_minus(node: ast.UnaryOp) -> bool:
    return isinstance(node.op, ast.USub)
