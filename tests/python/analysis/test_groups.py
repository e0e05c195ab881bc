import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from swarmwright import compare
from swarmwright.analysis.groups import group
from swarmwright.analysis.table import option_columns
from swarmwright.analysis.tasks import group_by_task
from swarmwright.simulations.user_code.copying import Copy, compute_digest
from swarmwright.simulations.user_code.parts import Part
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
    assert len(notes) == 2
    assert notes[0].endswith("base-1 is given more than once and counts once")
    assert notes[1].startswith(f"{again.path} has experiment and seed of {one.path}, ")
    longer = KnownRun(tmp_path / "longer", [[0.0] * 9], seed=1)
    groups, notes = group([one, longer])
    assert groups[0].runs == (longer,)


@pytest.mark.slow
def test_many_copies_of_a_run_are_noted_together(tmp_path: Path) -> None:
    same = [KnownRun(tmp_path / f"r{number}", [[1.0]], seed=1) for number in range(1001)]
    groups, notes = group([*same, *same[:2]])
    assert groups[0].runs == (same[0],)
    twice, copies = notes
    assert twice == f"2 runs are given more than once and count once: {same[0].path}, {same[1].path}"
    assert copies == (
        f"1,000 runs have experiment and seed of {same[0].path}, so they are not further samples and do not "
        f"count: {same[1].path}, {same[2].path}, {same[3].path} and 997 more"
    )


def test_missions_are_called_as_in_the_experiment(tmp_path: Path) -> None:
    """`aac` and `aggregation` are one mission."""
    short = [in_arena(tmp_path, name, mission=name) for name in ("aac", "foraging")]
    groups, _ = group([*short, in_arena(tmp_path, "long", mission="aggregation")])
    assert [one.label for one in groups] == ["mission aac", "mission foraging"]
    assert [one.differs for one in groups] == [
        {"parameters.mission": "aac"},
        {"parameters.mission": "foraging"},
    ]


def test_two_names_of_a_mission_are_one_value(tmp_path: Path) -> None:
    written = [("aac", 4), ("aggregation", 9), ("foraging", 4), ("foraging", 9)]
    groups, _ = group(
        [
            KnownRun(
                tmp_path / f"{name}-{size}", [[1.0]], simulation="arena", parameters={"mission": name},
                method={"population": size},
            )
            for name, size in written
        ]
    )  # fmt: skip
    assert [one.differs["parameters.mission"] for one in groups] == ["aac", "aac", "foraging", "foraging"]
    tasks = group_by_task(groups, by="fitness", held_out=False)
    assert [(one.label, one.indices) for one in tasks] == [
        ("mission aac", (0, 1)),
        ("mission foraging", (2, 3)),
    ]


def mission(title: str, **changes: Any) -> dict[str, Any]:
    spot = {"name": "spot", "circle": {"center": [0, 0], "radius": 0.3}, "color": "black"}
    return {
        "title": title, "walls": {"rectangle": [2, 2]}, "floor": {"color": "grey", "patches": [spot]},
        "start": {"disc": {"radius": 0.8}}, "robots": 4, "duration": 5,
        "metrics": {"inside": {"kind": "robots_on", "patch": "spot", "when": "end"}},
        "fitness": {"offset": 0, "factors": {"inside": 1}}, **changes,
    }  # fmt: skip


def in_arena(path: Path, name: str, **parameters: Any) -> KnownRun:
    return KnownRun(path / name, [[1.0]], simulation="arena", parameters=parameters)


def labels(*some: KnownRun) -> list[str]:
    return [one.label for one in group(some)[0]]


def test_missions_and_robots_with_names_stand_for_what_differs_in_them(tmp_path: Path) -> None:
    homing = in_arena(tmp_path, "homing", mission="homing")
    one = in_arena(tmp_path, "one", mission=mission("One spot"))
    assert labels(homing, one) == ["mission Homing", "mission One spot"]
    returns = {"trips": {"kind": "returns", "sources": ["spot"], "nest": "spot"}}
    other = mission("Two", metrics=returns, fitness={"offset": 1, "factors": {"trips": 1}})
    assert labels(one, in_arena(tmp_path, "other", mission=other)) == ["mission One spot", "mission Two"]
    own = {"radius": 0.04, "drive": {"kind": "differential", "wheel_base": 0.06, "max_speed": 0.1},
           "sensors": [{"kind": "proximity", "count": 3, "range": 0.2}]}  # fmt: skip
    fitted = in_arena(tmp_path, "own", mission="homing", robot=own)
    named = in_arena(tmp_path, "named", mission="homing", robot="e-puck-rm1.2")
    assert labels(fitted, named) == ["robot of its own", "robot e-puck-rm1.2"]


