"""The required part of the Kubernetes API; errors quote Kubernetes."""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.servers.launchers._base import LauncherError
from swarmwright.servers.launchers._kubernetes_manifests import CONTAINER

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
