"""Keys without effect are named when a run begins, and refused nowhere."""

from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, optimize
from swarmwright.experiment.checks import find_setting_warnings

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
    assert [text.split()[0] for text in find_setting_warnings(experiment)] == keys
    written_out = Experiment.from_mapping(experiment.to_mapping())
    assert find_setting_warnings(written_out) == find_setting_warnings(experiment)


@pytest.mark.parametrize("seeds", ["same", "new"])
def test_elites_of_lucky_seeds_are_warned_of(seeds: str) -> None:
    for method in (
        {"kind": "nsga2", "objectives": {"steps": "minimize"}},
        {"kind": "map_elites", "measures": {"steps": {"range": [0, 9]}}},
        {"kind": "nnga"},
    ):
        values = {"simulation": "minisim", "method": method, "ranking": {"seeds": seeds}}
        expected = [["ranking.seeds:", "new"]] if seeds == "new" and method["kind"] != "nnga" else []
        found = find_setting_warnings(Experiment.from_mapping(values))
        assert [text.split()[:2] for text in found] == expected


@pytest.mark.parametrize(
    ("options", "warned"),
    [
        ({"seeds": "new"}, False),
        ({"seeds": "new", "memory": 1}, False),
        ({"seeds": "new", "memory": 5}, True),
        ({"seeds": "same", "memory": 5}, False),
    ],
)
def test_differences_on_other_seeds_are_warned_of(options: dict[str, Any], warned: bool) -> None:
    ranking = {"kind": "multi_fidelity", "slow": "minisim", **options}
    found = find_setting_warnings(Experiment.from_mapping({"simulation": "minisim", "ranking": ranking}))
    assert [text.split(" with ")[0] for text in found] == (["ranking.memory: 5"] if warned else [])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"parameters": {"steering": "rule"}}, ["agents of minisim control themselves"]),
        ({"parameters": {"steering": "rule"}, "controller": {"kind": "parameter_set"}}, []),
        ({"controller": {"output_range": [5, 9]}}, ["[5, 9] is outside the outputs of tanh, -1 to 1"]),
        ({"controller": {"activation": "sigmoid", "output_range": [-2, -1]}}, ["of sigmoid, 0 to 1"]),
        ({"controller": {"activation": "sigmoid", "output_range": [-2, 0.5]}}, []),
        ({"controller": {"activation": "relu", "output_range": [-2, 0]}}, ["of relu, 0 or more"]),
        ({"controller": {"output_activation": "linear", "output_range": [5, 9]}}, []),
    ],
)
def test_settings_with_which_no_controller_matters(values: dict[str, Any], words: list[str]) -> None:
    if values.get("controller", {}).get("kind") == "parameter_set":
        values["controller"]["parameters"] = {"avoidance": {"type": "real", "range": [0, 2]}}
    elif "controller" in values:
        values["controller"] = {"kind": "layered", **values["controller"]}
    found = find_setting_warnings(Experiment.from_mapping({"simulation": "minisim", **values}))
    assert len(found) == len(words)
    assert all(part in text for part, text in zip(words, found, strict=True))


@pytest.mark.parametrize(("nest", "count"), [("a", 1), ("b", 0)])
def test_a_nest_that_is_its_own_source_is_warned_of(nest: str, count: int) -> None:
    patches = [
        {"name": name, "circle": {"center": [x, 0], "radius": 0.3}, "color": "black"}
        for name, x in (("a", -0.5), ("b", 0.5))
    ]
    mission = {
        "walls": {"rectangle": [2, 2]},
        "start": {"disc": {"radius": 0.8}},
        "robots": 3,
        "duration": 30,
        "floor": {"patches": patches},
        "metrics": {"x": {"kind": "returns", "sources": ["a"], "nest": nest}},
        "fitness": "x",
    }
    found = find_setting_warnings(
        Experiment.from_mapping({"simulation": "arena", "parameters": {"mission": mission}})
    )
    assert len(found) == count
    assert all("parameters.mission.metrics.x: its nest 'a'" in text for text in found)


def test_a_run_begins_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("swarmwright.common.warn_once._given", set())
    method = {"population": 4, "generations": 1, "in_flight": 3}
    experiment = Experiment.from_mapping({"simulation": "minisim", "method": method, "servers": "local"})
    assert optimize(experiment, out=tmp_path / "run").generations == 1
    assert "method.in_flight has no effect with operation: generational" in caplog.messages
