"""Parallel runs of a sweep in worker processes."""

import json
import logging
import os
import selectors
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from tempfile import TemporaryFile
from typing import IO, Any

from swarmwright.analysis.sweep.run import Listener, Task, open_finished
from swarmwright.analysis.sweep.variants import Variant
from swarmwright.common import processes
from swarmwright.common.errors import InputError, RunError
from swarmwright.runs.optimization.generation import Generation
from swarmwright.runs.run import Run
from swarmwright.servers.evaluation import reports
from swarmwright.servers.evaluation.base import Servers
from swarmwright.servers.supervision.local_servers import count_processors

GRACE_S = 20.0
"""Seconds for interrupted runs to end and be stored."""
_POLL_S = 0.2
"""Seconds between checks of the processes."""
_LAST_BYTES = 2000
"""Bytes of a process's output in an error message."""

Json = dict[str, Any]


class _Process:
    """A worker process and its current task."""

    def __init__(self, settings: Json, threads: int) -> None:
        self.task: Task | None = None
        self.ready = False
        self._incomplete_line = b""
        self._stderr: IO[bytes] = TemporaryFile()  # noqa: SIM115 - closed in `close`
        self.events, writing = os.pipe()
        environment = {"RAYON_NUM_THREADS": str(threads), **os.environ, **processes.hash_seed_variables()}
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", "swarmwright.analysis.sweep.worker", str(writing)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._stderr,
                pass_fds=[writing],
                env=environment,
                process_group=0,  # Ctrl-C reaches only the parent, which then ends its workers
            )
        except BaseException:
            os.close(self.events)
            self._stderr.close()
            raise
        finally:
            os.close(writing)
        self._send(settings)

    def give(self, task: Task, message: Json) -> None:
        """Send the worker a task."""
        self.task = task
        self._send(message)

    def _send(self, message: Json) -> None:
        assert self.process.stdin is not None
        with suppress(BrokenPipeError):  # it has ended, as its events show
            self.process.stdin.write(f"{json.dumps(message)}\n".encode())
            self.process.stdin.flush()

    def read_reports(self) -> list[Json] | None:
        """Return the worker's reports since the last call; None if the worker has ended."""
        data = os.read(self.events, 1 << 16)
        if not data:
            return None
        *lines, self._incomplete_line = (self._incomplete_line + data).split(b"\n")
        return [json.loads(line) for line in lines]

    def dismiss(self) -> None:
        """Ask the worker to end, which interrupts a run in progress."""
        if self.process.stdin is not None and not self.process.stdin.closed:
            with suppress(BrokenPipeError):
                self.process.stdin.close()

    def exit_report(self) -> str:
        """Describe how it ended."""
        status = self.process.wait()
        outcome = f"was killed by signal {-status}" if status < 0 else f"ended with status {status}"
        end = self._stderr.seek(0, os.SEEK_END)
        self._stderr.seek(max(0, end - _LAST_BYTES))
        output = self._stderr.read().decode(errors="replace").strip()
        return f"the worker process of this run {outcome}" + (f": {output}" if output else "")

    def close(self, deadline: float) -> None:
        """Wait for its end, and kill it at the deadline."""
        self.dismiss()
        try:
            self.process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.events)
        self._stderr.close()


