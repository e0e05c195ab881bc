"""The number of parallel runs of a sweep, and the servers of each."""

from collections.abc import Sequence
from contextlib import suppress

from swarmwright import _engine
from swarmwright.common.errors import InputError, PlugInError
from swarmwright.common.plug_in_code import reported
from swarmwright.experiment.derived import with_environment
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.launcher_entries import written
from swarmwright.methods import METHODS
from swarmwright.servers.broker.credentials import from_keyring
from swarmwright.servers.evaluation import here
from swarmwright.servers.evaluation.base import HERE, Servers, chosen
from swarmwright.servers.supervision.local_servers import automatic_count, processors
from swarmwright.simulations import catalogue

_LISTEN = 1.0
"""Seconds for servers on a broker to say that they are there."""
_ASSUMED_POPULATION = 50
"""Candidates of a generation where their number depends on what only a server knows."""


def shares(
    experiments: Sequence[Experiment],
    runs: int,
    jobs: int | None,
    *,
    broker: str | None,
    servers: Servers | None,
) -> list[Servers | None]:
    """Return for each run that goes on at a time which servers it starts; None: none, it uses the broker's.

    Without `jobs`, there are as many as can work in parallel without sharing a resource:

    - evaluated in this process: a run for each processor;
    - servers that are started: a run for each of them, with a separate broker;
    - servers on a broker: as many runs as they can serve, where each takes as many as its generation has
      evaluations.

    Args:
        experiments: of the variants.
        runs: that are to be done.
        jobs: how many at a time.
        broker: whose servers are used.
        servers: which are started, instead of the first experiment's.

    Raises:
        InputError: fewer servers are to be started than runs go on at a time.
    """
    first = experiments[0]
    wanted = chosen(first, servers)
    if broker is None and wanted == "auto" and here.in_process_is_better(first):
        wanted = "local"
    if any(one.simulation.startswith("__main__:") for one in experiments):
        jobs = 1  # a class of this session, which no other process finds
    most = max(runs, 1)
    if broker is None and wanted in HERE:
        jobs = min(jobs or processors(), most)
        if wanted == "in-process" or not all(here.has_workers(one.simulation) for one in experiments):
            return [wanted] * jobs
        wanted = max(processors(), jobs)  # all runs together, not each of them
    if isinstance(wanted, tuple):  # one run after the other has all of them
        return [written(wanted)]
    if broker is not None and not isinstance(servers, int):
        return [None] * min(jobs or _served(experiments, broker), most)
    count = wanted if isinstance(wanted, int) else max(automatic_count(), jobs or 1)
    if jobs is None:
        jobs = count if broker is None else 1
    if jobs > count:
        raise InputError(
            f"jobs: {jobs} runs at a time need as many servers, and {count} are to be started; give a larger "
            "number of servers, or fewer jobs"
        )
    jobs = min(jobs, most)
    return [count // jobs + (place < count % jobs) for place in range(jobs)]


def _served(experiments: Sequence[Experiment], broker: str) -> int:
    """Return how many runs the servers on a broker can serve at a time."""
    from_keyring(broker)
    first = experiments[0]
    found = _engine.servers(broker, prefix=with_environment(first).prefix, wait=_LISTEN)
    titles = {catalogue.title(one.simulation) for one in experiments}
    able = [
        one for one in found if one.get("state") != "lost" and titles <= set(one.get("simulations") or ())
    ]
    return max(1, len(able) // max(_at_a_time(one) for one in experiments))


def _at_a_time(experiment: Experiment) -> int:
    """Return how many evaluations of a run can be made at a time, each on another server."""
    options = experiment.method
    if options.operation == "steady_state":
        return int(options.in_flight) * experiment.ranking.episodes
    representation = candidates = None
    # InputError: where only a server knows the numbers of sensors and actuators. What fails in a plug-in is
    # reported by the runs that use it.
    with suppress(InputError, PlugInError), reported():
        representation = experiment.representation()
    with suppress(InputError, PlugInError), reported():
        candidates = METHODS.get(options.kind).first_generation(options, representation)
    return (candidates or _ASSUMED_POPULATION) * experiment.ranking.episodes
