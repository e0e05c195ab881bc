"""S12 and S13: speed, which is measured and not judged; shutdown, the last rule."""

import signal
import time
from statistics import median

from swarmwright import _engine
from swarmwright.conformance._extensions import controller_set
from swarmwright.conformance._process import GRACE_S
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import Note, Skip
from swarmwright.conformance.server._retained import read_retained
from swarmwright.conformance.server._rules import rule
from swarmwright.servers.broker.client import PRESENCE, Failure

MEASUREMENT_S = 0.5
"""Target duration of a measurement in seconds."""
STEPS = 15
"""Steps over which the time between sensor messages is measured."""
LISTENING_S = 0.12
"""Seconds within which the sensor messages of a step arrive, including delayed acknowledgements (40 ms on
Linux)."""
HELD_BACK_S = 0.03
"""Seconds between the sensor messages of a step from which they seem to be held back."""


def _measure(server: Server, mode: str) -> str:
    server.announces(mode=mode)
    steps = server.reference.messages / len(server.reference.readings)
    if server.own_broker is None:
        raise Skip("other clients use this broker; let the kit start one")
    kinds = server.announced.get("controllers", ["layered"]) if mode == "offloaded" else ["layered"]
    if "layered" not in kinds:
        raise Skip("not announced: capabilities.swarmwright.controllers lacks 'layered'")
    pool = _engine.Pool(
        server.own_broker,
        simulation=server.settings.title,
        parameters=server.settings.parameters,
        requirements={"dimensions": server.settings.dimensions},
        sensors=server.sensors,
        actuators=server.actuators,
        prefix=server.prefix,
        tool="conformance/a",
        mode=mode,
        timeouts={"step": max(1.0, server.settings.timeout)},
        alone=True,
    )
    server.tools.add("conformance/a")
    try:
        pool.wait_for_server()
        count, seconds, rate = 1, 0.0, 0.0
        while seconds < MEASUREMENT_S / 4:
            count = max(
                count * 2, min(100_000, int(count * MEASUREMENT_S / max(seconds, MEASUREMENT_S / 64)))
            )
            controllers = controller_set(server, "layered", count)
            start = time.perf_counter()
            pool.evaluate(controllers.architecture, controllers.weights, [1])
            seconds = time.perf_counter() - start
            rate = count / seconds
            if count >= 100_000:
                break
    finally:
        pool.close()
    measured = f"{count} episodes of {steps:.0f} steps in {seconds:.2f} s"
    return f"{_short(rate)} episodes/s, {_short(rate * steps)} steps/s ({measured})"


def _short(value: float) -> str:
    return f"{value:,.0f}" if value >= 10 else f"{value:.2g}"


@rule(
    "S12.1",
    "Stepwise: episodes and steps per second (measured, not judged).",
    where="explanation/performance.md",
    fix="switch Nagle's algorithm off (TCP_NODELAY)",
    needs=["S2.8"],
    seconds=60,
)
def stepwise(server: Server) -> str:
    """Play layered networks, one episode after the other, as an optimization tool would."""
    return _measure(server, "stepwise")


@rule(
    "S12.2",
    "Batched: episodes and steps per second (measured, not judged).",
    where="explanation/performance.md",
    fix="step the episodes of a batch side by side",
    needs=["S10.1"],
    seconds=60,
)
def measure_batched(server: Server) -> str:
    """Play batches of layered networks."""
    return _measure(server, "batched")


@rule(
    "S12.3",
    "Offloaded: episodes and steps per second (measured, not judged).",
    where="explanation/performance.md",
    fix="evaluate the candidates of a request without messages in between",
    needs=["S9.1"],
    seconds=60,
)
def measure_offloaded(server: Server) -> str:
    """Evaluate layered networks offloaded."""
    return _measure(server, "offloaded")


@rule(
    "S12.4",
    "Stepwise: time between the first and the last sensor message of a step (measured, not judged).",
    where="Topics",
    fix="switch Nagle's algorithm off (TCP_NODELAY)",
    needs=["S2.8"],
    seconds=30,
)
def measure_spread(server: Server) -> Note:
    """Answer agents only when all were asked, since earlier answers would carry acknowledgements."""
    agents = len(server.reference.readings)
    episode = server.episode()
    episode.configure()
    sent = episode.start()
    spans: list[float] = []
    while len(spans) < STEPS and not episode.over and episode.receive(sent):
        first = episode.last_at
        # Answer no later than necessary, since a delay would make the server acknowledge the next messages at
        # once.
        while len(episode.pending) < agents:
            message = server.client.next(episode.is_mine, max(server.quiet, LISTENING_S))
            if message is None or not episode.take(message):
                break
        agents = len(episode.pending)
        if agents > 1:
            spans.append(episode.last_at - first)
        for agent, turn, sensors in list(episode.pending):
            sent = episode.answer(agent, server.policy(agent, turn, sensors))
    if not episode.over:
        episode.stop()
    if not spans:
        raise Skip("no step asks several agents; give parameters with several agents (--parameters)")
    span = median(spans)
    text = f"{span * 1e3:.1f} ms in the median of {len(spans)} steps"
    if span < HELD_BACK_S:
        return Note(text)
    why = "small packets seem to be held back (Nagle's algorithm): set TCP_NODELAY on the server's socket"
    return Note(f"{text}; {why}", doubt=f"{span * 1e3:.0f} ms between the sensor messages of a step: {why}")


@rule(
    "S13.1",
    "On SIGTERM, it removes its presence and exits.",
    where="protocol.md, Presence",
    fix="on SIGTERM, publish an empty retained presence message, disconnect, exit",
    needs=["S1.1"],
)
def leaves(server: Server) -> str:
    """Send SIGTERM to the process that the kit started."""
    if server.process is None:
        raise Skip("the kit did not start the server (--exec)")
    topic = f"{PRESENCE}{server.id}"
    announced = bool(read_retained(server, [topic]))
    server.left = True
    server.process.signal(signal.SIGTERM)
    if server.process.wait(GRACE_S) is None:
        raise Failure(f"it still ran {GRACE_S:g} s later", "its end", "SIGTERM")
    if not announced:
        return "no presence to be removed"
    left = read_retained(server, [topic])
    if left:
        raise Failure(f"the broker still keeps {left[0]}", "no presence message", "SIGTERM")
    return f"exit status {server.process.status}"
