"""Warnings of a pool have the times at which they arose."""

from collections.abc import Iterator

from swarmwright.servers.evaluation.warning_times import WarningTimes


def test_each_warning_has_its_own_time() -> None:
    clock: Iterator[float] = iter((1.0, 2.0, 3.0, 4.0, 5.0))
    times = WarningTimes(lambda: next(clock))
    for message in ("server 1 is slow", "server 2 is slow", "server 1 is slow"):
        times.note({"event": "warning", "message": message})
    times.note({"event": "server_ready", "server": 3})
    times.note({"event": "broker_lost", "reason": "end of file"})
    times.note({"event": "broker_back"})
    warnings = [
        "server 1 is slow",
        "server 2 is slow",
        "lost the broker (end of file); trying again",
        "the broker is back",
        "that was reported to none",
        "server 1 is slow",
    ]
    found = times.journal((), warnings).warnings
    assert [(entry.text, entry.time) for entry in found] == list(
        zip(warnings, (1.0, 2.0, 4.0, 5.0, None, 3.0), strict=True)
    )
    assert times.journal((), ["server 1 is slow"]).warnings[0].time is None, "each time is used once"
