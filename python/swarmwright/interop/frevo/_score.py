"""The evaluation of the networks of FREVO's result files."""

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
    check,
    open_session,
    run_all,
)
from swarmwright.interop.frevo._mapping import convert_problem
from swarmwright.interop.frevo._networks import Network, read_networks
from swarmwright.interop.frevo._representations import RELU, SIGMOID

_MOST_EPISODES = 100_000
"""Largest number of episodes, as in experiments."""
_NEAT = (
    "NEAT: in FREVO, children share their genes with their parents, and mutations change both: a network in "
    "the file may differ from the network with this fitness. Weights are rounded to 32 bits"
)


@dataclass(frozen=True)
class Score:
    """A candidate: its index in the file, its fitness in Swarmwright, and its fitness in FREVO.

    specification: its network, see `swarmwright.Controller`.
    """

    index: int
    fitness: float
    frevo: float
    specification: dict[str, Any] = field(repr=False)

    @property
    def difference(self) -> float:
        """The absolute difference between both fitness values."""
        return abs(self.fitness - self.frevo)


@dataclass(frozen=True)
class Scores:
    """All candidates of a result file, in file order. notes: why they may differ from FREVO's."""

    candidates: tuple[Score, ...]
    notes: tuple[str, ...]

    def __iter__(self) -> Iterator[Score]:
        return iter(self.candidates)

    def __len__(self) -> int:
        return len(self.candidates)

    @property
    def best(self) -> Score:
        """The candidate with the highest fitness in Swarmwright; the first of several."""
        return max(self.candidates, key=lambda candidate: candidate.fitness)

    @property
    def max_difference(self) -> float:
        """The largest difference from FREVO's fitness."""
        return max(candidate.difference for candidate in self.candidates)


@check_arguments
def score(path: str | PathLike[str], *, field: str | PathLike[str] | None = None) -> Scores:
    """Evaluate all candidates of a FREVO result file (.zre) again, in this process.

    Method and ranking of the file are not used and need no counterpart.

    Args:
        path: the file.
        field: see `load`.

    Raises:
        InputError: the file is not a FREVO result, or its problem or representation has no counterpart in
            Swarmwright; the message names file, line and element.
    """
    if first_character(Path(path)) not in ("<", ""):
        raise InputError(
            f"{path}: is not a result of FREVO (.zre), which is XML; evaluate a controller with "
            "`swarmwright evaluate EXPERIMENT --controller FILE --episodes N`"
        )
    session = open_session(Path(path))
    run_all(
        lambda: check(session.problem, replaceable=False),
        lambda: check(session.representation, replaceable=False),
    )
    networks = read_networks(session)
    lines, field_file, ranking, notes = convert_problem(session, None if field is None else Path(field))
    parameters = {line.key: line.value for line in lines}
    if field_file is not None:
        parameters["field"] = field_file.value
    notes += _describe_differences(session.representation)
    first: int = parameters.pop("seed", 0)
    episodes = next(line.value for line in ranking if line.key == "episodes")
    if episodes > _MOST_EPISODES:
        raise session.problem.error(
            "NumberofEvaluations", f"{episodes} found, expected a whole number of at most {_MOST_EPISODES}"
        )
    results = np.empty((len(networks), episodes))
    try:
        with engine_errors():
            seeds = range(first, first + episodes)
            for architecture, indices in _group_by_architecture(networks):
                weights = [networks[index].specification["weights"] for index in indices]
                genomes = np.array(weights, dtype=np.float32)
                results[indices], _ = _engine.evaluate(
                    "emergency_exit", parameters, architecture, genomes, seeds
                )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    # Add in sequence, like FREVO: sum() rounds differently.
    totals = np.add.accumulate(results, axis=1)[:, -1] + 0.0
    pairs = zip(totals.tolist(), networks, strict=True)
    scores = tuple(
        Score(index, total, network.fitness, network.specification)
        for index, (total, network) in enumerate(pairs)
    )
    return Scores(scores, tuple(notes))


def _describe_differences(representation: Section) -> list[str]:
    """Return reasons for which networks may behave differently than in FREVO."""
    if representation.class_name in (THREE_LAYERS, LAYERS):
        return [f"{representation.class_name}: its sigmoid is {SIGMOID}"]
    if representation.class_name == NEAT:
        return [_NEAT]
    activation = representation.take_text("activationFunction", "LINEAR")
    return {
        "SIGMOID": [f"activationFunction = SIGMOID: {SIGMOID}"],
        "RELU": [f"activationFunction = {RELU}"],
    }.get(activation, [])


def _group_by_architecture(networks: Sequence[Network]) -> Iterable[tuple[dict[str, Any], list[int]]]:
    """Return the specifications without weights, each with the indices of its networks."""
    groups: dict[str, tuple[dict[str, Any], list[int]]] = {}
    for index, network in enumerate(networks):
        common = {key: value for key, value in network.specification.items() if key != "weights"}
        groups.setdefault(json.dumps(common), (common, []))[1].append(index)
    return groups.values()
