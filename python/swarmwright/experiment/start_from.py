"""`start_from`: controllers to start evolution from, read once and stored in the experiment."""

from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.common.arrays import Genomes, shortest
from swarmwright.common.errors import InputError
from swarmwright.common.problems import format_value
from swarmwright.controllers import Representation
from swarmwright.controllers.controller import Controller, genome_beside
from swarmwright.experiment.opponents import genomes_of
from swarmwright.experiment.unavailable import method_of
from swarmwright.runs.store import StoreReader
from swarmwright.runs.store.folder import find_store

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment

Entry = dict[str, Any]
"""A controller: `architecture`, `weights`, its origin `from`, and `genome` if that differs."""
_OF_RUN = frozenset({"run", "generation", "candidate"})


def read_entries(value: Any, folder: Path) -> list[Entry]:  # noqa: ANN401 - whatever the file says
    """Read the controllers of `start_from`.

    Args:
        value: a path, a mapping, or a list of these.
        folder: base of relative paths.

    Raises InputError if a controller cannot be read.
    """
    if isinstance(value, str | PathLike):
        return [_read_path(folder / value, fspath(value))]
    if isinstance(value, Mapping):
        return [_read_mapping(value, folder)]
    if isinstance(value, Sequence) and value:
        return [entry for item in value for entry in read_entries(item, folder)]
    raise InputError(
        f"must be the path of a run or of a controller, or a list of these, not {format_value(value)}"
    )


def _read_mapping(value: Mapping[str, Any], folder: Path) -> Entry:
    run = value.get("run")
    if isinstance(run, str | PathLike) and value.keys() <= _OF_RUN:
        numbers = [value.get("candidate"), value.get("generation")]
        if any(
            number is not None and (isinstance(number, bool) or not isinstance(number, int) or number < 0)
            for number in numbers
        ):
            raise InputError("generation and candidate must be integers of at least 0")
        return _read_run(folder / run, fspath(run), *numbers)
    if isinstance(value.get("architecture"), Mapping) and isinstance(value.get("weights"), list):
        return dict(value)
    raise InputError(
        "a mapping must have the form {run: PATH, generation: G, candidate: N}, with the last two optional"
    )


def _read_path(path: Path, name: str) -> Entry:
    if path.is_dir():
        return _read_run(path, name, None, None)
    entry, genome = make_entry(Controller.load(path).specification, name), genome_beside(path)
    return entry if genome is None else {**entry, "genome": genome}


def _read_run(path: Path, name: str, candidate: int | None, generation: int | None) -> Entry:
    from swarmwright.experiment.experiment import load_stored_experiment  # noqa: PLC0415 - it imports this module

    store = StoreReader(find_store(path))
    evaluation = store.evaluation(candidate, generation)
    experiment = load_stored_experiment(store)
    specification = experiment.representation().specification(evaluation.genome)
    entry = make_entry(
        specification, f"{name}, candidate {evaluation.candidate} of generation {evaluation.generation}"
    )
    genome = shortest(evaluation.genome)
    return entry if genome == entry["weights"] else {**entry, "genome": genome}


def make_entry(specification: Mapping[str, Any], name: str) -> Entry:
    """Build the entry of a controller. name: its origin."""
    architecture = {key: value for key, value in specification.items() if key != "weights"}
    return {"from": name, "architecture": architecture, "weights": list(specification["weights"])}


def find_start_genomes(experiment: "Experiment", representation: Representation) -> Genomes | None:
    """Return the genomes to start from, (controllers, genome_size), or None.

    Raises InputError if they do not match the representation.
    """
    if experiment.start_from is not None:
        try:
            return genomes_of(experiment.start_from, representation)
        except InputError as error:
            raise InputError(f"start_from: {error}") from error
    start = representation.start_genome
    if start is None or method_of(experiment.method).no_start(experiment.method, 1) is not None:
        return None
    return start.reshape(1, -1)


def samples_around_start(experiment: "Experiment") -> bool:
    """Whether the method samples around a given controller instead of evaluating it."""
    return method_of(experiment.method).start_as == "center"
