"""Servers as pods of Kubernetes (https://kubernetes.io): Indexed Jobs, through the official Python client."""

import base64
import json
import os
import re
import secrets
import shlex
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError, Specification
from swarmwright.servers.launchers._remote import RemoteOptions, format_command, format_setup

if TYPE_CHECKING:
    pass

INSTANCE = "app.kubernetes.io/instance"
MANAGER = "app.kubernetes.io/managed-by"
JOB, INDEX = "batch.kubernetes.io/job-name", "batch.kubernetes.io/job-completion-index"
"""Labels that Kubernetes gives the pods of jobs."""
CONTAINER = "server"
FILES, CODE = "/run/swarmwright/files", "/run/swarmwright/code"
"""Folders in the containers: the Secret, and the unpacked code."""
ARCHIVE = "code.tar.gz"
LARGEST_SECRET_BYTES = 1 << 20
"""Kubernetes's size limit of a Secret."""
FINISHED_KEPT_S = 300
"""Seconds after which Kubernetes deletes an ended job if the tool is gone."""
LOST_NODE_S = 30
"""Seconds until a pod on an unresponsive node is replaced; Kubernetes's default is 300."""


def make_secret(
    name: str, run: str, specification: Specification, owner: Mapping[str, Any]
) -> dict[str, Any]:
    """Build the Secret of a job.

    owner: metadata of the job.

    Raises:
        InputError: the code exceeds the size limit of a Secret.
    """
    data = specification.files()
    if specification.code is not None:
        data[ARCHIVE] = specification.code.archive
    size = sum(map(len, data.values()))
    if size > LARGEST_SECRET_BYTES:
        raise InputError(
            f"servers: the simulation's code and files are {size / LARGEST_SECRET_BYTES:.1f} MiB compressed, "
            "more than the 1 MiB of a Kubernetes Secret; put them into the image and set the option code to "
            "their folder"
        )
    return {
        "apiVersion": "v1",
        "kind": "Secret",
        "metadata": {
            "name": name,
            "labels": _make_labels(run),
            "annotations": {}
            if specification.code is None
            else {"swarmwright/code": specification.code.digest},
            "ownerReferences": [
                {
                    "apiVersion": "batch/v1",
                    "kind": "Job",
                    "name": name,
                    "uid": owner.get("uid", ""),
                }
            ],
        },
        "type": "Opaque",
        "immutable": True,
        "data": {key: base64.b64encode(value).decode() for key, value in data.items()},
    }


def make_job(
    name: str, run: str, servers: Sequence[int], options: "KubernetesOptions", specification: Specification
) -> dict[str, Any]:
    """Build the job of servers."""
    labels = {**options.labels, **_make_labels(run)}
    return {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"name": name, "labels": labels},
        "spec": {
            "completions": len(servers),
            "parallelism": len(servers),
            "completionMode": "Indexed",
            # Failed or deleted servers are replaced by the launcher; evicted, preempted or lost ones by
            # Kubernetes, but only after their end, as ids are unique.
            "backoffLimitPerIndex": 0,
            "podReplacementPolicy": "Failed",
            "podFailurePolicy": {
                "rules": [
                    {"action": "Ignore", "onPodConditions": [{"type": "DisruptionTarget", "status": "True"}]}
                ]
            },
            "ttlSecondsAfterFinished": FINISHED_KEPT_S,
            "template": {
                "metadata": {"labels": labels, "annotations": options.annotations},
                "spec": _merge(_make_pod(name, servers, options, specification), options.pod),
            },
        },
    }


def _make_labels(run: str) -> dict[str, str]:
    return {
        "app.kubernetes.io/name": "swarmwright",
        "app.kubernetes.io/component": CONTAINER,
        INSTANCE: run,
        MANAGER: "swarmwright",
    }


def _make_pod(
    name: str, servers: Sequence[int], options: "KubernetesOptions", specification: Specification
) -> dict[str, Any]:
    lost = [
        {
            "key": f"node.kubernetes.io/{key}",
            "operator": "Exists",
            "effect": "NoExecute",
            "tolerationSeconds": LOST_NODE_S,
        }
        for key in ("not-ready", "unreachable")
    ]
    spec: dict[str, Any] = {
        "restartPolicy": "Never",
        "terminationGracePeriodSeconds": options.grace,
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        # Required in namespaces with the standard `restricted`.
        "securityContext": {"runAsNonRoot": True, "seccompProfile": {"type": "RuntimeDefault"}},
        "tolerations": [*options.tolerations, *lost],
        "containers": [_make_container(servers, options, specification)],
        "volumes": [
            {"name": "files", "secret": {"secretName": name, "defaultMode": 0o444}},
            {"name": "code", "emptyDir": {}},
        ],
    }
    optional: dict[str, Any] = {
        "imagePullSecrets": [{"name": pull_secret} for pull_secret in options.image_pull_secrets],
        "nodeSelector": options.node_selector,
        "serviceAccountName": options.service_account,
        "priorityClassName": options.priority_class,
    }
    return spec | {key: value for key, value in optional.items() if value}


