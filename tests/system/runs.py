"""What a run left behind."""

from pathlib import Path
from typing import Any

from swarmwright import Run
from swarmwright.common.errors import SwarmwrightError


def record(folder: Path) -> dict[str, Any]:
    """The run record, which depends on the experiment and its seed alone."""
    run = Run.open(folder)
    return {"record": run.digest, "history": run.history, "best.json": (folder / "best.json").read_bytes()}


def generations(folder: Path) -> int:
    """How many a run has stored, also one that goes on."""
    try:
        return Run.open(folder).generations
    except SwarmwrightError:  # it is being made
        return 0


def evaluations(folder: Path) -> list[tuple[float, list[float]]]:
    """Fitness and genome of every evaluation."""
    found = Run.open(folder).record
    return list(zip(found.fitness.tolist(), found.genomes.tolist(), strict=True))


def attempts(folder: Path) -> list[dict[str, Any]]:
    """Who evaluated what, when, how long it took, what went wrong."""
    return [vars(attempt) for attempt in Run.open(folder).attempts()]


def warnings(folder: Path) -> list[str]:
    """What was worth a warning."""
    return [event.text for event in Run.open(folder).events()]
