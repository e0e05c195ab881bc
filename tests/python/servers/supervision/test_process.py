"""Servers that are replaced after some evaluations, and how long they may finish what they compute."""

import os
import signal
import time
from typing import Any

import pytest

from swarmwright.servers.supervision import News, Output, ServerEnd, Supervisor
from swarmwright.servers.supervision.output import Sample
from swarmwright.servers.supervision.process import stagger_quotas
from tests.conftest import free_port


def test_servers_that_start_together_are_not_replaced_together() -> None:
    assert stagger_quotas(4, 1000) == [250, 500, 750, 1000]
    assert stagger_quotas(3, 2) == [1, 2, 2]  # none after no evaluation
    assert stagger_quotas(2, 0) == [0, 0]


IDLE = Sample(ended=3)
STEPPED = Sample(episode=0, ended=3)
REQUEST = Sample(request=7, candidates=2, ended=3)


@pytest.mark.parametrize(
    ("before", "now", "goes_on"),
    [
        (IDLE, STEPPED, False),
        (STEPPED, Sample(episode=0, ended=3, beats=9), True),
        (STEPPED, IDLE, False),
        (STEPPED, Sample(episode=0, ended=4), False),  # the next one
        (STEPPED, REQUEST, False),
        (REQUEST, Sample(request=7, first=1, candidates=1, ended=4), True),
        (REQUEST, Sample(request=8, candidates=2, ended=5), False),
        (REQUEST, STEPPED, False),
    ],
)
def test_whether_what_was_computed_goes_on(before: Sample, now: Sample, goes_on: bool) -> None:
    assert now.continues(before) is goes_on


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_server_that_the_system_kills_meanwhile_has_not_had_its_evaluations(number: signal.Signals) -> None:
    said: list[str] = []
    ended: list[Any] = []

    class Heard(Output):
        def record(self, server: int, text: str, work: str = "") -> None:
            assert (server, work) == (1, "")
            said.append(text)

    def tell(news: News) -> None:
        if isinstance(news, ServerEnd):
            ended.append(news)

    # It waits for a broker.
    settings = {"simulation": "minisim", "broker": f"mqtt://127.0.0.1:{free_port()}", "id": 1, "wait": 60.0}
    supervisor = Supervisor([settings], output=Heard(), tell=tell, recycle=1, restart=False)
    supervisor.start()
    try:
        process = supervisor._servers[1].process
        assert process is not None
        process.recycled = True
        os.kill(process.pid, number)
        deadline = time.monotonic() + 30
        while not ended and time.monotonic() < deadline:
            time.sleep(0.01)
    finally:
        supervisor.stop()
    is_killed = number == signal.SIGKILL
    assert said == [
        "[was killed by SIGKILL]" if is_killed else "[has reached its quota of evaluations (recycle)]"
    ]
