"""A Ray cluster of this machine: `python -m benchmarks.on_ray_process CORES`; see `on_ray`.

Prints its address; each line on standard input is a number of tasks, the answer their rate (tasks/s).
"""

import importlib
import sys
import time
from typing import Any

from benchmarks.spinning import spin


def main() -> None:
    """Answer until standard input ends."""
    ray: Any = importlib.import_module("ray")
    utils: Any = importlib.import_module("ray.cluster_utils")
    cores = {"num_cpus": int(sys.argv[1]), "include_dashboard": False}
    cluster = utils.Cluster(initialize_head=True, head_node_args=cores)
    ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
    print("address", cluster.address, flush=True)
    task = ray.remote(spin)
    ray.get([task.remote() for _ in range(200)])
    for line in sys.stdin:
        count = int(line)
        start = time.perf_counter()
        ray.get([task.remote() for _ in range(count)])
        print("rate", count / (time.perf_counter() - start), flush=True)
    ray.shutdown()
    cluster.shutdown()


if __name__ == "__main__":
    main()
