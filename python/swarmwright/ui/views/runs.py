"""The list of all runs, and what is done with several of them."""

from dataclasses import asdict
from typing import Any

from swarmwright import InputError
from swarmwright.ui.requests import read_field, read_whole
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window

MOST_RUNS = 500


def read_runs(window: Window, values: dict[str, Any]) -> list[str]:
    """Return the runs that a request names, each once. Raises InputError for one that is not in the list."""
    entries = read_field(values, "runs", list)
    runs = [*dict.fromkeys(read_field({"runs": run}, "runs", str) for run in entries)]
    for run in runs:
        window.index.path(run)
    if not 1 <= len(runs) <= MOST_RUNS:
        raise InputError(f"runs: choose 1 to {MOST_RUNS} runs, not {len(runs)}")
    return runs


def delete(window: Window, values: dict[str, Any]) -> Values:
    """Delete runs, by a job."""
    return {"jobs": [asdict(window.jobs.delete(read_runs(window, values)))]}


def resume(window: Window, values: dict[str, Any]) -> Values:
    """Resume runs, by a job each, up to a number of generations if there is one: all runs, or none."""
    generations = values.get("generations")
    count = None if generations is None else read_whole(generations, "generations")
    runs = read_runs(window, values)
    for run in runs:
        window.check_broker(window.run_of(run))
        window.jobs.check_resumption(run, count)
    return {"jobs": [asdict(window.jobs.resume(run, count)) for run in runs]}


VIEW = View("runs", STATIC / "runs.js", changes={"delete": delete, "resume": resume})
