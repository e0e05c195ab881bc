"""The list of runs below a folder, kept up to date by looking at their stores."""

import json
import math
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright import InputError, Run, SwarmwrightError
from swarmwright.common.simulation_names import label_of
from swarmwright.runs.annotations import FILE
from swarmwright.runs.store.lock import is_locked

STORE = "run.sqlite"
MOST_RUNS = 20_000
MOST_DEPTH = 8
"""Folders below the one that is shown."""
SPARK_POINTS = 40
LARGEST_WHOLE = 2**53
"""Numbers of browsers hold each whole number up to this."""
RATE_WEIGHT = 0.4
"""Of the newest measurement in the evaluations a second of a run that goes on."""
RETRY_S = 10.0
"""After which a run that could not be read is read again."""
STEP_S = 1.0
"""The least time in which the speed is measured."""
LATE = 2.0
"""A step is late when it takes so many times as long as the ones before."""
MOST_DELTAS = 16
"""Answers that are kept: whoever asks names the version."""
MOST_CHARACTERS = 500
"""Of a text in a row; a run folder that came from elsewhere may have any."""

Signature = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Step:
    """Progress of a run: some evaluations that were recorded together."""

    time: float
    evaluations: int
    """Of the run, so far."""
    done: int
    """Of this step; 0 where that is not known."""
    rate: float | None
    """Evaluations a second, of this step and those before."""


@dataclass(frozen=True)
class Row:
    """What the list says of a run. Its id is the path below the folder."""

    id: str
    state: str
    name: str = ""
    simulation: str = ""
    controller: str = ""
    method: str = ""
    seed: int | None = None
    generations: int = 0
    budget: int | None = None
    """Generations that were asked for; None where another limit ends the run."""
    evaluations: int = 0
    failed: int = 0
    best: float | None = None
    held_out: float | None = None
    held_out_failed: int = 0
    seconds: float = 0.0
    created: str = ""
    rate: float | None = None
    """Evaluations a second, of a run that goes on."""
    left: float | None = None
    """Seconds that are left, where generations end the run."""
    spark: tuple[float | None, ...] = ()
    """The best fitness so far, at points that are evenly spaced over the generations."""
    tags: tuple[str, ...] = ()
    problem: str = ""
    """Why the folder cannot be read."""


class RunIndex:
    """Rows of all runs below a folder; `refresh` reads those whose files have changed.

    Methods may be called from several threads.

    Args:
        folder: that is shown. Links are not followed, hidden folders left out.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.version = 0
        """It grows with every change of a row; at 0, nothing has been read yet."""
        self._start = time.time_ns() // 1000
        """Below all versions, and above those of an earlier window, which browsers still have."""
        self.is_complete = False
        """Whether the last `refresh` looked at all runs."""
        self._lock = threading.Lock()
        self._rows: dict[str, Row] = {}
        self._changed: dict[str, int] = {}
        """The version at which a row, or its absence, came."""
        self._signatures: dict[str, Signature] = {}
        self._read_at: dict[str, float] = {}
        self._steps: dict[str, Step] = {}
        """The last progress of each run that goes on."""
        self._deltas: dict[int, bytes] = {}

    def refresh(self, seconds: float = math.inf) -> bool:
        """Read what has changed; return whether anything has.

        seconds: after which it stops, so that the first rows of many are shown soon, see `is_complete`; the
        next call begins with those that were not read for longest.
        """
        before = self.version
        end = time.monotonic() + seconds
        present = dict(self._stores())
        for name in self._rows.keys() - present.keys():
            self._update(name, None)
        for name in sorted(present, key=lambda name: self._read_at.get(name, 0.0)):
            signature = present[name]
            row = self._rows.get(name)
            if row is None or signature != self._signatures.get(name) or self._is_due(row):
                self._signatures[name] = signature
                self._read_at[name] = time.monotonic()
                self._update(name, self._read(name))
                if time.monotonic() > end:
                    self.is_complete = False
                    return True
            elif row.state == "running":
                self._update(name, self._with_rate(row))
        self.is_complete = True
        if self.version == 0:  # there is none, which is news, too
            self.version = self._start
        return self.version > before

    def path(self, name: str) -> Path:
        """Return the folder of a run of the list. Raises InputError for anything else."""
        return self.folder / self.row(name).id

    def row(self, name: str) -> Row:
        """Return the row of a run. Raises InputError when there is none."""
        row = self._rows.get(name)
        if row is None:
            raise InputError(f"{name[:200]}: there is no such run below {self.folder}")
        return row

    def content(self, name: str) -> object:
        """Return what differs after each change of a run's files. Raises InputError when there is none."""
        return self.row(name), self._signatures.get(name)

    def delta(self, version: int) -> tuple[int, bytes]:
        """Return the present version, and as JSON what has changed since another: rows, ids that are gone.

        It is built once for all who ask for the same.
        """
        with self._lock:
            if not self._start <= version <= self.version:
                version = 0  # of an earlier window
            message_bytes = self._deltas.get(version)
            if message_bytes is None:
                names = [name for name, changed in self._changed.items() if changed > version]
                message = {
                    "version": self.version,
                    "whole": version == 0,
                    "rows": [asdict(self._rows[name]) for name in names if name in self._rows],
                    "gone": [name for name in names if name not in self._rows],
                }
                message_bytes = self._deltas[version] = json.dumps(message, allow_nan=False).encode()
                if len(self._deltas) > MOST_DELTAS:
                    del self._deltas[next(iter(self._deltas))]
            return self.version, message_bytes

    def _update(self, name: str, row: Row | None) -> None:
        with self._lock:
            if row == self._rows.get(name):
                return
            if row is None:
                del self._rows[name]
                self._signatures.pop(name, None)
                self._read_at.pop(name, None)
                self._steps.pop(name, None)
            else:
                self._rows[name] = row
            self.version = max(self.version, self._start) + 1
            self._changed[name] = self.version
            self._deltas.clear()

    def _stores(self) -> Iterator[tuple[str, Signature]]:
        count = 0
        for path, folders, files in os.walk(self.folder):
            below = os.path.relpath(path, self.folder)
            depth = 0 if below == "." else below.count(os.sep) + 1
            folders[:] = sorted(name for name in folders if not name.startswith(".")) * (depth < MOST_DEPTH)
            if STORE not in files or count >= MOST_RUNS:
                continue
            folders.clear()  # runs are not within runs
            count += 1
            yield below, signature_of(Path(path))

    def _is_due(self, row: Row) -> bool:
        """Return whether to read a run whose files are as they were.

        A killed run does not write that it has ended, and what could not be read may be readable later.
        """
        if row.state == "unreadable":
            return time.monotonic() - self._read_at[row.id] > RETRY_S
        return row.state == "running" and not is_locked(self.folder / row.id)

    def _read(self, name: str) -> Row:
        try:
            row = self._with_rate(summarize(Run(self.folder / name), name))
            json.dumps(asdict(row), allow_nan=False)
        except (SwarmwrightError, OSError) as error:
            return Row(name, "unreadable", problem=str(error)[:MOST_CHARACTERS])
        except Exception as error:  # noqa: BLE001 - a store that came from elsewhere may hold anything
            problem = f"{STORE}: has an impossible value: {error!r}"
            return Row(name, "unreadable", problem=problem[:MOST_CHARACTERS])
        return row

    def _with_rate(self, row: Row) -> Row:
        """Add evaluations a second and the time that is left to a run that goes on.

        Evaluations are recorded in steps, such as generations, so the speed is that of the last ones; when
        the next one is late, it can be no more than if it came now.
        """
        if row.state != "running":
            self._steps.pop(row.id, None)
            return row
        now = time.monotonic()
        last = self._steps.get(row.id)
        if last is None:
            rate = row.evaluations / row.seconds if row.seconds > 0 else None
            self._steps[row.id] = Step(now, row.evaluations, 0, rate)
        elif row.evaluations != last.evaluations and now - last.time >= STEP_S:
            done = row.evaluations - last.evaluations
            newest = done / (now - last.time)
            rate = newest if last.rate is None else RATE_WEIGHT * newest + (1 - RATE_WEIGHT) * last.rate
            self._steps[row.id] = Step(now, row.evaluations, done, rate)
        else:
            rate = last.rate
            if rate and last.done and last.done < rate * (now - last.time) / LATE:
                # One digit: the row shall not change all the time.
                rate = float(f"{last.done / (now - last.time):.1g}")
        left = None
        if rate and row.budget is not None and row.generations:
            left = (row.budget - row.generations) * (row.evaluations / row.generations) / rate
        return replace(row, rate=significant(rate), left=significant(left))


