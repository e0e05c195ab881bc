"""The types of what the library returns can be named."""

from swarmwright import Episodes, Run, compare, results


def test_what_is_returned_is_of_these_types(finished: Run) -> None:
    comparison = compare([finished])
    found: dict[str, object] = {
        "Best": finished.best,
        "ComparedGroup": comparison.groups[0],
        "Evaluation": finished.evaluation(0, 0),
        "Indicator": comparison.indicator,
        "Observation": Episodes("minisim").observe(),
        "RecordTable": finished.record,
        "ReplayPage": finished.replay(),
        "Session": finished.sessions[0],
        "Summary": finished.history[0],
        "Task": comparison.tasks[0],
    }
    for name, value in found.items():
        assert name in results.__all__
        assert type(value) is getattr(results, name), name
