"""Servers as pods of Kubernetes (https://kubernetes.io): Indexed Jobs, through the official Python client."""

import re
import secrets
import time
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

from pydantic import Field

from swarmwright.servers.launchers import _kubernetes_states as states
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError
from swarmwright.servers.launchers._kubernetes_api import Api
from swarmwright.servers.launchers._kubernetes_manifests import (
    INDEX,
    INSTANCE,
    JOB,
    MANAGER,
    make_job,
    make_secret,
)
from swarmwright.servers.launchers._remote import RemoteOptions
from swarmwright.servers.launchers._specification import Specification

LEAVE_S = 60.0
"""Seconds after their grace period within which deleted pods must end."""
_PODS_PER_REQUEST = 200
"""Pods deleted by one request, whose selector is part of its address."""
Quantity = str | int | float


class KubernetesOptions(RemoteOptions):
    """Pods in a namespace of Kubernetes 1.29 or later."""

    launcher: Literal["kubernetes"] = "kubernetes"
    image: str | None = Field(default=None, min_length=1)
    """Container image with Swarmwright, `sh` and `tar`. Default: swarmwright, tagged with this version."""
    image_pull_policy: Literal["Always", "IfNotPresent", "Never"] | None = None
    """When nodes pull the image. Default: that of Kubernetes."""
    image_pull_secrets: list[str] = Field(default=[])
    """Secrets with the registry's credentials."""
    namespace: str | None = Field(default=None, min_length=1)
    """Namespace. Default: that of the context or of this pod, else `default`."""
    kubeconfig: str | None = Field(default=None, min_length=1)
    """Cluster configuration. Default: KUBECONFIG, else ~/.kube/config, else the service account of this
    pod."""
    context: str | None = Field(default=None, min_length=1)
    """Context of the kubeconfig. Default: the current one."""
    requests: dict[str, Quantity] = Field(default={"cpu": 1, "memory": "256Mi"})
    """Resources reserved per server, as in a manifest."""
    limits: dict[str, Quantity] = Field(default={})
    """Resource limits per server, such as {memory: 2Gi, nvidia.com/gpu: 1}."""
    secrets: list[str] = Field(default=[])
    """Secrets whose keys become environment variables of the servers."""
    labels: dict[str, str] = Field(default={})
    """Further labels of jobs and pods."""
    annotations: dict[str, str] = Field(default={})
    """Annotations of pods."""
    node_selector: dict[str, str] = Field(default={})
    """Labels of the nodes to use."""
    tolerations: list[dict[str, Any]] = Field(default=[])
    """Tolerated taints of nodes, as in a manifest."""
    service_account: str | None = Field(default=None, min_length=1)
    """Service account of the pods; its token is not mounted. Default: the namespace's."""
    priority_class: str | None = Field(default=None, min_length=1)
    """Priority class of the pods."""
    grace: int = Field(default=30, ge=1, le=3600)
    """Seconds from SIGTERM to SIGKILL when a pod is deleted."""
    pod: dict[str, Any] = Field(default={})
    """Further fields of the pods' spec, such as {affinity: .., runtimeClassName: gvisor}; mappings are
    merged, other values replaced."""

    paths: ClassVar[tuple[str, ...]] = (*RemoteOptions.paths, "kubeconfig")