def _make_container(
    servers: Sequence[int], options: "KubernetesOptions", specification: Specification
) -> dict[str, Any]:
    container: dict[str, Any] = {
        "name": CONTAINER,
        "image": options.image or f"swarmwright:{_engine.__version__}",
        "command": ["/bin/sh", "-c", _format_script(servers, options, specification)],
        "resources": {
            "requests": {key: str(value) for key, value in options.requests.items()},
            "limits": {key: str(value) for key, value in options.limits.items()},
        },
        "securityContext": {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}},
        "volumeMounts": [
            {"name": "files", "mountPath": FILES, "readOnly": True},
            {"name": "code", "mountPath": CODE},
        ],
        # The end of a failed server's output becomes part of its status.
        "terminationMessagePolicy": "FallbackToLogsOnError",
    }
    if options.image_pull_policy is not None:
        container["imagePullPolicy"] = options.image_pull_policy
    if options.secrets:
        container["envFrom"] = [{"secretRef": {"name": secret_name}} for secret_name in options.secrets]
    return container


def _format_script(servers: Sequence[int], options: "KubernetesOptions", specification: Specification) -> str:
    travels = specification.code is not None
    code = CODE if travels else options.code
    unpack = f"tar -xzof {FILES}/{ARCHIVE} -C {CODE} || exit 1"
    marked = format_command(options, specification, 0).replace("--id 0", '--id "$server"')
    return "\n".join(
        [
            *([unpack] if travels else []),
            *format_setup(
                options,
                specification.variables(FILES),
                shlex.quote(code or CODE),
                None if code is None else shlex.quote(code),
            ),
            f"set -- {shlex.join(map(str, servers))}",
            'shift "$JOB_COMPLETION_INDEX"',
            "server=$1",
            f"exec {marked}",
        ]
    )


def _merge(base: Any, update: Any) -> Any:  # noqa: ANN401 - parts of a manifest
    if isinstance(base, Mapping) and isinstance(update, Mapping):
        return {**base, **{key: _merge(base.get(key), value) for key, value in update.items()}}
    return update


Object = Mapping[str, Any]

OVERDUE_S = 15.0
"""Seconds beyond its grace period after which a deleted pod is considered lost with its node."""
_FATAL_REASONS = {
    "CreateContainerConfigError",
    "CreateContainerError",
    "ErrImageNeverPull",
    "ImageInspectError",
    "ImagePullBackOff",
    "InvalidImageName",
    "RunContainerError",
}
"""Reasons of waiting containers that do not resolve by themselves."""
_POD = re.compile(r'^Error creating: |(?<=pods) "[^"]*"(?= is forbidden)')
_QUOTA = re.compile(r"requested: (.*), used: .*, limited: (.*)$")
_UNITS = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12, "P": 1e15, "E": 1e18}
_UNITS |= {f"{letter}i": 1024.0**power for power, letter in enumerate("KMGTPE", 1)}


def find_newest(pods: Iterable[Object]) -> dict[tuple[str, int], Object]:
    """Return the newest pod of each index of each job."""
    newest_pods: dict[tuple[str, int], Object] = {}
    for pod in sorted(pods, key=_sort_key):
        labels = pod["metadata"].get("labels", {})
        if JOB in labels and INDEX in labels:
            newest_pods[labels[JOB], int(labels[INDEX])] = pod
    return newest_pods


def _sort_key(pod: Object) -> tuple[str, bool]:
    meta = pod["metadata"]
    return meta.get("creationTimestamp") or "", "deletionTimestamp" not in meta


def is_active(pod: Object) -> bool:
    """Whether a pod may still start or run and was not deleted."""
    ended = pod.get("status", {}).get("phase") in {"Succeeded", "Failed"}
    return not ended and not pod["metadata"].get("deletionTimestamp")


