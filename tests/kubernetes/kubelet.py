"""What runs pods on a machine without a container runtime: their commands as processes, in mount namespaces.

Nodes, statuses, Secrets, volumes and deletions go through the API, as with Kubernetes's own kubelet; images
are names only, and probes are not made. Needs root.
"""

import base64
import http.server
import json
import os
import shlex
import signal
import ssl
import subprocess
import sys
import threading
import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from kubernetes import client, config
from kubernetes.client.exceptions import ApiException

from swarmwright import _engine

POLL_S = 0.2
_LEASE_S = 10.0


def now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


class _RefusedError(Exception):
    """A container cannot be started: the reason, and whether it is tried again."""

    def __init__(self, reason: str, message: str = "") -> None:
        super().__init__(reason)
        self.reason, self.message = reason, message


class _Pod:
    """A pod that was bound to a node."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.process: subprocess.Popen[bytes] | None = None
        self.told: Any = None
        self.ended_at: float | None = None
        self.pulls = 0

    @property
    def log(self) -> Path:
        return self.folder / "log"

    def terminate(self, grace: float) -> None:
        """Send SIGTERM once; SIGKILL after the grace."""
        if self.process is None or self.process.poll() is not None:
            return
        if self.ended_at is None:
            self.ended_at = time.monotonic() + grace
            self.process.send_signal(signal.SIGTERM)
        elif time.monotonic() > self.ended_at:
            os.killpg(self.process.pid, signal.SIGKILL)


def _read(method: Any, *arguments: str) -> dict[str, Any]:
    """Return an answer of the API as it is."""
    found: dict[str, Any] = json.loads(method(*arguments, _preload_content=False).data)
    return found


def _end(code: int) -> dict[str, Any]:
    reason = "Error" if code else "Completed"
    return {"exitCode": code, "reason": reason, "startedAt": now(), "finishedAt": now()}


class Kubelet:
    """All nodes of a cluster.

    Args:
        kubeconfig: an administrator's.
        folder: for containers' files and output.
        images: those that can be pulled.
    """

    def __init__(self, kubeconfig: Path, folder: Path, images: set[str]) -> None:
        self._folder, self._images = folder, images
        self._core: Any = client.CoreV1Api(config.new_client_from_config(str(kubeconfig)))  # type: ignore[no-untyped-call]
        self._leases: Any = client.CoordinationV1Api(self._core.api_client)
        self._pods: dict[str, _Pod] = {}
        self._nodes: set[str] = set()
        self._renewed = 0.0
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="kubelet", daemon=True)
        self._server = self._logs()
        self.failure: BaseException | None = None

    def start(self, *nodes: str) -> None:
        """Register nodes with four processors each."""
        for name in nodes:
            self._register(name)
        self._thread.start()
        threading.Thread(target=self._server.serve_forever, daemon=True, name="logs").start()

    def stop(self) -> None:
        """End all processes."""
        self._stopping.set()
        self._thread.join()
        self._server.shutdown()
        self._server.server_close()
        for one in self._pods.values():
            if one.process is not None:
                with suppress(ProcessLookupError):
                    os.killpg(one.process.pid, signal.SIGKILL)
                one.process.wait()

    def kill(self) -> None:
        """End all processes at once, as when the nodes fail."""
        for one in list(self._pods.values()):
            if one.process is not None and one.process.poll() is None:
                os.killpg(one.process.pid, signal.SIGKILL)

    def processes(self) -> int:
        """How many pods' programs run."""
        return sum(
            one.process is not None and one.process.poll() is None for one in list(self._pods.values())
        )

    def _keep(self) -> None:
        while not self._stopping.wait(POLL_S):
            try:
                self._look()
            except ApiException as error:
                if error.status not in {404, 409}:  # changed by others meanwhile
                    self.failure = error
            except Exception as error:  # noqa: BLE001 - the API server may be away for a while
                self.failure = error

    def _look(self) -> None:
        if time.monotonic() - self._renewed > _LEASE_S / 3:
            self._renew()
        pods = _read(self._core.list_pod_for_all_namespaces)["items"]
        there = {pod["metadata"]["uid"]: pod for pod in pods}
        for uid, pod in there.items():
            if pod["spec"].get("nodeName") in self._nodes:
                with suppress(ApiException):
                    self._sync(uid, pod)
        for uid in set(self._pods) - set(there):
            self._pods[uid].terminate(1)
            if self._pods[uid].process is None or self._pods[uid].process.poll() is not None:  # type: ignore[union-attr] # another thread does not change it
                del self._pods[uid]

    def _sync(self, uid: str, pod: dict[str, Any]) -> None:
        """Bring a pod nearer to what it should be."""
        one = self._pods.setdefault(uid, _Pod(self._folder / uid))
        meta, phase = pod["metadata"], pod["status"].get("phase")
        deleted = meta.get("deletionTimestamp")
        if deleted and one.process is not None:
            one.terminate(meta.get("deletionGracePeriodSeconds") or 0)
        status = None if one.process is None else one.process.poll()
        if status is not None and phase not in {"Succeeded", "Failed"}:
            code = status if status >= 0 else 128 - status
            self._tell(pod, one, "Failed" if code else "Succeeded", {"terminated": _end(code)})
        elif deleted and one.process is None and phase == "Pending":
            self._tell(
                pod, one, "Failed", {"terminated": {"exitCode": 137, "reason": "ContainerStatusUnknown"}}
            )
        elif deleted and (one.process is None or status is not None):
            options = client.V1DeleteOptions(
                grace_period_seconds=0, preconditions=client.V1Preconditions(uid=uid)
            )
            self._core.delete_namespaced_pod(meta["name"], meta["namespace"], body=options)
        elif one.process is None and phase == "Pending" and not deleted:
            try:
                self._start(pod, one)
            except _RefusedError as refusal:
                words = {
                    "reason": refusal.reason,
                    **({"message": refusal.message} if refusal.message else {}),
                }
                self._tell(pod, one, "Pending", {"waiting": words})
            else:
                self._tell(pod, one, "Running", {"running": {"startedAt": now()}})

    def _tell(self, pod: dict[str, Any], one: _Pod, phase: str, state: dict[str, Any]) -> None:
        """Write a pod's status, if it changes."""
        told = (phase, {key: value for key, value in state.items() if key == "waiting"})
        if told == one.told:
            return
        container = pod["spec"]["containers"][0]
        ready = phase == "Running"
        others = [
            c for c in pod["status"].get("conditions") or [] if c["type"] not in {"Ready", "ContainersReady"}
        ]
        flags = [
            {"type": kind, "status": str(ready), "lastTransitionTime": now()}
            for kind in ("Ready", "ContainersReady")
        ]
        body = {
            "status": {
                "phase": phase,
                "hostIP": "127.0.0.1",
                "podIP": "127.0.0.1",
                "podIPs": [{"ip": "127.0.0.1"}],
                "startTime": now(),
                "conditions": [*others, *flags],
                "containerStatuses": [
                    {
                        "name": container["name"],
                        "image": container["image"],
                        "imageID": "",
                        "ready": ready,
                        "restartCount": 0,
                        "state": state,
                    }
                ],
            }
        }
        self._core.patch_namespaced_pod_status(pod["metadata"]["name"], pod["metadata"]["namespace"], body)
        one.told = told

    def _start(self, pod: dict[str, Any], one: _Pod) -> None:
        container = pod["spec"]["containers"][0]
        image = container["image"]
        if image not in self._images:
            one.pulls += 1
            if one.pulls == 1:
                raise _RefusedError("ErrImagePull", f'failed to pull image "{image}": not found')
            raise _RefusedError("ImagePullBackOff", f'Back-off pulling image "{image}": not found')
        variables = self._variables(pod, container)
        one.folder.mkdir(parents=True, exist_ok=True)
        volumes = {volume["name"]: self._volume(pod, volume, one.folder) for volume in pod["spec"]["volumes"]}
        lines = ["set -e", "mount -t tmpfs tmpfs /run", *self._hosts(one.folder)]
        for mount in container.get("volumeMounts") or []:
            source, target = shlex.quote(str(volumes[mount["name"]])), shlex.quote(mount["mountPath"])
            lines += [f"mkdir -p {target}", f"mount --bind {source} {target}"]
        lines.append('exec "$@"')
        command = [*(container.get("command") or []), *(container.get("args") or [])]
        with one.log.open("ab") as log:
            one.process = subprocess.Popen(
                [
                    "unshare",
                    "--mount",
                    "--propagation",
                    "private",
                    "sh",
                    "-c",
                    "\n".join(lines),
                    "pod",
                    *command,
                ],
                cwd="/",
                env=variables,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def _hosts(self, folder: Path) -> list[str]:
        """Give the names of Services; all pods are on this machine's network."""
        found = _read(self._core.list_service_for_all_namespaces)["items"]
        names = " ".join(one["metadata"]["name"] for one in found)
        (folder / "hosts").write_text(f"127.0.0.1 localhost {names}\n")
        return [f"mount --bind {shlex.quote(str(folder / 'hosts'))} /etc/hosts"]

    def _variables(self, pod: dict[str, Any], container: dict[str, Any]) -> dict[str, str]:
        path = f"{Path(sys.executable).parent}:/usr/bin:/bin"  # of an image with Swarmwright
        found = {"PATH": path, "HOME": "/tmp", "HOSTNAME": pod["metadata"]["name"]}
        for one in container.get("envFrom") or []:
            secret = self._secret(pod, one["secretRef"]["name"])
            if secret is None:
                raise _RefusedError(
                    "CreateContainerConfigError", f'secret "{one["secretRef"]["name"]}" not found'
                )
            found |= {key: base64.b64decode(value).decode() for key, value in secret.items()}
        for one in container.get("env") or []:
            if "value" in one:
                found[one["name"]] = one["value"]
            elif "valueFrom" in one:
                where, _, key = (
                    one["valueFrom"]["fieldRef"]["fieldPath"].removeprefix("metadata.").partition("[")
                )
                found[one["name"]] = pod["metadata"][where][key.strip("'[]")]
        return found

    def _volume(self, pod: dict[str, Any], volume: dict[str, Any], folder: Path) -> Path:
        """Return the folder of a volume."""
        place = folder / str(volume["name"])
        namespace = pod["metadata"]["namespace"]
        if "persistentVolumeClaim" in volume:
            name = volume["persistentVolumeClaim"]["claimName"]
            claim = self._core.read_namespaced_persistent_volume_claim(name, namespace)
            disk = self._core.read_persistent_volume(claim.spec.volume_name)
            return Path(str(disk.spec.host_path.path))
        data: dict[str, bytes] = {}
        if "secret" in volume:
            secret = self._secret(pod, volume["secret"]["secretName"])
            if secret is None:
                raise _RefusedError("ContainerCreating")  # and an event, in a real cluster
            data = {key: base64.b64decode(value) for key, value in secret.items()}
            items = volume["secret"].get("items")
            data = data if items is None else {one["path"]: data[one["key"]] for one in items}
        if "configMap" in volume:
            found = self._core.read_namespaced_config_map(volume["configMap"]["name"], namespace)
            data = {key: value.encode() for key, value in (found.data or {}).items()}
        place.mkdir(exist_ok=True)
        for key, value in data.items():
            (place / key).write_bytes(value)
        return place

    def _secret(self, pod: dict[str, Any], name: str) -> dict[str, str] | None:
        try:
            found = _read(self._core.read_namespaced_secret, name, pod["metadata"]["namespace"])
        except ApiException as error:
            if error.status == 404:
                return None
            raise
        return found.get("data") or {}

    def _register(self, name: str) -> None:
        node = {"apiVersion": "v1", "kind": "Node", "metadata": {"name": name, "labels": {"node": name}}}
        self._core.create_node(node)
        self._nodes.add(name)
        room = {"cpu": "4", "memory": "8Gi", "pods": "110"}
        status = {
            "capacity": room,
            "allocatable": room,
            "addresses": [{"type": "InternalIP", "address": "127.0.0.1"}],
            "daemonEndpoints": {"kubeletEndpoint": {"Port": self._server.server_address[1]}},
            "conditions": [{"type": "Ready", "status": "True", "reason": "KubeletReady"}],
        }
        self._core.patch_node_status(name, {"status": status})

    def _renew(self) -> None:
        """Say that the nodes are alive."""
        self._renewed = time.monotonic()
        stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        for name in self._nodes:
            spec = {"holderIdentity": name, "leaseDurationSeconds": 40, "renewTime": stamp}
            lease = {"metadata": {"name": name}, "spec": spec}
            try:
                self._leases.patch_namespaced_lease(name, "kube-node-lease", lease)
            except ApiException as error:
                if error.status != 404:
                    raise
                self._leases.create_namespaced_lease("kube-node-lease", lease)

    def _logs(self) -> http.server.ThreadingHTTPServer:
        """What the API server asks for `kubectl logs`."""
        kubelet = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                parts = urlsplit(self.path)
                name = parts.path.split("/")[3]
                last = int(parse_qs(parts.query).get("tailLines", ["1000000"])[0])
                pods = kubelet._core.list_pod_for_all_namespaces(field_selector=f"metadata.name={name}")
                one = kubelet._pods.get(pods.items[0].metadata.uid) if pods.items else None
                lines = b"" if one is None or not one.log.exists() else one.log.read_bytes()
                self.send_response(200)
                self.end_headers()
                self.wfile.write(b"\n".join(lines.splitlines()[-last:]) + b"\n")

            def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002 - the interface's name
                pass

        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        _, _, certificate, key = _engine.certificates(["127.0.0.1"], 1)
        pem = self._folder / "kubelet.pem"
        pem.write_text(certificate + key)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(pem)
        server.socket = context.wrap_socket(server.socket, server_side=True)
        return server
