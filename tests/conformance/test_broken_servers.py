"""Each server that breaks a rule is caught by this rule and no other."""

import os
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from paho.mqtt.client import Client

from swarmwright.conformance._check import check_server
from swarmwright.conformance._server_under_test import QUIET_S
from swarmwright.conformance.results import Report
from swarmwright.conformance.rules import Profile
from swarmwright.conformance.server import connection
from tests.conformance.broken import batches, offloaded, seeds
from tests.conformance.broken.base import Broken
from tests.conformance.broken.batches import Batched
from tests.conformance.broken.episodes import QuotesAMetric
from tests.conformance.broken.servers import SERVERS
from tests.conformance.sound import PATIENCE, Json, SoundServer, World
from tests.conftest import ROOT


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
        self.late, self.due = tuple(late), time.monotonic() + 4 * QUIET_S

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
    vary: Mapping[str, Any] | None = None,
) -> Report:
    with ExitStack() as stack:

        def start(url: str) -> None:
            stack.callback(kind(url).close)

        return check_server(
            start=start,
            parameters=parameters,
            vary=vary,
            rules=[rules],
            profile=profile,
            timeout=2.0,
            wait=5.0,
            step_timeout=step_timeout,
        )


@pytest.mark.parametrize("kind", SERVERS, ids=lambda kind: kind.__name__)
def test_a_broken_server_is_caught_by_the_right_rule(kind: type[Broken]) -> None:
    report = report_of(kind, kind.rules, parameters=kind.parameters_of_episodes)
    assert set(report.list_ids("failed", "died")) == kind.breaks, str(report)
    assert bool(report.list_ids("died")) == kind.died


def test_a_field_that_is_wrong_is_shown_in_full() -> None:
    """Requests are shortened in reports, and the field that was changed may be at their end."""
    report = report_of(ServesWithoutSeeds, "S1.1,S2.3,S9.1,S9.11")
    (failed,) = (result for result in report.results if result.status == "failed")
    assert failed.id == "S9.11"
    assert failed.sent.startswith("seeds: <0 bytes>, in "), failed.sent


def test_a_fitness_of_another_episode_is_told_from_sensors_of_another() -> None:
    """What agents sense is compared nevertheless."""
    report = report_of(seeds.FitnessOfTheLast, "S2,S3,S4")
    (failed,) = (result for result in report.results if result.status == "failed")
    assert "the sensors were the same: the fitness is of an earlier episode" in failed.came, failed.came
    assert {"S3.3", "S3.4", "S3.5", "S4.1"} <= set(report.list_ids("passed")), str(report)
    report = report_of(seeds.Leaks, "S2,S3,S4")
    (failed,) = (result for result in report.results if result.status == "failed")
    assert "senses" in failed.came, failed.came
    assert {"S3.3", "S3.4", "S3.5", "S4.1"} <= set(report.list_ids("not run")), str(report)


class IgnoresTheSeed(SoundServer):
    """All of its episodes are the same but for their parameters."""

    def make(self, parameters: Json) -> World:
        return super().make({**parameters, "seed": 0})


def test_another_parameter_stands_in_for_the_seed() -> None:
    report = report_of(IgnoresTheSeed, "S2,S3")
    assert set(report.list_ids("skipped")) == {"S3.3", "S3.4", "S3.5"}
    last = report.results[-1]
    assert "the server ignores seed, or nothing is random" in last.detail
    assert "the server ignores the parameter seed" in last.advice
    assert not {"advice", "doubt"} & last.record().keys()
    assert str(report).splitlines()[0].endswith("skipped; the seed changed nothing: is it ignored?")
    report = report_of(IgnoresTheSeed, "S2,S3", vary={"agents": 2})
    assert set(report.list_ids("skipped")) == {"S3.5"}
    assert report.ok, str(report)
    assert "ignored" not in str(report)


class KeepsBatches(Batched):
    """Waits for the actuators of a batch for ever."""

    def patience(self) -> float:
        return 1.0

    def give_up(self) -> None:
        pass


def test_a_server_that_never_gives_up_a_batch_is_caught() -> None:
    report = report_of(KeepsBatches, "S1.1,S2.3,S10.1,S10.9", step_timeout=1.0)
    assert report.list_ids("failed", "died") == ["S10.9"], str(report)


