"""The tab of a competition's progress: champions of all generations against each other."""

import hashlib
import json
import logging
import os
import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from starlette.requests import Request

import swarmwright
from swarmwright import InputError, Run, SwarmwrightError
from swarmwright.analysis.competition import CompetitionProgress, SideProgress, color_sides, measure_progress
from swarmwright.common.files import make_private_folder, read_bytes, state_folder, write_whole
from swarmwright.common.time_limit import TimeLimit
from swarmwright.common.untrusted import escape_line
from swarmwright.methods.rankings.tournament import TournamentOptions
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.matches import sides_of
from swarmwright.ui.index import as_values
from swarmwright.ui.replays import shorten_waits
from swarmwright.ui.requests import read_field, read_whole
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window

T = TypeVar("T")

CHAMPIONS, MOST_CHAMPIONS = 20, 40
EPISODES, MOST_EPISODES = 10, 30
LONGEST_S = 1800.0
"""After which the matches are given up."""
LONGEST_NAME = 100
"""Characters of the name of a side."""
LARGEST_BYTES = 4 << 20
"""Of a file with results."""
MOST_WAITING = 20
"""Runs whose matches wait for those of another one."""
MOST_KEPT = 100
"""Runs whose results are kept."""
PAUSE_S = 0.1
"""Between two looks at whether matches that wait for others are still wanted."""

playing = threading.Lock()
"""Held while matches are played: those of one run at a time."""


@dataclass
class Playing:
    """Matches that are being played."""

    limit: TimeLimit = field(
        default_factory=lambda: TimeLimit(
            LONGEST_S,
            f"the matches take more than {LONGEST_S / 60:.0f} minutes, which is too long here; use "
            "`swarmwright progress RUN`",
        )
    )
    done: int = 0
    """Finished episodes."""
    whole: int = 0
    waiting_for: str = ""
    is_stopped: bool = False

    def follow(self, done: int, whole: int, waiting_for: str) -> None:
        """Note how far it is. Raises InputError when it shall end."""
        self.done, self.whole, self.waiting_for = done, whole, waiting_for
        self.limit.check()

    def stop(self) -> None:
        """End at the next step."""
        self.is_stopped = True
        self.limit.cancel()


