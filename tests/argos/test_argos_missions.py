"""Missions of the arena in ARGoS: the server with the real simulator inside."""

import subprocess
from contextlib import ExitStack

import pytest

from tests import attached_checks
from tests.attached import ARGOS, build
from tests.conftest import Run
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch

pytestmark = [ARGOS.needed, pytest.mark.timeout(600)]  # the first of them builds the server


def test_modes_servers_and_losses_change_no_record(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    attached_checks.missions_agree(ARGOS, embedded, launch, experiment, cleanup)


def test_it_conforms(program: Run) -> None:
    attached_checks.missions_conform(ARGOS, program)


def test_a_thousand_episodes_need_no_more_memory(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    attached_checks.missions_need_no_more_memory(ARGOS, embedded, launch, experiment, cleanup)


def test_every_mission_and_robot_runs_or_is_refused(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    refused = {"object_retrieval": "has no grippers"}
    attached_checks.every_mission_runs(ARGOS, embedded, launch, experiment, cleanup, refused=refused)


def test_fitness_is_near_that_of_the_arena(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    attached_checks.it_agrees_with_the_arena(ARGOS, embedded, launch, experiment, cleanup, within=0.25)


def test_wrong_options_are_reported(unused_port: int) -> None:
    server = build(ARGOS) / "swarmwright-argos"
    for options, expected, status in (
        (["--brokr", "x"], "--brokr: unknown", 2),
        (["--broker", f"mqtt://127.0.0.1:{unused_port}"], "no broker answers", 1),
    ):
        done = subprocess.run(
            [str(server), *options], capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == status
        assert expected in done.stderr
