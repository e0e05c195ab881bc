"""Checking the fitness that a bundle states: by its episodes, and by evaluating them again."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmwright.common.errors import SwarmwrightError
from swarmwright.common.untrusted import one_line
from swarmwright.experiment.experiment import recorded_experiment
from swarmwright.export.bundle import (
    EVALUATION,
    MANIFEST,
)
from swarmwright.export.bundle_report import BundleVerification
from swarmwright.export.subject import Subject, fitness_words


def check_fitness(
    evaluation: Mapping[str, Any], facts: Mapping[str, str], report: BundleVerification
) -> None:
    """Compare the stated fitness with what the stated results make, and with what the formats say."""
    from swarmwright.runs.instances import fitness_of, meaning  # noqa: PLC0415 - loads the engine

    stated = float(evaluation["fitness"])
    parts = [one["episodes"] for one in [*evaluation.get("earlier", []), evaluation]]
    try:
        experiment = recorded_experiment(evaluation["experiment"])
    except SwarmwrightError as error:  # a plug-in is not here
        report.unverified["fitness"] = str(error)
        return
    made = None
    if all(result is not None for part in parts for result in part):
        made = fitness_of(experiment, parts)
    if made is None:
        report.unverified["fitness"] = "its ranking makes it of more than these episodes"
    elif not math.isclose(made, stated, rel_tol=1e-12, abs_tol=0.0):
        report.problems.append(f"{EVALUATION}: the fitness is {stated!r}, but its episodes make {made!r}")
    said = fitness_words(stated, meaning(experiment, len(parts)))
    if "Fitness" in facts and facts["Fitness"] not in (said, repr(stated + 0.0)):
        report.problems.append(
            f"{MANIFEST}: says of the fitness {one_line(facts['Fitness'])!r}, but {EVALUATION} {said!r}"
        )


def check_episodes(evaluation: Mapping[str, Any], subject: Subject, report: BundleVerification) -> None:
    """Evaluate the controller in the episodes of the run and those with held-out seeds."""
    from swarmwright.simulations import catalogue  # noqa: PLC0415 - loads the engine

    simulation = evaluation["experiment"].get("simulation")
    if simulation not in catalogue.titles():
        report.not_evaluated = f"the simulation {one_line(str(simulation))} is not a built-in one"
        return
    earlier = [(one["seeds"], one["episodes"]) for one in evaluation.get("earlier", [])]
    stated = [*earlier, (evaluation["seeds"], evaluation["episodes"])]
    if evaluation["held_out"] is not None:
        stated.append((evaluation["held_out"]["seeds"], evaluation["held_out"]["episodes"]))
    for seeds, episodes in stated:
        try:
            found = _episode_fitness(evaluation["experiment"], subject, [int(seed) for seed in seeds])
        except SwarmwrightError as error:
            report.not_evaluated = str(error)
            return
        report.episodes += len(seeds)
        for seed, value, is_now in zip(seeds, episodes, found, strict=True):
            if not _same(value, is_now):
                report.problems.append(
                    f"{EVALUATION}: the fitness in the episode with seed {seed} is {is_now!r}, not {value}"
                )


def _same(stated: float | None, found: float) -> bool:
    return math.isnan(found) if stated is None else stated == found


def _episode_fitness(values: Mapping[str, Any], subject: Subject, seeds: list[int]) -> list[float]:
    from swarmwright.experiment.experiment import Experiment  # noqa: PLC0415 - loads the engine
    from swarmwright.servers.evaluation.base import Controllers  # noqa: PLC0415 - loads the engine
    from swarmwright.servers.evaluation.opening import open_backend  # noqa: PLC0415 - loads the engine

    experiment = Experiment.from_mapping(dict(values))
    architecture = {**subject.specification, "weights": []}
    weights = np.array(subject.specification["weights"], dtype=np.float32)[np.newaxis]
    with open_backend(experiment, servers="in-process") as backend:
        results = backend.evaluate(Controllers(architecture, weights), seeds, lambda *_: None)
    found: list[float] = results.fitness[0].tolist()
    return found
