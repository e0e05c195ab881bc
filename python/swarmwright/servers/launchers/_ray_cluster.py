"""A Ray cluster with an actor for each server; in the process of `_driver`."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import ray
from ray.exceptions import GetTimeoutError, RayError

from swarmwright.servers.launchers._base import Health
from swarmwright.servers.launchers._slot import GRACE_S, End, Slot
from swarmwright.servers.launchers._specification import Specification

if TYPE_CHECKING:
    from swarmwright.servers.launchers.ray import RayOptions

_ANSWER_S = 5.0
"""Seconds for a question to an actor."""


@dataclass
class _Actor:
    """An actor, and what it will return: where it is, and how its server ended."""

    handle: Any
    where: Any
    end: Any
    host: str | None = None
    ended: End | None = None


class Cluster:
    """A connection to a Ray cluster.

    Args:
        options: of the launcher.
        specification: of the servers.
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
        wanted = {"CPU": options.num_cpus, "GPU": options.num_gpus, "memory": options.memory or 0}
        self._wanted = {name: size for name, size in {**wanted, **options.resources}.items() if size > 0}

    def start(self, servers: Sequence[int]) -> None:
        """Create actors."""
        options = self._options
        given = {
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
            named = kind.options(name=f"{self._label}-{server}", **given)
            handle = named.remote(self._specification, server, options.code)
            self._actors[server] = _Actor(handle, handle.where.remote(), handle.run.remote())

    def health(self) -> Mapping[int, Health]:
        """Return the states of all actors."""
        pending = [actor.where for actor in self._actors.values() if actor.host is None]
        pending += [actor.end for actor in self._actors.values() if actor.ended is None]
        done = set(ray.wait(pending, num_returns=len(pending), timeout=0)[0]) if pending else set()
        waits = ""
        found = {}
        for server, actor in self._actors.items():
            if actor.ended is None and actor.end in done:
                actor.ended = _end(actor.end)
                self._printed[server] = actor.ended.lines
            elif actor.host is None and actor.where in done:
                with suppress(RayError):  # then `run` fails, too
                    actor.host = ray.get(actor.where)
            if actor.ended is not None:
                found[server] = Health("ended", actor.ended.words)
            elif actor.host is not None:
                found[server] = Health("running")
            else:
                waits = waits or self._reason()
                found[server] = Health("waiting", waits)
        return found

    def stop(self, servers: Sequence[int]) -> None:
        """End servers by SIGTERM, then their actors."""
        leaving = {server: self._actors.pop(server) for server in servers if server in self._actors}
        running = [actor for actor in leaving.values() if actor.ended is None and self._is_there(actor)]
        for entry in running:
            entry.handle.stop.remote()
        if running:
            ends = [actor.end for actor in running]
            ray.wait(ends, num_returns=len(ends), timeout=GRACE_S + _ANSWER_S)
        for entry in leaving.values():
            with suppress(RayError, ValueError):
                ray.kill(entry.handle)

    def logs(self, server: int, lines: int) -> Sequence[str]:
        """Return the last lines of a server."""
        actor = self._actors.get(server)
        if actor is None or actor.ended is not None or not self._is_there(actor):
            return list(self._printed.get(server, ()))[-lines:]
        with suppress(RayError, GetTimeoutError):
            found: Sequence[str] = ray.get(actor.handle.tail.remote(lines), timeout=_ANSWER_S)
            return found
        return []

    def close(self) -> None:
        """End all actors, and the connection."""
        self.stop(list(self._actors))
        ray.shutdown()

    def _is_there(self, actor: _Actor) -> bool:
        """Whether an actor has been placed."""
        return actor.host is not None or bool(ray.wait([actor.where], timeout=0)[0])

    def _reason(self) -> str:
        """Say why actors wait."""
        nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        wanted = _shown(self._wanted)
        if not any(all(node.get(name, 0) >= size for name, size in self._wanted.items()) for node in nodes):
            have = "; ".join(sorted({_shown(node) for node in nodes}))
            return f"no node of the cluster has {wanted}; nodes have {have or 'nothing'}"
        free = ray.available_resources()
        shown = _shown({name: free.get(name, 0) for name in self._wanted})
        return f"starting, or waiting for {wanted}; free in the cluster: {shown}"


def _end(reference: Any) -> End:  # noqa: ANN401 - a reference of Ray
    try:
        found: End = ray.get(reference)
    except RayError as error:
        return End(f"lost: {_words(error)}")
    return found


def _words(error: Exception) -> str:
    """Return what Ray says, without the traceback on the worker."""
    lines = [line.strip() for line in str(error).strip().splitlines() if line.strip()]
    if (lines and lines[0].startswith("ray::")) or "Traceback" in str(error):
        return lines[-1]
    return " ".join(lines[:8]) or type(error).__name__


def _shown(resources: Mapping[str, float]) -> str:
    """Return resources as text, without those that Ray itself adds to nodes."""
    known = {name: size for name, size in resources.items() if not name.startswith(("node:", "object_store"))}
    return "{" + ", ".join(f"{name}: {size:g}" for name, size in sorted(known.items())) + "}"
