"""A real Kubernetes on this machine, of the programs that `make kubernetes` builds."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.kubernetes.cluster import ControlPlane, until
from tests.kubernetes.kubelet import Kubelet

HERE = Path(__file__).parent
WHY_NOT = (
    os.environ.get("SWARMWRIGHT_NO_KUBERNETES")
    or "SWARMWRIGHT_KUBERNETES is not set: run `make test-kubernetes`"
)
IMAGE = "registry.test/swarmwright:1"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if os.environ.get("SWARMWRIGHT_KUBERNETES"):
        return
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.skip(reason=WHY_NOT))


@dataclass
class Cluster:
    """Kubernetes with two nodes of four processors."""

    control: ControlPlane
    kubelet: Kubelet


@pytest.fixture(scope="session")
def binaries() -> Path:
    """Folder of the programs."""
    return Path(os.environ["SWARMWRIGHT_KUBERNETES"])


@pytest.fixture(scope="session")
def cluster(binaries: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    folder = tmp_path_factory.mktemp("kubernetes")
    control = ControlPlane(binaries, folder)
    kubelet = None
    try:
        control.start()
        kubelet = Kubelet(control.kubeconfig, folder, {IMAGE})
        kubelet.start("node-1", "node-2")
        until(lambda: "default" in control.names("serviceaccounts", "default"))
        yield Cluster(control, kubelet)
    finally:
        if kubelet is not None:
            kubelet.stop()
        control.stop()


@pytest.fixture
def namespace(cluster: Cluster) -> Iterator[Callable[..., str]]:
    """Make a namespace; at the end nothing of the servers may be left in it."""
    made = []

    def make(name: str, *labels: str) -> str:
        cluster.control.kubectl("create", "namespace", name)
        if labels:
            cluster.control.kubectl("label", "namespace", name, *labels)
        until(lambda: "default" in cluster.control.names("serviceaccounts", name))
        made.append(name)
        return name

    yield make
    for name in made:
        for kind in ("jobs", "pods", "secrets"):
            assert cluster.control.names(kind, name) == []
        cluster.control.kubectl("delete", "namespace", name, "--wait=false")
