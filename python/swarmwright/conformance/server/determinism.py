"""S3 and S4: determinism of episodes, handling of actuators."""

from swarmwright.common.json_text import Json, is_number
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance._trajectory import Always, Policy, Trajectory, Wander
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import play_until_several
from swarmwright.servers.broker.client import Failure

SAME = "decision 002; protocol.md, Presence"
SEED_UNUSED = (
    "the seeds 1 and 2 give the same episode: the server ignores seed, or nothing is random with these "
    "parameters; give --parameters with which something is, or --vary another parameter"
)
SEED_UNUSED_ADVICE = (
    "The seeds 1 and 2 gave the same episode: either the server ignores the parameter seed, and all episodes "
    "of a run would be the same, or nothing is random with these --parameters."
)
SEED_DOUBT = "the seed changed nothing: is it ignored?"
LARGEST_SEED = 2**63 - 1
BEYOND_32_BITS = 5 * 2**32
"""Difference of two seeds that are equal if only 32 bits are read. Not 2^32, because Ruby's `Random.new`
drops a leading word of 1 and so gives 1 and 2^32 + 1 the same state."""
PAIRS = 8
"""Pairs of seeds that must all give equal episodes before bits count as lost: two seeds can be equal by
chance, for example with few start positions. Testing stops at the first pair that differs."""


def read_determinism(server: Server) -> str | None:
    """Return `capabilities.swarmwright.determinism`; None if it is missing."""
    declaration = server.announced.get("determinism")
    return declaration if isinstance(declaration, str) else None


def another(server: Server) -> Trajectory:
    """Play an episode with other actuators and another seed."""
    policy = Wander(server.actuators, seed=77) if server.trajectory and server.trajectory.messages else None
    return server.play(policy, {**server.settings.parameters, "seed": 77})


def seeded(server: Server, seed: int) -> Json:
    """Return the parameters with a seed."""
    return {**server.settings.parameters, "seed": seed}


@rule(
    "S3.1",
    "Equal parameters and actuators give the same episode, to the last bit.",
    where=SAME,
    fix="take random numbers only from the seed, use no clock; or declare "
    'capabilities.swarmwright.determinism "statistical" or "none"',
    needs=["S2.5", "S2.8"],
)
def deterministic(server: Server) -> str | None:
    """Play an episode twice, each time after the same other one."""
    declaration = read_determinism(server)
    another(server)
    trajectory = server.play(parameters=seeded(server, 1))
    another(server)
    two = server.play(parameters=seeded(server, 1))
    difference = trajectory.difference(two)
    if declaration in {"none", "statistical"}:
        server.deterministic = False
        if declaration == "statistical":
            _check_tolerance(server, trajectory, two)
        raise Skip(f'declared "{declaration}"; twice the same episode: {difference or "the same bits"}')
    if difference:
        server.deterministic = False
        promise = 'declared "bitwise"' if declaration else "nothing else is declared"
        raise Failure(
            f"in two episodes {difference}",
            f"the same bits ({promise})",
            "the same parameters and actuators twice",
        )
    server.deterministic = True
    return 'declared "bitwise"' if declaration else None


def _check_tolerance(server: Server, first: Trajectory, second: Trajectory) -> None:
    tolerance = server.announced.get("tolerance")
    if not is_number(tolerance):
        return
    pairs = {"the fitness": (first.fitness or 0.0, second.fitness or 0.0)}
    pairs |= {
        f"metric {name}": (first.metrics[name], second.metrics[name])
        for name in first.metrics.keys() & second.metrics
    }
    for name, (low, high) in pairs.items():
        if abs(low - high) > tolerance * max(1.0, abs(low), abs(high)):
            raise Failure(
                f"{name} is {low!r} and {high!r}",
                f'no more apart than the declared "tolerance" {tolerance}',
            )


@rule(
    "S3.2",
    "An episode does not depend on the one before it.",
    where=SAME,
    fix="reset everything at the start: positions, counters, controllers, random numbers",
    needs=["S3.1", "S2.9"],
)
def forgets(server: Server) -> None:
    """Play an episode after itself, after another one, and after one that was aborted."""
    server.comparable()
    first = server.play(parameters=seeded(server, 1))
    second = server.play(parameters=seeded(server, 1))
    difference, after = first.difference(second), "itself"
    if not difference:
        another(server)
        second = server.play(parameters=seeded(server, 1))
        difference, after = first.difference(second), "another one"
    if not difference:
        cut = server.episode()
        cut.configure()
        cut.start()
        cut.receive()
        cut.stop()
        server.must_answer("an answer: the episode was ended")
        second = server.play(parameters=seeded(server, 1))
        difference, after = first.difference(second), "one that was ended"
    if difference:
        came = f"{difference}, the second time after {after}"
        if first.find_sensor_difference(second):
            server.deterministic, server.repeats, server.carries_over = None, False, True
        else:
            server.sensors_only = True
            came += "; the sensors were the same: the fitness is of an earlier episode, or computed late"
        raise Failure(came, "the same bits whatever was before")


def skip_unused_seed(server: Server) -> Skip:
    """Return the reason to skip a rule that needs two seeds with different episodes.

    With --vary, the seed is known to change nothing, so the reason has no doubt.
    """
    if server.settings.vary:
        return Skip(SEED_UNUSED)
    return Skip(SEED_UNUSED, SEED_UNUSED_ADVICE, SEED_DOUBT)


