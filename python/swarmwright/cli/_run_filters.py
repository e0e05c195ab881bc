"""Filters and order of the runs that `swarmwright runs list` shows."""

import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import click

from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import unknown_key

COLUMNS = (
    *("run", "state", "simulation", "controller", "method", "seed", "generations", "evaluations", "failed"),
    *("best", "held_out", "seconds", "created"),
)
"""Keys by which runs are sorted and filtered; `runs list --json` has them."""
_CONDITION = re.compile(r"\s*([^\s<>=!]+)\s*(!=|<=|>=|=|<|>)(.*)", re.DOTALL)
_ORDERS: Mapping[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True)
class Condition:
    """A condition on a column of the list or a key of the experiment: `method.population>=50`."""

    key: str
    operator: str
    value: str

    def holds(self, values: Mapping[str, Any]) -> bool:
        """Return whether it holds for a run.

        A missing value, such as the best fitness of a run without a generation, satisfies `!=` alone.
        Raises InputError where a number is to be compared with something else.
        """
        found = values.get(self.key)
        if _is_missing(found):
            return self.operator == "!="
        if self.operator in _ORDERS:
            return self._is_in_order(found)
        return self._is_equal(found) == (self.operator == "=")

    def _is_in_order(self, found: Any) -> bool:  # noqa: ANN401 - any value of an experiment
        compare = _ORDERS[self.operator]
        if not _is_number(found):
            return compare(_text(found), self.value)
        wanted = _number(self.value)
        if wanted is None:
            raise InputError(
                f"--filter {self.key}{self.operator}{self.value}: {self.value!r} is not a number"
            )
        return compare(found, wanted)

    def _is_equal(self, found: Any) -> bool:  # noqa: ANN401 - any value of an experiment
        wanted = _number(self.value) if _is_number(found) else None
        if wanted is not None:
            return bool(found == wanted)
        return fnmatchcase(_text(found), self.value)


class ConditionType(click.ParamType[Condition]):
    """KEY=VALUE, or with another comparison."""

    name = "condition"

    def convert(
        self, value: str | Condition, param: click.Parameter | None, ctx: click.Context | None
    ) -> Condition:
        """Parse the condition."""
        if isinstance(value, Condition):
            return value
        found = _CONDITION.fullmatch(value)
        if found is None:
            self.fail(
                f"'{value}' is not a condition: write KEY=VALUE, or !=, <, <=, > or >= in the place of =, in "
                "quotes where it has < or >.",
                param,
                ctx,
            )
        return Condition(found[1], found[2], found[3].strip())


def selected(
    runs: Sequence[Mapping[str, Any]],
    experiments: Sequence[Mapping[str, Any]],
    conditions: Sequence[Condition],
) -> list[Mapping[str, Any]]:
    """Return the runs for which all conditions hold.

    Args:
        runs: the columns of each run.
        experiments: the flat keys of each run's experiment.
        conditions: on columns, else on keys of experiments.

    Raises:
        InputError: no run has a key of a condition, or a number is compared with something else.
    """
    known = {key for one in experiments for key in one}
    for condition in conditions:
        if runs and condition.key not in COLUMNS and condition.key not in known:
            what = unknown_key(condition.key, [*COLUMNS, *sorted(known)])
            raise InputError(f"--filter {condition.key}: {what}")
    return [
        run
        for run, experiment in zip(runs, experiments, strict=True)
        if all(one.holds({**experiment, **run}) for one in conditions)
    ]


def in_order(runs: Sequence[Mapping[str, Any]], column: str, *, reverse: bool) -> list[Mapping[str, Any]]:
    """Return runs sorted by a column; those without a value come first, or last where it is reversed."""

    def place(run: Mapping[str, Any]) -> tuple[bool, Any, str]:
        value = run[column]
        missing = _is_missing(value)
        return (not missing, 0 if missing else value, run["created"])

    return sorted(runs, key=place, reverse=reverse)


def _is_missing(value: Any) -> bool:  # noqa: ANN401 - any value of an experiment
    return value is None or (isinstance(value, float) and math.isnan(value))


def _is_number(value: Any) -> bool:  # noqa: ANN401 - any value of an experiment
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _text(value: Any) -> str:  # noqa: ANN401 - any value of an experiment
    """Return a value as it is written in an experiment."""
    return str(value).lower() if isinstance(value, bool) else str(value)
