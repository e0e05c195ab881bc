"""Checks what the code of a BatchSimulation returns, for many episodes at once."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from swarmwright.simulations.calls import OBSERVATIONS_ALONE, is_of_gymnasium, short

Many = tuple[NDArray[np.bool_], NDArray[np.float32], NDArray[np.bool_]]
"""Who acts next, (episodes, agents); (episodes, agents, sensors); which episodes have ended, (episodes,)."""
Call = Callable[..., Any]


class BatchChecks:
    """Episodes that are stepped together.

    Args:
        sensors: of an agent.
        episodes: how many.
        most: agents of an episode, None for no limit.
        fail: raises SimulationError with a reason, "method: why".
    """

    def __init__(
        self, sensors: int, episodes: int, most: int | None, fail: Callable[[str], NoReturn]
    ) -> None:
        self._sensors, self._episodes, self._most, self._fail = sensors, episodes, most, fail
        self._agents: int | None = None
        self._over = np.zeros(episodes, bool)

    def seen(self, method: str, returned: Any, call: Call) -> Many:  # noqa: ANN401 - whatever it returns
        """Check observations; ask which episodes have ended, and who acts."""
        rows = self._rows(method, returned)
        self._over = self._over | self._flags("done", call("done"), (self._episodes,))
        acting = call("acting")
        shape = rows.shape[:2]
        acts = np.ones(shape, bool) if acting is None else self._flags("acting", acting, shape)
        acts = acts & ~self._over[:, None]
        finite = np.isfinite(rows)
        if not finite.all():
            wrong = np.argwhere(~finite & acts[:, :, None])
            if len(wrong):
                episode, agent, sensor = wrong[0]
                self._fail(
                    f"{method}: sensor {sensor} of agent {agent} in episode {episode} is "
                    f"{rows[episode, agent, sensor]}, expected a finite number (binary32)"
                )
        return acts, rows, self._over

    def results(self, metrics: Sequence[str], call: Call) -> NDArray[np.float64]:
        """Ask for fitness and metrics, (1 + metrics, episodes)."""
        found = np.empty((1 + len(metrics), self._episodes))
        found[0] = self._numbers("fitness", call("fitness"))
        if metrics:
            measured = call("measure")
            if not isinstance(measured, Mapping) or not set(metrics) <= set(measured):
                self._fail(f"measure: expected a mapping with {', '.join(metrics)}")
            for index, name in enumerate(metrics, 1):
                found[index] = self._numbers(f"measure: {name!r}", measured[name])
        return found

    def _rows(self, method: str, returned: Any) -> NDArray[np.float32]:  # noqa: ANN401
        agents = "agents" if self._agents is None else self._agents
        expected = f"({self._episodes}, {agents}, {self._sensors})"
        if is_of_gymnasium(returned):
            self._fail(f"{method}: {short(returned)} returned, {OBSERVATIONS_ALONE}")
        given = _array(returned)
        fits = given.ndim == 3 and (given.shape[0], given.shape[2]) == (self._episodes, self._sensors)
        if given.dtype.kind not in "biuf" or not fits or given.shape[1] != (self._agents or given.shape[1]):
            self._fail(f"{method}: observations of the shape {given.shape} returned, expected {expected}")
        if self._agents is None:
            self._agents = given.shape[1]
            if not self._agents or (self._most is not None and self._agents > self._most):
                limit = (
                    "" if self._most is None else f" and at most {self._most}, the simulation's max_agents"
                )
                self._fail(f"{method}: {self._agents} agents returned, expected at least 1{limit}")
        with np.errstate(over="ignore"):
            return np.ascontiguousarray(given, dtype=np.float32)

    def _flags(self, method: str, returned: Any, shape: tuple[int, ...]) -> NDArray[np.bool_]:  # noqa: ANN401
        flags = _array(returned)
        if flags.dtype != np.bool_ or flags.shape != shape:
            self._fail(
                f"{method}: {flags.dtype} of the shape {flags.shape} returned, expected {shape} booleans"
            )
        return flags

    def _numbers(self, what: str, returned: Any) -> NDArray[np.float64]:  # noqa: ANN401
        numbers = _array(returned)
        if numbers.dtype.kind not in "biuf" or numbers.shape != (self._episodes,):
            self._fail(f"{what}: the shape {numbers.shape} returned, expected ({self._episodes},) numbers")
        return numbers.astype(np.float64)


def _array(returned: Any) -> NDArray[Any]:  # noqa: ANN401 - whatever the code returns
    try:
        return np.asarray(returned)
    except (TypeError, ValueError):  # ragged
        return np.empty(0, object)
