"""The window in the browser: what watching costs a run, how late it is, and how soon a long list is there.

The window has one processor, the run another. Clients read the same stream of events as pages do.
"""

import contextlib
import http.client
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import swarmwright
from benchmarks.measurement import Samples
from benchmarks.suite import NotBuiltError

CLIENTS = 20
RUNS = 1000
GENERATIONS = 1500
EXPERIMENT = {
    "simulation": "minisim",
    "servers": "in-process",
    "controller": {"kind": "layered", "hidden": [20]},
    "method": {"kind": "snes", "population": 400, "generations": GENERATIONS},
    "parameters": {"maxSteps": 100},
    "validate": False,
}
# Generations are committed as by the command line, and timed.
RUN = """
import json, os, sys, time, swarmwright
os.sched_setaffinity(0, {int(sys.argv[3])})
times = []
start = time.perf_counter()
experiment, out = json.loads(sys.argv[1]), sys.argv[2]
swarmwright.optimize(experiment, out=out, on_generation=lambda summary: times.append(time.time()))
print(json.dumps([time.perf_counter() - start, times]))
"""


class WindowSuite:
    """A run with and without a window; a folder with many runs.

    smaller: divides clients, runs and generations.
    """

    def __init__(self, smaller: int = 1) -> None:
        from swarmwright.ui.server import missing_library

        missing = missing_library()
        if missing is not None:
            raise NotBuiltError(missing)
        self._clients, self._runs = max(CLIENTS // smaller, 2), max(RUNS // smaller, 5)
        self._experiment = EXPERIMENT | {
            "method": {"kind": "snes", "population": 400, "generations": max(GENERATIONS // smaller, 20)}
        }
        self.alone = Samples(name="a run that nobody watches", unit="s")
        self.watched = Samples(
            name=f"the run, watched by {self._clients} clients", unit="s", against=self.alone, aim="<= 1.03"
        )
        self.rate = Samples(name="its generations", unit="1/s")
        self.delay = Samples(name="delay of the last client, 99 % of the messages", unit="s")
        self.listing = Samples(name=f"a list of {self._runs} runs, complete", unit="s")
        self.memory = Samples(name="memory of the window with it", unit="MB")

    def repeat(self) -> None:
        """Take one sample of everything."""
        self._watch()
        self._list()

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [self.alone, self.watched, self.rate, self.delay, self.listing, self.memory]

    def close(self) -> None:
        """Nothing goes on."""

    def _watch(self) -> None:
        with TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "runs").mkdir()
            seconds, _ = self._run(folder / "alone")
            self.alone.add(seconds)
            with serve(folder / "runs") as (port, _pid):
                clients = [Client(port) for _ in range(self._clients)]
                seconds, times = self._run(folder / "runs" / "run")
                time.sleep(2)
                for client in clients:
                    client.close()
        self.watched.add(seconds)
        self.rate.add(len(times) / seconds)
        delays = sorted(
            moment - times[generations - 1]
            for client in clients
            for moment, generations in client.received
            if 0 < generations <= len(times)
        )
        self.delay.add(delays[int(0.99 * (len(delays) - 1))])

    def _run(self, out: Path) -> tuple[float, list[float]]:
        done = subprocess.run(
            [
                sys.executable, "-c", RUN, json.dumps(self._experiment), str(out),
                str(max(os.sched_getaffinity(0))),
            ],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        seconds, times = json.loads(done.stdout)
        return seconds, times

    def _list(self) -> None:
        with TemporaryDirectory() as name:
            folder = Path(name)
            swarmwright.optimize(
                self._experiment | {"method": {"kind": "snes", "population": 20, "generations": 20}},
                out=folder / "run-0",
            )
            for number in range(1, self._runs):
                shutil.copytree(folder / "run-0", folder / f"run-{number}")
            start = time.perf_counter()
            with serve(folder) as (port, pid):
                client = Client(port)
                while client.rows < self._runs:
                    time.sleep(0.01)
                self.listing.add(time.perf_counter() - start)
                status = Path(f"/proc/{pid}/status").read_text()
                client.close()
            resident = next(line for line in status.splitlines() if line.startswith("VmRSS"))
            self.memory.add(int(resident.split()[1]) / 1024)


class Client:
    """Reads the stream of events in a thread."""

    def __init__(self, port: int) -> None:
        self.received: list[tuple[float, int]] = []
        """When a row of a run came, and the generations that it names."""
        self._ids: set[str] = set()
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        self._connection.request("GET", "/api/events", headers={"Authorization": "Bearer benchmark"})
        self._response = self._connection.getresponse()
        assert self._response.status == 200, self._response.read()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    @property
    def rows(self) -> int:
        """Runs of which a row came."""
        return len(self._ids)

    def _read(self) -> None:
        with contextlib.suppress(OSError, ValueError, AttributeError, http.client.HTTPException):
            while line := self._response.readline():
                if line.startswith(b"data: "):
                    moment = time.time()
                    for row in json.loads(line[6:])["rows"]:
                        self._ids.add(row["id"])
                        self.received.append((moment, row["generations"]))

    def close(self) -> None:
        """End the connection."""
        if self._connection.sock is not None:
            self._connection.sock.shutdown(2)
        self._connection.close()
        self._thread.join(10)


@contextlib.contextmanager
def serve(folder: Path) -> Iterator[tuple[int, int]]:
    """Serve the window on the first processor; yield its port and the number of its process."""
    program = (
        "import os, sys; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); from pathlib import Path\n"
        "from swarmwright.ui.server import Settings, serve\n"
        "settings = Settings(port=0, token='benchmark')\n"
        "serve(Path(sys.argv[1]), settings, on_ready=lambda line: print(line, flush=True))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(folder)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        yield int(process.stdout.readline().split("/?")[0].rpartition(":")[2]), process.pid
    finally:
        process.terminate()
        process.wait(20)
        if process.stdout is not None:
            process.stdout.close()
