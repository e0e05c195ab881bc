"""What jobs and pods say, as Kubernetes 1.34 writes it, and the states that follow."""

from typing import Any

import pytest

from swarmwright.servers.launchers import kubernetes as states
from swarmwright.servers.launchers.kubernetes import INDEX, JOB

JUST = {"metadata": {"name": "j"}, "status": {}}
QUOTA = (
    'Error creating: pods "j-0-abcde" is forbidden: exceeded quota: lab, '
    "requested: pods=1,requests.cpu=500m, used: pods={used}, limited: pods=2,requests.cpu={cpu}"
)


def pod(name: str = "j-0-a", phase: str = "Pending", **others: Any) -> dict[str, Any]:
    meta = {"name": name, "creationTimestamp": others.pop("made", "2026-01-01T00:00:00Z")}
    if "deleted" in others:
        meta["deletionTimestamp"] = others.pop("deleted")
    labels = {JOB: "j", INDEX: "0"}
    return {"metadata": {**meta, "labels": labels}, "status": {"phase": phase, **others}}


def waiting(reason: str, message: str = "") -> list[dict[str, Any]]:
    return [{"name": "server", "state": {"waiting": {"reason": reason, "message": message}}}]


@pytest.mark.parametrize(
    ("made", "state", "words"),
    [
        (pod(phase="Running"), "running", ""),
        (pod(), "waiting", ""),
        (
            pod(
                conditions=[
                    {
                        "type": "PodScheduled",
                        "status": "False",
                        "reason": "Unschedulable",
                        "message": "0/2 nodes are available: 2 Insufficient cpu.",
                    }
                ]
            ),
            "waiting",
            "Unschedulable: 0/2 nodes are available: 2 Insufficient cpu.",
        ),
        (pod(containerStatuses=waiting("ContainerCreating")), "waiting", ""),
        (pod(containerStatuses=waiting("ErrImagePull", "not found")), "waiting", "ErrImagePull: not found"),
        (
            pod(containerStatuses=waiting("ImagePullBackOff", "Back-off pulling image x")),
            "ended",
            "pod j-0-a: ImagePullBackOff: Back-off pulling image x",
        ),
        (
            pod(
                phase="Failed",
                containerStatuses=[{"state": {"terminated": {"exitCode": 137, "reason": "OOMKilled"}}}],
            ),
            "ended",
            "pod j-0-a: ended with status 137, OOMKilled",
        ),
        (
            pod(phase="Failed", reason="Evicted", message="The node was low on resource: memory."),
            "ended",
            "pod j-0-a: Evicted: The node was low on resource: memory.",
        ),
        (
            pod(
                phase="Failed",
                conditions=[
                    {
                        "type": "DisruptionTarget",
                        "status": "True",
                        "reason": "EvictionByEvictionAPI",
                        "message": "Eviction API: evicting",
                    }
                ],
            ),
            "waiting",
            "pod j-0-a was ended by EvictionByEvictionAPI: Eviction API: evicting",
        ),
        (
            pod(phase="Running", deleted="2026-01-01T00:00:00Z"),
            "ended",
            "pod j-0-a was deleted; its node  does not end it",
        ),
    ],
)
def test_a_pod(made: dict[str, Any], state: str, words: str) -> None:
    found = states.find_health(JUST, 0, made, "")
    assert (found.state, found.reason) == (state, words)


@pytest.mark.parametrize(
    ("job", "refusal", "state", "words"),
    [
        (None, "", "ended", "its job was deleted"),
        (JUST, "", "waiting", ""),
        ({"metadata": {}, "status": {"failedIndexes": "1,3-5"}}, "", "ended", "its pod was deleted"),
        ({"metadata": {}, "status": {"failedIndexes": "1,3,5-7"}}, "", "waiting", ""),
        (JUST, QUOTA.format(used=2, cpu=4), "waiting", "pods is forbidden: exceeded quota: lab"),
        (JUST, QUOTA.format(used=0, cpu="0.2"), "ended", "pods is forbidden: exceeded quota: lab"),
        (JUST, QUOTA.format(used=0, cpu="501m"), "waiting", "pods is forbidden: exceeded quota: lab"),
        (
            JUST,
            'Error creating: pods "j-0-x" is forbidden: violates PodSecurity "restricted": runAsNonRoot',
            "ended",
            'pods is forbidden: violates PodSecurity "restricted": runAsNonRoot',
        ),
    ],
)
def test_without_a_pod(job: dict[str, Any] | None, refusal: str, state: str, words: str) -> None:
    found = states.find_health(job, 4, None, refusal)
    assert found.state == state
    assert found.reason.startswith(words)


def test_the_newest_pod_of_an_index_counts() -> None:
    first, second = pod("a", "Failed"), pod("b", "Running", made="2026-01-01T00:00:05Z")
    stranger = {"metadata": {"name": "other", "creationTimestamp": "2026-01-01T00:00:09Z"}, "status": {}}
    assert states.find_newest([second, stranger, first]) == {("j", 0): second}
