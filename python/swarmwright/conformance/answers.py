"""Who answers a discovery: it finds servers that publish no presence."""

from collections.abc import Collection, Sequence
from typing import Any

from swarmwright.conformance._client import Client, Message
from swarmwright.conformance._json import is_number, new_hash


def answers(
    broker: str, simulation: str, dimensions: Sequence[float], *, prefix: str = "", wait: float = 1.0
) -> list[dict[str, Any]]:
    """Send a discovery for each number of dimensions, as D6.1 defines it.

    Returns the answers that come within `wait` seconds, one for each server, sorted by id: `server`,
    `simulations`, `capabilities`. Servers that are taken or do not fit are silent. Those that answer stay
    free, because no parameters follow.

    Raises RunError when the broker cannot be reached.
    """
    found: dict[int, dict[str, Any]] = {}
    with Client(broker, prefix, ["server"]) as client:
        hashes = {new_hash(): {"dimensions": number} for number in dimensions}
        for hash_, needs in hashes.items():
            client.send("discovery", simulation=simulation, simulation_hash=hash_, requirements=needs)
        for message in client.drain(wait):
            answer = _answer(message, hashes)
            if answer is not None:
                found.setdefault(answer["server"], answer)
    return [found[server] for server in sorted(found)]


def _answer(message: Message, hashes: Collection[str]) -> dict[str, Any] | None:
    """What a server says of itself; None where it says that to another tool, or breaks the schema."""
    content = message.maybe
    server, hash_ = content.get("server"), content.get("simulation_hash")
    if message.retained or not is_number(server) or server != int(server):
        return None
    if not isinstance(hash_, str) or hash_ not in hashes:
        return None
    simulations, capabilities = content.get("simulations"), content.get("capabilities")
    return {
        "server": int(server),
        "simulations": simulations if isinstance(simulations, list) else [],
        "capabilities": capabilities if isinstance(capabilities, dict) else {},
    }