class GivesUpSilently(Batched):
    """Frees itself, and does not say that the batch failed."""

    def patience(self) -> float:
        return 1.0

    def give_up(self) -> None:
        self.enter("free")


class Held(GivesUpSilently):
    """Says that the batch failed, and is held for its tool, as after others."""

    def give_up(self) -> None:
        self.sensors_message(self.batch, error={"kind": "failed", "reason": "no actuators came"})
        self.enter("held", self.holder)


class Invalid(GivesUpSilently):
    """Gives another error."""

    def give_up(self) -> None:
        self.sensors_message(self.batch, error={"kind": "invalid", "reason": "no actuators came"})
        self.enter("free")


@pytest.mark.parametrize(
    ("kind", "failed", "doubt"), [(GivesUpSilently, [], True), (Held, [], False), (Invalid, ["S10.9"], False)]
)
def test_a_batch_that_is_given_up_without_the_error_failed_is_doubted(
    kind: type[Batched], failed: list[str], *, doubt: bool
) -> None:
    """Servers from before the protocol demanded it are no broken ones."""
    report = report_of(kind, "S1.1,S2.3,S10.1,S10.9", step_timeout=1.0)
    assert report.list_ids("failed", "died") == failed, str(report)
    assert ("without the error failed" in str(report)) == doubt


def test_an_ignored_output_activation_is_named() -> None:
    report = report_of(offloaded.IgnoresOutputActivation, "S1.1,S2.3,S9.3,S9.14")
    (failed,) = (result for result in report.results if result.status == "failed")
    assert "the fitness without output_activation, which the server ignores" in failed.came
    assert "or the error invalid that names output_activation" in failed.expected


def test_mistakes_of_a_controller_are_none_of_seeds() -> None:
    report = report_of(offloaded.LessSteepAndFirst, "S1.1,S2.3,S3,S9.20")
    (result,) = (result for result in report.results if result.id == "S9.20")
    assert result.status == "not run"
    assert "evostick" in result.detail


def test_the_words_of_the_report_name_how_a_seed_was_lost() -> None:
    for kind, words in (
        (offloaded.OffloadedSeeds, "as with the seed 1, as if it were truncated to 32 bits"),
        (offloaded.PrefersTheSeedOfParameters, "as with the seed 5, which is in parameters"),
        (batches.BatchSeedsAsDoubles, "as if it were read through a double"),
        (batches.BatchPrefersTheSeedOfParameters, "as with the seed 5, which is in parameters"),
    ):
        report = report_of(kind, "S1.1,S2.3,S3.2,S9.3,S9.20,S10.1,S10.7")
        (failed,) = (result for result in report.results if result.status == "failed")
        assert words in failed.came, failed.came


class SeedsOfRuby(SoundServer):
    """Passes the seed to a generator that drops its upper 32 bits if they are 1, as Ruby's does."""

    def make(self, parameters: Json) -> World:
        seed = parameters.get("seed", 0)
        return super().make({**parameters, "seed": seed % 2**32 if seed >> 32 == 1 else seed})


def test_a_generator_that_makes_one_state_of_few_seeds_is_no_truncated_seed() -> None:
    report = report_of(SeedsOfRuby, "S1.1,S2.3,S3.1,S3.5")
    assert report.ok, str(report)


def test_a_cause_that_the_kit_cannot_see_is_no_statement() -> None:
    for kind, words in (
        (seeds.SeedOf32Bits, "as if the seed, or what the generator makes of it, were truncated to 32 bits"),
        (seeds.SeedAsDouble, "as if the seed were read through a double, which has 53 bits"),
    ):
        report = report_of(kind, "S1.1,S2.3,S3.1,S3.5")
        (failed,) = (result for result in report.results if result.status == "failed")
        assert failed.came.endswith(words), failed.came


STARTED = """\
import os, secrets, sys
import msgpack
from tests.conformance.sound import SoundServer

instance = secrets.token_hex(4)

class Server(SoundServer):
    def capabilities(self):
        found = super().capabilities()
        found["swarmwright"]["instance"] = instance
        return found

    def on_control(self, content):
        if "another" in content.get("simulation", ""):
            print("out of wheels", flush=True)
            os._exit(3)
        super().on_control(content)

    def requested(self, payload):
        request = msgpack.unpackb(payload)
        if {silent}:
            print("refused: a request", flush=True)
        elif request.get("instance", instance) != instance:
            self.reply(request, error={"kind": "taken", "reason": "another instance"})
        else:
            super().requested(payload)

Server(sys.argv[1]).client._thread.join()
"""


