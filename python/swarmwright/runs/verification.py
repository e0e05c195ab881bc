"""Verify a run folder: the store against its digests, and best.json against the store."""

import json
import math
from pathlib import Path
from typing import Any

from swarmwright.common.arrays import shortest
from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.files import read_contents
from swarmwright.common.json_text import loads
from swarmwright.runs.run import Run
from swarmwright.runs.store import Evaluation, StoreReader
from swarmwright.runs.store.verification import Verification
from swarmwright.runs.store.verification import verify as verify_store

_BEST = "best.json"
_COMPLETE = {"done", "stopped"}
"""Outcomes of a session that updates best.json; a killed session leaves an old file."""


def verify(folder: Path) -> Verification:
    """Compare everything in a run folder that has a digest, and best.json with the record.

    No code of the run is executed; parts that need it are listed in `not_compared`.

    Raises InputError as `swarmwright.runs.store.verification.verify`.
    """
    verification = verify_store(folder)
    if not verification.problems:
        problem = _find_problem(folder, verification.not_compared)
        if problem is not None:
            verification.add(
                f"{_BEST}: {problem}; `swarmwright resume {folder}` writes it again from the record"
            )
    return verification


def _find_problem(folder: Path, not_compared: list[str]) -> str | None:
    """Return how best.json differs from the record; None if it does not, or does not exist.

    not_compared: parts that could not be compared are added to it.
    """
    file = folder / _BEST
    if not file.exists():
        return None
    try:
        values = loads(read_contents(file))
    except InputError as error:
        return str(error).removeprefix(f"{file}: ")
    except ValueError as error:
        return f"is not valid JSON: {error}"
    controller = values.get("controller") if isinstance(values, dict) else None
    if not isinstance(controller, dict):
        return "has no controller"
    with StoreReader.open_snapshot(folder) as reader:
        run = Run(folder, reader)
        best, position = reader.best(), tuple(values.get(key) for key in ("generation", "candidate"))
        if best is None or not all(type(number) is int for number in position):
            return f"does not name a candidate of the run, but {_format_candidate(*position)}"
        try:
            recorded = reader.evaluation(position[1], position[0])
        except InputError:
            return f"names {_format_candidate(*position)}, which the run does not have"
        if reader.sessions()[-1].outcome in _COMPLETE and position != (best.generation, best.candidate):
            return (
                f"names {_format_candidate(*position)}, but the best is "
                f"{_format_candidate(best.generation, best.candidate)}"
            )
        return _compare(run, recorded, values, controller, not_compared)


def _compare(
    run: Run,
    recorded: Evaluation,
    values: dict[str, Any],
    controller: dict[str, Any],
    not_compared: list[str],
) -> str | None:
    """Describe the difference from the evaluation that the file names; None if there is none."""
    candidate = _format_candidate(recorded.generation, recorded.candidate)
    fitness = recorded.fitness if math.isfinite(recorded.fitness) else None
    if values.get("fitness") != fitness:
        return f"its fitness is {values.get('fitness')!r}, but that of {candidate} is {fitness!r}"
    genome = shortest(recorded.genome)
    if values.get("genome", genome) != genome:
        return f"its genome is not that of {candidate}"
    weights = controller.get("weights")
    if getattr(run.experiment.controller, "in_files", False):
        # These files may be from another user.
        not_compared.append(
            f"{_BEST}: its weights, which only code of the run can decode from the genome; it was not "
            "executed"
        )
        return (
            None if "genome" in values or weights == genome else f"its weights are not those of {candidate}"
        )
    try:
        representation = run.experiment.representation()
        decoded = json.loads(json.dumps(representation.specification(recorded.genome)["weights"]))
    except SwarmwrightError as error:
        not_compared.append(f"{_BEST}: its weights, which cannot be decoded from the genome here: {error}")
        return None
    if "genome" not in values and decoded != genome:
        return f"has no genome, which the weights of {candidate} are decoded from"
    return None if weights == decoded else f"its weights are not those of {candidate}"


def _format_candidate(generation: object, candidate: object) -> str:
    return f"candidate {candidate!r} of generation {generation!r}"
