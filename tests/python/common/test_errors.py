"""Errors that are raised again with more to say."""

import pytest

from swarmwright.common.errors import (
    InputError,
    PlugInError,
    RunError,
    SimulationError,
    SwarmwrightError,
    with_message,
)


@pytest.mark.parametrize("kind", [InputError, RunError, PlugInError])
def test_another_message_keeps_the_class(kind: type[SwarmwrightError]) -> None:
    error = kind("what")
    again = with_message(error, "where: what")
    assert (type(again), str(again), str(error)) == (kind, "where: what", "what")


def test_another_message_keeps_attributes() -> None:
    again = with_message(SimulationError("what", "a traceback"), "where: what")
    assert (str(again), again.stack) == ("where: what", "a traceback")