class Kubernetes(Launcher):
    """Launcher of servers as pods of Indexed Jobs.

    One request starts any number of servers. A Deployment could neither end single servers nor leave ended
    ones alone. Kubernetes replaces pods that it evicts, preempts or loses with a node; other ended pods are
    replaced in a new job, under a new id. A job owns the Secret that its servers read, so both are deleted
    together; the job ends by itself if the tool is gone.
    """

    kind: ClassVar[str] = "kubernetes"
    options_model = KubernetesOptions
    options: KubernetesOptions
    interval: ClassVar[float] = 2.0

    def __init__(self, options: KubernetesOptions, specification: Specification) -> None:
        super().__init__(options, specification)
        label = re.sub(r"[^a-z0-9]+", "-", specification.label.lower()).strip("-")[:38].strip("-")
        self.name = f"{label or 'swarmwright'}-{secrets.token_hex(4)}"
        """Name of the run: the label `app.kubernetes.io/instance` of all objects."""
        self._api: Api | None = None
        self._jobs: dict[str, list[int]] = {}
        self._positions: dict[int, tuple[str, int]] = {}
        self._pods: dict[int, str] = {}
        self._number = 0

    @property
    def _selector(self) -> str:
        return f"{INSTANCE}={self.name},{MANAGER}=swarmwright"

    def open(self) -> None:
        """Connect to the cluster.

        Raises:
            InputError: the client is not installed, the kubeconfig is wrong, or there is too much code.
            LauncherError: the cluster cannot be reached, or refuses.
        """
        make_secret("", "", self.specification, {})  # check the size
        self._api = Api(self.options.kubeconfig, self.options.context, self.options.namespace)
        self._api.check_version()
        self._api.list_pods(self._selector)

    def start(self, servers: Sequence[int]) -> None:
        """Create a job with a pod per server, and its Secret."""
        api = self._require_api()
        self._number += 1
        name = f"{self.name}-{self._number}"
        manifest = make_job(name, self.name, list(servers), self.options, self.specification)
        created = api.create_job(manifest)
        self._jobs[name] = list(servers)
        self._positions |= {server: (name, index) for index, server in enumerate(servers)}
        try:
            api.create_secret(make_secret(name, self.name, self.specification, created["metadata"]))
        except LauncherError:
            self.stop(servers)
            raise

    def health(self) -> Mapping[int, Health]:
        """Query the jobs, their pods, and why pods were not created."""
        if not self._positions:
            return {}
        api = self._require_api()
        jobs = {manifest["metadata"]["name"]: manifest for manifest in api.list_jobs(self._selector)}
        pods = states.find_newest(api.list_pods(self._selector))
        self._pods = {
            server: pods[position]["metadata"]["name"]
            for server, position in self._positions.items()
            if position in pods
        }
        self._end_late(jobs, pods)
        without = {name for name, index in self._positions.values() if (name, index) not in pods}
        refused = {name: api.find_refusal(name) for name in without & set(jobs)}
        return {
            server: states.find_health(jobs.get(name), index, pods.get((name, index)), refused.get(name, ""))
            for server, (name, index) in self._positions.items()
        }

    def stop(self, servers: Sequence[int]) -> None:
        """Delete pods, and jobs without other servers."""
        leaving: dict[str, list[int]] = {}
        for server in servers:
            if server in self._positions:
                name, index = self._positions[server]
                leaving.setdefault(name, []).append(index)
        for name, indexes in leaving.items():
            gone = {self._jobs[name][index] for index in indexes}
            remaining = [
                server for server in self._jobs[name] if server in self._positions and server not in gone
            ]
            if remaining:
                self._delete_pods(name, indexes)
            else:
                self._require_api().delete_job(name)
                del self._jobs[name]
            for server in gone:
                del self._positions[server]

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:
        """Return the last lines of a pod."""
        pod = self._pods.get(server)
        return () if pod is None else self._require_api().read_log(pod, lines)[-lines:]

    def close(self) -> None:
        """Delete all jobs, and wait until their pods and Secrets are gone."""
        api, self._api = self._api, None
        if api is None or self._number == 0:
            return
        api.delete_all(self._selector)
        deadline = time.monotonic() + self.options.grace + LEAVE_S
        while remaining := api.list_remaining(self._selector):
            if time.monotonic() > deadline:
                raise LauncherError(f"still present after deletion: {', '.join(remaining)}")
            time.sleep(0.3)
        self._jobs, self._positions, self._pods = {}, {}, {}

    def _require_api(self) -> Api:
        if self._api is None:
            raise LauncherError("the connection to the cluster is closed")
        return self._api

    def _delete_pods(self, name: str, indexes: Sequence[int]) -> None:
        for first in range(0, len(indexes), _PODS_PER_REQUEST):
            selected = ",".join(map(str, indexes[first : first + _PODS_PER_REQUEST]))
            self._require_api().delete_pods(f"{JOB}={name},{INDEX} in ({selected})")

    def _end_late(
        self, jobs: Mapping[str, Mapping[str, Any]], pods: Mapping[tuple[str, int], Mapping[str, Any]]
    ) -> None:
        """Delete pods that were created after their server had been stopped."""
        for name, servers in self._jobs.items():
            late = [
                index
                for index, server in enumerate(servers)
                if server not in self._positions
                and (name, index) in pods
                and states.is_active(pods[name, index])
            ]
            if late and name in jobs:
                self._delete_pods(name, late)
