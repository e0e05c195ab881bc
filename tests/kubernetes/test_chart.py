"""The Helm chart: linted, refused where values are wrong, and installed in a real Kubernetes."""

import subprocess
from pathlib import Path

import pytest

from swarmwright import Experiment, optimize
from tests.conftest import PROGRAM, ROOT, free_port
from tests.kubernetes.cluster import until
from tests.kubernetes.conftest import IMAGE, Cluster
from tests.python.records import same_record

CHART = ROOT / "deploy/helm/swarmwright"
EXPERIMENT = "simulation: minisim\nmethod: {population: 10, generations: 3}\nvalidate: false\n"

pytestmark = pytest.mark.timeout(240)


def helm(binaries: Path, *arguments: str, status: int = 0) -> str:
    result = subprocess.run([binaries / "helm", *arguments], capture_output=True, text=True, check=False)
    assert result.returncode == status, result.stdout + result.stderr
    return result.stdout + result.stderr


def test_lint(binaries: Path) -> None:
    assert "0 chart(s) failed" in helm(binaries, "lint", "--strict", str(CHART), "--set", "credentials=lab")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((), "credentials is missing: the name of a Secret"),
        (("credentials=lab", "servers.cout=3"), "cout"),
        (("credentials=lab", "servers.count=many"), "count"),
        (("credentials=lab", "broker.port=80"), "port"),
    ],
)
def test_wrong_values(binaries: Path, values: tuple[str, ...], message: str) -> None:
    given = [part for value in values for part in ("--set", value)]
    assert message in helm(binaries, "template", "x", str(CHART), "--kube-version=1.34.0", *given, status=1)


def test_a_release_optimizes_in_the_cluster(cluster: Cluster, binaries: Path, tmp_path: Path) -> None:
    control, port = cluster.control, free_port()
    control.kubectl("create", "namespace", "chart")
    control.kubectl("label", "namespace", "chart", "pod-security.kubernetes.io/enforce=restricted")
    until(lambda: "default" in control.names("serviceaccounts", "chart"))
    lab, disk = tmp_path / "lab", tmp_path / "disk"
    subprocess.run([*PROGRAM, "broker", "--init", str(lab), "--host", "lab-swarmwright-broker"], check=True)
    disk.mkdir()
    control.kubectl("create", "secret", "generic", "lab", "-n", "chart", f"--from-file={lab}")
    control.kubectl(
        "apply",
        "-f",
        "-",
        given=f"""{{"apiVersion": "v1", "kind": "PersistentVolume", "metadata": {{"name": "disk"}}, "spec": {{
            "capacity": {{"storage": "1Gi"}}, "accessModes": ["ReadWriteOnce"], "storageClassName": "test",
            "hostPath": {{"path": "{disk}"}}}}}}""",
    )
    (tmp_path / "bin").mkdir()
    values = [
        *("--set", "credentials=lab"),
        *("--set", f"broker.port={port}"),
        *("--set", "image.repository=registry.test/swarmwright", "--set-string", "image.tag=1"),
        *("--set", "servers.count=2", "--set", "tool.persistence.storageClass=test"),
        *("--set-string", f"tool.experiment={EXPERIMENT.replace(',', chr(92) + ',')}"),
    ]
    access = ("--kubeconfig", str(control.kubeconfig), "--namespace", "chart")
    assert IMAGE == "registry.test/swarmwright:1"
    notes = helm(binaries, "install", "lab", str(CHART), *values, *access)
    assert f"mqtts://lab-swarmwright-broker.chart.svc:{port}" in notes
    try:
        until(lambda: any(one["status"].get("succeeded") for one in control.get("jobs", "chart")))
        run = next(disk.iterdir())
        (tmp_path / "lab.yaml").write_text(EXPERIMENT)
        experiment = Experiment.load(tmp_path / "lab.yaml")
        from swarmwright import Run

        here = optimize(experiment, out=tmp_path / "here", servers="in-process", progress=False)
        same_record(Run(run), here)
        helm(binaries, "upgrade", "lab", str(CHART), *values, "--set", "servers.count=3", *access)
        until(lambda: cluster.kubelet.processes() == 4)
    finally:
        helm(binaries, "uninstall", "lab", *access)
    assert control.names("persistentvolumeclaims", "chart") == ["lab-swarmwright-runs"]  # results are kept
    until(lambda: cluster.kubelet.processes() == 0)
    control.kubectl("delete", "namespace", "chart", "--wait=false")
