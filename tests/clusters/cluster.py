"""A cluster of two nodes on this machine: `python -m tests.clusters.cluster ray|dask`.

Prints its address; each line on standard input kills a node that runs servers, and adds another one; ends
with its standard input.
"""

import os
import signal
import sys
from typing import Any


def of_ray() -> None:
    from ray.cluster_utils import Cluster

    memory = 80_000_000
    head = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": memory}
    cluster: Any = Cluster(initialize_head=True, head_node_args=head)
    try:
        node = cluster.add_node(num_cpus=1, object_store_memory=memory)
        print("address", cluster.address, flush=True)
        for _ in sys.stdin:
            cluster.remove_node(node, allow_graceful=False)
            node = cluster.add_node(num_cpus=1, object_store_memory=memory)
            print("killed", flush=True)
    finally:
        cluster.shutdown()


def of_dask() -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        print("address", cluster.scheduler_address, flush=True)
        for _ in sys.stdin:
            os.kill(cluster.workers[0].pid, signal.SIGKILL)  # its nanny starts another worker
            print("killed", flush=True)


if __name__ == "__main__":
    {"ray": of_ray, "dask": of_dask}[sys.argv[1]]()
