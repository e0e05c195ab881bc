"""Elites at some generations of a run, which the tabs of fronts and archives share."""

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any, Self, TypeVar

import numpy as np

from swarmwright import InputError, Run, SwarmwrightError
from swarmwright.analysis.indicators import Indicator, build_indicator
from swarmwright.results import Elites
from swarmwright.runs.elites import compute_elites_over_generations
from swarmwright.ui.index import as_values, finite
from swarmwright.ui.views._base import Values

T = TypeVar("T")

MOST_GENERATIONS = 41
LONGEST_WAIT_S = 0.8
"""After which a request says how much is read."""
MOST_RUNS = 8
"""Runs whose elites are kept."""
MOST_POINTS = 20_000
"""Elites that are sent, the best by fitness."""


@dataclass(frozen=True)
class State:
    """The elites after a generation."""

    generation: int
    elites: Elites
    indicators: dict[str, float | None]
    """Hypervolume of a front; QD score and coverage of an archive."""

    @classmethod
    def of(cls, generation: int, elites: Elites, indicator: Indicator) -> Self:
        """Return a state with its indicators, without those that would take long."""
        indicators = {indicator.words: finite(indicator.value(elites)) if indicator.has_curve else None}
        if elites.grid is not None:
            indicators["coverage"] = elites.coverage
        return cls(generation, elites, indicators)


class Reading:
    """The states of a run while a thread computes them: all evaluations of long runs take seconds to read."""

    def __init__(self, run: Run) -> None:
        self.share = 0.0
        """Of the generations that are read, 0 to 1."""
        self._states: list[State] = []
        self._error: SwarmwrightError | None = None
        self._thread = threading.Thread(target=self._compute, args=(run,), daemon=True)
        self._thread.start()

    def wait(self, seconds: float | None = None) -> list[State] | None:
        """Return the states, or None if they are not ready after some seconds. Raises what stopped it."""
        self._thread.join(seconds)
        if self._thread.is_alive():
            return None
        if self._error is not None:
            raise self._error
        return self._states

    def _compute(self, run: Run) -> None:
        try:
            spaced = np.linspace(0, run.generations - 1, min(run.generations, MOST_GENERATIONS))
            chosen = frozenset(np.unique(spaced.round().astype(int)).tolist())
            steps = []
            for generation, elites in compute_elites_over_generations(run, chosen):
                steps.append((generation, elites))
                self.share = (generation + 1) / run.generations
            indicator = build_indicator(steps[-1][1])
            self._states = [State.of(generation, elites, indicator) for generation, elites in steps]
        except SwarmwrightError as error:
            self._error = error


class EliteHistory:
    """States of the elites of the runs that were looked at last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: OrderedDict[Run, Reading] = OrderedDict()

    def reading(self, run: Run) -> Reading:
        """Return the states of a run, computed or being computed."""
        with self._lock:
            if run not in self._kept:
                self._kept[run] = Reading(run)
                if len(self._kept) > MOST_RUNS:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(run)
            return self._kept[run]


HISTORY = EliteHistory()


def check_method(run: Run, options: type[T], method: str) -> T:
    """Return the options of a run's method. Raises InputError for another method, or without generations."""
    present = run.experiment.method
    if not isinstance(present, options):
        raise InputError(f"{run.path}: is a run of {present.kind}; this is for runs of {method}")
    if not run.generations:
        raise InputError(f"{run.path}: has no finished generation")
    return present


def describe_states(run: Run) -> dict[str, Any]:
    """Return the generations and the indicators of their elites; how much is read while that goes on."""
    reading = HISTORY.reading(run)
    states = reading.wait(LONGEST_WAIT_S)
    if states is None:
        return {"share": reading.share}
    last = states[-1].elites
    return {
        "generations": [state.generation for state in states],
        "counts": [len(state.elites.candidates) for state in states],
        "indicators": {name: [state.indicators[name] for state in states] for name in states[-1].indicators},
        "goals": last.goals,
        "notes": last.notes,
        "evaluated": last.evaluated,
    }


def describe_elites(run: Run, generation: int) -> Values:
    """Return the elites after the last known generation up to this one: a column for each value."""
    states = HISTORY.reading(run).wait() or []
    state = next((state for state in reversed(states) if state.generation <= generation), states[0])
    candidates = state.elites.candidates[:MOST_POINTS]
    names = list(state.elites.goals)
    return {
        "generation": state.generation,
        "count": len(state.elites.candidates),
        "born": [candidate.generation for candidate in candidates],
        "candidate": [candidate.candidate for candidate in candidates],
        "columns": {
            "fitness": [candidate.fitness for candidate in candidates],
            **{name: as_values([candidate.metrics[name] for candidate in candidates]) for name in names},
        },
    }
