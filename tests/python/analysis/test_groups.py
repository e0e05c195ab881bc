from pathlib import Path

from swarmwright.analysis.groups import group
from tests.python.analysis.runs import KnownRun, runs


def test_runs_that_differ_in_seed_or_place_are_one_group(tmp_path: Path) -> None:
    many = [
        *runs(tmp_path, [1.0, 2.0]),
        KnownRun(tmp_path / "x", [[1.0]], seed=9, servers=3, mode="stepwise", broker="mqtt://there"),
        KnownRun(tmp_path / "y", [[1.0]], seed=10, faults={"audit": 0.1}),
    ]
    groups, notes = group(many)
    assert [(one.label, len(one.runs)) for one in groups] == [("minisim, nnga", 4)]
    assert notes == []


def test_groups_are_named_by_what_differs_between_them(tmp_path: Path) -> None:
    groups, _ = group(
        [
            *runs(tmp_path, [1.0], method={"population": 8}),
            *runs(tmp_path, [1.0, 2.0]),
            *runs(tmp_path, [1.0], parameters={"maxSteps": 20}),
        ]
    )
    assert [one.label for one in groups] == [
        "maxSteps 15, population 8", "maxSteps 15, population 4", "maxSteps 20, population 4",
    ]  # fmt: skip
    assert groups[1].differs == {"parameters.maxSteps": 15, "method.population": 4}
    assert [len(one.runs) for one in groups] == [1, 2, 1]


def test_a_default_written_out_does_not_set_runs_apart(tmp_path: Path) -> None:
    given = {"speedAgents": 1, "mapWidth": 13.0}
    groups, _ = group([*runs(tmp_path, [1.0]), KnownRun(tmp_path / "x", [[1.0]], seed=7, parameters=given)])
    assert [(one.label, len(one.runs)) for one in groups] == [("minisim, nnga", 2)]


def test_options_of_one_kind_do_not_set_it_apart_from_another(tmp_path: Path) -> None:
    search = {"kind": "random_search", "population": 4, "generations": 3}
    groups, _ = group([*runs(tmp_path, [1.0]), *runs(tmp_path, [1.0], method=search)])
    assert [one.label for one in groups] == ["nnga", "random_search"]
    mesh = {"kind": "fully_meshed", "hidden": 3}
    groups, _ = group([*runs(tmp_path, [1.0]), *runs(tmp_path, [1.0], controller=mesh)])
    assert [one.label for one in groups] == ["layered", "fully_meshed"]
    wider = {"kind": "layered", "hidden": [3, 3]}
    groups, _ = group([*runs(tmp_path, [1.0]), *runs(tmp_path, [1.0], controller=wider)])
    assert [one.label for one in groups] == ["hidden [2]", "hidden [3, 3]"]


def test_keys_with_one_name_are_told_apart(tmp_path: Path) -> None:
    base = KnownRun(tmp_path / "a", [[1.0]])
    other = KnownRun(
        tmp_path / "b", [[1.0]], parameters={"seed": 5}, method={"generations": 7}, ranking={"episodes": 2}
    )
    groups, _ = group([base, other])
    assert groups[1].label == "parameters.seed 5, generations 7, episodes 2"
    assert groups[0].label == "parameters.seed 0, generations 3, episodes 1"
    layers = {"kind": "layered", "hidden": [3], "mutation": "proportional"}
    groups, _ = group([base, KnownRun(tmp_path / "c", [[1.0]], controller=layers)])
    assert groups[1].label == "mutation proportional, hidden [3]"


def test_parameters_of_a_foreign_simulation_may_be_missing(tmp_path: Path) -> None:
    foreign = {"simulation": "theirs", "sensors": 2, "actuators": 1, "servers": "auto"}
    groups, _ = group(
        [
            KnownRun(tmp_path / "a", [[1.0]], **foreign),
            KnownRun(tmp_path / "b", [[1.0]], **foreign, parameters={"slope": 3}),
        ]
    )
    assert [one.label for one in groups] == ["slope not given", "slope 3"]


def test_a_run_counts_once(tmp_path: Path) -> None:
    one, two = runs(tmp_path, [1.0, 2.0])
    again = KnownRun(tmp_path / "again", [[0.0], [1.0], [1.0]], seed=1)
    groups, notes = group([one, two, one, KnownRun(tmp_path / "." / one.path.name, [[1.0]], seed=1), again])
    assert [run.path.name for run in groups[0].runs] == ["base-1", "base-2"]
    assert len(notes) == 3
    assert notes[0] == f"{one.path} is given twice and counts once"
    assert "again has experiment and seed of" in notes[2]
    longer = KnownRun(tmp_path / "longer", [[0.0] * 9], seed=1)
    groups, notes = group([one, longer])
    assert groups[0].runs == (longer,)
