import pytest

from swarmwright.common import warn_once
from swarmwright.common.warn_once import warn_once as warn


@pytest.fixture(autouse=True)
def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warn_once, "_given", set())


def test_a_warning_appears_once(caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(3):
        warn("a.yaml: no effect; leave it out")
    assert caplog.messages == ["a.yaml: no effect; leave it out"]
    assert caplog.records[0].levelname == "WARNING"
    assert caplog.records[0].name == "swarmwright"


def test_different_texts_are_different_warnings(caplog: pytest.LogCaptureFixture) -> None:
    warn("the run has no copy; a.py is used")
    warn("the run has no copy; b.py is used")
    assert len(caplog.messages) == 2


def test_texts_with_one_key_are_one_warning(caplog: pytest.LogCaptureFixture) -> None:
    warn("the copy is used; --simulation takes another", key="the copy is used")
    warn("the copy is used", key="the copy is used")
    assert caplog.messages == ["the copy is used; --simulation takes another"]
