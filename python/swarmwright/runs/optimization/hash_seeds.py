"""Whether a simulation that is evaluated in this process depends on Python's hash seed."""

import ast
import logging
from typing import Any

from swarmwright.common.errors import SwarmwrightError
from swarmwright.common.processes import RANDOM
from swarmwright.common.simulation_names import is_command, is_python
from swarmwright.experiment.experiment import Experiment
from swarmwright.servers.evaluation.base import Backend
from swarmwright.simulations.base import BatchSimulation, Simulation
from swarmwright.simulations.host import Host
from swarmwright.simulations.loading import load
from swarmwright.simulations.other_process import NotRunError, Trial, difference, outcomes
from swarmwright.simulations.user_code.parts import read_simulation

_SEEDS = ("1", "2")
_MOST_STEPS = 1000


def warn_of_hash_seed(experiment: Experiment, backend: Backend) -> None:
    """Warn where episodes in this process depend on its hash seed, which no other process has.

    Servers that a run starts all have the same hash seed; this process has a random one, of which a
    repetition in the same process shows nothing. So an episode is tried in two processes with different hash
    seeds. That takes about a second, and is done only for code in Python in which a set occurs, or `hash` is
    called.
    """
    name = experiment.simulation
    if backend.hash_seed != RANDOM or not is_python(name) or is_command(name):
        return
    try:
        part = read_simulation(name)
        if part is None or not any(_has_sets(file.data) for file in part.files.values()):
            return
        kind: Any = load(name)
        if not issubclass(kind, Simulation | BatchSimulation):
            return
        host = Host(kind)
        if host.determinism == "none" or host.takes_controller:
            return
        trial = Trial(experiment.parameters, experiment.first_seed, _MOST_STEPS)
        one, other = outcomes(name, trial, _SEEDS)
        found = difference(other, one, host)
        if found is None:
            return
        (again,) = outcomes(name, trial, _SEEDS[:1])
        if difference(again, one, host) is not None:  # it differs anyway
            return
    except (NotRunError, SwarmwrightError):  # the run itself is finished
        return
    logging.getLogger("swarmwright").warning(
        "episodes of %s depend on Python's hash seed, which each process draws anew, so that the run cannot "
        "be repeated: with another one an episode has %s. Sort sets of texts before iterating over them; "
        "until then, evaluate on servers, which all have the same hash seed (`servers: local`), or set "
        "PYTHONHASHSEED=0 in the environment",
        kind.__name__, found,
    )  # fmt: skip


def _has_sets(source: bytes) -> bool:
    """Whether a set may occur in a Python file, or `hash` is called."""
    try:
        nodes = ast.walk(ast.parse(source))
    except (SyntaxError, ValueError):  # a file of another kind
        return False
    calls = {"set", "frozenset", "hash"}
    return any(
        isinstance(node, ast.Set | ast.SetComp)
        or (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in calls)
        for node in nodes
    )
