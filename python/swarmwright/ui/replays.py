"""Episodes for the player that is open in the window, and what changes with other parameters."""

import json
import os
import threading
import time
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

from swarmwright import InputError, Run, post_evaluate
from swarmwright.experiment.adjustable import list_adjustable
from swarmwright.runs.code import resolve_experiment
from swarmwright.simulations import catalogue
from swarmwright.ui.index import as_values

EPISODES, MOST_EPISODES = 10, 1000
"""Of a mean with other parameters."""
LONGEST_S = 60.0
"""After which such a mean is given up: someone waits for it."""
MOST_BODIES = 3_000_000
"""Bodies in all scenes of an episode with other parameters: 300 s with 500 robots have 1.5 million."""
MOST_PARAMETERS = 100
KEPT_CALLERS = 200

computing = threading.BoundedSemaphore(max(2, len(os.sched_getaffinity(0))))
"""Held while an episode is computed: there are more threads than processors."""
exporting = threading.Lock()
"""Held while a file is made, which may take minutes: replays do not wait for it."""


class Newest:
    """The newest question of each page: what it asked before is not worth computing any more."""

    def __init__(self) -> None:
        self._numbers: OrderedDict[str, int] = OrderedDict()
        self._lock = threading.Lock()

    def ask(self, caller: str, number: int) -> None:
        """Note the number of a question. caller: any text that a page has chosen for itself."""
        with self._lock:
            self._numbers[caller] = max(number, self._numbers.get(caller, number))
            self._numbers.move_to_end(caller)
            while len(self._numbers) > KEPT_CALLERS:
                self._numbers.popitem(last=False)

    def check(self, caller: str, number: int) -> None:
        """Raise InputError when the page has asked again since."""
        with self._lock:
            if self._numbers.get(caller, number) > number:
                raise InputError("a newer question has replaced this one")


def describe_parameters(run: Run) -> list[dict[str, Any]]:
    """Return what can be changed about the simulation of a run.

    Raises InputError when its code is not trusted or missing.
    """
    experiment = resolve_experiment(run, run.best.generation if run.history else None)
    return [
        {**vars(adjustable), "value": as_values(adjustable.value), "choices": list(adjustable.choices)}
        for adjustable in list_adjustable(experiment)
    ]


def read_parameters(text: str) -> dict[str, Any]:
    """Return parameters of a request, an object of JSON. Raises InputError for anything else."""
    try:
        values = json.loads(text or "{}")
    except (ValueError, RecursionError):
        raise InputError("parameters: must be an object of JSON") from None
    return check_parameters(values)


def check_parameters(values: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
    """Return parameters of a request if they are names and values. Raises InputError for anything else."""
    if not isinstance(values, dict):
        raise InputError("parameters: must be an object of JSON")
    if len(values) > MOST_PARAMETERS:
        raise InputError(f"parameters: at most {MOST_PARAMETERS} can be changed, not {len(values)}")
    return values


def mean_of(
    run: Run,
    parameters: Mapping[str, Any],
    *,
    generation: int | None,
    candidate: int | None,
    episodes: int,
    check: Any,  # noqa: ANN401 - any function
) -> dict[str, Any]:
    """Return the mean fitness and the mean metrics of a candidate on held-out seeds.

    check: called between episodes; it may raise. Raises the errors of `post_evaluate`, and InputError when it
    takes too long.
    """
    if not 1 <= episodes <= MOST_EPISODES:
        raise InputError(f"episodes: must be from 1 to {MOST_EPISODES}, not {episodes}")
    end = time.monotonic() + LONGEST_S

    def go_on(*_: object) -> None:
        check()
        if time.monotonic() > end:
            raise InputError(f"these episodes take more than {LONGEST_S:.0f} s; choose fewer or shorter ones")

    evaluation = post_evaluate(
        run,
        candidate,
        generation,
        episodes=max(episodes, run.experiment.ranking.episodes),
        parameters=parameters,
        servers="in-process" if catalogue.is_local(run.experiment.simulation) else None,
        on_progress=go_on,
        metrics="all",
    )
    values = evaluation.to_mapping()
    return {
        "fitness": as_values({key: values[key] for key in ("mean", "low", "high", "failed")}),
        "metrics": {
            name: as_values({key: metric[key] for key in ("mean", "low", "high")})
            for name, metric in values["metrics"].items()
        },
        "seeds": [str(seed) for seed in evaluation.seeds],
        "label": evaluation.label,
    }
