"""The tab of a front of several objectives, as `Run.elites` has it."""

from starlette.requests import Request

from swarmwright.methods._pareto import ParetoOptions
from swarmwright.ui.requests import read_integer
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.views._elites import check_method, describe_elites, describe_states
from swarmwright.ui.window import Window


def describe(window: Window, request: Request) -> Values:
    """Return the objectives and the hypervolume over generations."""
    run = window.run(request)
    check_method(run, ParetoOptions, "nsga2 or nsga3")
    return describe_states(run)


def describe_points(window: Window, request: Request) -> Values:
    """Return the front after a generation."""
    run = window.run(request)
    check_method(run, ParetoOptions, "nsga2 or nsga3")
    return describe_elites(run, read_integer(request, "generation"))


VIEW = View(
    "front",
    STATIC / "front.js",
    "Front",
    tab_of=lambda run: run.generations > 0 and isinstance(run.experiment.method, ParetoOptions),
    answers={"front": describe, "front_points": describe_points},
)
