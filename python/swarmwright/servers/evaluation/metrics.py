"""Which metrics an evaluation is asked for."""

from collections.abc import Sequence
from typing import Literal

from swarmwright.common.arguments import listed, text
from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import unknown
from swarmwright.experiment.experiment import Experiment
from swarmwright.simulations import catalogue


def asked_for(experiment: Experiment, metrics: Sequence[str] | Literal["all"]) -> list[str]:
    """Return the names of the metrics that are asked for; "all": those that the simulation announces.

    Raises InputError for one that is not there, and for "all" where only servers know the simulation.
    """
    if metrics != "all":
        listed("metrics", metrics, "names of metrics")
        metrics = [text("metrics", name, "a list of names") for name in metrics]
    if not catalogue.has_description(experiment.simulation):
        if metrics == "all":
            raise InputError(
                f"metrics: those of {experiment.label}, which is not here, are not known; give their names"
            )
        return list(metrics)
    there = list(catalogue.description(experiment.simulation, experiment.parameters)["metrics"])
    if metrics == "all":
        return there
    for name in metrics:
        if name not in there:
            raise InputError(f"metrics: {unknown('metric', name, there)}")
    return list(metrics)
