"""Each server that breaks a rule is caught by this rule and no other."""

import time
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import pytest

from swarmwright.conformance._check_server import check_server
from swarmwright.conformance._results import Report
from swarmwright.conformance._rules import Profile
from swarmwright.conformance._server_under_test import QUIET
from tests.conformance.broken.base import Broken
from tests.conformance.broken.servers import SERVERS, QuotesAMetric
from tests.conformance.sound import PATIENCE, Json, SoundServer


class GivesUp(SoundServer):
    """Gives up episodes, too, after the time-out from their start."""

    def tick(self) -> None:
        if self.state == "running" and time.monotonic() >= self.until:
            self.enter("free")
        super().tick()


class ServesWithoutSeeds(SoundServer):
    """Serves requests for no episode."""

    def check(self, request: Json) -> None:
        super().check({**request, "seeds": request["seeds"] or bytes(8)})


class LateTwice(GivesUp):
    """Answers each discovery, and once more after the next one, as over a connection that repeats."""

    last: str | None = None

    def answer(self, hash_: str) -> None:
        if self.last is not None:
            super().answer(self.last)
        self.last = hash_
        super().answer(hash_)


class LateAgents(GivesUp):
    """Its other agents are asked a moment after the first."""

    late: tuple[Any, ...] = ()
    due = 0.0

    def sense(self) -> None:
        publish, late = self.publish, []

        def one(topic: str, **fields: Any) -> None:
            if topic == "sensor" and fields["agent"] > 0:
                late.append(fields)
            else:
                publish(topic, **fields)

        with patch.object(self, "publish", one):
            super().sense()
        self.late, self.due = tuple(late), time.monotonic() + 4 * QUIET

    def tick(self) -> None:
        if self.late and time.monotonic() >= self.due:
            for fields in self.late:
                self.publish("sensor", **fields)
            self.late = ()
        super().tick()


def report_of(
    kind: type[SoundServer],
    rules: str,
    profile: Profile = "all",
    step_timeout: float | None = None,
    parameters: Mapping[str, Any] | None = None,
) -> Report:
    with ExitStack() as stack:

        def start(url: str) -> None:
            stack.callback(kind(url).close)

        return check_server(
            start=start,
            parameters=parameters,
            rules=[rules],
            profile=profile,
            timeout=2.0,
            wait=5.0,
            step_timeout=step_timeout,
        )


@pytest.mark.parametrize("kind", SERVERS, ids=lambda kind: kind.__name__)
def test_a_broken_server_is_caught_by_the_right_rule(kind: type[Broken]) -> None:
    report = report_of(kind, kind.rules, parameters=kind.parameters_of_episodes)
    assert set(report.of("failed", "died")) == kind.breaks, str(report)
    assert bool(report.of("died")) == kind.died


def test_a_field_that_is_wrong_is_shown_in_full() -> None:
    """Requests are shortened in reports, and the field that was changed may be at their end."""
    report = report_of(ServesWithoutSeeds, "S1.1,S2.3,S9.1,S9.11")
    (failed,) = (result for result in report.results if result.status == "failed")
    assert failed.id == "S9.11"
    assert failed.sent.startswith("seeds: <0 bytes>, in "), failed.sent


def test_a_metric_that_is_no_number_is_not_said_to_be_missing() -> None:
    report = report_of(QuotesAMetric, "S1.1,S1.2,S2.3,S8")
    (failed,) = (result for result in report.results if result.status == "failed")
    assert '"metrics.steps" is "6"' in failed.came, failed.came


def test_late_answers_to_earlier_discoveries_are_no_mistake() -> None:
    report = report_of(LateTwice, "S1.1,S1.2,S1.3,S6.6", step_timeout=PATIENCE)
    assert report.ok, str(report)
    assert "S6.6" in report.of("passed")


def test_late_agents_of_the_first_step_are_no_mistake_of_a_server_that_gives_up() -> None:
    report = report_of(LateAgents, "S1.1,S6.6", step_timeout=PATIENCE)
    assert report.ok, str(report)
    assert "S6.6" in report.of("passed")
