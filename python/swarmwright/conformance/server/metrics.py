"""S8: metrics."""

import json

from swarmwright.common import metric_names
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.servers.broker.client import Failure, shown


def names(server: Server) -> list[str]:
    """The metrics that are announced; skips the rule when there are none."""
    server.announces()
    found = server.announced.get("metrics")
    if not found:
        raise Skip("not announced: no capabilities.swarmwright.metrics")
    if not isinstance(found, list):
        raise Failure(f'"metrics": {found!r}', '"metrics" is a list of names')
    return found


@rule(
    "S8.1",
    "A metric's name is a letter or _, then letters, digits and _.",
    where="protocol.md, Metrics",
    fix="choose names that can be used in an expression",
    needs=["S1.2"],
)
def names_are_valid(server: Server) -> None:
    """The announcement."""
    wrong = [name for name in names(server) if metric_names.problem_of(str(name))]
    if wrong:
        raise Failure(f'"metrics" has {wrong[0]!r}', "names of letters, digits and _")


@rule(
    "S8.2",
    "All metrics that are announced come with the fitness of an episode.",
    where="protocol.md, Metrics",
    fix='send "metrics": {name: number, ...} in the fitness message; leave out only what is NaN or infinite',
    needs=["S2.3"],
)
def metrics_are_sent(server: Server) -> str:
    """The fitness messages of all episodes so far: one that never came is missing."""
    wanted = names(server)
    trajectory = server.play()
    missing = [name for name in wanted if name not in server.seen_metrics]
    wrong = [name for name in missing if name in server.wrong_metrics]
    if wrong:
        value = server.wrong_metrics[wrong[0]]
        raise Failure(f'"metrics.{wrong[0]}" is {shown(json.dumps(value))}', "a finite number")
    if missing:
        raise Failure(
            f"metrics {', '.join(trajectory.metrics) or 'none'} came",
            f"{missing[0]} as well, in some episode",
        )
    return ", ".join(wanted)
