"""A real Kubernetes on this machine: etcd, API server, controllers and scheduler, on loopback."""

import base64
import json
import os
import secrets
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa

from tests.conftest import free_port


def until(holds: Callable[[], object]) -> None:
    """Wait; the test's own time-out ends this."""
    while not holds():
        time.sleep(0.1)


class ControlPlane:
    """What decides; `kubelet.Kubelet` is what runs pods.

    Args:
        binaries: folder of the programs.
        folder: for data and logs.
    """

    def __init__(self, binaries: Path, folder: Path) -> None:
        self._binaries, self.folder = binaries, folder
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._port = free_port()
        self._etcd = free_port()
        self.token = secrets.token_hex(16)
        self.address = f"https://127.0.0.1:{self._port}"
        self.kubeconfig = folder / "admin.yaml"

    def start(self) -> None:
        """Start everything, and wait until the API answers."""
        self._write_keys()
        (self.folder / "tokens.csv").write_text(
            f'{self.token},admin,admin,"system:masters"\n{self.token}-poor,poor,poor,"people"\n'
        )
        peer = free_port()
        self._run(
            "etcd",
            f"--data-dir={self.folder}/etcd",
            f"--listen-client-urls=http://127.0.0.1:{self._etcd}",
            f"--advertise-client-urls=http://127.0.0.1:{self._etcd}",
            f"--listen-peer-urls=http://127.0.0.1:{peer}",
            f"--initial-advertise-peer-urls=http://127.0.0.1:{peer}",
            f"--initial-cluster=default=http://127.0.0.1:{peer}",
            "--unsafe-no-fsync",
        )
        self.start_api()
        self.write_kubeconfig(self.kubeconfig, self.token)
        common = (f"--kubeconfig={self.kubeconfig}", "--leader-elect=false", "--secure-port=0")
        self._run(
            "kube-controller-manager",
            *common,
            f"--service-account-private-key-file={self.folder}/accounts.key",
            f"--root-ca-file={self.folder}/apiserver.crt",
            "--kube-api-qps=200",
            "--kube-api-burst=400",
        )
        self._run("kube-scheduler", *common)

    def start_api(self) -> None:
        """Start the API server, and wait until it is ready."""
        self._run(
            "kube-apiserver",
            f"--etcd-servers=http://127.0.0.1:{self._etcd}",
            "--bind-address=127.0.0.1",
            "--advertise-address=127.0.0.1",
            "--endpoint-reconciler-type=none",
            f"--secure-port={self._port}",
            f"--cert-dir={self.folder}",
            "--authorization-mode=RBAC",
            f"--token-auth-file={self.folder}/tokens.csv",
            "--service-cluster-ip-range=10.0.0.0/24",
            "--service-account-issuer=https://kubernetes.default.svc",
            f"--service-account-key-file={self.folder}/accounts.pub",
            f"--service-account-signing-key-file={self.folder}/accounts.key",
            "--disable-admission-plugins=TaintNodesByCondition",
            "--kubelet-preferred-address-types=InternalIP",
        )
        until(lambda: (self.folder / "apiserver.crt").exists() and self._is_ready())

    def stop_api(self) -> None:
        """End the API server, as when its machine fails."""
        process = self._processes.pop("kube-apiserver")
        process.kill()
        process.wait()

    def stop(self) -> None:
        """End everything."""
        for process in reversed(self._processes.values()):
            process.kill()
            process.wait()
        self._processes = {}

    def write_kubeconfig(self, file: Path, token: str, namespace: str = "default") -> None:
        """Write a kubeconfig for a token."""
        authority = base64.b64encode((self.folder / "apiserver.crt").read_bytes()).decode()
        made = {
            "apiVersion": "v1",
            "kind": "Config",
            "current-context": "test",
            "contexts": [
                {"name": "test", "context": {"cluster": "here", "user": "one", "namespace": namespace}}
            ],
            "clusters": [
                {
                    "name": "here",
                    "cluster": {"server": self.address, "certificate-authority-data": authority},
                }
            ],
            "users": [{"name": "one", "user": {"token": token}}],
        }
        file.write_text(json.dumps(made))

    def kubectl(self, *arguments: str, given: str | None = None) -> str:
        """Return what kubectl prints."""
        result = subprocess.run(
            ["kubectl", f"--kubeconfig={self.kubeconfig}", *arguments],
            input=given,
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "HOME": str(self.folder)},
        )
        assert result.returncode == 0, f"kubectl {' '.join(arguments)}: {result.stderr}"
        return result.stdout

    def get(self, kind: str, namespace: str, *arguments: str) -> list[dict[str, Any]]:
        """Return objects."""
        found = json.loads(self.kubectl("get", kind, "-n", namespace, "-o", "json", *arguments))
        return list(found["items"])

    def names(self, kind: str, namespace: str) -> list[str]:
        """Return the names of objects."""
        return [one["metadata"]["name"] for one in self.get(kind, namespace)]

    def _is_ready(self) -> bool:
        import urllib3

        authority = str(self.folder / "apiserver.crt")
        try:
            with urllib3.PoolManager(ca_certs=authority, retries=False) as pool:
                headers = {"Authorization": f"Bearer {self.token}"}
                return pool.request("GET", f"{self.address}/readyz", headers=headers, timeout=5).status == 200
        except urllib3.exceptions.HTTPError:
            return False

    def _write_keys(self) -> None:
        key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
        (self.folder / "accounts.key").write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM,
                serialization.PrivateFormat.TraditionalOpenSSL,
                serialization.NoEncryption(),
            )
        )
        (self.folder / "accounts.pub").write_bytes(
            key.public_key().public_bytes(
                serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
            )
        )

    def _run(self, name: str, *arguments: str) -> None:
        with (self.folder / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                [self._binaries / name, *arguments], stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
