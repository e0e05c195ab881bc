"""Whose each rule is, and that a peer which knows D6.1 alone is blamed for nothing else."""

import os
import re
import sys

import pytest

from swarmwright.common.errors import InputError
from swarmwright.conformance import check_server
from swarmwright.conformance.optimizer import RULES as OPTIMIZER
from swarmwright.conformance.rules import Rules
from swarmwright.conformance.server import RULES as SERVER
from tests.conformance.broken.base import Broken
from tests.conformance.broken.discovery import OffersEverything
from tests.conformance.broken.episodes import IgnoresTheEnd, StaysTaken
from tests.conformance.broken.messages import AnyHash, AnyServer, ConvertsText, CountsAnybody
from tests.conformance.broken.tools import AsksEverybody, LeastTool
from tests.conformance.sound import Json
from tests.conformance.test_broken_servers import report_of
from tests.conformance.test_optimizers import report_of as report_of_tool
from tests.conftest import ROOT

LEAST = f"{sys.executable} {ROOT}/tests/conformance/least.py {{broker}} {{id}}"
SWARMWRIGHTS = {
    "S1": (5,),
    "S2": (4, 8, 11),
    "S4": (1, 3, 4),
    "S5": (4, 5, 9, 10, 11),
    "S6": (1, 3, 4),
    "S11": (4,),
    "O1": (3,),
    "O5": (1, 2, 3),
    "O7": (2,),
}
"""What D6.1 does not demand, though a peer that knows D6.1 alone may be tried for it."""


def test_every_rule_says_whose_it_is() -> None:
    for rules in (SERVER, OPTIMIZER):
        for rule in rules:
            assert rule.owner == ("D6.1" if rule.d61 else "Swarmwright"), rule.id
            assert rule.source.startswith("D6.1, ") or rule.source == f"Swarmwright, {rule.where}"
            if rule.d61:
                parts = re.split(r"; |, | and | to ", rule.d61)
                assert all(re.match(r"[567]\.\d|(Schemas? )?\d|[A-Z]\w+ message", part) for part in parts)
                assert rule.id.partition(".")[0] in {"S1", "S2", "S5", "S6", "O1", "O2", "O3", "O4"}


@pytest.mark.parametrize(
    "number", [f"{group}.{number}" for group, numbers in SWARMWRIGHTS.items() for number in numbers]
)
def test_what_d61_does_not_demand_is_swarmwrights(number: str) -> None:
    rules: Rules = SERVER if number.startswith("S") else OPTIMIZER
    assert rules[number].owner == "Swarmwright"
    with pytest.raises(InputError, match=r"not rules of D6\.1"):
        rules.select([number], "d6.1")


def test_the_least_that_d61_demands_is_enough() -> None:
    """The server departs from Swarmwright's rules wherever D6.1 lets it."""
    report = check_server(command=LEAST, simulation="least", actuators=1, timeout=3.0, profile="d6.1")
    assert report.ok, str(report)
    assert {result.owner for result in report.results} == {"D6.1"}
    # What can be told only of a server that waits for its answers.
    assert set(report.list_ids("skipped")) == {"S5.1", "S5.2", "S5.3", "S5.6", "S5.7", "S5.8"}


def test_it_breaks_swarmwrights_rules_and_no_other() -> None:
    wanted = ["S1", "S2", "S4", "S6", "-S6.5"]
    report = check_server(command=LEAST, simulation="least", actuators=1, timeout=1.0, rules=wanted)
    failed = {result.id: result.owner for result in report.results if result.status in {"failed", "died"}}
    assert set(failed.values()) == {"Swarmwright"}, str(report)
    assert {"S1.5", "S2.4", "S2.11", "S2.13", "S2.14", "S6.1"} <= failed.keys(), str(report)
    text = str(report)
    assert text.index("D6.1's rules:") < text.index("Swarmwright's rules:") < text.index("S1.5 ")
    assert "S2.11 Control without parameters for its hash starts nothing. (Swarmwright, protocol.md" in text


@pytest.mark.parametrize(
    "kind", [OffersEverything, StaysTaken, IgnoresTheEnd, ConvertsText, CountsAnybody, AnyHash, AnyServer]
)
def test_a_server_that_breaks_d61_is_caught_with_the_profile(kind: type[Broken]) -> None:
    report = report_of(kind, "", profile="d6.1")
    assert set(report.list_ids("failed", "died")) == kind.breaks, str(report)


@pytest.fixture
def _places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "python")]))


@pytest.mark.timeout(120)
@pytest.mark.usefixtures("_places")
def test_the_least_that_d61_demands_of_a_tool_is_enough() -> None:
    report = report_of_tool(LeastTool, "", profile="d6.1", lasts=30.0)
    assert report.ok, str(report)
    assert not report.list_ids("skipped")
    wide = report_of_tool(LeastTool, "O2,O3,O4.6,O4.7")
    assert {"O4.6", "O4.7"} <= set(wide.list_ids("failed")), str(wide)
    assert {result.owner for result in wide.results if result.status == "failed"} == {"Swarmwright"}


class LooseFlags(Broken):
    """Takes whatever is true in JavaScript for true, and begins anew."""

    def on_control(self, content: Json) -> None:
        super().on_control({**content, "run": bool(content.get("run", True))})

    def may_start(self, tool: str | None) -> bool:  # noqa: ARG002
        return True


def test_the_message_to_blame_is_named() -> None:
    """Of the many that a rule sends, the one that moves the server."""
    report = report_of(LooseFlags, "S1,S2,S5.3")
    (failed,) = [result for result in report.results if result.status == "failed"]
    assert failed.id == "S5.3"
    assert re.fullmatch(
        r'while it waited for actuators: control \{"server": 1, "simulation_hash": "\w+", "run": "false"\}',
        failed.sent,
    )


@pytest.mark.timeout(120)
@pytest.mark.usefixtures("_places")
def test_the_offer_that_a_tool_should_not_take_is_named() -> None:
    (failed,) = report_of_tool(AsksEverybody, "O4.3").results
    assert failed.status == "failed"
    assert re.match(r'server \{"server": 1[12], "simulation_hash": ".+ 0?"', failed.sent), failed.sent
    assert '"server": 1' in failed.came
