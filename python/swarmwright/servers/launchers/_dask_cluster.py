"""A Dask cluster with one task per server, used in the process of `_driver`."""

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

from swarmwright.servers.launchers._base import Health, LauncherError, Specification
from swarmwright.servers.launchers._slot import GRACE_S, End, Slot

if TYPE_CHECKING:
    from swarmwright.servers.launchers.dask import DaskOptions

_CONNECT_S = 15.0
"""Time limit for connecting to the scheduler, seconds."""
_ANSWER_S = 5.0
"""Time limit for answers of workers, seconds."""
_SLOTS: dict[str, Slot] = {}
"""On a worker: its running servers, by the names of their tasks."""


def serve(specification: Specification, server: int, code: str | None, key: str, topic: str) -> End:
    """Run a server on a worker until it ends."""
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
    """Return the last output lines of a server on this worker."""
    slot = _SLOTS.get(key)
    return [] if slot is None else slot.tail(lines)


@dataclass
class _Task:
    """A task and the end of its server."""

    key: str
    future: Any
    ended: End | None = None


class Cluster:
    """A connection to a Dask cluster.

    Args:
        options: options of the launcher.
        specification: specification of the servers.

    Raises:
        LauncherError: workers have another version of Python.
    """

    def __init__(self, options: "DaskOptions", specification: Specification) -> None:
        address = options.address or os.environ.get("DASK_SCHEDULER_ADDRESS")
        location: dict[str, Any] = {"address": address}
        if options.scheduler_file is not None:
            if not Path(options.scheduler_file).is_file():
                raise LauncherError(f"scheduler_file: {options.scheduler_file} does not exist")
            location = {"scheduler_file": options.scheduler_file}
        warnings.simplefilter("ignore")  # versions are compared below
        self._client = Client(**location, timeout=_CONNECT_S)
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
        workers = self._list_workers()
        started = self._find_started()
        waits = self._explain_waiting(workers)
        states = {}
        for server, task in self._tasks.items():
            if task.ended is None and task.future.done():
                task.ended = _find_end(task.future)
                self._printed[server] = task.ended.lines
            if task.ended is not None:
                states[server] = Health("ended", task.ended.words)
            elif started.get(server) in workers:
                states[server] = Health("running")
            else:
                states[server] = Health("waiting", waits)
        return states

    def stop(self, servers: Sequence[int]) -> None:
        """End servers by SIGTERM, and drop tasks that have not begun."""
        leaving = {server: self._tasks.pop(server) for server in servers if server in self._tasks}
        unfinished = [task for task in leaving.values() if not task.future.done()]
        if not unfinished:
            return
        started = self._find_started()
        running = {task.key for server, task in leaving.items() if server in started}
        for leaving_task in unfinished:
            if leaving_task.key not in running:
                leaving_task.future.cancel()
        # All workers get the request, as tasks may have begun in the meantime.
        self._client.run(end, [task.key for task in unfinished], on_error="ignore")
        if running:
            with suppress(TimeoutError):
                wait([task.future for task in unfinished if task.key in running], timeout=GRACE_S + _ANSWER_S)
        for leaving_task in leaving.values():
            leaving_task.future.cancel()

    def logs(self, server: int, lines: int) -> Sequence[str]:
        """Return the last lines of a server."""
        task = self._tasks.get(server)
        worker = self._find_started().get(server)
        if task is None or task.ended is not None or worker is None:
            return list(self._printed.get(server, ()))[-lines:]
        lines_by_worker = self._client.run(tail, task.key, lines, workers=[worker], on_error="ignore")
        return list(lines_by_worker.get(worker, ()))

    def close(self) -> None:
        """End all tasks, and the connection."""
        self.stop(list(self._tasks))
        self._client.close(timeout=_ANSWER_S)

    def _list_workers(self) -> dict[str, Any]:
        """Return the cluster's workers, by address. Raises LauncherError."""
        if self._client.status != "running":
            raise LauncherError("the connection to the scheduler is lost")
        workers: dict[str, Any] = self._client.scheduler_info(n_workers=-1)["workers"]
        return workers

    def _find_started(self) -> dict[int, str]:
        """Return the worker of each started server; the last one if Dask repeated a lost task."""
        return {event["server"]: event["worker"] for _, event in self._client.get_events(self._topic)}

    def _compare_versions(self) -> None:
        version = platform.python_version()
        workers = self._client.get_versions()["workers"]
        worker_versions = {
            str(client["host"]["python"]).split(".final")[0] for client in workers.values() if client
        }
        wrong = sorted(
            worker_version
            for worker_version in worker_versions
            if worker_version.split(".")[:2] != version.split(".")[:2]
        )
        if wrong:
            raise LauncherError(
                f"workers run Python {', '.join(wrong)}, this machine {version}; Dask needs the same "
                "version on both"
            )

    def _explain_waiting(self, workers: Mapping[str, Any]) -> str:
        """Explain why tasks wait."""
        if not workers:
            return "the cluster has no workers"
        required = self._options.resources
        if not any(
            all(worker["resources"].get(name, 0) >= size for name, size in required.items())
            for worker in workers.values()
        ):
            have = sorted({_format_resources(worker["resources"]) for worker in workers.values()})
            return (
                f"no worker of the cluster has {_format_resources(required)}; workers have {'; '.join(have)}"
            )
        threads = sum(worker["nthreads"] for worker in workers.values())
        free = f" with {_format_resources(required)}" if required else ""
        return f"no free thread of a worker{free}; {len(workers)} workers have {threads} threads"


def _find_end(future: Any) -> End:  # noqa: ANN401 - of Dask
    if future.status == "finished":
        result: End = future.result()
        return result
    if future.cancelled():
        return End("lost: the task was cancelled, or the scheduler was restarted")
    error = future.exception()
    return End(f"lost: {str(error).strip() or type(error).__name__}")


def _format_resources(resources: Mapping[str, float]) -> str:
    return "{" + ", ".join(f"{name}: {size:g}" for name, size in sorted(resources.items())) + "}"
