"""What a server announces decides which rules it has to keep: no announcement requires more than it says."""

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import ClassVar

import pytest

from swarmwright.conformance import check_server
from swarmwright.conformance.results import Report
from tests.conformance.sound import Json, SoundServer
from tests.conftest import ROOT

RESERVED = {"S6.7", "S6.8", "S6.9", "S6.10", "S6.11", "S6.12", "S6.13", "S7.2", "S7.3", "S7.4", "S11.3"}
"""Rules for servers with presence, which are held for tools that name themselves."""
ONE_ID = {"S16.1", "S16.2", "S16.3", "S16.4", "S16.5"}
WHY = "no presence is published, and none is required"
EXAMPLES = ROOT / "wrappers" / "examples" / "python"


class Plain(SoundServer):
    """Is free after each episode, minds no tool, publishes no presence; announces what is required below."""

    announcement: ClassVar[Json]

    def capabilities(self) -> Json:
        capabilities = super().capabilities()
        return {**capabilities, "swarmwright": {"version": 1, **self.announcement}}

    def will(self) -> None:
        pass

    def tell(self) -> None:
        pass

    def on_control(self, content: Json) -> None:
        super().on_control({key: value for key, value in content.items() if key != "tool"})


class Presenting(Plain):
    """Publishes presence, and is not held all the same."""

    def will(self) -> None:
        SoundServer.will(self)

    def tell(self) -> None:
        SoundServer.tell(self)


def report_of(kind: type[Plain], announcement: Json, rules: str) -> Report:
    class Announcing(kind):  # type: ignore[valid-type,misc]
        pass

    Announcing.announcement = announcement
    with ExitStack() as stack:

        def start(url: str) -> None:
            stack.callback(Announcing(url).close)

        return check_server(
            start=start,
            simulation="toy",
            sensors=2,
            actuators=1,
            rules=[rules],
            timeout=2.0,
            wait=5.0,
        )


@pytest.mark.parametrize(
    "announcement",
    [
        {"sensors": 2, "actuators": 1},
        {"metrics": ["arrived", "steps"]},
        {"determinism": "bitwise"},
        {"scenes": True},
        {"control": True},
        {"modes": ["stepwise"]},
    ],
    ids=lambda announcement: next(iter(announcement)),
)
def test_an_announcement_does_not_require_presence(announcement: Json) -> None:
    report = report_of(Plain, announcement, "S1,S2.3,S2.8,S2.9,S3.1,S6.7,S6.8,S6.11,S6.12,S7,S8,S14,S15.1")
    assert report.ok, str(report)
    reasons = {result.id: result.detail for result in report.results if result.id in RESERVED}
    assert reasons, "they are in the report"
    assert all(WHY in reason for reason in reasons.values()), reasons


@pytest.mark.parametrize(
    ("kind", "announcement", "broken"),
    [
        (Plain, {"instance": "a"}, {"S6.7", "S6.12", "S7.2"}),
        (Plain, {"modes": ["offloaded"]}, {"S6.7", "S6.12", "S7.2"}),
        (Plain, {"modes": ["batched"]}, {"S6.7", "S6.12", "S7.2"}),
        (Presenting, {"scenes": True}, {"S6.7", "S6.12"}),
    ],
    ids=["instance", "offloaded", "batched", "presence"],
)
def test_who_needs_presence_is_held_as_well(kind: type[Plain], announcement: Json, broken: set[str]) -> None:
    report = report_of(kind, announcement, "S1,S2,S6.7,S6.12,S7.2")
    assert set(report.list_ids("failed", "died")) == broken, str(report)


@pytest.mark.timeout(200)
@pytest.mark.parametrize("program", ["line_server.py", "scene_server.py"])
def test_the_servers_of_the_page_keep_every_rule_that_applies(program: str) -> None:
    """Every rule, also those that wait for seconds."""
    report = check_server(
        command=f"{sys.executable} {EXAMPLES / program} {{broker}} {{id}}",
        simulation="line",
        parameters={"agents": 3},
        sensors=1,
        actuators=1,
        timeout=2.0,
    )
    assert report.ok, str(report)
    assert set(report.list_ids("skipped")) >= RESERVED | ONE_ID
    assert {"S2.5", "S3.5", "S4.2"} <= set(report.list_ids("passed")), "those that need agents and a seed"
    scenes = {"S14.1", "S14.2", "S14.3"}
    assert scenes <= set(report.list_ids("passed" if program == "scene_server.py" else "skipped"))


class FailsInScenes(Plain):
    """Its episodes fail when they are to be shown, as its message says."""

    def sense(self) -> None:
        if self.topic is None:
            super().sense()
            return
        assert self.world is not None
        failed = {"kind": "failed", "reason": "Swarm.scene: TypeError: no wheels (swarm.py:36)"}
        self.show(self.topic, {**self.picture(self.world), **failed})
        self.enter("free")


def test_the_reason_that_a_server_gives_is_shown() -> None:
    report = report_of(FailsInScenes, {"scenes": True}, "S1.1,S2.3,S14.1")
    (failed,) = (result for result in report.results if result.status == "failed")
    assert failed.id == "S14.1"
    assert failed.came == (
        "the message failed came, with the reason: Swarm.scene: TypeError: no wheels (swarm.py:36)"
    )
    assert failed.seconds < 2.0, "it is not waited for"


RAISES = """\
from swarmwright import Simulation
import numpy as np

class Raises(Simulation):
    title, sensors, actuators = "raises", 1, 1

    def reset(self, parameters, seed):
        print("before", flush=True)
        return np.zeros((1, 1))

    def step(self, actions):
        raise ValueError("no wheels")

    def done(self):
        return False

    def fitness(self):
        return 0.0
"""


def test_what_a_process_prints_in_the_episode_is_shown(tmp_path: Path) -> None:
    (tmp_path / "raises.py").write_text(RAISES)
    serve = f"{sys.executable} -m swarmwright serve {tmp_path}/raises.py:Raises"
    report = check_server(
        command=f"{serve} --broker {{broker}} --id {{id}}", rules=["S1.1,S2.3"], timeout=2.0
    )
    (failed,) = (result for result in report.results if result.status == "failed")
    assert failed.id == "S2.3"
    assert "nothing arrived within 2 s after 1 sensor messages; it said last:\n" in failed.came
    assert "ValueError: no wheels" in failed.came
