"""Servers as pods of a real Kubernetes: the same record, an empty namespace, errors in its words."""

import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, RunError, optimize, resume
from swarmwright.testing import check_launcher
from tests.conftest import Run
from tests.kubernetes.cluster import until
from tests.kubernetes.conftest import IMAGE, Cluster
from tests.paced_simulation import written
from tests.python.records import same_record

pytestmark = pytest.mark.timeout(240)

Namespace = Callable[..., str]


def options(cluster: Cluster, namespace: str, **others: Any) -> dict[str, Any]:
    return {
        "command": f"{sys.executable} -m swarmwright",
        "image": IMAGE,
        "kubeconfig": str(cluster.control.kubeconfig),
        "namespace": namespace,
        "broker_host": "127.0.0.1",
        "grace": 5,
        **others,
    }


def experiment(cluster: Cluster, namespace: str, simulation: str = "minisim", **servers: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": simulation,
            "method": {"population": 20, "generations": 12},
            "validate": False,
            "servers": {"launcher": "kubernetes", "count": 2, **options(cluster, namespace, **servers)},
        }
    )


def test_the_conformance_check(cluster: Cluster, namespace: Namespace) -> None:
    name = namespace("check")
    alive = lambda: len(cluster.control.names("jobs,pods,secrets", name)) + cluster.kubelet.processes()  # noqa: E731
    check_launcher("kubernetes", options(cluster, name), alive=alive)


def test_a_deleted_pod_a_drained_node_and_a_lost_api_change_nothing(
    cluster: Cluster, namespace: Namespace, tmp_path: Path
) -> None:
    from swarmwright.servers.evaluation.launched.servers import find_own_address

    control, name = cluster.control, namespace("lab", "pod-security.kubernetes.io/enforce=restricted")
    made = experiment(cluster, name, written(tmp_path / "simulation"), broker_host=find_own_address())
    here = optimize(made, out=tmp_path / "here", servers="in-process", progress=False)
    done: list[int] = []

    def running() -> dict[str, str]:
        pods = control.get("pods", name, "--field-selector=status.phase=Running")
        return {one["metadata"]["name"]: one["spec"]["nodeName"] for one in pods}

    def disturb(generation: Any) -> None:
        done.append(generation.generation)
        if len(done) == 2:
            until(lambda: len(running()) == 2)
            secrets = control.get("secrets", name)
            assert {one["metadata"]["ownerReferences"][0]["kind"] for one in secrets} == {"Job"}
            assert {"code.tar.gz", "password", "ca.pem"} <= set(secrets[0]["data"])
            gone = min(running())
            control.kubectl("delete", "pod", gone, "-n", name, "--wait=false")
            until(lambda: len(running()) == 2 and gone not in running())
        if len(done) == 4:
            before = running()
            node = before[min(before)]
            control.kubectl("drain", node, "--delete-emptydir-data", "--timeout=60s")
            until(lambda: len(running()) == 2 and node not in running().values())
            control.kubectl("uncordon", node)
        if len(done) == 6:
            control.stop_api()
        if len(done) == 8:
            control.start_api()

    same_record(optimize(made, disturb, out=tmp_path / "there", progress=False), here)
    assert len(done) == 12