def differing(server: Server) -> tuple[Json, Json, Trajectory, Trajectory]:
    """Return two sets of parameters with different trajectories; skip the rule if none are found."""
    server.comparable()
    first_trajectory, second_trajectory = seeded(server, 1), seeded(server, 2)
    first, second = server.play(parameters=first_trajectory), server.play(parameters=second_trajectory)
    if server.settings.vary and not first.difference(second):
        second_trajectory = {**first_trajectory, **server.settings.vary}
        second = server.play(parameters=second_trajectory)
    if not first.difference(second):
        raise skip_unused_seed(server)
    return first_trajectory, second_trajectory, first, second


@rule(
    "S3.3",
    "Control starts an episode with the latest parameters of its hash.",
    where="protocol.md, An episode, 3",
    fix="replace the parameters of a hash when new ones arrive",
    needs=["S3.1"],
)
def the_last_count(server: Server) -> None:
    """Send parameters with one seed, then with another, for the same hash."""
    first_trajectory, second_trajectory, _, second = differing(server)
    episode = server.episode(first_trajectory)
    episode.configure()
    sent = episode.configure(**second_trajectory)
    episode.start()
    difference = second.difference(episode.play())
    if difference:
        raise Failure(f"{difference}: the parameters before", "the parameters received last", sent)


@rule(
    "S3.4",
    "Parameters with another hash change nothing.",
    where="protocol.md, An episode, 3",
    fix="store parameters by hash, for several tools at once",
    needs=["S3.1"],
)
def separates_hashes(server: Server) -> None:
    """Send parameters with two hashes, then control with the first."""
    first_trajectory, second_trajectory, first, _ = differing(server)
    episode, other = server.episode(first_trajectory), server.episode(second_trajectory)
    episode.configure()
    sent = other.configure()
    other.over = True
    episode.start()
    difference = first.difference(episode.play())
    if difference:
        raise Failure(f"{difference}: the parameters of the other hash", "those of the control's hash", sent)


@rule(
    "S3.5",
    "All 64 bits of the seed count: those beyond the lowest 32, differences of 1 beyond 2^53, and 2^63 - 1.",
    where="protocol.md, An episode, 2",
    fix="read the seed as a 64-bit integer; if the generator takes 32 bits, fold it: seed ^ seed >> 32",
    needs=["S3.1"],
)
def exact_seed(server: Server) -> None:
    """Play an episode with the largest seed, then pairs of seeds that are equal if bits are lost."""
    episode = server.episode(seeded(server, LARGEST_SEED))
    sent = f"{episode.configure()}, then {episode.start()}"
    episode.receive(sent)
    episode.play()
    server.comparable()
    if not server.play(parameters=seeded(server, 1)).difference(server.play(parameters=seeded(server, 2))):
        raise skip_unused_seed(server)
    for distance, base, lost in (
        (BEYOND_32_BITS, 1, "as if the seed, or what the generator makes of it, were truncated to 32 bits"),
        (1, 2**53, "as if the seed were read through a double, which has 53 bits"),
    ):
        pairs = [(base + 4 * index, base + 4 * index + distance) for index in range(PAIRS)]
        if all(_alike(server, *pair) for pair in pairs):
            first, second = pairs[0]
            raise Failure(
                f"the same bits with seed {first} and with seed {second}, {lost}",
                "different episodes, as with the seeds 1 and 2",
                f'parameters with "seed": {first}, then with "seed": {second}',
            )


def _alike(server: Server, first: int, second: int) -> bool:
    one_episode, another = (server.play(parameters=seeded(server, seed)) for seed in (first, second))
    return not one_episode.difference(another)


def effective(server: Server, first: Policy, second: Policy) -> tuple[Trajectory, Trajectory]:
    """Return two different trajectories; skip the rule if actuators have no visible effect."""
    server.comparable()
    _ = server.reference
    trajectories = server.play(first), server.play(second)
    if not trajectories[0].difference(trajectories[1]):
        raise Skip("other actuators change nothing that can be seen; give --parameters with longer episodes")
    return trajectories


@rule(
    "S4.1",
    "Actuators outside -1 to +1 are clamped.",
    where="protocol.md, Reading",
    fix="clamp every actuator to -1..+1 when you read it",
    needs=["S3.1"],
)
def clamps_actuators(server: Server) -> None:
    """Send +1 and 7.5, then -1 and -1e30, to all actuators."""
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
    "Actuators of a step may arrive in any order.",
    where="protocol.md, An episode, 4",
    fix="sort actuators by agent, not by arrival",
    needs=["S3.1", "S2.9"],
)
def accepts_any_order(server: Server) -> None:
    """Play a whole episode, answering the last agent of each step first."""
    server.comparable()
    play_until_several(server).stop()
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
    "A second answer for one agent and step is refused.",
    where="protocol.md, Reading",
    fix="keep the first actuators of an agent in a step",
    needs=["S3.1"],
)
def the_first_counts(server: Server) -> None:
    """Send the first agent also the opposite actuators in one step, before the others get theirs."""
    episode = play_until_several(server)
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
    fix="round to binary32 on reading, if necessary from a double",
    needs=["S3.1"],
)
def binary32(server: Server) -> None:
    """Send decimals with many digits, then the shortest ones that round to the same binary32."""
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
