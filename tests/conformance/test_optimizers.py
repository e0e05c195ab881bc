"""Our optimization tool keeps every rule; each tool that breaks one is caught by this rule and no other."""

import os
import sys

import pytest

from swarmwright.conformance import Report, check_optimizer
from swarmwright.conformance.rules import Profile
from tests.conformance.broken.tools import TOOLS, SoundTool
from tests.conftest import ROOT

PLAIN = "O1.1,O1.2,O2,O3,O7.1"
"""What one run of a tool tells."""
OURS = f'{sys.executable} -m swarmwright optimize {{experiment}} --out "{{folder}}"/run'


@pytest.fixture
def places(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the tools of the tests are imported from."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "python")]))


def report_of(kind: type[SoundTool], rules: str, profile: Profile = "all", *, lasts: float = 6.0) -> Report:
    """Check a tool; `lasts` is waited for in full where a scene does not come to its end."""
    command = f"{sys.executable} -m tests.conformance.broken.tools {kind.__name__} {{broker}}"
    return check_optimizer(command=command, rules=[rules], profile=profile, episodes=2, lasts=lasts)


@pytest.mark.timeout(180)
def test_our_tool_keeps_every_rule() -> None:
    report = check_optimizer(command=OURS)
    assert report.ok, str(report)
    assert not report.of("skipped")


@pytest.mark.timeout(120)
@pytest.mark.usefixtures("places")
def test_the_model_that_broken_tools_are_made_of_is_sound() -> None:
    report = report_of(SoundTool, "", lasts=30.0)
    assert report.ok, str(report)
    assert set(report.of("skipped")) == {"O6.1", "O6.2", "O6.3"}


@pytest.mark.timeout(120)
@pytest.mark.usefixtures("places")
@pytest.mark.parametrize("kind", TOOLS, ids=lambda kind: kind.__name__)
def test_a_broken_tool_is_caught_by_the_right_rule(kind: type[SoundTool]) -> None:
    report = report_of(kind, ",".join([PLAIN, *sorted(kind.breaks)]))
    assert set(report.of("failed", "died")) == kind.breaks, str(report)
