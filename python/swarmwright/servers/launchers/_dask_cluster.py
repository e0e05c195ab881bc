"""A Dask cluster with a task for each server; in the process of `_driver`."""

import os
import platform
import secrets
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from distributed import Client, get_worker, wait

from swarmwright.servers.launchers._base import Health, LauncherError
from swarmwright.servers.launchers._slot import GRACE_S, End, Slot
from swarmwright.servers.launchers._specification import Specification

if TYPE_CHECKING:
    from swarmwright.servers.launchers.dask import DaskOptions

_CONNECT_S = 15.0
"""Seconds for reaching the scheduler."""
_ANSWER_S = 5.0
"""Seconds for a question to workers."""
_SLOTS: dict[str, Slot] = {}
"""On a worker: the servers that run in it, by their tasks' names."""


def serve(specification: Specification, server: int, code: str | None, key: str, topic: str) -> End:
    """Run a server on a worker, to its end."""
    worker = get_worker()
    slot = _SLOTS[key] = Slot(specification, server, code, worker.local_directory)
    try:
        worker.log_event(topic, {"server": server, "worker": worker.address})
        return slot.run()
    finally:
        del _SLOTS[key]


def end(keys: Sequence[str]) -> None:
    """End servers of this worker, without waiting."""
    for slot in [_SLOTS[key] for key in keys if key in _SLOTS]:
        slot.stop()


def tail(key: str, lines: int) -> list[str]:
    """Return what a server of this worker has printed last."""
    slot = _SLOTS.get(key)
    return [] if slot is None else slot.tail(lines)


@dataclass
class _Task:
    """A task, and how its server ended."""

    key: str
    future: Any
    ended: End | None = None


class Cluster:
    """A connection to a Dask cluster.

    Args:
        options: of the launcher.
        specification: of the servers.

    Raises:
        LauncherError: workers have another version of Python.
    """

    def __init__(self, options: "DaskOptions", specification: Specification) -> None:
        where = options.address or os.environ.get("DASK_SCHEDULER_ADDRESS")
        given: dict[str, Any] = {"address": where}
        if options.scheduler_file is not None:
            if not Path(options.scheduler_file).is_file():
                raise LauncherError(f"scheduler_file: {options.scheduler_file} is not there")
            given = {"scheduler_file": options.scheduler_file}
        warnings.simplefilter("ignore")  # about versions, which are compared below
        self._client = Client(**given, timeout=_CONNECT_S)
        self._compare_versions()
        self._options, self._label = options, specification.label
        self._topic = f"swarmwright-{secrets.token_hex(8)}"
        self._tasks: dict[int, _Task] = {}
        self._printed: dict[int, Sequence[str]] = {}
        self._specification = specification

    def start(self, servers: Sequence[int]) -> None:
        """Submit tasks."""
        for server in servers:
            key = f"{self._label}-{self._topic[-8:]}-{server}"
            future = self._client.submit(
                serve,
                self._specification,
                server,
                self._options.code,
                key,
                self._topic,
                key=key,
                resources=self._options.resources or None,
                pure=False,
                retries=0,
            )
            self._tasks[server] = _Task(key, future)

    def health(self) -> Mapping[int, Health]:
        """Return the states of all tasks."""
        workers = self._workers()
        started = self._started()
        waits = self._reason(workers)
        found = {}
        for server, task in self._tasks.items():
            if task.ended is None and task.future.done():
                task.ended = _end(task.future)
                self._printed[server] = task.ended.lines
            if task.ended is not None:
                found[server] = Health("ended", task.ended.words)
            elif started.get(server) in workers:
                found[server] = Health("running")
            else:
                found[server] = Health("waiting", waits)
        return found

    def stop(self, servers: Sequence[int]) -> None:
        """End servers by SIGTERM, and drop tasks that have not begun."""
        leaving = {server: self._tasks.pop(server) for server in servers if server in self._tasks}
        unfinished = [task for task in leaving.values() if not task.future.done()]
        if not unfinished:
            return
        started = self._started()
        running = {task.key for server, task in leaving.items() if server in started}
        for leaving_task in unfinished:
            if leaving_task.key not in running:
                leaving_task.future.cancel()
        # Those that began in the meantime are ended, too: all workers are told.
        self._client.run(end, [task.key for task in unfinished], on_error="ignore")
        if running:
            with suppress(TimeoutError):
                wait([task.future for task in unfinished if task.key in running], timeout=GRACE_S + _ANSWER_S)
        for leaving_task in leaving.values():
            leaving_task.future.cancel()

    def logs(self, server: int, lines: int) -> Sequence[str]:
        """Return the last lines of a server."""
        task = self._tasks.get(server)
        worker = self._started().get(server)
        if task is None or task.ended is not None or worker is None:
            return list(self._printed.get(server, ()))[-lines:]
        found = self._client.run(tail, task.key, lines, workers=[worker], on_error="ignore")
        return list(found.get(worker, ()))

    def close(self) -> None:
        """End all tasks, and the connection."""
        self.stop(list(self._tasks))
        self._client.close(timeout=_ANSWER_S)

    def _workers(self) -> dict[str, Any]:
        """Return the cluster's workers, by address. Raises LauncherError."""
        if self._client.status != "running":
            raise LauncherError("the connection to the scheduler is lost")
        workers: dict[str, Any] = self._client.scheduler_info(n_workers=-1)["workers"]
        return workers

    def _started(self) -> dict[int, str]:
        """Return the workers of servers that have begun; the last, where Dask repeated a lost task."""
        return {event["server"]: event["worker"] for _, event in self._client.get_events(self._topic)}

    def _compare_versions(self) -> None:
        own = platform.python_version()
        found = self._client.get_versions()["workers"]
        others = {str(client["host"]["python"]).split(".final")[0] for client in found.values() if client}
        wrong = sorted(other for other in others if other.split(".")[:2] != own.split(".")[:2])
        if wrong:
            raise LauncherError(
                f"workers have Python {', '.join(wrong)}, this machine {own}; Dask needs the same on both"
            )

    def _reason(self, workers: Mapping[str, Any]) -> str:
        """Say why tasks wait."""
        if not workers:
            return "for workers: the cluster has none"
        wanted = self._options.resources
        if not any(
            all(worker["resources"].get(name, 0) >= size for name, size in wanted.items())
            for worker in workers.values()
        ):
            have = sorted({_shown(worker["resources"]) for worker in workers.values()})
            return f"no worker of the cluster has {_shown(wanted)}; workers have {'; '.join(have)}"
        threads = sum(worker["nthreads"] for worker in workers.values())
        free = f" with {_shown(wanted)}" if wanted else ""
        return f"for a free thread of a worker{free}; {len(workers)} workers have {threads} threads"


def _end(future: Any) -> End:  # noqa: ANN401 - of Dask
    if future.status == "finished":
        found: End = future.result()
        return found
    if future.cancelled():
        return End("lost: the task was cancelled, or the scheduler was restarted")
    error = future.exception()
    return End(f"lost: {str(error).strip() or type(error).__name__}")


def _shown(resources: Mapping[str, float]) -> str:
    return "{" + ", ".join(f"{name}: {size:g}" for name, size in sorted(resources.items())) + "}"