class Tournaments:
    """Champions of runs against each other, each computed in a thread; results are kept in files."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._playing: dict[str, Playing] = {}
        self._errors: OrderedDict[str, str] = OrderedDict()
        self._results: OrderedDict[str, Values] = OrderedDict()

    def describe(self, run: Run) -> Values:
        """Return the newest results of a run, and how far the present matches are."""
        key = key_of(run)
        with self._lock:
            current, error = self._playing.get(key), self._errors.get(key)
            result = self._results.get(key)
        progress = None
        if current is not None:
            progress = {"done": current.done, "whole": current.whole, "waiting_for": current.waiting_for}
        return {"playing": progress, "error": error, "result": result or read_result(key)}

    def start(self, run: Run, champions: int, episodes: int, broker: str | None) -> None:
        """Play the matches of a run, unless they are being played.

        Args:
            run: a competition.
            champions: as in `measure_progress`.
            episodes: likewise.
            broker: whose servers play; None: this process does.

        Raises InputError when the run's code is not trusted or missing, or too many others wait.
        """
        experiment = resolve_experiment(run, run.generations - 1)
        if broker is not None:
            experiment = shorten_waits(experiment)
        key, new = key_of(run), Playing()

        def measure() -> CompetitionProgress:
            with new.limit:
                return measure_progress(
                    run,
                    experiment=experiment,
                    champions=champions,
                    episodes=episodes,
                    broker=broker,
                    servers="in-process" if broker is None else "auto",
                    on_progress=new.follow,
                )

        def work() -> None:
            result, error = None, None
            try:
                while not playing.acquire(timeout=PAUSE_S):
                    new.waiting_for = "the matches of another run"
                    if new.is_stopped:
                        return
                try:
                    result = describe_result(run, measure())
                finally:
                    playing.release()
                write_result(key, result)
            except SwarmwrightError as raised:
                error = None if new.is_stopped else str(raised)
            except Exception:
                logging.getLogger("swarmwright").exception("%s: its matches failed", run.path)
                error = "the matches failed; what the window prints in its terminal says why"
            finally:
                self._end(key, result, error)

        with self._lock:
            if key in self._playing:
                return
            if len(self._playing) > MOST_WAITING:
                raise InputError(
                    f"the matches of {MOST_WAITING} other runs are waiting; stop some, or try later"
                )
            self._playing[key] = new
            self._errors.pop(key, None)
        threading.Thread(target=work, name="matches", daemon=True).start()

    def stop(self, run: Run) -> None:
        """Give up the matches of a run that are being played, if any."""
        with self._lock:
            current = self._playing.get(key_of(run))
        if current is not None:
            current.stop()

    def _end(self, key: str, result: Values | None, error: str | None) -> None:
        with self._lock:
            del self._playing[key]
            remember(self._results, key, result)
            remember(self._errors, key, error)


TOURNAMENTS = Tournaments()


def remember(entries: OrderedDict[str, T], key: str, value: T | None) -> None:
    """Keep a value, if there is one, as long as it is among the newest."""
    if value is not None:
        entries[key] = value
        entries.move_to_end(key)
        while len(entries) > MOST_KEPT:
            entries.popitem(last=False)


def key_of(run: Run) -> str:
    """Return the name under which the results of a run are kept."""
    parts = (swarmwright.__version__, os.fspath(run.path.resolve()), run.created)
    return hashlib.sha256("\0".join(parts).encode(errors="surrogatepass")).hexdigest()


def results_folder() -> Path | None:
    """Return the folder of results; None for a user without a home folder."""
    state = state_folder()
    return None if state is None else state / "ui-progress"


def read_result(key: str) -> Values | None:
    """Return results that an earlier window kept; None without any."""
    folder = results_folder()
    try:
        values = None if folder is None else json.loads(read_bytes(folder / f"{key}.json", LARGEST_BYTES))
    except (OSError, ValueError, RecursionError, InputError):
        return None
    return values if isinstance(values, dict) else None


def write_result(key: str, result: Values) -> None:
    """Keep results for later windows, as far as they can be written, and forget the oldest ones."""
    folder = results_folder()
    if folder is None:
        return
    try:
        make_private_folder(folder)
        write_whole(folder / f"{key}.json", json.dumps(result, allow_nan=False).encode())
        files = sorted(folder.glob("*.json"), key=lambda file: file.stat().st_mtime_ns)
        for file in files[:-MOST_KEPT]:
            file.unlink(missing_ok=True)
    except OSError as error:
        logging.getLogger("swarmwright").warning("%s: cannot be written: %s", folder, error.strerror)


def describe_result(run: Run, progress: CompetitionProgress) -> Values:
    """Return the progress of all sides for the page."""
    colors = color_sides(run.experiment)
    return {
        "episodes": progress.episodes,
        "seed": str(progress.seed),
        "generations": list(progress.sides[0].generations),
        "sides": [describe_side(side, color) for side, color in zip(progress.sides, colors, strict=True)],
    }


def describe_side(side: SideProgress, color: str) -> Values:
    """Return the progress of a side for the page."""
    return {
        "name": escape_line(side.side[:LONGEST_NAME]),
        "opponents": escape_line(side.opponents[:LONGEST_NAME]),
        "color": color,
        "verdict": side.verdict,
        "outcomes": as_values(side.outcomes),
        **as_values(side.summary()),
    }


def describe(window: Window, request: Request) -> Values:
    """Return what is known of the progress of a run."""
    run = window.run(request)
    require_competition(run)
    limits = {"champions": [CHAMPIONS, MOST_CHAMPIONS], "episodes": [EPISODES, MOST_EPISODES]}
    facts = {"present": run.generations, "sides": len(sides_of(run.experiment)), "limits": limits}
    return {**TOURNAMENTS.describe(run), **facts}


def play(window: Window, values: dict[str, Any]) -> Values:
    """Start the matches of a run."""
    run = window.run_of(read_field(values, "run", str))
    require_competition(run)
    numbers = {}
    for name, most in (("champions", MOST_CHAMPIONS), ("episodes", MOST_EPISODES)):
        numbers[name] = read_whole(values.get(name), name)
        if not 2 <= numbers[name] <= most:
            raise InputError(f"{name}: must be from 2 to {most}, not {numbers[name]}")
    TOURNAMENTS.start(run, **numbers, broker=window.find_broker(run))
    return TOURNAMENTS.describe(run)


def stop(window: Window, values: dict[str, Any]) -> Values:
    """Give up the matches of a run."""
    run = window.run_of(read_field(values, "run", str))
    TOURNAMENTS.stop(run)
    return TOURNAMENTS.describe(run)


def is_competition(run: Run) -> bool:
    """Return whether a run is a competition."""
    return isinstance(run.experiment.ranking, TournamentOptions)


def require_competition(run: Run) -> None:
    """Raise InputError for other runs, and those of fewer than two generations."""
    if not is_competition(run):
        raise InputError(f"{run.path}: is not a competition")
    if run.generations < 2:
        raise InputError(
            f"{run.path}: progress needs at least two finished generations, not {run.generations}"
        )


VIEW = View(
    "progress",
    STATIC / "progress.js",
    "Progress",
    tab_of=lambda run: run.generations > 0 and is_competition(run),
    answers={"progress": describe},
    asks={"progress_play": play, "progress_stop": stop},
)
