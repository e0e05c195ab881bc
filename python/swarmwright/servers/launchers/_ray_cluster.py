"""A Ray cluster with one actor per server, used in the process of `_driver`."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import ray
from ray.exceptions import GetTimeoutError, RayError

from swarmwright.servers.launchers._base import Health, Specification
from swarmwright.servers.launchers._slot import GRACE_S, End, Slot

if TYPE_CHECKING:
    from swarmwright.servers.launchers.ray import RayOptions

_ANSWER_S = 5.0
"""Time limit for answers of actors, seconds."""


@dataclass
class _Actor:
    """An actor, with references to its host and to the end of its server."""

    handle: Any
    host_reference: Any
    end_reference: Any
    host: str | None = None
    ended: End | None = None


class Cluster:
    """A connection to a Ray cluster.

    Args:
        options: options of the launcher.
        specification: specification of the servers.
    """

    def __init__(self, options: "RayOptions", specification: Specification) -> None:
        ray.init(
            address=options.address or os.environ.get("RAY_ADDRESS", "auto"),
            log_to_driver=False,
            logging_level="ERROR",
        )
        self._options, self._label = options, specification.label
        self._specification = ray.put(specification)
        self._actors: dict[int, _Actor] = {}
        self._printed: dict[int, Sequence[str]] = {}
        required = {"CPU": options.num_cpus, "GPU": options.num_gpus, "memory": options.memory or 0}
        self._required = {name: size for name, size in {**required, **options.resources}.items() if size > 0}

    def start(self, servers: Sequence[int]) -> None:
        """Create actors."""
        options = self._options
        actor_options = {
            "num_cpus": options.num_cpus,
            "num_gpus": options.num_gpus or None,
            "memory": options.memory,
            "resources": options.resources or None,
            "runtime_env": options.runtime_env or None,
            "scheduling_strategy": "SPREAD",
            "max_concurrency": 4,  # `run` is one of them
            "max_restarts": 0,
        }
        kind = ray.remote(Slot)
        for server in servers:
            actor_class = kind.options(name=f"{self._label}-{server}", **actor_options)
            handle = actor_class.remote(self._specification, server, options.code)
            self._actors[server] = _Actor(handle, handle.node_name.remote(), handle.run.remote())

    def health(self) -> Mapping[int, Health]:
        """Return the states of all actors."""
        pending = [actor.host_reference for actor in self._actors.values() if actor.host is None]
        pending += [actor.end_reference for actor in self._actors.values() if actor.ended is None]
        done = set(ray.wait(pending, num_returns=len(pending), timeout=0)[0]) if pending else set()
        waits = ""
        states = {}
        for server, actor in self._actors.items():
            if actor.ended is None and actor.end_reference in done:
                actor.ended = _find_end(actor.end_reference)
                self._printed[server] = actor.ended.lines
            elif actor.host is None and actor.host_reference in done:
                with suppress(RayError):  # `run` fails as well
                    actor.host = ray.get(actor.host_reference)
            if actor.ended is not None:
                states[server] = Health("ended", actor.ended.words)
            elif actor.host is not None:
                states[server] = Health("running")
            else:
                waits = waits or self._explain_waiting()
                states[server] = Health("waiting", waits)
        return states

    def stop(self, servers: Sequence[int]) -> None:
        """End servers by SIGTERM, then their actors."""
        leaving = {server: self._actors.pop(server) for server in servers if server in self._actors}
        running = [actor for actor in leaving.values() if actor.ended is None and self._is_placed(actor)]
        for entry in running:
            entry.handle.stop.remote()
        if running:
            ends = [actor.end_reference for actor in running]
            ray.wait(ends, num_returns=len(ends), timeout=GRACE_S + _ANSWER_S)
        for entry in leaving.values():
            with suppress(RayError, ValueError):
                ray.kill(entry.handle)

    def logs(self, server: int, lines: int) -> Sequence[str]:
        """Return the last lines of a server."""
        actor = self._actors.get(server)
        if actor is None or actor.ended is not None or not self._is_placed(actor):
            return list(self._printed.get(server, ()))[-lines:]
        with suppress(RayError, GetTimeoutError):
            tail: Sequence[str] = ray.get(actor.handle.tail.remote(lines), timeout=_ANSWER_S)
            return tail
        return []

    def close(self) -> None:
        """End all actors, and the connection."""
        self.stop(list(self._actors))
        ray.shutdown()

    def _is_placed(self, actor: _Actor) -> bool:
        """Whether Ray has placed an actor on a node."""
        return actor.host is not None or bool(ray.wait([actor.host_reference], timeout=0)[0])

    def _explain_waiting(self) -> str:
        """Explain why actors wait."""
        nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        required = _format_resources(self._required)
        if not any(all(node.get(name, 0) >= size for name, size in self._required.items()) for node in nodes):
            have = "; ".join(sorted({_format_resources(node) for node in nodes}))
            return f"no node of the cluster has {required}; nodes have {have or 'nothing'}"
        free = ray.available_resources()
        available = _format_resources({name: free.get(name, 0) for name in self._required})
        return f"starting, or waiting for {required}; free in the cluster: {available}"


def _find_end(reference: Any) -> End:  # noqa: ANN401 - a reference of Ray
    try:
        end: End = ray.get(reference)
    except RayError as error:
        return End(f"lost: {_format_error(error)}")
    return end


def _format_error(error: Exception) -> str:
    """Return Ray's message without the traceback of the worker."""
    lines = [line.strip() for line in str(error).strip().splitlines() if line.strip()]
    if (lines and lines[0].startswith("ray::")) or "Traceback" in str(error):
        return lines[-1]
    return " ".join(lines[:8]) or type(error).__name__


def _format_resources(resources: Mapping[str, float]) -> str:
    """Format resources, without those that Ray adds to nodes."""
    relevant = {
        name: size for name, size in resources.items() if not name.startswith(("node:", "object_store"))
    }
    return "{" + ", ".join(f"{name}: {size:g}" for name, size in sorted(relevant.items())) + "}"
