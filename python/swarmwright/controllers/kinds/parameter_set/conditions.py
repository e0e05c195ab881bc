"""Conditions over the values of parameters: `algorithm in ["acs", "mmas"] and ants > 10`.

The operators of fitness expressions (Python) and those of irace's files (R) are both understood: `and` and
`&`, `or` and `|`, `not` and `!`, `in [..]` and `%in% c(..)`. The value of an inactive parameter is R's NA: a
comparison with it is neither true nor false, `in` is false, and `or` is true if another operand is.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.suggestions import did_you_mean, suggest_or_list

Numbers = NDArray[np.float64]
Columns = Mapping[str, Numbers]
"""Parameter -> value for each candidate; for texts the index of the choice, NaN where it is inactive."""
Constant = str | float | bool

_LONGEST = 1000
"""Characters of a condition, at most."""
_DEEPEST = 40
"""Nested levels, at most."""
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?L?(?![\w.]))"
    r"|\"(?P<double>[^\"]*)\"|'(?P<single>[^']*)'|`(?P<quoted>[^`]*)`"
    r"|(?P<name>[^\W\d][\w.]*)|(?P<operator>%in%|[=!<>]=|&&|\|\||[-+*/()\[\],<>&|!]))"
)
_COMPARISONS: dict[str, Callable[[Numbers, Numbers], NDArray[np.bool_]]] = {
    "==": np.equal,
    "!=": np.not_equal,
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
}
_ARITHMETIC: dict[str, Callable[[Numbers, Numbers], Numbers]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
}
_WORDS = {"and": "&", "or": "|", "not": "!", "in": "%in%", "&&": "&", "||": "|"}
_CONSTANTS = {"True": True, "TRUE": True, "true": True, "False": False, "FALSE": False, "false": False}
_ORDERS = frozenset({"<", "<=", ">", ">="})


class ConditionError(ValueError):
    """The text is not a valid condition."""


@dataclass(frozen=True)
class Variable:
    """What conditions can do with a parameter."""

    choices: Sequence[str] | None = None
    """Texts that it can be; None for numbers and booleans."""
    is_boolean: bool = False
    is_ordered: bool = True
    """Whether values can be compared by < and >."""


class _Token(NamedTuple):
    kind: Literal["number", "text", "name", "operator", "end"]
    text: str
    column: int


class _Operand(NamedTuple):
    """A part of a condition."""

    kind: Literal["number", "choice", "logic"]
    compute: Callable[[Columns], Numbers]
    constant: Constant | None = None
    variable: Variable | None = None
    """The parameter, if it is nothing else."""
    text: str = ""


class Condition:
    """A condition, checked.

    Args:
        text: such as `algorithm == "acs"`.
        variables: the parameters that may occur, by name.

    Raises:
        ConditionError: the text is not a valid condition.
    """

    def __init__(self, text: str, variables: Mapping[str, Variable]) -> None:
        self.text = text
        parser = _Parser(text, variables)
        self._compute = parser.parse()
        self.names = tuple(dict.fromkeys(parser.names))
        """Names of the parameters that occur."""

    def holds(self, columns: Columns) -> NDArray[np.bool_]:
        """Return for which candidates the condition is true, (n,)."""
        with np.errstate(all="ignore"):
            return np.asarray(self._compute(columns) == 1.0)


class _Parser:
    """A recursive descent parser whose results are functions."""

    def __init__(self, text: str, variables: Mapping[str, Variable]) -> None:
        self._variables = variables
        self._tokens = _split(text)
        self._next = 0
        self._depth = 0
        self.names: list[str] = []

    def parse(self) -> Callable[[Columns], Numbers]:
        whole = self._parse_or()
        if self._token.kind != "end":
            self._refuse_token("an operator")
        return self._require_logic(whole).compute

    @property
    def _token(self) -> _Token:
        return self._tokens[self._next]

    def _take(self, *operators: str) -> str | None:
        """Return the next token if it is one of these operators, and go on."""
        token = self._token
        if token.kind != "operator" or token.text not in operators:
            return None
        self._next += 1
        return token.text

    def _require(self, operator: str) -> None:
        if self._take(operator) is None:
            self._refuse_token(f"'{operator}'")

    def _refuse_token(self, expected: str) -> None:
        token = self._token
        actual = "it ends there" if token.kind == "end" else f"not {token.text!r}"
        raise ConditionError(f"expected {expected} in column {token.column}, {actual}")

    def _parse_or(self) -> _Operand:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ConditionError(f"is nested too deeply; at most {_DEEPEST} levels are possible")
        operand = self._join(self._parse_and, "|", _disjoin)
        self._depth -= 1
        return operand

    def _parse_and(self) -> _Operand:
        return self._join(self._parse_not, "&", _conjoin)

    def _join(
        self, parse: Callable[[], _Operand], operator: str, combine: Callable[[list[Numbers]], Numbers]
    ) -> _Operand:
        operands = [parse()]
        while self._take(operator):
            operands.append(parse())
        if len(operands) == 1:
            return operands[0]
        parts = [self._require_logic(operand).compute for operand in operands]
        return _Operand("logic", lambda columns: combine([part(columns) for part in parts]))

    def _parse_not(self) -> _Operand:
        negations = 0
        while self._take("!"):
            negations += 1
        operand = self._parse_comparison()
        if not negations:
            return operand
        inner = self._require_logic(operand).compute
        return _Operand("logic", inner if negations % 2 == 0 else lambda columns: 1.0 - inner(columns))

    def _parse_comparison(self) -> _Operand:
        left = self._parse_sum()
        if self._take("!"):  # not in
            self._require("%in%")
            inside = self._parse_membership(left).compute
            return _Operand("logic", lambda columns: 1.0 - inside(columns))
        if self._take("%in%"):
            return self._parse_membership(left)
        operator = self._take(*_COMPARISONS)
        if operator is None:
            return left
        return self._compare(operator, left, self._parse_sum())

    def _parse_membership(self, left: _Operand) -> _Operand:
        end = ")" if self._token == ("name", "c", self._token.column) else "]"
        if end == ")":
            self._next += 1
        self._require("(" if end == ")" else "[")
        options = [self._compare("==", left, self._parse_sum()).compute]
        while self._take(","):
            options.append(self._compare("==", left, self._parse_sum()).compute)
        self._require(end)
        return _Operand(
            "logic", lambda columns: np.nan_to_num(_disjoin([option(columns) for option in options]))
        )

    def _parse_sum(self) -> _Operand:
        return self._calculate(self._parse_product, "+", "-")

    def _parse_product(self) -> _Operand:
        return self._calculate(self._parse_atom, "*", "/")

    def _calculate(self, parse: Callable[[], _Operand], *operators: str) -> _Operand:
        result = parse()
        operator = self._take(*operators)
        while operator is not None:
            result = self._apply(operator, result, parse())
            operator = self._take(*operators)
        return result

    def _apply(self, operator: str, left: _Operand, right: _Operand) -> _Operand:
        first, second = (self._require_number(operand).compute for operand in (left, right))
        function = _ARITHMETIC[operator]
        return _Operand("number", lambda columns: function(first(columns), second(columns)))

    def _parse_atom(self) -> _Operand:
        token = self._token
        if self._take("-"):
            return self._negate(self._parse_atom_within())
        if self._take("("):
            operand = self._parse_or()
            self._require(")")
            return operand
        if token.kind in ("end", "operator"):
            self._refuse_token("a parameter or a value")
        self._next += 1
        if token.kind == "number":
            return _number(float(token.text.removesuffix("L")))
        if token.kind == "text":
            return _Operand("choice", _no_value, token.text, text=repr(token.text))
        if token.text in _CONSTANTS and token.text not in self._variables:
            value = _CONSTANTS[token.text]
            return _Operand("logic", lambda _: np.array(float(value)), value, text=token.text)
        return self._parse_name(token.text)

    def _parse_atom_within(self) -> _Operand:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ConditionError(f"is nested too deeply; at most {_DEEPEST} levels are possible")
        operand = self._parse_atom()
        self._depth -= 1
        return operand

    def _negate(self, operand: _Operand) -> _Operand:
        if isinstance(operand.constant, float):
            return _number(-operand.constant)
        inner = self._require_number(operand).compute
        return _Operand("number", lambda columns: -inner(columns))

    def _parse_name(self, name: str) -> _Operand:
        variable = self._variables.get(name)
        if variable is None:
            raise ConditionError(f"there is no parameter {name!r}{did_you_mean(name, self._variables)}")
        self.names.append(name)
        kind: Literal["number", "choice", "logic"] = "choice" if variable.choices is not None else "number"
        if variable.is_boolean:
            kind = "logic"
        return _Operand(kind, lambda columns: columns[name], variable=variable, text=name)

    def _compare(self, operator: str, left: _Operand, right: _Operand) -> _Operand:
        if left.variable is None and right.variable is not None and left.constant is not None:
            mirrored = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
            return self._compare(mirrored.get(operator, operator), right, left)
        variable = left.variable
        if variable is not None and variable.choices is not None:
            right = _choice_of(left.text, variable, right)
            if operator in _ORDERS and not variable.is_ordered:
                raise ConditionError(f"{left.text} has no order, so {operator} is not possible; use == or in")
        elif variable is not None and variable.is_boolean:
            right = _boolean_of(left.text, right)
        else:
            left, right = self._require_number(left), self._require_number(_number_of(right))
        function = _COMPARISONS[operator]

        def compute(columns: Columns) -> Numbers:
            first, second = left.compute(columns), right.compute(columns)
            unknown = np.isnan(first) | np.isnan(second)
            return np.where(unknown, np.nan, function(first, second))

        return _Operand("logic", compute)

    def _require_logic(self, operand: _Operand) -> _Operand:
        if operand.kind != "logic":
            raise ConditionError(
                f"{operand.text or 'a number'} is neither true nor false; compare it with a value"
            )
        return operand

    def _require_number(self, operand: _Operand) -> _Operand:
        if operand.kind != "number":
            raise ConditionError(f"{operand.text or 'a condition'} is not a number")
        return operand


def _split(text: str) -> list[_Token]:
    """Return the tokens of a condition."""
    if len(text) > _LONGEST:
        raise ConditionError(f"has {len(text)} characters; at most {_LONGEST} are possible")
    text = text.rstrip()
    tokens: list[_Token] = []
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            column = position + len(text[position:]) - len(text[position:].lstrip()) + 1
            raise ConditionError(f"is not a condition: unexpected {text[column - 1]!r} in column {column}")
        kind, value = next((kind, value) for kind, value in match.groupdict().items() if value is not None)
        column = match.start(kind) + 1
        position = match.end()
        if kind in ("double", "single"):
            tokens.append(_Token("text", value, column))
        elif kind == "operator" or (kind == "name" and value in _WORDS):
            tokens.append(_Token("operator", _WORDS.get(value, value), column))
        else:
            tokens.append(_Token("number" if kind == "number" else "name", value, column))
    return [*tokens, _Token("end", "", len(text) + 1)]


def _no_value(_: Columns) -> Numbers:
    raise AssertionError("texts are only compared with choices")


def _number(value: float) -> _Operand:
    if not np.isfinite(value):
        raise ConditionError("a number is too large; at most 1.7e308 is possible")
    return _Operand("number", lambda _: np.array(value), value, text=f"{value:g}")


def _number_of(operand: _Operand) -> _Operand:
    """Return a constant text as a number, if it is one: R's files quote the choices of numbers."""
    if isinstance(operand.constant, str):
        try:
            return _number(float(operand.constant))
        except ValueError:
            return operand
    return operand


