"""Servers of two launchers at once, those of one are preempted every 20 s: nothing is lost but time."""

import os
from pathlib import Path

import pytest

from swarmwright import Run
from tests.preemption.preempted import EPISODE_S, LIFE_S, Figures, Preemption, Size, run, written
from tests.python.records import same_record
from tests.ssh.conftest import running

ASKED = os.environ.get("SWARMWRIGHT_PREEMPTION", "")
"""Servers and seconds, such as 64x120."""
pytestmark = pytest.mark.skipif(
    not ASKED, reason="SWARMWRIGHT_PREEMPTION is not set: run `make test-preemption`"
)


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("preempted", ["process", "ssh"])
def test_the_record_is_that_of_an_undisturbed_run(preempted: str, tmp_path: Path) -> None:
    servers, _, seconds = ASKED.partition("x")
    # Two processes for each server through SSH, and twice as many starts: the smaller number shows the same.
    size = Size(int(servers), float(seconds)) if preempted == "process" else Size(8, 30)
    with running(tmp_path / "machine", slots=size.servers) as machine:
        file = written(tmp_path, size, machine, preempted)
        preemption = Preemption(tmp_path)
        preemption.start()
        status = run(file, tmp_path / "disturbed", episode_s=EPISODE_S)
        preemption.stop()
        told = (tmp_path / "disturbed.log").read_text()
        assert status == 0, told
        assert preemption.found() == set()
        assert machine.servers() == []
    figures = Figures.of(tmp_path / "disturbed", size.servers)
    print(
        f"{size.servers} servers, {preempted} preempted: {preemption.count} preemptions in "
        f"{figures.seconds:.0f} s, {preemption.killed} did not end within their time; "
        f"{figures.evaluations} evaluations, {figures.handed_back} handed back, {figures.repeated} computed "
        f"twice, {100 * figures.lost:.2f} % of the work lost, utilisation {100 * figures.utilisation:.0f} %"
    )
    # Half of what there is time for, since servers must start again on a busy machine.
    assert preemption.count >= size.servers / 2 * (size.seconds // LIFE_S) / 2, told
    assert figures.lost < 0.05
    status = run(file, tmp_path / "undisturbed", "--servers", "in-process", episode_s=0.0)
    assert status == 0, (tmp_path / "undisturbed.log").read_text()
    same_record(Run.open(tmp_path / "disturbed"), Run.open(tmp_path / "undisturbed"))
