"""Episodes for the player that is open in the window, and what changes with other parameters."""

import dataclasses
import json
import logging
import os
import queue
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from swarmwright import Experiment, InputError, Run, SwarmwrightError, post_evaluate
from swarmwright.common.time_limit import TimeLimit
from swarmwright.experiment.adjustable import list_adjustable
from swarmwright.runs.code import resolve_experiment
from swarmwright.ui.index import as_values

EPISODES, MOST_EPISODES = 10, 1000
"""Of a mean with other parameters."""
LONGEST_S = 60.0
"""After which such a mean is given up: someone waits for it."""
LONGEST_REPLAY_S = 300.0
"""After which an episode is given up."""
LONGEST_SEARCH_S = 10.0
"""For a broker, and then for a server there, that computes such a mean."""
MOST_BODIES = 3_000_000
"""Bodies in all scenes of an episode with other parameters: 300 s with 500 robots have 1.5 million."""
MOST_BODIES_OF_RUN = 30_000_000
"""The same with the parameters of the run."""
MOST_PARAMETERS = 100
KEPT_CALLERS = 200
T = TypeVar("T")

computing = threading.BoundedSemaphore(max(2, len(os.sched_getaffinity(0))))
"""Held while an episode is computed: there are more threads than processors."""
exporting = threading.Lock()
"""Held while a file is made, which may take minutes: replays do not wait for it."""


def limit_replay() -> TimeLimit:
    """Return the limit of the time that an episode may take."""
    message = (
        f"this takes more than {LONGEST_REPLAY_S:.0f} s, which is too long here; write the episode with "
        "`swarmwright replay RUN --save FILE`"
    )
    return TimeLimit(LONGEST_REPLAY_S, message)


def iterate_in_thread(iterate: Callable[[], Iterator[T]], limit: TimeLimit) -> Iterator[T]:
    """Yield what an iterator yields that must stay in one thread, such as one over an episode.

    Its thread does not wait for the reader, and ends at the next step when the reader gives up.

    Args:
        iterate: returns the iterator; both work in a thread of their own, with `computing`.
        limit: of its time.

    Raises InputError with the message of an error.
    """
    results: queue.SimpleQueue[tuple[T | None, str | None]] = queue.SimpleQueue()

    def work() -> None:
        message = None
        try:
            with computing, limit:
                limit.check()
                for result in iterate():
                    results.put((result, None))
        except SwarmwrightError as error:
            message = str(error)
        except Exception:
            logging.getLogger("swarmwright").exception("an episode failed")
            message = "the episode failed; what the window prints in its terminal says why"
        results.put((None, message))

    threading.Thread(target=work, name="episode", daemon=True).start()
    try:
        while True:
            result, message = results.get()
            if message is not None:
                raise InputError(message)
            if result is None:
                return
            yield result
    finally:
        limit.cancel()


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
        as_values({**vars(adjustable), "choices": list(adjustable.choices)})
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


def shorten_waits(experiment: Experiment) -> Experiment:
    """Return an experiment that waits for a broker and its servers at most `LONGEST_SEARCH_S` each."""
    waits = {
        name: min(getattr(experiment.timeouts, name), LONGEST_SEARCH_S) for name in ("connect", "discovery")
    }
    return dataclasses.replace(experiment, timeouts=experiment.timeouts.model_copy(update=waits))


def mean_of(
    run: Run,
    parameters: Mapping[str, Any],
    *,
    generation: int | None,
    candidate: int | None,
    episodes: int,
    broker: str | None,
    check: Callable[[], None],
) -> dict[str, Any]:
    """Return the mean fitness and the mean metrics of a candidate on held-out seeds.

    Args:
        run: of the candidate.
        parameters: that differ from those of the run.
        generation: as in `post_evaluate`.
        candidate: likewise.
        episodes: from 1 to 1000.
        broker: whose servers evaluate; None: this process does.
        check: called between episodes; it may raise.

    Raises the errors of `post_evaluate`, and InputError when it takes too long.
    """
    if not 1 <= episodes <= MOST_EPISODES:
        raise InputError(f"episodes: must be from 1 to {MOST_EPISODES}, not {episodes}")
    limit = TimeLimit(
        LONGEST_S, f"these episodes take more than {LONGEST_S:.0f} s; choose fewer or shorter ones"
    )

    def go_on(*_: object) -> None:
        check()
        limit.check()

    experiment = None
    if broker is not None:
        experiment = shorten_waits(resolve_experiment(run, run.evaluation(candidate, generation).generation))
    with limit:
        evaluation = post_evaluate(
            run,
            candidate,
            generation,
            episodes=max(episodes, run.experiment.ranking.episodes),
            experiment=experiment,
            parameters=parameters,
            broker=broker,
            servers="in-process" if broker is None else "auto",
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