def test_pods_that_wait_are_reported_with_the_words_of_the_scheduler(
    cluster: Cluster, namespace: Namespace, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    name = namespace("waiting")
    made = experiment(cluster, name, node_selector={"gpu": "true"})

    def labelled() -> None:
        until(lambda: "servers are waiting" in caplog.text)
        cluster.control.kubectl("label", "node", "node-1", "gpu=true")

    thread = threading.Thread(target=labelled)
    thread.start()
    optimize(made, out=tmp_path / "run", progress=False)
    thread.join()
    cluster.control.kubectl("label", "node", "node-1", "gpu-")
    assert "2 of 2 servers are waiting: Unschedulable: 0/2 nodes are available" in caplog.text


def test_an_elastic_pool_and_a_quota_for_one_pod(
    cluster: Cluster, namespace: Namespace, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    name = namespace("quota")
    cluster.control.kubectl("create", "quota", "few", "-n", name, "--hard=pods=1")
    made = experiment(cluster, name, written(tmp_path / "simulation"))
    done: list[int] = []

    def wait(generation: Any) -> None:
        done.append(generation.generation)
        if len(done) == 1:
            until(lambda: "servers are waiting" in caplog.text)

    optimize(made, wait, out=tmp_path / "run", progress=False)
    reason = "pods is forbidden: exceeded quota: few, requested: pods=1"
    assert f"1 of 2 servers are waiting: {reason}" in caplog.text


@pytest.mark.parametrize(
    ("quota", "servers", "message"),
    [
        (
            "",
            {"image": "registry.test/nope:2"},
            r'ImagePullBackOff: .*image "registry.test/nope:2": not found',
        ),
        ("", {"secrets": ["nope"]}, r'CreateContainerConfigError: secret "nope" not found'),
        ("", {"command": "/opt/no/swarmwright"}, r"ended with status 127\n.*/opt/no/swarmwright.*not found"),
        ("", {"requests": {"cpu": "much"}}, r"kubernetes: .*quantities must match.*\((400|422)\)"),
        ("", {"service_account": "nope"}, r'error looking up service account .*"nope" not found'),
        ("", {"namespace": "nope"}, r'kubernetes: namespaces "nope" not found \(404\)'),
        (
            "pods=0",
            {},
            r"pods is forbidden: exceeded quota: few, requested: pods=1, used: pods=0, limited: pods=0",
        ),
        (
            "count/jobs.batch=0",
            {},
            r"is forbidden: exceeded quota: few, requested: count/jobs.batch=1.*\(403\)",
        ),
        ("count/secrets=0", {}, r"is forbidden: exceeded quota: few, requested: count/secrets=1.*\(403\)"),
    ],
)
def test_what_is_wrong_is_said_in_the_words_of_kubernetes(
    cluster: Cluster, namespace: Namespace, tmp_path: Path, quota: str, servers: dict[str, Any], message: str
) -> None:
    name = namespace(f"wrong-{abs(hash((quota, str(servers))))}")
    if quota:
        cluster.control.kubectl("create", "quota", "few", "-n", name, f"--hard={quota}")
        until(lambda: "used" in cluster.control.get("quota", name)[0]["status"])
    with pytest.raises(RunError, match=message):
        optimize(experiment(cluster, **{"namespace": name, **servers}), out=tmp_path / "run", progress=False)


def test_who_is_not_admitted_or_has_no_rights(cluster: Cluster, namespace: Namespace, tmp_path: Path) -> None:
    name = namespace("rights")
    for token, message in (
        ("wrong", r"kubernetes: https://.* rejects the credentials: Unauthorized \(401\)"),
        (
            f"{cluster.control.token}-poor",
            r'pods is forbidden: User "poor" cannot list resource "pods".*\(403\)',
        ),
    ):
        file = tmp_path / "config"
        cluster.control.write_kubeconfig(file, token, name)
        made = experiment(cluster, name, kubeconfig=str(file))
        with pytest.raises(RunError, match=message):
            optimize(made, out=tmp_path / "run", progress=False)


def test_the_rights_of_the_documentation_are_enough(
    cluster: Cluster, namespace: Namespace, tmp_path: Path
) -> None:
    page = Path("docs/how-to/use-clusters.md").read_text()
    role = (
        "apiVersion: rbac.authorization.k8s.io"
        + page.split("apiVersion: rbac.authorization.k8s.io")[1].split("```")[0]
    )
    name = namespace("role")
    cluster.control.kubectl("apply", "-f", "-", given=role.replace("namespace: lab", f"namespace: {name}"))
    cluster.control.kubectl("create", "rolebinding", "poor", "-n", name, "--role=swarmwright", "--user=poor")
    file = tmp_path / "config"
    cluster.control.write_kubeconfig(file, f"{cluster.control.token}-poor", name)
    check_launcher("kubernetes", options(cluster, name, kubeconfig=str(file)))


def test_code_larger_than_a_secret(cluster: Cluster, namespace: Namespace, tmp_path: Path) -> None:
    import os

    simulation = written(tmp_path)
    (tmp_path / "map.bin").write_bytes(os.urandom(1 << 20))
    made = experiment(cluster, namespace("large"), simulation, files=["map.bin"])
    with pytest.raises(
        InputError, match=r"1\.0 MiB compressed, more than the 1 MiB of a Kubernetes Secret; .*option code"
    ):
        optimize(made, out=tmp_path / "run", progress=False)


def test_a_cluster_that_is_gone_in_mid_run(
    cluster: Cluster, namespace: Namespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its API does not answer, and no server is left: the results are kept, and `resume` goes on."""
    monkeypatch.setattr("swarmwright.servers.evaluation.launched.servers.LAUNCHER_TIMEOUT_S", 2.0)
    control, name = cluster.control, namespace("gone")
    made = experiment(cluster, name, written(tmp_path / "simulation"))
    here = optimize(made, out=tmp_path / "here", servers="in-process", progress=False)
    done: list[int] = []

    def lose(generation: Any) -> None:
        done.append(generation.generation)
        if len(done) == 4:
            control.stop_api()
            cluster.kubelet.kill()

    with pytest.raises(
        RunError, match=r"kubernetes: https://127.0.0.1:\d+ cannot be reached: .*Connection refused"
    ):
        optimize(made, lose, out=tmp_path / "there", progress=False)
    control.start_api()
    until(lambda: all("conditions" in one["status"] for one in control.get("jobs", name)))  # they have ended
    same_record(resume(tmp_path / "there", progress=False), here)
    # What could not be deleted: Kubernetes itself does it after some minutes.
    assert {one["spec"]["ttlSecondsAfterFinished"] for one in control.get("jobs", name)} == {300}
    control.kubectl("delete", "jobs", "--all", "-n", name)
    until(lambda: control.names("jobs,pods,secrets", name) == [])


def test_on_the_command_line(cluster: Cluster, namespace: Namespace, tmp_path: Path, program: Run) -> None:
    experiment(cluster, namespace("line")).save(tmp_path / "lab.yaml")
    result = program("optimize", "lab.yaml", "--servers", "kubernetes:1", "--out", "run", timeout=200)
    assert result.returncode == 0, result.stderr
    result = program("optimize", "lab.yaml", "--set", "servers.pod={hostNetwork: maybe}", "--out", "other")
    assert result.returncode == 2, result.stderr
    assert "hostNetwork" in result.stderr
