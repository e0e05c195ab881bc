"""S12: speed. Reported, not judged."""

import time

from swarmwright import _engine
from swarmwright.conformance._extensions import controller_set
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule

MEASUREMENT_S = 0.5
"""Seconds that are aimed at for one measurement."""


def _measured(server: Server, mode: str) -> str:
    server.announces(mode=mode)
    steps = server.reference.messages / len(server.reference.readings)
    if server.own_broker is None:
        raise Skip("other clients use this broker; let the kit start one")
    known = server.announced.get("controllers", ["layered"]) if mode == "offloaded" else ["layered"]
    if "layered" not in known:
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
    """Layered networks, one episode after the other, as an optimization tool would."""
    return _measured(server, "stepwise")


@rule(
    "S12.2",
    "Batched: episodes and steps per second (measured, not judged).",
    where="explanation/performance.md",
    fix="step the episodes of a batch side by side",
    needs=["S10.1"],
    seconds=60,
)
def batched(server: Server) -> str:
    """As stepwise."""
    return _measured(server, "batched")


@rule(
    "S12.3",
    "Offloaded: episodes and steps per second (measured, not judged).",
    where="explanation/performance.md",
    fix="evaluate the candidates of a request without a message between them",
    needs=["S9.1"],
    seconds=60,
)
def offloaded(server: Server) -> str:
    """As stepwise."""
    return _measured(server, "offloaded")
