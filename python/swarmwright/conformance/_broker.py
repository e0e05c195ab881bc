"""The broker between the kit and its peer."""

from contextlib import ExitStack
from urllib.parse import urlsplit

from swarmwright import _engine
from swarmwright.conformance._proxy import Door

OPEN = (
    "The kit's broker admits every user of this machine, since peers need not have accounts; "
    "--broker names another."
)


def open_broker(
    broker: str | None, stack: ExitStack, *, stranger: bool
) -> tuple[str, str | None, Door | None]:
    """Address for the kit, that of the embedded broker if there is one, and the door for the peer.

    The embedded broker admits every client, since peers need not have accounts.

    stranger: the peer is started by another party, who knows the address of the broker.
    """
    if broker is None:
        embedded = _engine.Broker()
        stack.callback(embedded.stop)
        address, direct = embedded.url, embedded.url
    else:
        address, direct = broker, None
    parts = urlsplit(address)
    if parts.scheme != "mqtt" or (broker is not None and stranger):
        return address, direct, None
    assert parts.hostname is not None
    door = Door(parts.hostname, parts.port or 1883)
    stack.callback(door.close)
    return address, direct, door
