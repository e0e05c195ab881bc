"""Keys of an experiment that were set and have no effect, or an undesired one, with its other keys."""

import math
from collections.abc import Iterator, Mapping

from swarmwright.common.options import Options
from swarmwright.controllers.networks import NetworkOptions
from swarmwright.experiment.derived import steers_agents
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.start_from import samples_around_start
from swarmwright.methods.rankings.multi_fidelity import MultiFidelityOptions
from swarmwright.simulations.catalogue import steers_itself, titles

_REACHED = {"tanh": (-1.0, 1.0), "sigmoid": (0.0, 1.0), "clamp": (0.0, 1.0), "relu": (0.0, math.inf)}
"""Lowest and highest output of a node, by activation; others have no limits."""


def setting_warnings(experiment: Experiment) -> list[str]:
    """Return sentences on keys that are not at their defaults and have no effect, or an undesired one."""
    method, validate = experiment.method, experiment.validate
    found = []
    if method.operation != "steady_state":
        found += [
            f"method.{key} has no effect with operation: {method.operation}"
            for key in _set_in(method, "in_flight")
        ]
    if not validate.transfers:
        found += [
            f"validate.{key} has no effect without validate.to, validate.vary or validate.pseudo_reality"
            for key in _set_in(validate, "seeds", "random")
        ]
    if experiment.start_from is not None and samples_around_start(experiment) and validate.episodes == 0:
        found.append(
            f"start_from: {method.kind} samples around the controller and does not keep it; with validate: "
            "false the run does not say whether its best is better"
        )
    ranking = experiment.ranking
    if method.needed_metrics and ranking.seeds == "new":
        episodes = ranking.episodes
        found.append(
            f"ranking.seeds: new lets {method.kind} compare candidates that were evaluated on different "
            "seeds, and those with easy seeds stay to the end; take seeds: same with more episodes "
            f"(ranking.episodes is {episodes}), and evaluate the result on held-out seeds"
        )
    if isinstance(ranking, MultiFidelityOptions) and ranking.seeds == "new" and (ranking.memory or 1) > 1:
        found.append(
            f"ranking.memory: {ranking.memory} with seeds: new corrects fitness by differences between the "
            "two simulations on other seeds as well; leave it out, or take seeds: same"
        )
    return [*found, *_without_influence(experiment)]


def _without_influence(experiment: Experiment) -> Iterator[str]:
    """Yield sentences on settings with which all controllers have the same fitness."""
    simulation, parameters, controller = experiment.simulation, experiment.parameters, experiment.controller
    if steers_agents(experiment) and simulation in titles() and steers_itself(simulation, parameters):
        yield (
            f"controller: {controller.kind} steers agents, but those of {simulation} steer themselves with "
            "these parameters, and all candidates have the same fitness; change the parameters, or evolve "
            "them with controller: {kind: parameter_set}"
        )
    if isinstance(controller, NetworkOptions) and controller.last_activation in _REACHED:
        (low, high), (least, most) = controller.outputs, _REACHED[controller.last_activation]
        if most <= low or high <= least:
            reached = f"{least:g} to {most:g}" if math.isfinite(most) else f"{least:g} or more"
            yield (
                f"controller.output_range: [{low:g}, {high:g}] is beyond all outputs of "
                f"{controller.last_activation}, {reached}: actuators have one value, whatever the controller"
            )
    mission = parameters.get("mission")
    metrics = mission.get("metrics") if isinstance(mission, Mapping) else None
    for name, metric in metrics.items() if isinstance(metrics, Mapping) else ():
        if isinstance(metric, Mapping) and metric.get("kind") == "returns":
            sources = metric.get("sources")
            if isinstance(sources, list) and metric.get("nest") in sources:
                yield (
                    f"parameters.mission.metrics.{name}: its nest {metric['nest']!r} is also one of its "
                    "sources, and no robot is counted; name another patch"
                )


def _set_in(options: Options, *keys: str) -> Iterator[str]:
    """Yield the keys with other values than the defaults, which files of runs have written out."""
    fields = type(options).model_fields
    return (key for key in keys if getattr(options, key) != fields[key].default)
