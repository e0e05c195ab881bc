"""Swarmwright evolves controllers for swarms of robots on many simulation servers through an MQTT broker.

    import swarmwright

    experiment = swarmwright.Experiment.load("experiments/minisim.yaml")
    run = swarmwright.optimize(experiment)
    print(run.best.fitness, run.path)

Names are imported when they are first used, so that `import swarmwright` costs next to nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from swarmwright._errors import InputError, RunError, SwarmwrightError

if TYPE_CHECKING:
    from swarmwright import callbacks, templates
    from swarmwright._controller import Controller
    from swarmwright._evaluate import evaluate, simulate
    from swarmwright._experiment import Experiment
    from swarmwright._optimize import Generation, optimize, resume
    from swarmwright._own._base import Simulation
    from swarmwright._own._batch import BatchSimulation
    from swarmwright._own._parameter import Parameter
    from swarmwright._repeat import Repeated, repeat
    from swarmwright._results.comparison import Comparison, compare
    from swarmwright._run import Run

    __version__: str

__all__ = [
    "BatchSimulation",
    "Comparison",
    "Controller",
    "Experiment",
    "Generation",
    "InputError",
    "Parameter",
    "Repeated",
    "Run",
    "RunError",
    "Simulation",
    "SwarmwrightError",
    "__version__",
    "callbacks",
    "compare",
    "evaluate",
    "optimize",
    "repeat",
    "resume",
    "simulate",
    "templates",
]

_LAZY = {
    "BatchSimulation": "_own._batch",
    "Comparison": "_results.comparison",
    "Controller": "_controller",
    "Experiment": "_experiment",
    "Generation": "_optimize",
    "Parameter": "_own._parameter",
    "Repeated": "_repeat",
    "Run": "_run",
    "Simulation": "_own._base",
    "compare": "_results.comparison",
    "evaluate": "_evaluate",
    "optimize": "_optimize",
    "repeat": "_repeat",
    "resume": "_optimize",
    "simulate": "_evaluate",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - PEP 562: any of the names above
    if name == "__version__":
        value: Any = import_module("swarmwright._engine").__version__
    elif name in {"callbacks", "frevo", "templates", "testing"}:
        value = import_module(f"swarmwright.{name}")
    elif name in _LAZY:
        value = getattr(import_module(f"swarmwright.{_LAZY[name]}"), name)
    else:
        raise AttributeError(f"module 'swarmwright' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
