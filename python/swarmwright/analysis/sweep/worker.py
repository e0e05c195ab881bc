"""A worker process, which does runs of a sweep sequentially.

Its argument is a file descriptor for events as JSON lines. Standard input has the settings as a JSON line,
then a line for each task. When it closes, the parent is done or has died: the run in progress is interrupted,
its results are kept, and the process ends.
"""

import dataclasses
import json
import logging
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from swarmwright.analysis.sweep.file import Sweep
from swarmwright.analysis.sweep.run import BusyRunError, Executor, Task, reason
from swarmwright.analysis.sweep.variants import Variant
from swarmwright.common.errors import SwarmwrightError
from swarmwright.experiment.experiment import build_recorded_experiment
from swarmwright.runs.optimization.generation import Generation
from swarmwright.runs.optimization.memory import progress
from swarmwright.servers.evaluation import reports as incidents

REPORT_INTERVAL_S = 0.25
"""Seconds between reports of the progress of a generation."""
GRACE_S = 30.0
"""Seconds for the run in progress to end after the parent."""

Json = dict[str, Any]


class Worker:
    """Does tasks and reports their progress.

    events: file descriptor for the reports.
    """

    def __init__(self, events: int) -> None:
        self._events = events
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._changing = threading.Lock()
        self._busy = self._over = False
        self._last_report = 0.0

    def listen(self) -> None:
        """Read tasks from standard input, then end the run in progress; for a separate thread."""
        for line in sys.stdin:
            self._lines.put(line)
        with self._changing:
            self._over = True
            self._lines.put("")
            if self._busy:
                os.kill(os.getpid(), signal.SIGINT)
        threading.Event().wait(GRACE_S)
        os._exit(1)

    def run(self) -> int:
        """Do tasks until there are no more; return the exit status."""
        try:
            settings = json.loads(self._lines.get())
            variants = [_variant(variant) for variant in settings["variants"]]
            sweep = Sweep(tuple(variants), (), Path())
            with (
                self._forwarding(settings["reports"]),
                Executor(sweep, broker=settings["broker"], servers=settings["servers"]) as executor,
            ):
                self._tell("ready")
                while line := self._lines.get():
                    task = json.loads(line)
                    self._do(executor, Task(variants[task["variant"]], task["seed"], Path(task["folder"])))
        except KeyboardInterrupt:
            return 0
        except SwarmwrightError as error:
            self._tell("broken", message=str(error), status=error.exit_status)
            return error.exit_status
        return 0

    def _do(self, executor: Executor, task: Task) -> None:
        with self._changing:
            self._busy = True
        try:
            run = executor.run(task, self._generation, self._evaluating)
            self._tell("interrupted" if run.interrupted else "done")
        except BusyRunError:
            self._tell("busy")
        except Exception as error:  # noqa: BLE001 - errors of plug-ins do not stop the other runs
            self._tell("failed", message=reason(error))
        finally:
            with self._changing:
                self._busy = False

    def _generation(self, generation: Generation) -> None:
        self._check()
        self._tell("generation", generation=asdict(generation))

    def _evaluating(self, done: int, total: int, waiting_for: str) -> None:
        self._check()
        now = time.monotonic()
        if now - self._last_report >= REPORT_INTERVAL_S:
            self._last_report = now
            self._tell("evaluating", done=done, total=total, waiting_for=waiting_for)

    def _check(self) -> None:
        """End the run when the parent has ended, even if the signal was swallowed."""
        if self._over:
            raise KeyboardInterrupt

    @contextmanager
    def _forwarding(self, reports: str) -> Iterator[None]:
        """Forward logs and reports to the parent within the block."""
        tell = self._tell

        class Handler(logging.Handler):
            def emit(self, record: logging.LogRecord) -> None:
                tell("log", logger=record.name, level=record.levelno, message=record.getMessage())

        logging.getLogger("swarmwright").addHandler(Handler())
        progress.setLevel(logging.INFO)
        with ExitStack() as stack:
            if reports:
                listening = incidents.listening(
                    lambda report: tell("report", report=dict(report)), warnings_only=reports == "warnings"
                )
                stack.enter_context(listening)
            yield

    def _tell(self, event: str, **values: Any) -> None:  # noqa: ANN401 - plain values
        line = memoryview(f"{json.dumps({'event': event, **values})}\n".encode())
        with suppress(OSError):  # the pipe is closed
            while line:
                line = line[os.write(self._events, line) :]


def _variant(values: Json) -> Variant:
    experiment = build_recorded_experiment(values["experiment"])
    if values["path"] is not None:
        experiment = dataclasses.replace(experiment, path=Path(values["path"]))
    return Variant(values["label"], values["folder"], experiment)


def main() -> int:
    """Work until the parent has no more tasks; return the exit status."""
    # The parent may ignore SIGINT, as background jobs of shells do.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    worker = Worker(int(sys.argv[1]))
    threading.Thread(target=worker.listen, daemon=True).start()
    return worker.run()


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # another thread may still run code of a simulation
