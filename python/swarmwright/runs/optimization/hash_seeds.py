"""Detect simulations in this process that depend on Python's hash seed."""

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
    """Warn if episodes in this process depend on its random hash seed.

    Servers that a run starts all have the same hash seed. This process has a random one, whose effect a
    repetition in the same process cannot show. So an episode is run in two processes with different hash
    seeds. That takes about a second, and is done only for Python code that uses sets or calls `hash`.
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
        first, second = outcomes(name, trial, _SEEDS)
        effect = difference(second, first, host)
        if effect is None:
            return
        (repeated,) = outcomes(name, trial, _SEEDS[:1])
        if difference(repeated, first, host) is not None:  # it differs even with the same hash seed
            return
    except (NotRunError, SwarmwrightError):  # the run itself is finished
        return
    logging.getLogger("swarmwright").warning(
        "the run is not reproducible: episodes of %s depend on Python's hash seed, which is random in each "
        "process; with another hash seed, an episode differs in its %s. Sort sets of strings before you "
        "iterate over them, evaluate on servers, which share a hash seed (`servers: local`), or set "
        "PYTHONHASHSEED=0",
        kind.__name__, effect,
    )  # fmt: skip


def _has_sets(source: bytes) -> bool:
    """Return whether a Python file may use a set or call `hash`."""
    try:
        nodes = ast.walk(ast.parse(source))
    except (SyntaxError, ValueError):  # not Python
        return False
    calls = {"set", "frozenset", "hash"}
    return any(
        isinstance(node, ast.Set | ast.SetComp)
        or (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in calls)
        for node in nodes
    )
