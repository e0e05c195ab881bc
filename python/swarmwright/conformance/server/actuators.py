"""S4: handling of actuators."""

from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance._trajectory import Always, Policy, Trajectory, Wander
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import until_several
from swarmwright.servers.broker.client import Failure


def effective(server: Server, one: Policy, other: Policy) -> tuple[Trajectory, Trajectory]:
    """Two trajectories that differ; skips the rule when actuators change nothing that could be seen."""
    server.comparable()
    _ = server.reference
    trajectories = server.play(one), server.play(other)
    if not trajectories[0].difference(trajectories[1]):
        raise Skip("other actuators change nothing that can be seen; give --parameters with longer episodes")
    return trajectories


@rule(
    "S4.1",
    "Actuators outside -1 to +1 are clamped.",
    where="protocol.md, Reading",
    fix="clamp every actuator to -1..+1 when it is read, before the simulation sees it",
    needs=["S3.1"],
)
def clamped(server: Server) -> None:
    """+1 and 7.5, -1 and -1e30, to all actuators."""
    count = server.actuators
    plus, _ = effective(server, Always((1.0,) * count), Wander(count))
    minus = server.play(Always((-1.0,) * count))
    for value, limit, trajectory in ((7.5, "+1", plus), (-1e30, "-1", minus), (1.0000001, "+1", plus)):
        difference = trajectory.difference(server.play(Always((value,) * count)))
        if difference:
            came = f"with {value:g} instead of {limit} {difference}"
            raise Failure(
                came, f"{value:g} counts as {limit}", f'"actuator": {[value] * count} to all agents'
            )


@rule(
    "S4.2",
    "The answers of a step may come in any order.",
    where="protocol.md, An episode, 4",
    fix="sort actuators by their agent, not by arrival",
    needs=["S3.1", "S2.9"],
)
def any_order(server: Server) -> None:
    """A whole episode, the last agent of each step first."""
    server.comparable()
    until_several(server).stop()
    server.must_answer("an answer: the episode was ended")
    episode = server.episode()
    episode.configure()
    episode.start()
    episode.gather()
    while not episode.over:
        for agent, turn, numbers in reversed(list(episode.pending)):
            episode.answer(agent, server.policy(agent, turn, numbers))
        episode.gather()
    difference = server.reference.difference(episode.trajectory)
    if difference:
        raise Failure(difference, "the same episode", "the last agent's actuators first in each step")


@rule(
    "S4.3",
    "A second answer for one agent and step is refused: the first one counts.",
    where="protocol.md, Reading",
    fix="when an agent has its actuators in this step refuse others",
    needs=["S3.1"],
)
def the_first_counts(server: Server) -> None:
    """In one step the first agent gets the opposite actuators as well, before the others have theirs."""
    episode = until_several(server)
    agents = [agent for agent, _, _ in episode.pending]
    agent, turn, numbers = episode.pending[0]
    values = server.policy(agent, turn, numbers)
    episode.answer(agent, values)
    sent = episode.answer(agent, [-value if value else 1.0 for value in values])
    episode.must_wait(agents, "other agents have no actuators yet", sent)
    trajectory = episode.play()
    if server.deterministic:
        difference = server.reference.difference(trajectory)
        if difference:
            raise Failure(difference, "the episode without the second answer", sent)


@rule(
    "S4.4",
    "Actuators are read as the nearest IEEE binary32.",
    where="protocol.md, Reading; decision 002",
    fix="round to binary32 when actuators are read; in doubt read a double and convert it",
    needs=["S3.1"],
)
def binary32(server: Server) -> None:
    """Decimals with many digits, then the shortest that round to the same binary32."""
    count = server.actuators
    long = Always(tuple(0.1000000001 + 0.2 * (index % 3) for index in range(count)))
    short = Always(tuple((0.1, 0.3, 0.5)[index % 3] for index in range(count)))
    effective(server, short, Wander(count, seed=5))
    difference = server.play(short).difference(server.play(long))
    if difference:
        raise Failure(
            f"with 0.1000000001 instead of 0.1 {difference}",
            "the same: both are the binary32 0.1",
            f'"actuator": {list(long.values)} to all agents, after {list(short.values)} in another episode',
        )
