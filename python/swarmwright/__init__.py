"""Swarmwright evolves controllers for swarms of robots on many simulation servers.

An experiment describes a simulation, a kind of controller, a method that searches for it, and the number of
episodes per candidate. The method proposes genomes that encode controllers, simulations evaluate them, and
the best ones shape the next generation. Simulations run in this process, on servers that are started
on this machine, or on any servers that an MQTT broker connects; the results are bit-identical.

    import swarmwright

    experiment = swarmwright.Experiment.from_mapping(
        {
            "simulation": "minisim",              # an agent has to get past a defender to its goal
            "controller": {"hidden": [8]},        # a neural network: 4 sensors, 8 nodes, 1 actuator
            "method": {"kind": "nnga", "population": 50, "generations": 20},
            "servers": "local",                   # or a number; without it, name a broker
        }
    )
    run = swarmwright.optimize(experiment)        # is stored in run.path, and can be resumed
    print(run.best.fitness)                       # 0.0: the agent reaches its goal
    figure = run.plot()                           # fitness and diversity; a notebook shows it
    page = run.replay()                           # the best controller at work, to play and step through
    controller = run.best.controller              # sensors in, actuators out
    print(controller([0.9, 0.0, 0.5, 0.1]))

To find out whether another method is better, run several seeds of each: a single run says little.

    result = swarmwright.sweep(
        {"experiment": experiment, "grid": {"method.kind": ["nnga", "random_search"]}, "seeds": 5}
    )
    print(result.compare())                       # medians, tests, sizes of effects

Overview:

    Experiment                  simulation, controller, method and servers; from a file or a mapping
    optimize, resume            evolve a controller; continue a run
    Run, Controller             results: record, plots, replays; a callable controller
    transfer                    fitness that candidates lose in other simulations
    sweep, compare              variants with several seeds, and statistical tests
    reproduce_elites            an archive on held-out seeds: which elites are illusory
    compare_controllers         two controllers in the same episodes
    export_controller           a controller as C, C++, Python, MicroPython or ONNX, for robots
    export_bundle, verify_bundle  an archive to hand over, with evidence; its check
    evaluate, simulate, repeat  the fitness of genomes; an episode; a repeated evaluation
    evaluate_episodes           the fitness and the metrics of genomes in each episode
    Episodes, environments      episodes that your code controls; PettingZoo and Gymnasium environments
    Simulation, BatchSimulation, CommandSimulation, Parameter   base classes of custom simulations
    Group                       agents of one kind in a custom simulation
    Side                        side of a match in a custom simulation
    Physics                     base class of simulators that move the robots of the arena's missions
    callbacks, templates, frevo, testing     TensorBoard and MLflow; experiments to start from; FREVO's files;
                                checks for plug-ins
    methods, rankings, representations, modules, display    base classes of plug-ins; scenes that are drawn
    results                     types of results, for annotations
    ui                          `show`: the window on runs in a notebook or a browser
    InputError, RunError        invalid input; a run that failed for other reasons
    PlugInError, SimulationError  of RunError: the code of a plug-in or of a simulation failed

Arrays are NumPy's: genomes float32, fitness float64, more is better, NaN for an evaluation that failed.
Names are imported when they are first used, so that `import swarmwright` is fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from swarmwright.common import installation
from swarmwright.common.errors import (
    InputError,
    PlugInError,
    RunError,
    SimulationError,
    SwarmwrightError,
)

if TYPE_CHECKING:
    from swarmwright import controllers as representations
    from swarmwright import display, methods, results, testing, ui
    from swarmwright.analysis.comparison import Comparison, compare
    from swarmwright.analysis.paired import ControllerComparison, compare_controllers
    from swarmwright.analysis.sweep.result import SweepResult, sweep
    from swarmwright.analysis.transfer.result import Transfer
    from swarmwright.analysis.transfer.transfer import transfer
    from swarmwright.cli import templates
    from swarmwright.controllers import modules
    from swarmwright.controllers.controller import Controller
    from swarmwright.experiment.experiment import Experiment
    from swarmwright.export import environments
    from swarmwright.export.bundle import Bundle, BundleVerification, export_bundle, verify_bundle
    from swarmwright.export.exporting import ExportResult, export_controller
    from swarmwright.interop import frevo
    from swarmwright.methods import rankings
    from swarmwright.runs import callbacks
    from swarmwright.runs.learning_curve import LearningCurve, learning_curve
    from swarmwright.runs.optimization.optimize import Generation, optimize, resume
    from swarmwright.runs.post_evaluation import ControllerEvaluation, PostEvaluation, post_evaluate
    from swarmwright.runs.repeat import Repetition, repeat
    from swarmwright.runs.reproduction import Reproduction, reproduce_elites
    from swarmwright.runs.run import Run
    from swarmwright.runs.validation import Validation
    from swarmwright.servers.evaluation.episodes import Episodes
    from swarmwright.servers.evaluation.evaluate import (
        EpisodeResults,
        evaluate,
        evaluate_episodes,
        simulate,
    )
    from swarmwright.simulations.base import BatchSimulation, Group, Side, Simulation
    from swarmwright.simulations.command.simulation import CommandSimulation
    from swarmwright.simulations.parameters import Parameter
    from swarmwright.simulations.physics import Physics

    __version__: str

__all__ = [
    "BatchSimulation",
    "Bundle",
    "BundleVerification",
    "CommandSimulation",
    "Comparison",
    "Controller",
    "ControllerComparison",
    "ControllerEvaluation",
    "EpisodeResults",
    "Episodes",
    "Experiment",
    "ExportResult",
    "Generation",
    "Group",
    "InputError",
    "LearningCurve",
    "Parameter",
    "Physics",
    "PlugInError",
    "PostEvaluation",
    "Repetition",
    "Reproduction",
    "Run",
    "RunError",
    "Side",
    "Simulation",
    "SimulationError",
    "SwarmwrightError",
    "SweepResult",
    "Transfer",
    "Validation",
    "__version__",
    "callbacks",
    "compare",
    "compare_controllers",
    "display",
    "environments",
    "evaluate",
    "evaluate_episodes",
    "export_bundle",
    "export_controller",
    "frevo",
    "learning_curve",
    "methods",
    "modules",
    "optimize",
    "post_evaluate",
    "rankings",
    "repeat",
    "representations",
    "reproduce_elites",
    "results",
    "resume",
    "simulate",
    "sweep",
    "templates",
    "testing",
    "transfer",
    "ui",
    "verify_bundle",
]

_LAZY = {
    "BatchSimulation": "simulations.base",
    "Bundle": "export.bundle",
    "BundleVerification": "export.bundle",
    "CommandSimulation": "simulations.command.simulation",
    "Comparison": "analysis.comparison",
    "Controller": "controllers.controller",
    "ControllerComparison": "analysis.paired",
    "Episodes": "servers.evaluation.episodes",
    "EpisodeResults": "servers.evaluation.evaluate",
    "Experiment": "experiment.experiment",
    "ExportResult": "export.exporting",
    "Generation": "runs.optimization.optimize",
    "Group": "simulations.base",
    "LearningCurve": "runs.learning_curve",
    "Parameter": "simulations.parameters",
    "Physics": "simulations.physics",
    "ControllerEvaluation": "runs.post_evaluation",
    "PostEvaluation": "runs.post_evaluation",
    "Repetition": "runs.repeat",
    "Reproduction": "runs.reproduction",
    "Run": "runs.run",
    "Side": "simulations.base",
    "Simulation": "simulations.base",
    "SweepResult": "analysis.sweep.result",
    "Transfer": "analysis.transfer.result",
    "Validation": "runs.validation",
    "compare": "analysis.comparison",
    "compare_controllers": "analysis.paired",
    "evaluate": "servers.evaluation.evaluate",
    "evaluate_episodes": "servers.evaluation.evaluate",
    "export_bundle": "export.bundle",
    "export_controller": "export.exporting",
    "learning_curve": "runs.learning_curve",
    "optimize": "runs.optimization.optimize",
    "post_evaluate": "runs.post_evaluation",
    "reproduce_elites": "runs.reproduction",
    "repeat": "runs.repeat",
    "resume": "runs.optimization.optimize",
    "simulate": "servers.evaluation.evaluate",
    "sweep": "analysis.sweep.result",
    "transfer": "analysis.transfer.transfer",
    "verify_bundle": "export.bundle",
}
_MODULES = {
    "callbacks": "runs.callbacks",
    "display": "display",
    "environments": "export.environments",
    "frevo": "interop.frevo",
    "methods": "methods",
    "modules": "controllers.modules",
    "rankings": "methods.rankings",
    "representations": "controllers",
    "results": "results",
    "templates": "cli.templates",
    "testing": "testing",
    "ui": "ui",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - PEP 562: any of the names above
    if name == "_engine":  # when it is imported for the first time
        value: Any = installation.engine()
    elif name == "__version__":
        value = __getattr__("_engine").__version__
    elif name in _MODULES:
        installation.check_system()
        value = import_module(f"swarmwright.{_MODULES[name]}")
    elif name in _LAZY:
        installation.check_system()
        value = getattr(import_module(f"swarmwright.{_LAZY[name]}"), name)
    else:
        raise AttributeError(f"module 'swarmwright' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
