"""Verification of a run folder: the store against its digests, and best.json against the store."""

import json
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
"""Outcomes of a session after which best.json is of the best candidate; a killed one leaves an old file."""


def verify(folder: Path) -> Verification:
    """Compare everything in a run folder that has a digest, and best.json with the record.

    No code of the run is executed: what only that could compute is among what was not compared.

    Raises InputError as `swarmwright.runs.store.verification.verify`.
    """
    found = verify_store(folder)
    if not found.problems:
        problem = _problem(folder, found.not_compared)
        if problem is not None:
            found.add(f"{_BEST}: {problem}; `swarmwright resume {folder}` writes it again from the record")
    return found


def _problem(folder: Path, not_compared: list[str]) -> str | None:
    """Return what in best.json is not as the record has it; None where all is, or there is no such file.

    not_compared: gets what of it could not be compared.
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
        best, where = reader.best(), tuple(values.get(key) for key in ("generation", "candidate"))
        if best is None or not all(type(number) is int for number in where):
            return f"does not name a candidate of the run, but {_named(*where)}"
        try:
            recorded = reader.evaluation(where[1], where[0])
        except InputError:
            return f"names {_named(*where)}, which the run does not have"
        if reader.sessions()[-1].outcome in _COMPLETE and where != (best.generation, best.candidate):
            return f"names {_named(*where)}, the best is {_named(best.generation, best.candidate)}"
        return _difference(run, recorded, values, controller, not_compared)


def _difference(
    run: Run,
    recorded: Evaluation,
    values: dict[str, Any],
    controller: dict[str, Any],
    not_compared: list[str],
) -> str | None:
    """Return in words what differs from the evaluation that the file names."""
    of = _named(recorded.generation, recorded.candidate)
    if values.get("fitness") != recorded.fitness:
        return f"its fitness is {values.get('fitness')!r}, that of {of} {recorded.fitness!r}"
    genome = shortest(recorded.genome)
    if values.get("genome", genome) != genome:
        return f"its genome is not that of {of}"
    weights = controller.get("weights")
    if getattr(run.experiment.controller, "in_files", False):
        # These files may be anybody's.
        not_compared.append(
            f"{_BEST}: its weights, which only code of the run decodes from the genome; it was not executed"
        )
        return None if "genome" in values or weights == genome else f"its weights are not those of {of}"
    try:
        decoded = _decoded(run, recorded)
    except SwarmwrightError as error:
        not_compared.append(f"{_BEST}: its weights, which cannot be decoded from the genome here: {error}")
        return None
    if "genome" not in values and decoded != genome:
        return f"has no genome, of which the weights of {of} are decoded"
    return None if weights == decoded else f"its weights are not those of {of}"


def _decoded(run: Run, recorded: Evaluation) -> Any:  # noqa: ANN401 - JSON
    """Return the weights that a genome is decoded to. Raises SwarmwrightError where that is not possible."""
    representation = run.experiment.representation()
    return json.loads(json.dumps(representation.specification(recorded.genome)["weights"]))


def _named(generation: object, candidate: object) -> str:
    return f"candidate {candidate!r} of generation {generation!r}"