def find_health(job: Object | None, index: int, pod: Object | None, refusal: str) -> Health:
    """Return the state of a server.

    Args:
        job: its job; None if deleted.
        index: its index in the job.
        pod: its newest pod, if any.
        refusal: why pods of the job could not be created, or empty.
    """
    if job is None:
        return Health("ended", "its job was deleted")
    if pod is None:
        status = job.get("status", {})
        for key in ("failedIndexes", "completedIndexes"):
            if index in _parse_indexes(status.get(key) or ""):
                return Health("ended", "its pod was deleted")
        words = _POD.sub("", refusal)
        return Health("ended" if _is_refused_forever(refusal) else "waiting", words)
    name = pod["metadata"]["name"]
    deleted = pod["metadata"].get("deletionTimestamp")
    status = pod.get("status", {})
    phase = status.get("phase")
    if phase in {"Succeeded", "Failed"}:
        return _describe_end(name, pod)
    if deleted and (datetime.now(UTC) - datetime.fromisoformat(deleted)).total_seconds() > OVERDUE_S:
        node = pod.get("spec", {}).get("nodeName", "")
        return Health("ended", f"pod {name} was deleted; its node {node} does not end it")
    if phase == "Running":
        return Health("running")
    return _describe_pending(name, status)


def _describe_pending(name: str, status: Object) -> Health:
    for condition in status.get("conditions") or []:
        if condition["type"] == "PodScheduled" and condition["status"] != "True" and condition.get("message"):
            return Health("waiting", f"{condition.get('reason', 'not scheduled')}: {condition['message']}")
    for container in status.get("containerStatuses") or []:
        waits = container.get("state", {}).get("waiting") or {}
        reason = waits.get("reason", "")
        words = ": ".join(filter(None, [reason, waits.get("message")]))
        if reason in _FATAL_REASONS:
            return Health("ended", f"pod {name}: {words}")
        if waits.get("message"):
            return Health("waiting", words)
    return Health("waiting")


def _describe_end(name: str, pod: Object) -> Health:
    status = pod["status"]
    for condition in status.get("conditions") or []:
        if condition["type"] == "DisruptionTarget" and condition["status"] == "True":
            # Kubernetes replaces the pod.
            words = f"{condition.get('reason', 'disrupted')}: {condition.get('message', '')}".rstrip(": ")
            return Health("waiting", f"pod {name} was ended by {words}")
    parts = [status.get("reason"), status.get("message")]
    for container in status.get("containerStatuses") or []:
        end = container.get("state", {}).get("terminated")
        if end:
            reason = "" if end.get("reason") in {None, "Error", "Completed"} else f", {end['reason']}"
            parts.append(f"ended with status {end.get('exitCode')}{reason}")
    return Health("ended", f"pod {name}: {': '.join(filter(None, parts)) or 'ended'}")


def _parse_indexes(text: str) -> set[int]:
    """Parse a text such as 1,3-5 into numbers."""
    indexes: set[int] = set()
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        indexes.update(range(int(first), int(last or first) + 1))
    return indexes


def _is_refused_forever(refusal: str) -> bool:
    """Whether a pod is refused for good, rather than until others end."""
    if "forbidden" not in refusal and "nvalid" not in refusal:
        return False
    if "exceeded quota" not in refusal:
        return True
    match = _QUOTA.search(refusal)
    if match is None:
        return False
    requested, most = (
        dict(pair.split("=", 1) for pair in text.split(",") if "=" in pair) for text in match.groups()
    )
    return any(
        key in most and _parse_quantity(value) > _parse_quantity(most[key])
        for key, value in requested.items()
    )


def _parse_quantity(quantity: str) -> float:
    match = re.fullmatch(r"([-+.\d]+(?:[eE][-+]?\d+)?)([A-Za-z]*)", quantity.strip())
    if match is None:
        return 0.0
    return float(match[1]) * _UNITS.get(match[2], 1.0)


_TIMEOUTS_S = (10.0, 60.0)
"""Time limits for a connection and for an answer, seconds."""
_PAGE_ITEMS = 500
"""Items per list request."""
_OLDEST = (1, 29)
_ACCOUNT = Path("/var/run/secrets/kubernetes.io/serviceaccount/namespace")


