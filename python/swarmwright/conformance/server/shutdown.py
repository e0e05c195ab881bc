"""S13: shutdown. The last rule, because the server is gone afterwards."""

import signal

from swarmwright.conformance._process import GRACE_S
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._retained import kept
from swarmwright.conformance.server._rules import rule
from swarmwright.servers.broker.client import PRESENCE, Failure


@rule(
    "S13.1",
    "Asked to end (SIGTERM), it removes its presence and ends.",
    where="protocol.md, Presence",
    fix="on SIGTERM publish an empty retained presence message, disconnect, exit",
    needs=["S1.1"],
)
def leaves(server: Server) -> str:
    """SIGTERM to the process that the kit started."""
    if server.process is None:
        raise Skip("the kit did not start the server (--exec)")
    topic = f"{PRESENCE}{server.id}"
    announced = bool(kept(server, [topic]))
    server.left = True
    server.process.signal(signal.SIGTERM)
    if server.process.wait(GRACE_S) is None:
        raise Failure(f"it still ran {GRACE_S:g} s later", "its end", "SIGTERM")
    if not announced:
        return "no presence to be removed"
    left = kept(server, [topic])
    if left:
        raise Failure(f"the broker still keeps {left[0]}", "no presence message", "SIGTERM")
    return f"exit status {server.process.status}"
