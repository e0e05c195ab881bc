"""Keys without effect are named when a run begins, and refused nowhere."""

from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, optimize
from swarmwright.experiment.setting_warnings import setting_warnings

STEADY = {"operation": "steady_state"}
TRANSFERRED = {"vary": {"parameters.speedDefenders": [0.4, 0.8]}}


@pytest.mark.parametrize(
    ("method", "validate", "keys"),
    [
        ({}, {}, []),
        ({"in_flight": 3}, {}, ["method.in_flight"]),
        ({"in_flight": 3} | STEADY, {}, []),
        ({}, {"seeds": 9, "random": 2}, ["validate.seeds", "validate.random"]),
        ({}, {"seeds": 9, "random": 2} | TRANSFERRED, []),
    ],
)
def test_keys_without_effect(method: dict[str, Any], validate: dict[str, Any], keys: list[str]) -> None:
    values = {"simulation": "minisim", "method": method, "validate": validate}
    experiment = Experiment.from_mapping(values)
    assert [text.split()[0] for text in setting_warnings(experiment)] == keys
    written_out = Experiment.from_mapping(experiment.to_mapping())
    assert setting_warnings(written_out) == setting_warnings(experiment)


@pytest.mark.parametrize("seeds", ["same", "new"])
def test_elites_of_lucky_seeds_are_warned_of(seeds: str) -> None:
    for method in (
        {"kind": "nsga2", "objectives": {"steps": "minimize"}},
        {"kind": "map_elites", "measures": {"steps": {"range": [0, 9]}}},
        {"kind": "nnga"},
    ):
        values = {"simulation": "minisim", "method": method, "ranking": {"seeds": seeds}}
        expected = [["ranking.seeds:", "new"]] if seeds == "new" and method["kind"] != "nnga" else []
        found = setting_warnings(Experiment.from_mapping(values))
        assert [text.split()[:2] for text in found] == expected


def test_a_run_begins_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("swarmwright.user_code.notices._told", set())
    method = {"population": 4, "generations": 1, "in_flight": 3}
    experiment = Experiment.from_mapping({"simulation": "minisim", "method": method, "servers": "local"})
    assert optimize(experiment, out=tmp_path / "run").generations == 1
    assert "method.in_flight has no effect with operation: generational" in caplog.messages
