"""The API of Kubernetes, as far as it is needed, with its own words in errors."""

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
"""Seconds for a connection, and for an answer."""
_PAGE_ITEMS = 500
"""Items that one request lists."""
_OLDEST = (1, 29)
_ACCOUNT = Path("/var/run/secrets/kubernetes.io/serviceaccount/namespace")


class Api:
    """A namespace of a cluster.

    Args:
        kubeconfig: file; None: as kubectl finds it, else the service account of this pod.
        context: of the kubeconfig; None: its current one.
        namespace: None: that of the context.

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
        found = self._connect(kubernetes, kubeconfig, context)
        self.namespace = namespace or found or "default"
        self._batch: Any = kubernetes.client.BatchV1Api(self._client)
        self._core: Any = kubernetes.client.CoreV1Api(self._client)
        self._version: Any = kubernetes.client.VersionApi(self._client)

    def _connect(self, library: Any, kubeconfig: str | None, context: str | None) -> str | None:  # noqa: ANN401 - a module
        """Make the client; return the namespace that the configuration names."""
        config = library.config
        settings = library.client.Configuration()
        settings.retries = False  # the pool tries again
        inside = "KUBERNETES_SERVICE_HOST" in os.environ
        given = kubeconfig or os.environ.get("KUBECONFIG") or str(Path("~/.kube/config").expanduser())
        files = [path for path in given.split(os.pathsep) if Path(path).exists()]
        where = f"servers: kubeconfig: {given}"
        try:
            if not files and kubeconfig is None and context is None and inside:
                config.load_incluster_config(client_configuration=settings)
                self._client = library.client.ApiClient(settings)
                return _ACCOUNT.read_text(encoding="utf-8").strip() if _ACCOUNT.exists() else None
            if not files:
                raise InputError(
                    f"{where}: is not there; name a file with the option kubeconfig or the environment "
                    "variable KUBECONFIG"
                )
            contexts, active = config.list_kube_config_contexts(config_file=given)
            names = [named["name"] for named in contexts]
            if context is not None and context not in names:
                raise InputError(
                    f"servers: context: {context} is not in {given}; available: {', '.join(names)}"
                )
            config.load_kube_config(given, context, settings, persist_config=False)
        except (config.ConfigException, OSError, ValueError, TypeError) as error:
            raise InputError(f"{where}: cannot be used: {error}") from error
        self._client = library.client.ApiClient(settings)
        chosen = active if context is None else next(named for named in contexts if named["name"] == context)
        return str(chosen["context"].get("namespace") or "") or None

    def check_version(self) -> None:
        """Raise LauncherError for a cluster that cannot be reached or is too old."""
        found = self._json(self._version.get_code)
        numbers = [int("".join(filter(str.isdecimal, found.get(key, ""))) or 0) for key in ("major", "minor")]
        if tuple(numbers) < _OLDEST:
            raise LauncherError(
                f"{self._client.configuration.host} is Kubernetes {found.get('gitVersion')}; "
                f"{_OLDEST[0]}.{_OLDEST[1]} or later is needed"
            )

    def create_job(self, manifest: Mapping[str, Any]) -> dict[str, Any]:
        """Create a job; return it."""
        return self._create(self._batch.create_namespaced_job, manifest)

    def create_secret(self, manifest: Mapping[str, Any]) -> dict[str, Any]:
        """Create a Secret; return it."""
        return self._create(self._core.create_namespaced_secret, manifest)

    def jobs(self, selector: str) -> list[dict[str, Any]]:
        """Return jobs."""
        return self._list(self._batch.list_namespaced_job, label_selector=selector)

    def pods(self, selector: str) -> list[dict[str, Any]]:
        """Return pods."""
        return self._list(self._core.list_namespaced_pod, label_selector=selector)

    def refusal(self, job: str) -> str:
        """Return why the last pod of a job could not be created; empty if there is no such event."""
        chosen = f"involvedObject.kind=Job,involvedObject.name={job},reason=FailedCreate"
        try:
            events = self._list(self._core.list_namespaced_event, field_selector=chosen)
        except LauncherError:  # events need a right of their own
            return ""
        latest = max(
            events, key=lambda event: event.get("lastTimestamp") or event.get("eventTime") or "", default={}
        )
        return str(latest.get("message", ""))

    def log(self, pod: str, lines: int) -> list[str]:
        """Return the last lines of a pod; none where there is no log."""
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
        """Delete a job, with its pods; one that is gone is not an error."""
        try:
            self._json(
                self._batch.delete_namespaced_job, name, self.namespace, propagation_policy="Background"
            )
        except NotThereError:
            return

    def delete_pods(self, selector: str) -> None:
        """Delete pods."""
        self._json(self._core.delete_collection_namespaced_pod, self.namespace, label_selector=selector)

    def delete_all(self, selector: str) -> None:
        """Delete jobs, with their pods, and Secrets."""
        self._json(
            self._batch.delete_collection_namespaced_job,
            self.namespace,
            label_selector=selector,
            propagation_policy="Background",
        )
        self._json(self._core.delete_collection_namespaced_secret, self.namespace, label_selector=selector)

    def left(self, selector: str) -> list[str]:
        """Return the names of jobs and pods that are there."""
        found = {"job": self.jobs(selector), "pod": self.pods(selector)}
        return [f"{kind} {item['metadata']['name']}" for kind, some in found.items() for item in some]

    def _create(self, method: Callable[..., Any], manifest: Mapping[str, Any]) -> dict[str, Any]:
        from pydantic import ValidationError  # noqa: PLC0415 - the client's, too

        try:
            return self._json(method, self.namespace, dict(manifest), field_validation="Strict")
        except ValidationError as error:  # of the client's models
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"] if not isinstance(part, int))
            raise InputError(f"servers: kubernetes: {where}: {first['msg']}") from error

    def _list(self, method: Callable[..., Any], **chosen: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []
        more: dict[str, Any] = {}
        while True:
            answer = self._json(method, self.namespace, limit=_PAGE_ITEMS, **chosen, **more)
            found += answer.get("items") or []
            token = answer.get("metadata", {}).get("continue")
            if not token:
                return found
            more = {"_continue": token}

    def _json(self, method: Callable[..., Any], *arguments: object, **others: object) -> dict[str, Any]:
        """Call the client, without its models: these refuse what later versions of Kubernetes answer."""
        with self._errors():
            answer = method(*arguments, _preload_content=False, _request_timeout=_TIMEOUTS_S, **others)
            found: dict[str, Any] = json.loads(answer.data)
            return found

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Within this block, errors of the client become LauncherErrors."""
        from kubernetes.client.exceptions import ApiException  # noqa: PLC0415
        from urllib3.exceptions import HTTPError  # noqa: PLC0415

        host = self._client.configuration.host
        try:
            yield
        except ApiException as error:
            kind = NotThereError if error.status == 404 else LauncherError
            raise kind(_words(host, error)) from error
        except (HTTPError, OSError) as error:
            raise LauncherError(f"{host} cannot be reached: {_cause(error)}") from error
        except json.JSONDecodeError as error:
            raise LauncherError(f"{host} does not answer as Kubernetes does: {error}") from error


class NotThereError(LauncherError):
    """What was asked for is not there, or not any more."""


def _words(host: str, error: Any) -> str:  # noqa: ANN401 - of a library without types
    """Return what Kubernetes says."""
    body = error.body if isinstance(error.body, str | bytes) else getattr(error, "data", None) or b""
    try:
        said = str(json.loads(body)["message"])
    except (ValueError, KeyError, TypeError):
        said = str(error.reason or "").strip()
    if error.status == 401:
        return f"{host} does not accept the credentials: {said or 'Unauthorized'} (401)"
    return f"{said} ({error.status})"


def _cause(error: BaseException) -> str:
    """Return the words of the operating system or of TLS, without the names of objects around them."""
    reason: Any = getattr(error, "reason", None)
    while isinstance(reason, BaseException) and getattr(reason, "reason", None) is not reason:
        error, reason = reason, getattr(reason, "reason", None)
    text = str(error)
    return text.rpartition(": Failed to establish a new connection: ")[2] or text
