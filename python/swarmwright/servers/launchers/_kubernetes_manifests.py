"""Kubernetes manifests: a job with a pod per server, and the Secret that the pods read."""

import base64
import shlex
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.servers.launchers._remote import format_command, format_setup
from swarmwright.servers.launchers._specification import Specification

if TYPE_CHECKING:
    from swarmwright.servers.launchers.kubernetes import KubernetesOptions

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