class Api:
    """A namespace of a cluster.

    Args:
        kubeconfig: file; None to search like kubectl, else the service account of this pod.
        context: context of the kubeconfig; None for the current one.
        namespace: None for that of the context.

    Raises:
        InputError: the client is not installed, or the configuration is wrong.
    """

    def __init__(self, kubeconfig: str | None, context: str | None, namespace: str | None) -> None:
        try:
            import kubernetes  # noqa: PLC0415 - optional
        except ImportError as error:
            raise InputError(
                "servers: kubernetes needs the package kubernetes: pip install 'swarmwright[kubernetes]'"
            ) from error
        self._client: Any = None
        configured = self._connect(kubernetes, kubeconfig, context)
        self.namespace = namespace or configured or "default"
        self._batch: Any = kubernetes.client.BatchV1Api(self._client)
        self._core: Any = kubernetes.client.CoreV1Api(self._client)
        self._version: Any = kubernetes.client.VersionApi(self._client)

    def _connect(self, library: Any, kubeconfig: str | None, context: str | None) -> str | None:  # noqa: ANN401 - a module
        """Create the client; return the namespace in the configuration."""
        config = library.config
        settings = library.client.Configuration()
        settings.retries = False  # the launcher retries
        inside = "KUBERNETES_SERVICE_HOST" in os.environ
        paths = kubeconfig or os.environ.get("KUBECONFIG") or str(Path("~/.kube/config").expanduser())
        files = [path for path in paths.split(os.pathsep) if Path(path).exists()]
        field = f"servers: kubeconfig: {paths}"
        try:
            if not files and kubeconfig is None and context is None and inside:
                config.load_incluster_config(client_configuration=settings)
                self._client = library.client.ApiClient(settings)
                return _ACCOUNT.read_text(encoding="utf-8").strip() if _ACCOUNT.exists() else None
            if not files:
                raise InputError(
                    f"{field}: does not exist; set the option kubeconfig or the environment variable "
                    "KUBECONFIG"
                )
            contexts, active = config.list_kube_config_contexts(config_file=paths)
            names = [entry["name"] for entry in contexts]
            if context is not None and context not in names:
                raise InputError(
                    f"servers: context: {context} is not in {paths}; available: {', '.join(names)}"
                )
            config.load_kube_config(paths, context, settings, persist_config=False)
        except (config.ConfigException, OSError, ValueError, TypeError) as error:
            raise InputError(f"{field}: cannot be used: {error}") from error
        self._client = library.client.ApiClient(settings)
        chosen = active if context is None else next(entry for entry in contexts if entry["name"] == context)
        return str(chosen["context"].get("namespace") or "") or None

    def check_version(self) -> None:
        """Raise LauncherError if the cluster cannot be reached or is too old."""
        version = self._request(self._version.get_code)
        numbers = [
            int("".join(filter(str.isdecimal, version.get(key, ""))) or 0) for key in ("major", "minor")
        ]
        if tuple(numbers) < _OLDEST:
            raise LauncherError(
                f"{self._client.configuration.host} runs Kubernetes {version.get('gitVersion')}; "
                f"{_OLDEST[0]}.{_OLDEST[1]} or later is needed"
            )

    def create_job(self, manifest: Mapping[str, Any]) -> dict[str, Any]:
        """Create a job and return it."""
        return self._create(self._batch.create_namespaced_job, manifest)

    def create_secret(self, manifest: Mapping[str, Any]) -> dict[str, Any]:
        """Create a Secret and return it."""
        return self._create(self._core.create_namespaced_secret, manifest)

    def list_jobs(self, selector: str) -> list[dict[str, Any]]:
        """List jobs."""
        return self._list(self._batch.list_namespaced_job, label_selector=selector)

    def list_pods(self, selector: str) -> list[dict[str, Any]]:
        """List pods."""
        return self._list(self._core.list_namespaced_pod, label_selector=selector)

    def find_refusal(self, job: str) -> str:
        """Return why the last pod of a job could not be created, or an empty text."""
        selector = f"involvedObject.kind=Job,involvedObject.name={job},reason=FailedCreate"
        try:
            events = self._list(self._core.list_namespaced_event, field_selector=selector)
        except LauncherError:  # reading events needs a separate permission
            return ""
        latest = max(
            events, key=lambda event: event.get("lastTimestamp") or event.get("eventTime") or "", default={}
        )
        return str(latest.get("message", ""))

    def read_log(self, pod: str, lines: int) -> list[str]:
        """Return the last lines of a pod's log, if there is one."""
        try:
            with self._errors():
                answer = self._core.read_namespaced_pod_log(
                    pod,
                    self.namespace,
                    container=CONTAINER,
                    tail_lines=lines,
                    _preload_content=False,
                    _request_timeout=_TIMEOUTS_S,
                )
                return str(answer.data.decode(errors="replace")).splitlines()
        except LauncherError:
            return []

    def delete_job(self, name: str) -> None:
        """Delete a job and its pods, if it exists."""
        try:
            self._request(
                self._batch.delete_namespaced_job, name, self.namespace, propagation_policy="Background"
            )
        except NotFoundError:
            return

    def delete_pods(self, selector: str) -> None:
        """Delete pods."""
        self._request(self._core.delete_collection_namespaced_pod, self.namespace, label_selector=selector)

    def delete_all(self, selector: str) -> None:
        """Delete jobs, with their pods, and Secrets."""
        self._request(
            self._batch.delete_collection_namespaced_job,
            self.namespace,
            label_selector=selector,
            propagation_policy="Background",
        )
        self._request(self._core.delete_collection_namespaced_secret, self.namespace, label_selector=selector)

    def list_remaining(self, selector: str) -> list[str]:
        """Return the names of existing jobs and pods."""
        objects = {"job": self.list_jobs(selector), "pod": self.list_pods(selector)}
        return [f"{kind} {item['metadata']['name']}" for kind, items in objects.items() for item in items]

    def _create(self, method: Callable[..., Any], manifest: Mapping[str, Any]) -> dict[str, Any]:
        from pydantic import ValidationError  # noqa: PLC0415 - the client's, too

        try:
            return self._request(method, self.namespace, dict(manifest), field_validation="Strict")
        except ValidationError as error:  # raised by the client's models
            first = error.errors()[0]
            field = ".".join(str(part) for part in first["loc"] if not isinstance(part, int))
            raise InputError(f"servers: kubernetes: {field}: {first['msg']}") from error

    def _list(self, method: Callable[..., Any], **selectors: str) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = []
        more: dict[str, Any] = {}
        while True:
            answer = self._request(method, self.namespace, limit=_PAGE_ITEMS, **selectors, **more)
            items += answer.get("items") or []
            token = answer.get("metadata", {}).get("continue")
            if not token:
                return items
            more = {"_continue": token}

    def _request(self, method: Callable[..., Any], *arguments: object, **options: object) -> dict[str, Any]:
        """Call the client without its models, which refuse answers of later versions of Kubernetes."""
        with self._errors():
            answer = method(*arguments, _preload_content=False, _request_timeout=_TIMEOUTS_S, **options)
            content: dict[str, Any] = json.loads(answer.data)
            return content

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Convert errors of the client to LauncherError within this block."""
        from kubernetes.client.exceptions import ApiException  # noqa: PLC0415
        from urllib3.exceptions import HTTPError  # noqa: PLC0415

        host = self._client.configuration.host
        try:
            yield
        except ApiException as error:
            kind = NotFoundError if error.status == 404 else LauncherError
            raise kind(_format_error(host, error)) from error
        except (HTTPError, OSError) as error:
            raise LauncherError(f"{host} cannot be reached: {_find_cause(error)}") from error
        except json.JSONDecodeError as error:
            raise LauncherError(f"{host} is not a Kubernetes API: {error}") from error


class NotFoundError(LauncherError):
    """The requested object does not exist."""


def _format_error(host: str, error: Any) -> str:  # noqa: ANN401 - of a library without types
    """Return Kubernetes's error message."""
    body = error.body if isinstance(error.body, str | bytes) else getattr(error, "data", None) or b""
    try:
        message = str(json.loads(body)["message"])
    except (ValueError, KeyError, TypeError):
        message = str(error.reason or "").strip()
    if error.status == 401:
        return f"{host} rejects the credentials: {message or 'Unauthorized'} (401)"
    return f"{message} ({error.status})"


def _find_cause(error: BaseException) -> str:
    """Return the underlying message of the operating system or of TLS."""
    reason: Any = getattr(error, "reason", None)
    while isinstance(reason, BaseException) and getattr(reason, "reason", None) is not reason:
        error, reason = reason, getattr(reason, "reason", None)
    text = str(error)
    return text.rpartition(": Failed to establish a new connection: ")[2] or text


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
        pods = find_newest(api.list_pods(self._selector))
        self._pods = {
            server: pods[position]["metadata"]["name"]
            for server, position in self._positions.items()
            if position in pods
        }
        self._end_late(jobs, pods)
        without = {name for name, index in self._positions.values() if (name, index) not in pods}
        refused = {name: api.find_refusal(name) for name in without & set(jobs)}
        return {
            server: find_health(jobs.get(name), index, pods.get((name, index)), refused.get(name, ""))
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
                if server not in self._positions and (name, index) in pods and is_active(pods[name, index])
            ]
            if late and name in jobs:
                self._delete_pods(name, late)