def test_the_robot_that_the_arena_has_by_default_is_named(tmp_path: Path) -> None:
    default = in_arena(tmp_path, "default")
    named = in_arena(tmp_path, "named", robot="e-puck-rm1.2")
    first, second = group([default, named])[0]
    assert first.label.startswith("robot e-puck-rm1.1, ")
    assert second.label.startswith("robot e-puck-rm1.2, ")
    assert first.differs["parameters.robot"] == "e-puck-rm1.1"


def test_missions_with_one_name_are_told_apart_by_what_differs(tmp_path: Path) -> None:
    short, long = (
        in_arena(tmp_path, str(length), mission=mission("A", duration=length)) for length in (5, 9)
    )
    assert labels(short, long) == ["duration 5", "duration 9"]
    other = in_arena(tmp_path, "other", mission=mission("B"))
    assert labels(short, long, other) == ["mission A, duration 5", "mission A, duration 9", "mission B"]


def test_kinds_within_parameters_have_their_names(tmp_path: Path) -> None:
    one = in_arena(tmp_path, "one", mission=mission("A"))
    kind = {"inside": {"kind": "robots_on", "patch": "spot", "when": "mean"}}
    assert labels(one, in_arena(tmp_path, "mean", mission=mission("A", metrics=kind))) == [
        "when end", "when mean",
    ]  # fmt: skip
    nowhere = {"inside": {"kind": "most_robots_on", "patches": ["spot"], "when": "end"}}
    found = labels(one, in_arena(tmp_path, "away", mission=mission("A", metrics=nowhere)))
    assert found == ["mission.metrics.inside.kind robots_on", "mission.metrics.inside.kind most_robots_on"]


def test_groups_with_long_names_are_numbered_and_explained(tmp_path: Path) -> None:
    many = {"maxSteps": 20, "mapWidth": 15, "mapHeight": 17, "numAgents": 3, "numDefenders": 2}
    more = {"placement": "random", "speedDefenders": 0.5, "speedAgents": 0.5}
    groups, notes = group(
        [KnownRun(tmp_path / "a", [[1.0]]), KnownRun(tmp_path / "b", [[1.0]], parameters=many | more)]
    )
    assert all(one.label.startswith(f"group {number}: ") for number, one in enumerate(groups, 1))
    assert max(len(one.label) for one in groups) < 80
    assert "group 2 has" in notes[1]
    assert all(name in notes[1] for name in many)
    figure = compare([run for one in groups for run in one.runs]).figure()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # that the layout does not work out
        figure.canvas.draw()
    (legend,) = figure.legends
    assert legend.get_window_extent().y1 < figure.axes[0].get_window_extent().y0


class Coded(KnownRun):
    """A run with a copy of its code: part -> source."""

    def __init__(self, path: Path, parts: Mapping[str, str], **changes: Any) -> None:
        super().__init__(path, [[1.0]], **changes)
        found = []
        for part, source in parts.items():
            file = path.parent / f"{path.name}-{part}" / "mine.py"
            file.parent.mkdir()
            file.write_text(source)
            found.append(Part.from_file(part, f"{file}:Mine", file))
        path.mkdir()
        Copy.write(path, 1, found)
        self._code = {1: compute_digest({part.name: part.digests for part in found})}

    @property
    def code(self) -> dict[int, str]:
        return self._code


def test_code_tells_groups_apart_only_where_it_differs_in_one_component(tmp_path: Path) -> None:
    built_in = KnownRun(tmp_path / "a", [[1.0]])
    climbing = Coded(tmp_path / "b", {"method": "x = 1"}, method={"kind": "random_search"})
    groups, _ = group([built_in, climbing])
    assert [one.label for one in groups] == ["nnga", "random_search"]
    assert all(list(one.differs) == ["method.kind"] for one in groups)
    edited = Coded(tmp_path / "c", {"method": "x = 2"}, method={"kind": "random_search"}, seed=5)
    groups, _ = group([climbing, edited])
    assert [one.label.rpartition(" ")[0] for one in groups] == ["code of the method"] * 2
    same = Coded(tmp_path / "d", {"method": "x = 1"}, method={"kind": "random_search"}, seed=6)
    assert len(group([climbing, same])[0]) == 1


