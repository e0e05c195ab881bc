"""The Helm chart: linted, refused where values are wrong, and installed in a real Kubernetes."""

import os
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from swarmwright import Experiment, optimize
from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD
from tests.conftest import PROGRAM, ROOT, free_port
from tests.kubernetes.cluster import until
from tests.kubernetes.conftest import IMAGE, Cluster
from tests.python.records import same_record

CHART = ROOT / "deploy/helm/swarmwright"
FILES = (
    "ca.pem",
    "broker.pem",
    "broker-key.pem",
    "passwords",
    "acl",
    "server.password",
    "tool.password",
)
"""What the documentation puts into the Secret."""
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
        (("credentials=lab", "tool.arguments={--wait,null}"), "arguments"),
    ],
)
def test_wrong_values(binaries: Path, values: tuple[str, ...], message: str) -> None:
    given = [part for value in values for part in ("--set", value)]
    assert message in helm(binaries, "template", "x", str(CHART), "--kube-version=1.34.0", *given, status=1)


def templates(binaries: Path, *values: str) -> dict[str, dict[str, Any]]:
    """Return the container of each component."""
    given = [
        part
        for value in ("credentials=lab", f"tool.experiment={EXPERIMENT.replace(',', chr(92) + ',')}", *values)
        for part in ("--set", value)
    ]
    text = helm(binaries, "template", "x", str(CHART), "--kube-version=1.34.0", *given)
    found = [one for one in yaml.safe_load_all(text) if one["kind"] in {"Deployment", "Job"}]
    return {
        one["metadata"]["labels"]["app.kubernetes.io/component"]: one["spec"]["template"]["spec"]
        for one in found
    }


@pytest.mark.parametrize("prefix", ["", "lab1", "lab 1/hall"])
def test_accounts_are_those_of_the_prefix(binaries: Path, tmp_path: Path, prefix: str) -> None:
    lab = tmp_path / "lab"
    given = ("--prefix", prefix) if prefix else ()
    subprocess.run([*PROGRAM, "broker", "--init", str(lab), "--host", "b", *given], check=True)
    for role, pod in templates(binaries, f"prefix={prefix}").items():
        (container,) = pod["containers"]
        if role != "broker":
            variables = {one["name"]: one.get("value") for one in container["env"]}
            user = variables["SWARMWRIGHT_USERNAME"]
            assert f"{user}:" in (lab / "passwords").read_text()
            assert variables["SWARMWRIGHT_PASSWORD_FILE"] == f"/etc/swarmwright/{user}.password"
            assert any(prefix in word for word in container["args"] if "prefix" in word) == bool(prefix)
        (secret,) = [one["secret"] for one in pod["volumes"] if one["name"] == "credentials"]
        assert all((lab / one["key"]).is_file() for one in secret["items"])
        assert "ca-key.pem" not in str(pod)


def test_the_job_waits_and_is_resumed_with_what_resume_takes(binaries: Path, tmp_path: Path) -> None:
    program = tmp_path / "swarmwright"
    program.write_text('#!/bin/sh\nfor word; do echo "$word"; done\n')
    program.chmod(0o755)
    words = [
        "--seed",
        "3",
        "--set",
        "timeouts.step=5",
        "--set=controller.kind=x",
        "--set",
        "ranking.kind=race",
    ]
    words += ["--set=method.generations=9", "--json", "--wait", "500", "--servers=2"]
    comma = ","
    given = f"tool.arguments={{{comma.join(words)}}}"
    (container,) = templates(binaries, given, "prefix=lab1")["tool"]["containers"]
    assert all(isinstance(word, str) for word in container["args"])

    def said(run: Path) -> list[str]:
        variables = {"RUN": str(run), "PATH": f"{tmp_path}:{os.environ['PATH']}"}
        command = [*container["command"], *container["args"]]
        return subprocess.run(
            command, env=variables, capture_output=True, text=True, check=True
        ).stdout.splitlines()

    run = tmp_path / "a run"
    waits = ["--wait=300", "--set=timeouts.discovery=300", '--set=prefix="lab1"']
    first = ["optimize", "/etc/experiment/experiment.yaml", "--out", str(run)]
    assert said(run) == [*first, *waits, *words]
    run.mkdir()
    (run / "run.sqlite").touch()
    kept = ["--set=timeouts.step=5", "--set=method.generations=9", "--json", "--wait", "500", "--servers=2"]
    assert said(run) == ["resume", str(run), *waits, *kept]
    # As `resume` has them.
    script = container["command"][2]
    assert {key for key in KEYS_OUTSIDE_RECORD | {"method"} if f"--set={key}" not in script} == set()
    # An experiment that says how long to wait is not overridden.
    longer = "tool.experiment=timeouts: {discovery: 900}"
    assert "timeouts.discovery=300" not in str(templates(binaries, longer)["tool"])


def test_a_release_optimizes_in_the_cluster(cluster: Cluster, binaries: Path, tmp_path: Path) -> None:
    control, port = cluster.control, free_port()
    control.kubectl("create", "namespace", "chart")
    control.kubectl("label", "namespace", "chart", "pod-security.kubernetes.io/enforce=restricted")
    until(lambda: "default" in control.names("serviceaccounts", "chart"))
    lab, disk = tmp_path / "lab", tmp_path / "disk"
    subprocess.run([*PROGRAM, "broker", "--init", str(lab), "--host", "lab-swarmwright-broker"], check=True)
    disk.mkdir()
    files = [f"--from-file={lab}/{name}" for name in FILES]
    control.kubectl("create", "secret", "generic", "lab", "-n", "chart", *files)
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
