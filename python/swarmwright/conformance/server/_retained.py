"""Retained presence, and which servers must have it."""

from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import Skip
from swarmwright.servers.broker.client import PRESENCE, Client, Message

MODES = ("batched", "offloaded")
"""Modes whose servers have presence and can be reserved by named tools."""


def read_retained(server: Server, topics: list[str]) -> list[Message]:
    """Return the retained messages on these topics."""
    with Client(server.client.url, server.prefix, topics) as client:
        return [message for message in client.drain(server.quiet) if message.retained and message.payload]


def must_have_presence(server: Server) -> bool:
    """Return whether the announcement requires presence: it has an instance, or a mode of `MODES`."""
    modes = server.announced.get("modes")
    return bool(server.instance) or (isinstance(modes, list) and any(mode in modes for mode in MODES))


def skip_without_presence(server: Server) -> None:
    """Skip the rule unless extensions are announced, and presence exists or is required by one of them."""
    server.announces()
    if must_have_presence(server) or read_retained(server, [f"{PRESENCE}{server.id}"]):
        return
    raise Skip(
        "no presence is published, and none is required: capabilities.swarmwright has no instance and none "
        f"of the modes {', '.join(MODES)}"
    )
