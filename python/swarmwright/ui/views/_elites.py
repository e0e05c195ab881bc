"""Elites at some generations of a run, which the tabs of fronts and archives share."""

import logging
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

from swarmwright import InputError, Run, SwarmwrightError
from swarmwright.analysis.indicators import Indicator, build_indicator
from swarmwright.results import Elite, Elites
from swarmwright.runs.elites import EliteCollector, options_of_elites
from swarmwright.ui.index import as_values, finite
from swarmwright.ui.views._base import Values

T = TypeVar("T")

MOST_GENERATIONS = 41
"""Upper limit of generations whose elites are stored."""
LONGEST_WAIT_S = 0.8
"""Time after which a request answers how much is read."""
MOST_RUNS = 8
"""Upper limit of runs whose elites are stored."""
MOST_POINTS = 20_000
"""Upper limit of elites in an answer, the best by fitness."""

reading = threading.BoundedSemaphore(2)
"""Held while a run is read."""


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
        if elites.coverage is not None:
            indicators["coverage"] = elites.coverage
        return cls(generation, elites, indicators)


class Reading:
    """The states of a run: all evaluations of long runs take seconds to read, which a thread does once."""

    def __init__(self) -> None:
        self.share = 0.0
        """Share of the generations that are read, 0 to 1."""
        self.is_current = True
        """Whether its thread continues: the run is among those that were opened last."""
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._error: SwarmwrightError | None = None
        self._forget()

    def _forget(self) -> None:
        self._collector: EliteCollector | None = None
        self._read = 0
        self._steps: dict[int, Elites] = {}
        self._states: list[State] = []
        self._elites: dict[tuple[int, int], Elite] = {}

    def read(self, run: Run, seconds: float | None = None) -> list[State] | None:
        """Return the states, or None if they are not ready after some seconds.

        Raises what stopped it; the next call begins anew.
        """
        with self._lock:
            if self._thread is None and self._read < run.generations:
                self._thread = threading.Thread(target=self._compute, args=(run,), daemon=True)
                self._thread.start()
            thread = self._thread
        if thread is not None:
            thread.join(seconds)
            if thread.is_alive():
                return None
        with self._lock:
            if self._thread is thread:
                self._thread = None
            error, self._error = self._error, None
            if error is not None:
                raise error
            if not self._states:
                raise InputError(f"{run.path}: its evaluations could not be read; try again")
            return self._states

    def find(self, run: Run, generation: int) -> State:
        """Return the last state up to a generation, or the first one; raises as `read`."""
        with self._lock:
            states = self._states
        states = states or self.read(run) or []
        return next((state for state in reversed(states) if state.generation <= generation), states[0])

    def _compute(self, run: Run) -> None:
        try:
            with reading:
                self._go_on(run)
        except SwarmwrightError as error:
            self._forget()
            self._error = error
        except Exception as error:
            logging.getLogger("swarmwright").exception("%s: its elites cannot be read", run.path)
            self._forget()
            self._error = InputError(f"{run.path}: its elites cannot be read: {error}")

    def _go_on(self, run: Run) -> None:
        last = run.generations - 1
        stride = 1
        while last // stride >= MOST_GENERATIONS - 1:
            stride *= 2
        chosen = frozenset((*range(0, run.generations, stride), last))
        if self._collector is None:
            self._collector = EliteCollector(run)
        for generation, elites in self._collector.follow(run, chosen):
            self._steps[generation] = self._share_equals(elites)
            self.share = (generation + 1) / run.generations
            if not self.is_current:
                raise InputError(f"{run.path}: other runs were opened meanwhile; try again")
        self._steps = {
            generation: elites for generation, elites in self._steps.items() if generation in chosen
        }
        indicator = build_indicator(self._steps[last])
        present = (elite for elites in self._steps.values() for elite in elites.candidates)
        self._elites = {(elite.generation, elite.candidate): elite for elite in present}
        self._states = [State.of(generation, elites, indicator) for generation, elites in self._steps.items()]
        self._read = run.generations

    def _share_equals(self, elites: Elites) -> Elites:
        """Return elites as the objects of earlier states: most stay from one to the next.

        Those that were evaluated again since have other means.
        """
        candidates = []
        for elite in elites.candidates:
            key = elite.generation, elite.candidate
            if self._elites.get(key) != elite:
                self._elites[key] = elite
            candidates.append(self._elites[key])
        return replace(elites, candidates=candidates)


class EliteHistory:
    """States of the elites of the runs that were looked at last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._readings: OrderedDict[tuple[str, str], Reading] = OrderedDict()

    def reading(self, run: Run) -> Reading:
        """Return the states of a run, computed or being computed."""
        key = str(run.path), run.created
        with self._lock:
            states = self._readings.setdefault(key, Reading())
            self._readings.move_to_end(key)
            if len(self._readings) > MOST_RUNS:
                self._readings.popitem(last=False)[1].is_current = False
            return states


HISTORY = EliteHistory()


def check_method(run: Run, options: type[T], method: str) -> T:
    """Return the options of a run's method. Raises InputError for another method, or without generations."""
    present = options_of_elites(run)
    if not isinstance(present, options):
        raise InputError(
            f"{run.path}: is a run of {run.experiment.method.kind}; this is for runs of {method}"
        )
    if not run.generations:
        raise InputError(f"{run.path}: has no finished generation")
    return present


def describe_states(run: Run) -> dict[str, Any]:
    """Return the generations and the indicators of their elites; how much is read while that goes on."""
    history = HISTORY.reading(run)
    states = history.read(run, LONGEST_WAIT_S)
    if states is None:
        return {"share": history.share}
    last = states[-1].elites
    return {
        "generations": [state.generation for state in states],
        "counts": [len(state.elites.candidates) for state in states],
        "indicators": {name: [state.indicators[name] for state in states] for name in states[-1].indicators},
        "goals": last.goals,
        "notes": last.notes,
    }


def describe_elites(run: Run, generation: int) -> Values:
    """Return the elites after the last known generation up to this one: a column for each value."""
    state = HISTORY.reading(run).find(run, generation)
    candidates = state.elites.candidates[:MOST_POINTS]
    names = list(state.elites.goals)
    evaluations = [candidate.evaluations for candidate in candidates]
    return {
        "generation": state.generation,
        "count": len(state.elites.candidates),
        "born": [candidate.generation for candidate in candidates],
        "candidate": [candidate.candidate for candidate in candidates],
        "columns": {
            "fitness": [candidate.fitness for candidate in candidates],
            **{name: as_values([candidate.metrics[name] for candidate in candidates]) for name in names},
            **({"evaluations": evaluations} if max(evaluations, default=1) > 1 else {}),
        },
    }
