"""Offloaded evaluation against empty tasks of Ray and Dask, bare MQTT, and the same work in this process."""

import contextlib
import subprocess
import sys
import time

import numpy as np
import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks import bare
from benchmarks.measurement import Samples
from benchmarks.processes import ROOT, embedded, servers
from benchmarks.rollout import Block, minisim, stadium
from swarmwright import _engine
from swarmwright.servers.rows import Journal

SERVERS = 2
PREFIX = "bench/tasks"


class Library:
    """Ray or Dask in a process of its own."""

    def __init__(self, name: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.tasks_process", name, str(SERVERS)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=ROOT,
        )
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.strip() == "ready":
                return
        raise SystemExit(f"{name} did not start; `make bench` installs it")

    def ask(self, what: str) -> float:
        """The figure that the process measures."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(what + "\n")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())

    def close(self) -> None:
        """End it and what it has started."""
        self._process.communicate(timeout=60)


class TaskSuite:
    """One broker, two servers of each simulation; an evaluation of one step is the empty task."""

    def __init__(self, *, libraries: bool = True, scale: int = 1) -> None:
        self._scale = scale
        self._stack = contextlib.ExitStack()
        self._broker = self._stack.enter_context(embedded())
        self._stack.enter_context(servers(self._broker, SERVERS, PREFIX))
        self._stack.enter_context(servers(self._broker, SERVERS, PREFIX, "emergency_exit"))
        self._empty = minisim(max(200, 10_000 // scale), maxSteps=1)
        self._sizes = self._message_sizes()
        self._libraries: dict[str, Library] = {}
        self._rates: dict[str, Samples] = {}
        self._singles: dict[str, Samples] = {}
        for name in ("ray", "dask") if libraries else ():
            self._libraries[name] = self._stack.enter_context(contextlib.closing(Library(name)))
            self._rates[name] = Samples(f"{name.title()}, empty tasks, pipelined", "tasks/s")
            self._singles[name] = Samples(f"{name.title()}, one empty task there and back", "us")
        self._rate = Samples(
            "offloaded, single candidates, pipelined", "evaluations/s", self._rates.get("ray"), ">= 10,000/s"
        )
        self._bare = Samples("bare round trip of an evaluation's messages", "us")
        self._single = Samples("offloaded, one evaluation there and back", "us", self._bare, "<= 3")
        for single in self._singles.values():
            single.against = self._bare
        self._work = {
            "Minisim": minisim(200_000 // scale),
            # Half a second of work: with less, the last blocks decide, which are never equally large.
            "Stadium": stadium(60_000 // scale),
        }
        self._local: dict[str, Samples] = {}
        self._offloaded: dict[str, Samples] = {}
        for name in self._work:
            self._local[name] = Samples(f"{name}, in this process, 2 threads", "evaluations/s")
            # A request holds 20 ms of Stadium, but 0.2 ms of Minisim: short episodes, large genomes.
            self._offloaded[name] = Samples(
                f"{name}, offloaded, 2 servers",
                "evaluations/s",
                self._local[name],
                ">= 0.9" if name == "Stadium" else "",
            )

    def _pool(self, block: Block, *, largest: int | None = None) -> _engine.Pool:
        pool = _engine.Pool(
            self._broker.url,
            simulation=block.title,
            parameters=block.parameters,
            requirements={"dimensions": 2},
            prefix=PREFIX,
            tool="bench",
            mode="offloaded",
            largest=largest,
        )
        pool.wait_for_server()
        return pool

    def _message_sizes(self) -> tuple[int, int]:
        """Bytes of an evaluation's request and of its reply."""
        seen: dict[str, int] = {}

        def note(_client: mqtt.Client, _data: object, message: mqtt.MQTTMessage) -> None:
            for way in ("v1/server/", "v1/tool/"):
                if way in message.topic:
                    seen[way] = len(message.payload)

        client = mqtt.Client(CallbackAPIVersion.VERSION2, protocol=mqtt.MQTTv5)
        client.on_message = note
        subscribed: list[bool] = []
        client.on_subscribe = lambda *_: subscribed.append(True)
        client.connect("127.0.0.1", self._broker.port)
        client.subscribe(f"{PREFIX}/#")
        client.loop_start()
        while not subscribed:
            time.sleep(0.01)
        with contextlib.closing(self._pool(self._empty)) as pool:
            for _ in range(3):
                pool.evaluate(self._empty.architecture, self._empty.genomes[:1].copy(), [0])
        time.sleep(0.2)
        client.disconnect()
        client.loop_stop()
        return seen["v1/server/"], seen["v1/tool/"]

    def repeat(self) -> None:
        """Take one sample of everything."""
        empty = self._empty
        tasks, singles = max(100, 3_000 // self._scale), max(20, 300 // self._scale)
        for name, library in self._libraries.items():
            self._rates[name].add(library.ask(f"pipelined {tasks}"))
            self._singles[name].add(library.ask(f"single {singles}"))
        with contextlib.closing(self._pool(empty, largest=1)) as pool:
            self._evaluate(pool, empty)
            start = time.perf_counter()
            self._evaluate(pool, empty)
            self._rate.add(empty.candidates / (time.perf_counter() - start))
            one = empty.genomes[:1].copy()
            start = time.perf_counter()
            for _ in range(singles):
                pool.evaluate(empty.architecture, one, [0])
            self._single.add((time.perf_counter() - start) / singles * 1e6)
        self._bare.add(bare.pingpong(self._broker, 10 * singles, self._sizes))
        for name, block in self._work.items():
            with contextlib.closing(self._pool(block)) as pool:
                # The first time, the pool learns how fast the servers are.
                self._evaluate(pool, block)
                start = time.perf_counter()
                found = self._evaluate(pool, block)
                self._offloaded[name].add(block.candidates / (time.perf_counter() - start))
            start = time.perf_counter()
            expected = block.run(threads=SERVERS)
            self._local[name].add(block.candidates / (time.perf_counter() - start))
            if found.tobytes() != expected.tobytes():
                raise SystemExit("offloaded evaluation and this process give different fitness")

    @staticmethod
    def _evaluate(pool: _engine.Pool, block: Block) -> np.ndarray:
        fitness, _, attempts, _ = pool.evaluate(block.architecture, block.genomes, [0])
        errors = Journal.from_fields(attempts, []).errors
        if errors:
            raise SystemExit(f"offloaded evaluation failed: {errors[0]}")
        return fitness[:, 0]

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        rest = [one for name in self._work for one in (self._local[name], self._offloaded[name])]
        return [*self._rates.values(), self._rate, self._bare, *self._singles.values(), self._single, *rest]

    def close(self) -> None:
        """End everything that was started."""
        self._stack.close()
