"""Selection of the metrics that an evaluation measures."""

from collections.abc import Sequence
from typing import Literal

from swarmwright.common.arguments import require_list, text
from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import unknown
from swarmwright.experiment.experiment import Experiment
from swarmwright.simulations import catalogue


def select_metrics(experiment: Experiment, metrics: Sequence[str] | Literal["all"]) -> list[str]:
    """Return the names of the requested metrics; "all" selects every metric that the simulation announces.

    Raises InputError for an unknown metric, and for "all" if only servers know the simulation.
    """
    if metrics != "all":
        require_list("metrics", metrics, "names of metrics")
        metrics = [text("metrics", name, "a list of names") for name in metrics]
    if not catalogue.has_description(experiment.simulation):
        if metrics == "all":
            raise InputError(
                f"metrics: {experiment.label} is not available in this process; list the metrics by name"
            )
        return list(metrics)
    announced = list(catalogue.description(experiment.simulation, experiment.parameters)["metrics"])
    if metrics == "all":
        return announced
    for name in metrics:
        if name not in announced:
            raise InputError(f"metrics: {unknown('metric', name, announced)}")
    return list(metrics)
