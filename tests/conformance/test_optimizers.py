"""Our optimization tool keeps every rule; each tool that breaks one is caught by this rule and no other."""

import os
import sys
from unittest.mock import MagicMock

import pytest

from swarmwright.conformance import Report, check_optimizer
from swarmwright.conformance.optimizer._stage import Record
from swarmwright.conformance.optimizer._tool import Tool, ToolSettings
from swarmwright.conformance.optimizer.episodes import uses_answering_servers
from swarmwright.conformance.rules import Profile, Skip
from swarmwright.servers.broker.client import Failure
from tests.conformance.broken.tools import (
    TOOLS,
    FailsAtOnce,
    LosesRefusedWork,
    OnlyBatches,
    OnlyOffloads,
    SoundTool,
)
from tests.conftest import ROOT

PLAIN = "O1.1,O1.2,O2,O3,O7.1"
"""What one run of a tool tells."""
OURS = f'{sys.executable} -m swarmwright optimize {{experiment}} --out "{{folder}}"/run'


@pytest.fixture
def places(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the tools of the tests are imported from."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "python")]))


def report_of(kind: type[SoundTool], rules: str, profile: Profile = "all", *, lasts: float = 15.0) -> Report:
    """Check a tool; `lasts` is waited for in full where a scene does not come to its end."""
    command = f"{sys.executable} -m tests.conformance.broken.tools {kind.__name__} {{broker}}"
    return check_optimizer(command=command, rules=[rules], profile=profile, episodes=2, lasts=lasts)


@pytest.mark.timeout(180)
def test_our_tool_keeps_every_rule() -> None:
    report = check_optimizer(command=OURS)
    assert report.ok, str(report)
    assert not report.list_ids("skipped")


@pytest.mark.timeout(120)
@pytest.mark.usefixtures("places")
def test_the_model_that_broken_tools_are_made_of_is_sound() -> None:
    report = report_of(SoundTool, "", lasts=30.0)
    assert report.ok, str(report)
    assert set(report.list_ids("skipped")) == {"O6.1", "O6.2", "O6.3"}


@pytest.mark.timeout(120)
@pytest.mark.usefixtures("places")
@pytest.mark.parametrize("kind", TOOLS, ids=lambda kind: kind.__name__)
def test_a_broken_tool_is_caught_by_the_right_rule(kind: type[SoundTool]) -> None:
    report = report_of(kind, ",".join([PLAIN, *sorted(kind.breaks)]))
    assert set(report.list_ids("failed", "died")) == kind.breaks, str(report)


@pytest.mark.timeout(180)
@pytest.mark.usefixtures("places")
@pytest.mark.parametrize(("kind", "requests"), [(OnlyOffloads, {"O6.1", "O6.2"}), (OnlyBatches, {"O6.3"})])
def test_stepwise_rules_are_skipped_for_a_tool_of_another_mode(
    kind: type[SoundTool], requests: set[str]
) -> None:
    report = report_of(kind, "O1,O2,O3.1,O3.7,O4.1,O6,O7.1")
    assert report.ok, str(report)
    assert set(report.list_ids("passed")) == {"O1.1", "O1.3", "O2.4", *requests}, str(report)
    assert "only" in next(result.detail for result in report.results if result.id == "O1.2")
    assert str(report).splitlines()[0].endswith("it played no episode stepwise: is that meant?")


@pytest.mark.timeout(120)
@pytest.mark.usefixtures("places")
@pytest.mark.parametrize("kind", [LosesRefusedWork, FailsAtOnce], ids=lambda kind: kind.__name__)
def test_a_tool_of_one_mode_that_evaluates_too_little_is_caught(kind: type[SoundTool]) -> None:
    """How many episodes its run has is not known from stepwise ones."""
    report = report_of(kind, "O1.1,O1.2,O6.1,O6.2")
    assert set(report.list_ids("failed", "died")) == kind.breaks, str(report)


class Recalled(Tool):
    """A tool that offloads, and ended in some way where servers were stepwise."""

    def __init__(self, ended: str, status: int | None, *, started: bool = True) -> None:
        settings = ToolSettings(title=None, sensors=3, actuators=2, episodes=2, lasts=1.0, wait=1.0)
        super().__init__("", "", settings, door=None, process=MagicMock() if started else None)
        self._scenes["plain"] = Record(ended=ended, status=status)
        if started:
            self._scenes["offloaded"] = Record(requests=[{}])


def test_a_tool_that_ends_with_an_error_at_stepwise_servers_is_doubted() -> None:
    """It may have found no server of its mode; a signal that killed it is a mistake."""
    with pytest.raises(Skip, match=r"only offloaded; with stepwise servers: ended with 1") as skipped:
        uses_answering_servers(Recalled("ended with 1", 1))
    assert skipped.value.doubt
    with pytest.raises(Failure, match="SIGSEGV"):
        uses_answering_servers(Recalled("killed by SIGSEGV", -11))


def test_a_tool_that_others_start_is_to_be_started_by_the_kit_for_another_mode() -> None:
    with pytest.raises(Failure, match=r"let the kit start the tool \(--exec\) if it only offloads"):
        uses_answering_servers(Recalled("", None, started=False))
