"""A run that asks for audits which no server can make says so, once."""

from pathlib import Path

import pytest

from swarmwright import Experiment, optimize
from swarmwright.servers.evaluation.reports import listening
from swarmwright.servers.evaluation.through_broker import MissingAudits
from swarmwright.servers.rows import AttemptEntry, Journal, WarningEntry


def journal(server: int, candidates: int, *warnings: WarningEntry) -> Journal:
    """What a server did: blocks of two episodes of each candidate."""
    attempt = AttemptEntry("offloaded", 0, candidates, 0, 2, server, 1, None, 0.0, 1.0, "done", None, None)
    return Journal([attempt], list(warnings))


def test_one_server_is_named_once_audits_were_due() -> None:
    missing = MissingAudits(0.1)
    assert missing.note(journal(22, 49)) is None, "9.8 audits were due"
    last = journal(22, 1)
    text = missing.note(last)
    assert text is not None
    assert "faults.audit: 0.1, because only server 22 is used" in text
    assert [warning.text for warning in last.warnings] == [text]
    assert missing.note(journal(22, 1000)) is None, "it is said once"


def test_nothing_is_said_where_other_servers_are_used_or_nothing_is_asked_for() -> None:
    missing = MissingAudits(0.5)
    assert missing.note(journal(1, 1)) is None
    assert missing.note(journal(2, 1000)) is None
    assert MissingAudits(0.0).note(journal(1, 1000)) is None
    assert MissingAudits(0.5).note(journal(1, 1000, WarningEntry("by the pool", unaudited=True))) is None


@pytest.mark.slow
@pytest.mark.parametrize("servers", [1, 2])
@pytest.mark.parametrize("kind", ["nnga", "cma_es"])
def test_a_run_warns_and_stores_the_warning(tmp_path: Path, servers: int, kind: str) -> None:
    experiment = Experiment.from_mapping(
        {
            "simulation": "minisim",
            "method": {"kind": kind, "population": 20, "generations": 3},
            "faults": {"audit": 0.5},
        }
    )
    told: list[str] = []
    with listening(lambda report: told.append(str(report.get("message"))), warnings_only=True):
        run = optimize(experiment, servers=servers, out=tmp_path / "run")
    found = [text for text in told if "no audits take place" in text]
    attempts = list(run.attempts())
    others = [index for index, one in enumerate(attempts) if one.server != attempts[0].server]
    alone = attempts[: others[0]] if others else attempts
    # The second one may have come late: what the first one had done by then was told.
    enough = sum(one.candidates * one.episodes for one in alone) >= 20
    assert len(found) == 1 if not others else len(found) <= enough, told
    assert [event.text for event in run.events() if "no audits take place" in event.text] == found
