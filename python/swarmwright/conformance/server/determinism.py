"""S3: determinism of episodes."""

from swarmwright.conformance._rules import Failure, Skip
from swarmwright.conformance._server_under_test import Server, is_number
from swarmwright.conformance._trajectory import Trajectory, Wander
from swarmwright.conformance.server._rules import rule

SAME = "decision 002; protocol.md, Presence"


def declared(server: Server) -> str | None:
    """`capabilities.swarmwright.determinism`, None when the server does not say."""
    found = server.announced.get("determinism")
    return found if isinstance(found, str) else None


def another(server: Server) -> Trajectory:
    """An episode with other actuators and another seed."""
    policy = Wander(server.actuators, seed=77) if server.trajectory and server.trajectory.messages else None
    return server.play(policy, {**server.settings.parameters, "seed": 77})


def seeded(server: Server, seed: int) -> dict[str, object]:
    """The parameters, with a seed."""
    return {**server.settings.parameters, "seed": seed}


@rule(
    "S3.1",
    "Same parameters, same actuators: the same episode, to the last bit.",
    where=SAME,
    fix="take random numbers from the parameter seed alone, use no clock; or declare "
    'capabilities.swarmwright.determinism "statistical" or "none"',
    needs=["S2.5", "S2.8"],
)
def deterministic(server: Server) -> str | None:
    """An episode twice, each after the same other one."""
    said = declared(server)
    another(server)
    one = server.play(parameters=seeded(server, 1))
    another(server)
    two = server.play(parameters=seeded(server, 1))
    difference = one.difference(two)
    if said in {"none", "statistical"}:
        server.deterministic = False
        if said == "statistical":
            _within_tolerance(server, one, two)
        raise Skip(f'declared "{said}"; twice the same episode: {difference or "the same bits"}')
    if difference:
        server.deterministic = False
        promise = 'declared "bitwise"' if said else "nothing else is declared"
        raise Failure(
            f"in two episodes {difference}",
            f"the same bits ({promise})",
            "the same parameters and actuators twice",
        )
    server.deterministic = True
    return 'declared "bitwise"' if said else None


def _within_tolerance(server: Server, one: Trajectory, two: Trajectory) -> None:
    tolerance = server.announced.get("tolerance")
    if not is_number(tolerance):
        return
    pairs = {"the fitness": (one.fitness or 0.0, two.fitness or 0.0)}
    pairs |= {
        f"metric {name}": (one.metrics[name], two.metrics[name]) for name in one.metrics.keys() & two.metrics
    }
    for name, (first, second) in pairs.items():
        if abs(first - second) > tolerance * max(1.0, abs(first), abs(second)):
            raise Failure(
                f"{name} is {first!r} and {second!r}",
                f'no more apart than the declared "tolerance" {tolerance}',
            )


@rule(
    "S3.2",
    "An episode does not depend on the one before it.",
    where=SAME,
    fix="reset everything when an episode starts: places, counters, controllers, random numbers",
    needs=["S3.1", "S2.9"],
)
def forgets(server: Server) -> None:
    """An episode after itself, after another one, and after one that was ended in the middle."""
    server.comparable()
    first = server.play(parameters=seeded(server, 1))
    difference = first.difference(server.play(parameters=seeded(server, 1)))
    after = "itself"
    if not difference:
        another(server)
        difference, after = first.difference(server.play(parameters=seeded(server, 1))), "another one"
    if not difference:
        cut = server.episode()
        cut.configure()
        cut.start()
        cut.receive()
        cut.stop()
        server.must_answer("an answer: the episode was ended")
        difference, after = first.difference(server.play(parameters=seeded(server, 1))), "one that was ended"
    if difference:
        server.deterministic, server.repeats = None, False
        raise Failure(f"{difference}, the second time after {after}", "the same bits whatever was before")


def differing(server: Server) -> tuple[Trajectory, Trajectory]:
    """The trajectories of seeds 1 and 2; skips the rule when they are the same."""
    server.comparable()
    one, two = (server.play(parameters=seeded(server, seed)) for seed in (1, 2))
    if not one.difference(two):
        raise Skip("the seed changes nothing here; give --parameters with which it does")
    return one, two


@rule(
    "S3.3",
    "Control starts an episode with the parameters received last for its hash.",
    where="protocol.md, An episode, 3",
    fix="replace the parameters of a hash when new ones come",
    needs=["S3.2"],
)
def the_last_count(server: Server) -> None:
    """Parameters with one seed, then with another, same hash."""
    _, two = differing(server)
    episode = server.episode(seeded(server, 1))
    episode.configure()
    sent = episode.configure(seed=2)
    episode.start()
    difference = two.difference(episode.play())
    if difference:
        raise Failure(f"{difference}: the parameters before", "the parameters received last", sent)


@rule(
    "S3.4",
    "Parameters with another hash change nothing.",
    where="protocol.md, An episode, 3",
    fix="keep parameters by their hash, those of several tools side by side",
    needs=["S3.2"],
)
def by_hash(server: Server) -> None:
    """Parameters of two hashes, then control of the first."""
    one, _ = differing(server)
    episode, other = server.episode(seeded(server, 1)), server.episode(seeded(server, 2))
    episode.configure()
    sent = other.configure()
    other.over = True
    episode.start()
    difference = one.difference(episode.play())
    if difference:
        raise Failure(f"{difference}: the parameters of the other hash", "those of the control's hash", sent)