def test_without_the_copies_it_is_known_whether_code_differs(tmp_path: Path) -> None:
    some = [Coded(tmp_path / name, {"method": "x = 1"}, seed=seed) for seed, name in enumerate("ab")]
    other = Coded(tmp_path / "c", {"method": "x = 2"}, seed=5)
    (tmp_path / "a" / "code" / "1" / "manifest.json").unlink()
    groups, _ = group([*some, other])
    assert [len(one.runs) for one in groups] == [2, 1]
    assert all(list(one.differs) == ["code"] for one in groups)


def test_options_in_which_a_kind_does_not_differ_are_no_part_of_its_name(tmp_path: Path) -> None:
    """Initial steps of cma_es and largest mutations of evostick are unlike quantities."""
    evostick = {"kind": "evostick", "population": 4, "elites": 2, "generations": 3}
    wide, narrow = ({"kind": "cma_es", "step": step, "generations": 3} for step in (0.5, 0.2))
    some = [evostick, wide, narrow]
    groups, _ = group([run for method in some for run in runs(tmp_path, [1.0], method=method)])
    assert [one.label for one in groups] == ["evostick", "cma_es, step 0.5", "cma_es, step 0.2"]
    assert groups[0].differs == {"method.kind": "evostick"}


def test_options_of_different_kinds_have_columns_of_their_own() -> None:
    evostick = {"method.kind": "evostick", "method.step": 0.2, "ranking.kind": "absolute"}
    wide = {"method.kind": "cma_es", "method.step": 0.5, "ranking.kind": "absolute"}
    race = {**wide, "method.step": 0.3, "ranking.kind": "race", "ranking.episodes": 8, "ranking.level": 0.1}
    rows = [
        (evostick, ["method.kind"]),
        (wide, ["method.kind", "method.step"]),
        (race, ["method.kind", "method.step", "ranking.episodes", "ranking.level"]),
    ]
    names = ("method.kind", "method.cma_es.step", "ranking.episodes", "ranking.level")
    assert option_columns(rows) == [
        dict(zip(names, values, strict=True))
        for values in (
            ("evostick", None, None, None),
            ("cma_es", 0.5, None, None),
            ("cma_es", 0.3, 8, 0.1),
        )
    ]
    both = [(evostick, ["method.step"]), (wide, ["method.step"])]
    assert option_columns(both) == [
        {"method.evostick.step": 0.2, "method.cma_es.step": None},
        {"method.evostick.step": None, "method.cma_es.step": 0.5},
    ]
    alike = [(wide, ["method.step"]), (race, ["method.step"])]
    assert option_columns(alike) == [{"method.step": 0.5}, {"method.step": 0.3}]


def test_runs_of_a_sweep_are_named_by_what_its_grid_sets(tmp_path: Path) -> None:
    methods = [
        {"kind": "evostick", "population": 4, "elites": 2, "evaluations": 30},
        {"kind": "cma_es", "step": 0.2, "evaluations": 30},
        {"kind": "cma_es", "step": 0.5, "evaluations": 30},
    ]
    made = [run for method in methods for run in runs(tmp_path, [1.0, 2.0], method=method)]
    made += runs(tmp_path, [1.0, 2.0], method=methods[0], ranking={"reevaluate": False, "episodes": 2})
    keys = [
        ["method.kind", "method.evaluations", "method.population", "method.elites"],
        *[["method.kind", "method.evaluations", "method.step"]] * 2,
        ["method.kind", "method.evaluations", "ranking.episodes"],
    ]
    names = [run.path.name for run in made]
    variants = [{"keys": one, "runs": names[2 * at : 2 * at + 2]} for at, one in enumerate(keys)]
    (tmp_path / "sweep.json").write_text(json.dumps({"variants": variants}))
    assert [one.label for one in group(made)[0]] == [
        "evostick, population 4, elites 2", "cma_es, step 0.2", "cma_es, step 0.5", "evostick, episodes 2",
    ]  # fmt: skip
    # Episodes differ, so they are told where the grid is not known, or sets something else.
    for text in ("{}", json.dumps({"variants": [{"keys": ["method.kind"], "runs": names}]})):
        (tmp_path / "sweep.json").write_text(text)
        assert labels(*made)[0] == "evostick, episodes 1"