class WorkerPool:
    """Does tasks in parallel.

    Args:
        variants: variants of the sweep.
        broker: of existing servers.
        servers: the servers that each process starts, see `choose_servers`.
        listener: receives the progress.
    """

    def __init__(
        self,
        variants: Sequence[Variant],
        *,
        broker: str | None,
        servers: Sequence[Servers | None],
        listener: Listener,
    ) -> None:
        self._variants = list(variants)
        self._broker = broker
        self._servers = servers
        self._listener = listener
        self._threads = max(1, count_processors() // len(servers))
        self._processes: list[_Process | None] = [None] * len(servers)
        self._selector = selectors.DefaultSelector()

    def run(self, tasks: Sequence[Task]) -> None:
        """Do all tasks.

        Raises InputError or RunError when a process cannot begin with any task, KeyboardInterrupt when this
        process is interrupted; then all runs in progress have ended, and their results are stored.
        """
        waiting = deque(tasks)
        try:
            for index in range(len(self._processes)):
                self._start(index)
            while waiting or any(process is not None and process.task for process in self._processes):
                for key, _ in self._selector.select(_POLL_S):
                    self._receive(key.data, waiting)
                self._listener.tick()
        finally:
            self._close()

    def _start(self, index: int) -> None:
        """Start a process, which gets its first task when it is ready."""
        settings = {
            "variants": [_plain(variant) for variant in self._variants],
            "broker": self._broker,
            "servers": self._servers[index],
            "reports": ("warnings" if reports.needs_only_warnings() else "all")
            if reports.has_listeners()
            else "",
        }
        process = _Process(settings, self._threads)
        self._processes[index] = process
        self._selector.register(process.events, selectors.EVENT_READ, index)

    def _receive(self, index: int, waiting: deque[Task]) -> None:
        process = self._processes[index]
        assert process is not None
        messages = process.read_reports()
        if messages is None:
            self._replace(index, waiting)
            return
        for message in messages:
            if self._take(process, message):
                self._give(process, waiting)

    def _take(self, process: _Process, message: Json) -> bool:
        """Handle a message of a process; return whether it is idle now."""
        task = process.task
        match message["event"]:
            case "ready":
                process.ready = True
                return True
            case "broken":
                error = InputError if message["status"] == InputError.exit_status else RunError
                raise error(message["message"])
            case "log":
                logging.getLogger(message["logger"]).log(message["level"], "%s", message["message"])
            case "report":
                reports.tell(message["report"])
            case event if task is not None:
                process.task = self._report(task, event, message)
                return process.task is None
        return False

    def _report(self, task: Task, event: str, message: Json) -> Task | None:
        """Forward the progress of a task; return the task, or None if it has ended."""
        match event:
            case "generation":
                self._listener.generation(task, Generation(**message["generation"]))
                return task
            case "evaluating":
                self._listener.evaluating(task, message["done"], message["total"], message["waiting_for"])
                return task
            case "failed":
                self._listener.on_failure(task, message["message"])
            case "busy":
                self._listener.busy(task)
            case "done":
                self._listener.on_end(task, Run.open(task.folder))
        return None  # interrupted: this worker, or all of them, received a signal

    def _give(self, process: _Process, waiting: deque[Task]) -> None:
        while waiting and (run := open_finished(waiting[0])) is not None:
            self._listener.on_finished_elsewhere(waiting.popleft(), run)
        if not waiting:
            process.dismiss()
            return
        task = waiting.popleft()
        self._listener.on_begin(task)
        index_of_variant = next(
            index for index, variant in enumerate(self._variants) if variant is task.variant
        )
        process.give(task, {"variant": index_of_variant, "seed": task.seed, "folder": str(task.folder)})

    def _replace(self, index: int, waiting: deque[Task]) -> None:
        """Replace a process that has ended, if there is still work."""
        process = self._processes[index]
        assert process is not None
        self._selector.unregister(process.events)
        self._processes[index] = None
        task, ready = process.task, process.ready
        message = process.exit_report()
        process.close(time.monotonic())
        if task is not None:
            self._listener.on_failure(task, message)
        elif not ready:
            raise RunError(message)
        if waiting:
            self._start(index)

    def _close(self) -> None:
        """End all processes and handle their last reports, on how interrupted runs ended."""
        deadline = time.monotonic() + GRACE_S
        for process in self._processes:
            if process is not None:
                process.dismiss()
        try:
            while self._selector.get_map() and time.monotonic() < deadline:
                for key, _ in self._selector.select(_POLL_S):
                    process = self._processes[key.data]
                    assert process is not None
                    messages = process.read_reports()
                    if messages is None:
                        self._selector.unregister(key.fd)
                    for message in messages or ():
                        if message["event"] != "broken":
                            self._take(process, message)
        finally:
            self._selector.close()
            for process in self._processes:
                if process is not None:
                    process.close(deadline)


def _plain(variant: Variant) -> Json:
    path = variant.experiment.path
    return {
        "label": variant.label,
        "folder": variant.folder,
        "experiment": variant.experiment.to_mapping(),
        "path": None if path is None else str(path),
    }