def signature_of(folder: Path) -> Signature:
    """Return what changes with the store: times and sizes of its files."""
    signature = []
    for name in (STORE, f"{STORE}-wal", FILE):
        try:
            state = (folder / name).lstat()
        except OSError:
            continue
        signature.append((state.st_mtime_ns, state.st_size))
    return tuple(signature)


def summarize(run: Run, name: str) -> Row:
    """Return the row of a run without its rate."""
    experiment, unseen, history = run.experiment, run.unseen, run.history
    picked = history
    if len(history) > SPARK_POINTS:
        picked = [history[round(position)] for position in np.linspace(0, len(history) - 1, SPARK_POINTS)]
    try:
        tags = run.tags
    except InputError:  # list the run without tags
        tags = ()
    return Row(
        id=name,
        state=run.state,
        name=run.name[:MOST_CHARACTERS],
        simulation=experiment.label[:MOST_CHARACTERS],
        controller=experiment.controller.kind,
        method=label_of(experiment.method.kind),
        seed=experiment.seed,
        generations=run.generations,
        budget=experiment.budget.generations,
        evaluations=run.evaluations,
        failed=run.failed_evaluations,
        best=finite(history[-1].best_so_far) if history else None,
        held_out=None if unseen is None else finite(unseen.fitness.mean),
        held_out_failed=0 if unseen is None else unseen.failed,
        seconds=finite(run.seconds) or 0.0,
        created=run.created[:MOST_CHARACTERS],
        spark=tuple(finite(summary.best_so_far) for summary in picked),
        tags=tags,
    )


def finite(value: float | None) -> float | None:
    """Return a number that JSON has; None for others."""
    return None if value is None or not math.isfinite(value) else float(value)


def significant(value: float | None) -> float | None:
    """Return a number with three significant digits, so that a row changes when its text does."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.3g}")


def as_values(value: Any) -> Any:  # noqa: ANN401 - JSON
    """Return a value that JSON and browsers have: NumPy's as Python's, NaN and infinity as None.

    Other objects, and whole numbers that browsers would round, become text.
    """
    if isinstance(value, dict):
        return {str(key): as_values(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [as_values(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return as_values(value.tolist())
    if isinstance(value, np.generic):
        return as_values(value.item())
    if isinstance(value, float):
        return finite(value)
    if isinstance(value, int) and abs(value) > LARGEST_WHOLE:
        return str(value)
    return value if value is None or isinstance(value, bool | int | str) else str(value)
