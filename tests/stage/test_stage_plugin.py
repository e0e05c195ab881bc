"""Files of one's own in Stage: the plug-in in the real simulator."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from tests import attached_checks
from tests.attached import STAGE
from tests.conftest import Run
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch

pytestmark = [STAGE.needed, pytest.mark.timeout(600)]  # the first of them builds the plug-in


def test_every_mode_and_two_servers_give_the_same_record(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    attached_checks.modes_agree(STAGE, embedded, launch, experiment, cleanup)


def test_the_loss_of_one_of_two_servers_changes_nothing(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    attached_checks.loss_changes_nothing(STAGE, embedded, launch, experiment, cleanup)


def test_it_conforms(program: Run, tmp_path: Path) -> None:
    attached_checks.conforms(STAGE, program, tmp_path)


def test_a_thousand_episodes_need_no_more_memory(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    attached_checks.memory_is_flat(STAGE, embedded, launch, experiment, cleanup)


def test_without_a_broker_it_ends(tmp_path: Path, unused_port: int) -> None:
    attached_checks.without_a_broker_it_ends(STAGE, tmp_path, unused_port)


MISTAKES = {
    "no sensors": ("ranger( sensor( range [ 0 1 ] fov 345 samples 24 ) )", "", "senses nothing"),
    "unknown option": ("speed=0.4", "sped=0.4", '"sped=0.4" is unknown'),
    "no number": ("speed=0.4", "speed=fast", "is not a number"),
    "no duration": ("duration=10", "duration=-3", "duration: -3 found, expected a number above 0"),
    "two options": (
        'robot( name "d"',
        'robot( ctrl "swarmwright_stage speed=1" name "d"',
        "robots have different options",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_reported(embedded: BrokerProcess, tmp_path: Path, mistake: str) -> None:
    before, after, expected = MISTAKES[mistake]
    text = STAGE.file.read_text()
    assert before in text
    said = attached_checks.a_bad_file(STAGE, tmp_path, text.replace(before, after), url=embedded.url)
    assert expected in said, said


def test_robots_with_different_sensors_are_reported(embedded: BrokerProcess, tmp_path: Path) -> None:
    text = STAGE.file.read_text().replace('robot( name "d"', 'robot( name "d" ranger( sensor( samples 3 ) )')
    said = attached_checks.a_bad_file(STAGE, tmp_path, text, url=embedded.url)
    assert "robots have different sensors: a gets 24 numbers, d gets 27" in said, said
