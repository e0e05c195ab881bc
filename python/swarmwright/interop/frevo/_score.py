"""FREVO's networks, evaluated again."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright import _engine
from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.files import first_character
from swarmwright.interop.frevo._document import (
    LAYERS,
    NEAT,
    THREE_LAYERS,
    Section,
    all_of,
    check,
    open_session,
)
from swarmwright.interop.frevo._mapping import problem_parameters
from swarmwright.interop.frevo._networks import Network, networks
from swarmwright.interop.frevo._representations import RELU, SIGMOID

_MOST_EPISODES = 100_000
"""As in experiments."""
_NEAT = (
    "NEAT: children share their genes with their parents in FREVO, whose mutations change both: a network in "
    "the file may be another one than that which got the fitness. Weights are rounded to 32 bits"
)


@dataclass(frozen=True)
class Score:
    """A candidate: its place in the file, its fitness here, and the one that FREVO gave it.

    specification: its network, as `swarmwright.Controller` takes it.
    """

    index: int
    fitness: float
    frevo: float
    specification: dict[str, Any] = field(repr=False)

    @property
    def difference(self) -> float:
        """How far the two are apart."""
        return abs(self.fitness - self.frevo)


@dataclass(frozen=True)
class Scores:
    """All candidates of a result file, in its order. notes: why they may differ from FREVO's."""

    candidates: tuple[Score, ...]
    notes: tuple[str, ...]

    def __iter__(self) -> Iterator[Score]:
        return iter(self.candidates)

    def __len__(self) -> int:
        return len(self.candidates)

    @property
    def best(self) -> Score:
        """The candidate with the highest fitness here, the first of them."""
        return max(self.candidates, key=lambda candidate: candidate.fitness)

    @property
    def max_difference(self) -> float:
        """The largest difference from FREVO's fitness."""
        return max(candidate.difference for candidate in self.candidates)


@check_arguments
def score(path: str | PathLike[str], *, field: str | PathLike[str] | None = None) -> Scores:
    """Evaluate every candidate of a FREVO result file (.zre) again, in this process.

    Args:
        path: the file.
        field: as in `load`.

    Method and ranking do not matter, and need no counterpart here.

    Raises:
        InputError: the file is not a FREVO result, or its problem or representation has no counterpart
            here; the message names file, line and element.
    """
    if first_character(Path(path)) not in ("<", ""):
        raise InputError(
            f"{path}: is not a result of FREVO (.zre), which is XML; a controller is evaluated with "
            "`swarmwright evaluate EXPERIMENT --controller FILE --episodes N`"
        )
    session = open_session(Path(path))
    all_of(
        lambda: check(session.problem, replaceable=False),
        lambda: check(session.representation, replaceable=False),
    )
    found = networks(session)
    lines, field_file, ranking, notes = problem_parameters(session, None if field is None else Path(field))
    parameters = {line.key: line.value for line in lines}
    if field_file is not None:
        parameters["field"] = field_file.value
    notes += _notes(session.representation)
    first: int = parameters.pop("seed", 0)
    episodes = next(line.value for line in ranking if line.key == "episodes")
    if episodes > _MOST_EPISODES:
        raise session.problem.error(
            "NumberofEvaluations", f"{episodes} found, expected a whole number of at most {_MOST_EPISODES}"
        )
    results = np.empty((len(found), episodes))
    try:
        with engine_errors():
            seeds = range(first, first + episodes)
            for architecture, indices in _by_architecture(found):
                weights = [found[index].specification["weights"] for index in indices]
                genomes = np.array(weights, dtype=np.float32)
                results[indices], _ = _engine.evaluate(
                    "emergency_exit", parameters, architecture, genomes, seeds
                )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    # One after another, as FREVO adds them; sum() would round otherwise.
    totals = np.add.accumulate(results, axis=1)[:, -1] + 0.0
    pairs = zip(totals.tolist(), found, strict=True)
    scores = tuple(
        Score(index, total, network.fitness, network.specification)
        for index, (total, network) in enumerate(pairs)
    )
    return Scores(scores, tuple(notes))


def _notes(representation: Section) -> list[str]:
    """Return why networks may behave in another way than in FREVO."""
    if representation.class_name in (THREE_LAYERS, LAYERS):
        return [f"{representation.class_name}: its sigmoid is {SIGMOID}"]
    if representation.class_name == NEAT:
        return [_NEAT]
    activation = representation.take_text("activationFunction", "LINEAR")
    return {
        "SIGMOID": [f"activationFunction = SIGMOID: {SIGMOID}"],
        "RELU": [f"activationFunction = {RELU}"],
    }.get(activation, [])


def _by_architecture(networks: Sequence[Network]) -> Iterable[tuple[dict[str, Any], list[int]]]:
    """Return specifications without weights, each with the indices of its networks."""
    found: dict[str, tuple[dict[str, Any], list[int]]] = {}
    for index, network in enumerate(networks):
        common = {key: value for key, value in network.specification.items() if key != "weights"}
        found.setdefault(json.dumps(common), (common, []))[1].append(index)
    return found.values()
