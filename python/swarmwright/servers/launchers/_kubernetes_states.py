"""Conversion of the states of jobs and pods to those of servers."""

import re
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from swarmwright.servers.launchers._base import Health
from swarmwright.servers.launchers._kubernetes_manifests import INDEX, JOB

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