def _choice_of(name: str, variable: Variable, operand: _Operand) -> _Operand:
    """Return the index of a constant in the choices of a parameter."""
    value, choices = operand.constant, variable.choices
    assert choices is not None
    if value is None:
        raise ConditionError(f"{name} can only be compared with its choices: {', '.join(choices)}")
    # R compares numbers with texts as texts.
    text = f"{value:.15g}" if isinstance(value, float) else str(value)
    if isinstance(value, bool):
        text = text.upper()
    if text not in choices:
        raise ConditionError(f"{text!r} is not a choice of {name}{suggest_or_list(text, choices)}")
    return _number(float(choices.index(text)))


def _boolean_of(name: str, operand: _Operand) -> _Operand:
    value = operand.constant
    if isinstance(value, str):
        value = _CONSTANTS.get(value)
    if not isinstance(value, bool):
        raise ConditionError(f"{name} can only be compared with true and false")
    return _number(float(value))


def _disjoin(parts: list[Numbers]) -> Numbers:
    """Return 1 where a part is 1, else NaN where one is NaN, else 0."""
    result = parts[0]
    for part in parts[1:]:
        unknown = np.where(np.isnan(result) | np.isnan(part), np.nan, 0.0)
        result = np.where((result == 1.0) | (part == 1.0), 1.0, unknown)
    return result


def _conjoin(parts: list[Numbers]) -> Numbers:
    """Return 0 where a part is 0, else NaN where one is NaN, else 1."""
    return 1.0 - _disjoin([1.0 - part for part in parts])
