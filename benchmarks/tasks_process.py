"""A process that runs empty tasks in Ray or Dask: `python -m benchmarks.tasks_process ray|dask CORES`.

Each line on standard input is `pipelined N` (all submitted, then all awaited; tasks/s) or `single N` (one
after another; us there and back); the answer is a line with the figure.
"""

import importlib
import sys
import time
from collections.abc import Callable
from typing import Any


def nothing() -> None:
    """The empty task."""


def ray_ways(cores: int) -> tuple[Callable[[int], Any], Callable[[], Any], Callable[[], Any]]:
    """One actor per core, which is Ray's fastest way."""
    ray: Any = importlib.import_module("ray")
    ray.init(num_cpus=cores, include_dashboard=False, log_to_driver=False, logging_level="ERROR")

    class Worker:
        def nothing(self) -> None:
            return None

    actor = ray.remote(Worker)
    workers = [actor.remote() for _ in range(cores)]

    def pipelined(count: int) -> None:
        ray.get([workers[index % cores].nothing.remote() for index in range(count)])

    return pipelined, lambda: ray.get(workers[0].nothing.remote()), ray.shutdown


def dask_ways(cores: int) -> tuple[Callable[[int], Any], Callable[[], Any], Callable[[], Any]]:
    """One worker process per core."""
    distributed: Any = importlib.import_module("distributed")
    cluster = distributed.LocalCluster(n_workers=cores, threads_per_worker=1, dashboard_address=None)
    client = distributed.Client(cluster)

    def empty(_index: int) -> None:
        return None

    def pipelined(count: int) -> None:
        client.gather(client.map(empty, range(count), pure=False))

    def close() -> None:
        client.close()
        cluster.close()

    return pipelined, lambda: client.submit(nothing, pure=False).result(), close


def main() -> None:
    """Answer until standard input ends."""
    ways = {"ray": ray_ways, "dask": dask_ways}[sys.argv[1]]
    pipelined, single, close = ways(int(sys.argv[2]))
    pipelined(200)
    for _ in range(50):
        single()
    print("ready", flush=True)
    for line in sys.stdin:
        kind, count = line.split()[0], int(line.split()[1])
        start = time.perf_counter()
        if kind == "pipelined":
            pipelined(count)
            print(count / (time.perf_counter() - start), flush=True)
        else:
            for _ in range(count):
                single()
            print((time.perf_counter() - start) / count * 1e6, flush=True)
    close()


if __name__ == "__main__":
    main()
