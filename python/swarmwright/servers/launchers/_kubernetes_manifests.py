"""What is created in Kubernetes: a job with a pod for each server, and the Secret that they read."""

import base64
import shlex
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.servers.launchers._remote import called, prepared
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
"""Bytes in a Secret, of Kubernetes."""
FINISHED_KEPT_S = 300
"""Seconds after which Kubernetes deletes a job that has ended, should the tool be gone."""
LOST_NODE_S = 30
"""Seconds after which a pod is replaced whose node does not answer; Kubernetes's default is 300."""


def secret(name: str, run: str, specification: Specification, owner: Mapping[str, Any]) -> dict[str, Any]:
    """Return the Secret of a job.

    owner: metadata of the job.

    Raises:
        InputError: there is more code than a Secret can hold.
    """
    data = specification.files()
    if specification.code is not None:
        data[ARCHIVE] = specification.code.archive
    size = sum(map(len, data.values()))
    if size > LARGEST_SECRET_BYTES:
        raise InputError(
            f"servers: the simulation's code and files are {size / LARGEST_SECRET_BYTES:.1f} MiB, compressed;"
            " a Secret of Kubernetes holds 1 MiB: put them into the image, and name their folder in it with "
            "the option code"
        )
    return {
        "apiVersion": "v1",
        "kind": "Secret",
        "metadata": {
            "name": name,
            "labels": _labels(run),
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


def job(
    name: str, run: str, servers: Sequence[int], options: "KubernetesOptions", specification: Specification
) -> dict[str, Any]:
    """Return the job of some servers."""
    labels = {**options.labels, **_labels(run)}
    return {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"name": name, "labels": labels},
        "spec": {
            "completions": len(servers),
            "parallelism": len(servers),
            "completionMode": "Indexed",
            # A server that failed, or was deleted, is replaced by the pool; one that was evicted, preempted
            # or lost with its node by Kubernetes, but only when it has ended: ids are unique.
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
                "spec": _merged(_pod(name, servers, options, specification), options.pod),
            },
        },
    }


def _labels(run: str) -> dict[str, str]:
    return {
        "app.kubernetes.io/name": "swarmwright",
        "app.kubernetes.io/component": CONTAINER,
        INSTANCE: run,
        MANAGER: "swarmwright",
    }


def _pod(
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
    found: dict[str, Any] = {
        "restartPolicy": "Never",
        "terminationGracePeriodSeconds": options.grace,
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        # What namespaces of the standard `restricted` ask for.
        "securityContext": {"runAsNonRoot": True, "seccompProfile": {"type": "RuntimeDefault"}},
        "tolerations": [*options.tolerations, *lost],
        "containers": [_container(servers, options, specification)],
        "volumes": [
            {"name": "files", "secret": {"secretName": name, "defaultMode": 0o444}},
            {"name": "code", "emptyDir": {}},
        ],
    }
    given: dict[str, Any] = {
        "imagePullSecrets": [{"name": pull_secret} for pull_secret in options.image_pull_secrets],
        "nodeSelector": options.node_selector,
        "serviceAccountName": options.service_account,
        "priorityClassName": options.priority_class,
    }
    return found | {key: value for key, value in given.items() if value}


def _container(
    servers: Sequence[int], options: "KubernetesOptions", specification: Specification
) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": CONTAINER,
        "image": options.image or f"swarmwright:{_engine.__version__}",
        "command": ["/bin/sh", "-c", _script(servers, options, specification)],
        "resources": {
            "requests": {key: str(value) for key, value in options.requests.items()},
            "limits": {key: str(value) for key, value in options.limits.items()},
        },
        "securityContext": {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}},
        "volumeMounts": [
            {"name": "files", "mountPath": FILES, "readOnly": True},
            {"name": "code", "mountPath": CODE},
        ],
        # The end of what a failed server printed is a part of its status.
        "terminationMessagePolicy": "FallbackToLogsOnError",
    }
    if options.image_pull_policy is not None:
        found["imagePullPolicy"] = options.image_pull_policy
    if options.secrets:
        found["envFrom"] = [{"secretRef": {"name": secret_name}} for secret_name in options.secrets]
    return found


def _script(servers: Sequence[int], options: "KubernetesOptions", specification: Specification) -> str:
    travels = specification.code is not None
    code = CODE if travels else options.code
    unpack = f"tar -xzof {FILES}/{ARCHIVE} -C {CODE} || exit 1"
    marked = called(options, specification, 0).replace("--id 0", '--id "$server"')
    return "\n".join(
        [
            *([unpack] if travels else []),
            *prepared(
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


def _merged(base: Any, others: Any) -> Any:  # noqa: ANN401 - parts of a manifest
    if isinstance(base, Mapping) and isinstance(others, Mapping):
        return {**base, **{key: _merged(base.get(key), value) for key, value in others.items()}}
    return others
