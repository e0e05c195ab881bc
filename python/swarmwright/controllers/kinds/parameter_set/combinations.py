"""Which parameters of a set are active, and which combinations of their values are forbidden."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.problems import FieldError
from swarmwright.controllers.kinds.parameter_set.conditions import (
    Condition,
    ConditionError,
    Numbers,
    Variable,
)


class Combinations:
    """The conditions of a parameter set, checked.

    Args:
        variables: all parameters, by name.
        when: the condition of each conditional parameter.
        forbidden: conditions of forbidden combinations.

    Raises:
        FieldError: a condition is not valid, or conditions depend on each other in a circle.
    """

    def __init__(
        self, variables: Mapping[str, Variable], when: Mapping[str, str], forbidden: Sequence[str]
    ) -> None:
        conditions = {
            name: _parse(text, variables, ("parameters", name, "when")) for name, text in when.items()
        }
        self._when = {name: conditions[name] for name in _sort(conditions)}
        self._forbidden = [
            _parse(text, variables, ("forbidden", index)) for index, text in enumerate(forbidden)
        ]
        self.involved: NDArray[np.bool_] = np.array(
            [[name in condition.names for name in variables] for condition in self._forbidden], dtype=bool
        ).reshape(len(self._forbidden), len(variables))
        """Which parameters occur in which forbidden combinations, (forbidden, parameters)."""

    def deactivate(self, columns: dict[str, Numbers]) -> None:
        """Replace the values of inactive parameters by NaN.

        columns: the values of each parameter, (n,) each.
        """
        for name, condition in self._when.items():
            columns[name] = np.where(condition.holds(columns), columns[name], np.nan)

    def find_forbidden(self, columns: Mapping[str, Numbers], count: int) -> NDArray[np.bool_]:
        """Return which candidates have which forbidden combinations, (n, forbidden).

        Args:
            columns: the values of each parameter, (n,) each, NaN where it is inactive.
            count: number of candidates, n.
        """
        result = np.zeros((count, len(self._forbidden)), dtype=bool)
        for index, condition in enumerate(self._forbidden):
            result[:, index] = condition.holds(columns)
        return result


def _parse(text: str, variables: Mapping[str, Variable], path: tuple[str | int, ...]) -> Condition:
    try:
        return Condition(text, variables)
    except ConditionError as error:
        raise FieldError(path, str(error)) from None


def _sort(conditions: Mapping[str, Condition]) -> list[str]:
    """Return conditional parameters after those in their conditions. Raises FieldError for circles."""
    done: list[str] = []
    finished: set[str] = set()
    for first in conditions:
        # An own stack, since chains can be longer than Python's.
        stack = [(first, iter(conditions[first].names))] if first not in finished else []
        path = [first]
        while stack:
            name, needed = stack[-1]
            other = next((other for other in needed if other in conditions and other not in finished), None)
            if other is None:
                stack.pop()
                path.pop()
                finished.add(name)
                done.append(name)
            elif other in path:
                circle = " -> ".join([*path[path.index(other) :], other])
                raise FieldError(
                    ("parameters", name, "when"), f"conditions depend on each other in a circle: {circle}"
                )
            else:
                stack.append((other, iter(conditions[other].names)))
                path.append(other)
    return done