def started(folder: Path, monkeypatch: pytest.MonkeyPatch, *, silent: bool) -> str:
    """The command of a server that ends at control with another title, and may answer no request."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "python")]))
    (folder / "server.py").write_text(STARTED.replace("{silent}", str(silent)))
    return f"{sys.executable} {folder / 'server.py'} {{broker}}"


def test_a_server_that_is_started_anew_has_another_instance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = started(tmp_path, monkeypatch, silent=False)
    report = check_server(command=command, rules=["S1.1,S2.3,S2.9,S2.15,S9.1,S9.9"], timeout=2.0)
    assert report.list_ids("failed", "died") == ["S2.15"], str(report)
    assert "S9.9" in report.list_ids("passed")


def test_what_a_silent_server_printed_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = started(tmp_path, monkeypatch, silent=True)
    report = check_server(command=command, rules=["S1.1,S2.3,S9.1"], timeout=1.0)
    (failed,) = (result for result in report.results if result.status == "failed")
    assert "no answer came within" in failed.came
    assert "refused: a request" in failed.came, failed.came


TWICE = """\
import sys
from tests.conformance.broken.discovery import KeepsItsId

server = KeepsItsId(sys.argv[1])
server.client._thread.join()
"""


def test_a_second_server_that_does_not_leave_is_caught(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "python")]))
    monkeypatch.setattr(connection, "LEAVES_WITHIN_S", 4.0)
    (tmp_path / "server.py").write_text(TWICE)
    report = check_server(
        command=f"{sys.executable} {tmp_path / 'server.py'} {{broker}}", rules=["S1.1,S2.3,S7.2,S16.2"]
    )
    assert report.list_ids("failed", "died") == ["S16.2"], str(report)
    assert "the second one still ran" in report.results[-1].came


def test_a_server_that_one_tool_keeps_to_itself_is_caught() -> None:
    """The sound server has no turns."""
    (result,) = report_of(SoundServer, "S6.13").results
    assert result.status == "failed"
    assert "conformance/b got no answer for " in result.came, result.came


def test_a_metric_that_is_no_number_is_not_said_to_be_missing() -> None:
    report = report_of(QuotesAMetric, "S1.1,S1.2,S2.3,S8")
    (failed,) = (result for result in report.results if result.status == "failed")
    assert '"metrics.steps" is "6"' in failed.came, failed.came


def test_late_answers_to_earlier_discoveries_are_no_mistake() -> None:
    report = report_of(LateTwice, "S1.1,S1.2,S1.3,S6.6", step_timeout=PATIENCE)
    assert report.ok, str(report)
    assert "S6.6" in report.list_ids("passed")


def test_late_agents_of_the_first_step_are_no_mistake_of_a_server_that_gives_up() -> None:
    report = report_of(LateAgents, "S1.1,S6.6", step_timeout=PATIENCE)
    assert report.ok, str(report)
    assert "S6.6" in report.list_ids("passed")


class HoldsBack(SoundServer):
    """Leaves Nagle's algorithm on: the second message of a step waits until the first is acknowledged."""

    def prompt(self, client: Client) -> None:
        pass


@pytest.mark.skipif(sys.platform != "linux", reason="acknowledgements are late elsewhere by other times")
@pytest.mark.parametrize("kind", [HoldsBack, SoundServer], ids=lambda kind: kind.__name__)
def test_a_server_that_holds_small_packets_back_is_told_so(kind: type[SoundServer]) -> None:
    report = report_of(kind, "S1.1,S2.3,S2.8,S12.4", parameters={"agents": 3, "steps": 30})
    assert report.ok, str(report)
    told = "set TCP_NODELAY" in str(report).splitlines()[0]
    assert told == (kind is HoldsBack), report.results[-1].detail


def test_one_agent_has_no_messages_to_hold_back() -> None:
    report = report_of(SoundServer, "S2.3,S2.8,S12.4", parameters={"agents": 1})
    assert report.list_ids("skipped") == ["S12.4"], str(report)
